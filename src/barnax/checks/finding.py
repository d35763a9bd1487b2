"""What a check found in a file, where, and what mends it."""

from dataclasses import dataclass
from typing import Any, Literal

from ..records.samples import Samples

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One observation about a file.

    An `error` makes the file unusable as it is, or everything computed from it wrong. A `warning`
    leaves it usable, at a price or with an option given. Both are findings in the strict sense
    and count for the exit status. A `note` is what barnax copes with by itself, or a property of
    the record to know about, and does not count.

    `row` is the source row of the first place it was seen, counted as `Record.row` counts, and
    `sheet` that row's sheet where there are several. `remedy` is the option of barnax or the
    action that mends it; a note may need none. `check` names the check.
    """

    severity: Severity
    what: str
    remedy: str = ""
    row: int | None = None
    sheet: str | None = None
    check: str = ""

    @property
    def counts(self) -> bool:
        """Whether it is more than a note."""
        return self.severity != "note"

    def to_dict(self) -> dict[str, Any]:
        """The finding as plain values."""
        return {
            "severity": self.severity,
            "check": self.check,
            "row": self.row,
            "sheet": self.sheet,
            "what": self.what,
            "remedy": self.remedy or None,
        }


def found_at(
    samples: Samples, sample: int, severity: Severity, what: str, remedy: str = ""
) -> Finding:
    """A finding at one sample, with the row and sheet it stands in."""
    sheet = samples.sheets[int(samples.sheet[sample])] if len(samples.sheets) > 1 else None
    return Finding(severity, what, remedy, int(samples.row[sample]), sheet)


def counted(count: int, noun: str) -> str:
    """A number and its noun, in the plural where it needs one."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
