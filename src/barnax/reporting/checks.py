"""Findings of the checks of a file, as a document."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..notices import Notice
from .document import Cells, Document, Table, make_table
from .wording import document
from .words import NOTHING, counted

if TYPE_CHECKING:
    from ..checks import FileCheck, Role

SEVERITIES = ("error", "warning", "note")


def check_document(check: "FileCheck") -> Document:
    """The file's contents, the findings, and the roles that it can serve in."""
    findings = (_findings_table(check.findings),) if check.findings else ()
    roles = (_roles_table(check),) if check.roles else ()
    return document("check", {"findings": findings, "roles": roles}, check=check)


def finding_line(file: str, finding: "Notice") -> str:
    """One finding as one line."""
    remedy = f" [{finding.remedy}]" if finding.remedy else ""
    return f"{file}: {_place(finding)}{finding.what}{remedy}"


def count_sentence(found: Sequence["FileCheck"], unreadable: int) -> str:
    """Counts of the findings in all files."""
    refused = f"{counted(unreadable, 'file')} could not be read" if unreadable else ""
    if not found:
        return f"{refused}, so nothing was checked."
    severities = [finding.severity for file in found for finding in file.findings]
    counts = [counted(severities.count(severity), severity) for severity in SEVERITIES]
    read = f"{counted(len(found), 'file')} checked: {', '.join(counts)}"
    return "; ".join(filter(None, (read, refused))) + "."


def _place(finding: "Notice") -> str:
    if finding.row is None:
        return ""
    sheet = f" of sheet {finding.sheet}" if finding.sheet else ""
    return f"row {finding.row}{sheet}: "


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


def _roles_table(found: "FileCheck") -> Table:
    has_errors = any(finding.severity == "error" for finding in found.findings)
    cells: Cells[Role] = {
        "usable for": lambda role: role.name,
        "": lambda role: "yes" if role.is_usable else "no",
        "because": lambda role: _reason(role, has_errors),
    }
    return make_table("", found.roles, cells, cells)
