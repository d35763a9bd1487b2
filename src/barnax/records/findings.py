"""What the rules find in a file: an error, a warning or a note, where it is, and its remedy.

Reading a record raises the first error; checking a file lists everything.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal

from ..errors import InputError

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One observation about a file.

    An `error` makes the file unusable as it is, or everything computed from it wrong. A `warning`
    leaves it usable, at a price or with an option given. Both count for the exit status. A `note`
    is what barnax copes with by itself, or a property of the record to know about, and does not
    count; `is_told` marks the notes of what was assumed or changed, which the record repeats.

    `row` is the source row of the first place it was seen, counted as `Record.row` counts, and
    `sheet` that row's sheet where there are several. `remedy` is an option, by its Python name in
    backticks, or an action. `check` names the rule.
    """

    severity: Severity
    what: str
    remedy: str = ""
    row: int | None = None
    sheet: str | None = None
    check: str = ""
    is_told: bool = False

    @property
    def counts(self) -> bool:
        """Whether it is more than a note."""
        return self.severity != "note"

    def sentence(self, file: str) -> str:
        """File, place, what, and remedy in one line."""
        where = "" if self.row is None else f"row {self.row}"
        where += f" of sheet '{self.sheet}'" if self.sheet else ""
        what = f"{self.what}; {self.remedy}" if self.remedy else self.what
        return ": ".join(filter(None, (file, where, what)))

    def to_dict(self) -> dict[str, Any]:
        """The finding as plain values."""
        names = ("severity", "check", "row", "sheet", "what", "remedy")
        return {name: getattr(self, name) for name in names} | {"remedy": self.remedy or None}


def named(check: str, findings: Iterable[Finding]) -> list[Finding]:
    """The findings under the name of the rule that made them."""
    return [replace(finding, check=check) for finding in findings]


def raise_first_error(findings: Iterable[Finding], file: str) -> None:
    """Raise InputError for the first error among the findings, if there is one."""
    for finding in findings:
        if finding.severity == "error":
            raise InputError(f"{finding.sentence(file)}.")


def warnings_of(findings: Iterable[Finding], file: str) -> tuple[str, ...]:
    """What reading a record warns of."""
    return tuple(each.sentence(file) for each in findings if each.severity == "warning")


def notes_of(findings: Iterable[Finding], file: str) -> tuple[str, ...]:
    """What reading a record assumed or changed."""
    return tuple(each.sentence(file) for each in findings if each.is_told)
