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
    Pictures,
    Table,
    make_table,
    screen,
)
from .wording import document, sentences, wording
from .words import NOTHING, counted, duration, fixed

if TYPE_CHECKING:
    from ..checks import FileCheck, Role
    from ..replay import ScenarioPart, SocReplay

FILTERS = {
    "sum": "Gaussian sum of extended Kalman filters",
    "ekf": "extended Kalman filter",
    "ukf": "unscented Kalman filter",
}
# A 95 % band that holds less often than this is called overconfident.
TRUSTED_BAND = 0.9
# A start from one of these needs no line.
EXPECTED = ("given", "rested voltage")
# A flat OCV at a smaller share of samples is not worth a line.
FLAT_SHARE = 0.05


def replay_document(replay: "SocReplay", illustrations: Iterable[Picture] = ()) -> Document:
    """The whole report of a replay."""
    errors = (*Pictures(illustrations).of("soc"), replay_table(replay))
    facts = {"replay": replay, "verdict": soc_lines(replay)}
    summary = "; ".join(facts_of(replay)).replace("   ", ", ")
    return document("replayed", {"errors": errors}, summary=summary, **facts)


def facts_of(replay: "SocReplay") -> tuple[str, str]:
    """The record that was replayed, and the filter."""
    low, high = replay.soc_range
    at_first, joint = "between ", "and"
    if replay.start is not None:
        at_first, joint = f"{100 * replay.start.soc + 0.0:.0f} %, then ", "to"
    return (
        f"{replay.record}   {duration(replay.duration_s)}   {replay.samples:,} samples   "
        f"SOC {at_first}{100 * low + 0.0:.0f} {joint} {100 * high:.0f} %",
        f"{replay.circuit}, {FILTERS[replay.settings.kind]}, {replay.states} states",
    )


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
    table = replace(replay_table(replay), caption="", is_bare=True)
    return screen(map(Paragraph, facts_of(replay)), [table], [Lines(soc_lines(replay))])


def soc_lines(replay: "SocReplay") -> tuple[str, ...]:
    """What went wrong, what was estimated, whether innovations are white, each after its head."""
    start, source = "", replay.start and replay.start.soc_source
    if replay.start is not None and (replay.before_s or source not in EXPECTED):
        start = wording("starts.evidence", replay.start, source, "as given")
    extents = {replay.record: replay.soc_range}
    beyond = "".join(sentences("starts.beyond", extents, "the identified OCV"))
    shares = [part.in_band for part in replay.scenarios if part.in_band is not None]
    is_overconfident = min(shares, default=1.0) < TRUSTED_BAND
    is_flat = replay.flat_soc is not None and replay.flat_share > FLAT_SHARE
    facts = start, beyond.removesuffix("."), is_overconfident, is_flat
    return sentences("replay.verdict", replay, *facts)


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


SEVERITIES = ("error", "warning", "note")


def check_document(check: "FileCheck") -> Document:
    """The file's contents, the findings, and the roles that it can serve in."""
    findings = (_findings_table(check.findings),) if check.findings else ()
    roles = (_roles_table(check),) if check.roles else ()
    return document("check", {"findings": findings, "roles": roles}, check=check)


def finding_line(file: str, finding: "Notice") -> str:
    """One finding as one line."""
    remedy = f" [{finding.remedy}]" if finding.remedy else ""
    sheet = f" of sheet {finding.sheet}" if finding.sheet else ""
    row = "" if finding.row is None else f"row {finding.row}{sheet}: "
    return f"{file}: {row}{finding.what}{remedy}"


def count_sentence(checks: Sequence["FileCheck"], unreadable: int) -> str:
    """Counts of the findings in all files."""
    refused = f"{counted(unreadable, 'file')} could not be read" if unreadable else ""
    if not checks:
        return f"{refused}, so nothing was checked."
    severities = [finding.severity for check in checks for finding in check.findings]
    counts = [counted(severities.count(severity), severity) for severity in SEVERITIES]
    read = f"{counted(len(checks), 'file')} checked: {', '.join(counts)}"
    return "; ".join(filter(None, (read, refused))) + "."


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
