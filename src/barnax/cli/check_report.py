"""Tables and sentences about a file's diagnosis, for a terminal."""

from collections.abc import Sequence
from itertools import groupby

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from ..checks import Facts, FileCheck, Finding, Role
from ..reporting.terminal import LAYOUT

STYLE = {"error": "bold red", "warning": "yellow", "note": "dim"}


def diagnosis_report(diagnosis: FileCheck) -> list[RenderableType]:
    """What the file is, what was found in it, and what it can serve as."""
    blocks: list[RenderableType] = [Text(diagnosis.file, style="bold")]
    if diagnosis.facts:
        blocks.append(Text(_facts_sentence(diagnosis.facts)))
    if diagnosis.findings:
        blocks.append(_findings_table(diagnosis.findings))
    else:
        blocks.append(Text("Nothing found.\n"))
    if diagnosis.roles:
        blocks.append(_roles_table(diagnosis))
    return blocks


def verdict_sentence(diagnoses: Sequence[FileCheck]) -> str:
    """How much was found in all files."""
    found = [finding.severity for diagnosis in diagnoses for finding in diagnosis.findings]
    counts = [_counted(found.count(severity), severity) for severity in STYLE]
    return f"{_counted(len(diagnoses), 'file')}: {', '.join(counts)}."


def finding_line(file: str, finding: Finding) -> str:
    """One finding as one line."""
    remedy = f" [{finding.remedy}]" if finding.remedy else ""
    return f"{file}: {_place(finding, 'row ', ': ')}{finding.what}{remedy}"


def _facts_sentence(facts: Facts) -> str:
    hours = (facts.last_s - facts.first_s) / 3600
    low_v, high_v = facts.voltage_v
    return (
        f"{facts.samples} samples in {hours:.2f} h, {facts.interval_s:.4g} s apart; "
        f"{low_v:.3f} to {high_v:.3f} V; {facts.charged_ah:.4g} Ah in, "
        f"{facts.discharged_ah:.4g} Ah out; current {facts.current_sign}, held "
        f"{facts.current_hold}"
    )


def _findings_table(findings: Sequence[Finding]) -> Table:
    table = Table(**LAYOUT)
    table.add_column("found")
    table.add_column("row", justify="right")
    table.add_column("what", ratio=3, overflow="fold")
    table.add_column("what mends it", ratio=2, overflow="fold")
    for finding in findings:
        style = STYLE[finding.severity]
        table.add_row(
            Text(finding.severity, style=style),
            Text(_place(finding)),
            Text(finding.what),
            Text(finding.remedy),
        )
    return table


def _roles_table(diagnosis: FileCheck) -> Table:
    is_sick = any(finding.severity == "error" for finding in diagnosis.findings)
    table = Table(caption="once the errors are mended" if is_sick else None, **LAYOUT)
    table.add_column("it can serve as", no_wrap=True)
    table.add_column("")
    table.add_column("because", ratio=1, overflow="fold")
    for (is_usable, why, options), alike in groupby(diagnosis.roles, _verdict):
        reason = Text(why)
        if options:
            reason.append(f"\n{' '.join(options)}", style="cyan")
        verdict = Text("yes", style="green") if is_usable else Text("no", style="dim")
        table.add_row(Text("\n".join(role.name for role in alike)), verdict, reason)
    return table


def _verdict(role: Role) -> tuple[bool, str, tuple[str, ...]]:
    return role.is_usable, role.reason, role.options


def _place(finding: Finding, before: str = "", after: str = "") -> str:
    if finding.row is None:
        return ""
    sheet = f" of {finding.sheet}" if finding.sheet else ""
    return f"{before}{finding.row}{sheet}{after}"


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
