"""Records in words: a replay by a Kalman filter, and the findings of the checks of a file."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ..notices import Notice
from .document import (
    Cells,
    Document,
    Lines,
    Paragraph,
    Picture,
    Table,
    make_table,
    screen,
)
from .wording import document, sentences, wording
from .words import NOTHING, duration, fixed

if TYPE_CHECKING:
    from ..checks import FileCheck, Role
    from ..replay import ScenarioPart, SocReplay


def replay_document(replay: "SocReplay", illustrations: Iterable[Picture] = ()) -> Document:
    """The whole report of a replay."""
    facts = {"replay": replay, "verdict": sentences("replay.verdict", replay)}
    return document("replayed", {"errors": (replay_table(replay),)}, illustrations, **facts)


def replay_table(replay: "SocReplay") -> Table:
    """The filter's errors in every scenario, beside those of plain counting."""
    cells: Cells[ScenarioPart] = {
        "errors in % SOC": lambda part: part.name,
        "within 3 %": _converged,
        "RMS": lambda part: _in_percent(part.rms),
        "above 10 %": lambda part: _in_percent(part.rms_above_10_soc),
        "max": lambda part: _in_percent(part.max),
        "band": lambda part: _in_percent(part.band),
        "in band": lambda part: _in_percent(part.in_band, 0),
        "counting": lambda part: _in_percent(part.counter_rms),
    }
    return make_table(wording("replay.errors"), replay.scenarios, cells, ["errors in % SOC"])


def soc_screen(replay: "SocReplay") -> Document:
    """The replay, its scenarios, the estimated parameters, and the innovations."""
    about = [wording("replay.record", replay, "   "), wording("replay.filter", replay)]
    about += sentences("replay.whole", replay)
    table = replace(replay_table(replay), caption="", is_bare=True)
    lines = Lines(sentences("replay.verdict", replay))
    return screen(map(Paragraph, about), [table], [lines])


def _converged(part: "ScenarioPart") -> str:
    if part.diverged_s is not None:
        return "diverged"
    if part.converged_s is None:
        return "never"
    if part.is_lost:
        return "lost"
    return duration(part.converged_s) if part.converged_s else "at once"


def _in_percent(share: float | None, decimals: int = 1) -> str:
    return fixed(None if share is None else 100 * share, decimals)


def check_document(check: "FileCheck") -> Document:
    """The file's contents, the findings, and the roles that it can serve in."""
    findings = (_findings_table(check.findings),) if check.findings else ()
    roles = (_roles_table(check),) if check.roles else ()
    return document("check", {"findings": findings, "roles": roles}, check=check)


def _findings_table(findings: Sequence["Notice"]) -> Table:
    cells: Cells[Notice] = {
        "kind": lambda finding: finding.severity,
        "row": lambda finding: NOTHING if finding.row is None else str(finding.row),
        "found": lambda finding: finding.what,
        "remedy": lambda finding: finding.remedy or NOTHING,
    }
    return make_table("", findings, cells, cells)


def _reason(role: "Role", has_errors: bool) -> str:
    if not role.is_usable:
        return role.reason
    advice = "" if role.window is None else role.window.advice
    mended = "once the errors are fixed" if has_errors else ""
    return "; ".join(filter(None, (role.reason, advice, mended)))


def _roles_table(check: "FileCheck") -> Table:
    has_errors = any(finding.severity == "error" for finding in check.findings)
    cells: Cells[Role] = {
        "usable for": lambda role: role.name,
        "": lambda role: "yes" if role.is_usable else "no",
        "because": lambda role: _reason(role, has_errors),
    }
    return make_table("", check.roles, cells, cells)
