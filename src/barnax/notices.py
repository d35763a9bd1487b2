"""Notices: messages of barnax about files, cells and results, as codes with numbers.

A notice is created where a condition is detected. Its sentence is formed on reading, by its code,
from `notices.toml`, which has the meaning and the words of every code.
"""

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from string import Formatter
from typing import Any, Literal, Self, cast

from .errors import InputError, counted, listed, printable

Severity = Literal["error", "warning", "note"]
Value = float | int | str
CODES = Path(__file__).with_name("notices.toml")
# Units of a template other than base units, and their factors.
_SCALES = {"mV": 1e3, "mA": 1e3, "mOhm": 1e3, "mohm": 1e3, "ms": 1e3, "%": 100, "microohm": 1e6}


@dataclass(frozen=True)
class Kind:
    """A code, and the words of its notices.

    `says`, `remedy` and `severity` are templates: `{gap_s:.3g s}` is a number with its unit,
    `{rows:n row}` a count. For a value that is a choice, `words` has the text of each, under `none`
    that for a missing value, and under `any` that for any other. A choice may have several texts:
    `{cause}` and `{cause.remedy}` both belong to the value `cause`.
    """

    code: str
    means: str
    severity: str
    says: str
    remedy: str = ""
    is_kept: bool = False
    words: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def worded(self, template: str, values: Mapping[str, Value]) -> str:
        """A template with the values inserted."""
        return _Words(self.words).vformat(template, (), values)


class _Words(Formatter):
    """The formatter of templates, with the words of choices."""

    def __init__(self, words: Mapping[str, Mapping[str, str]]):
        self.words = words

    def get_field(self, field_name: str, args: Any, kwargs: Mapping[str, Any]) -> Any:
        choices = self.words.get(field_name)
        if choices is None:
            return kwargs[field_name], field_name
        name = field_name.partition(".")[0]
        value = kwargs.get(name)
        choice = "none" if value is None else str(value)
        # A user's word may be "none" too.
        is_any = choice not in choices or value == "none"
        words = choices["any" if is_any else choice]
        # Within the words of a value, its name is the value itself.
        others = {key: text for key, text in self.words.items() if key not in (name, field_name)}
        return _Words(others).vformat(words, args, kwargs), field_name

    def format_field(self, value: Any, format_spec: str) -> str:
        number, _, unit = format_spec.partition(" ")
        if number == "n":
            return counted(value, unit)
        if unit:
            return f"{value * _SCALES.get(unit, 1):{number}} {unit}"
        return format(value, format_spec)


@cache
def kinds() -> Mapping[str, Kind]:
    """Every code, in the order of the documentation."""
    rooms = tomllib.loads(CODES.read_text(encoding="utf-8"))
    shared = rooms.pop("words")
    by_code: dict[str, Kind] = {}
    for room, codes in rooms.items():
        for name, given in codes.items():
            code = f"{room}.{name}"
            fields: dict[str, Any] = {**given, "words": {**shared, **given.get("words", {})}}
            by_code[code] = Kind(code, **fields)
    return by_code


@dataclass(frozen=True, repr=False)
class Notice:
    """An error, a warning or a note; printed as its sentence with the remedy.

    An `error` makes an input unusable as it is, or everything computed from it wrong. A `warning`
    leaves it usable, with a loss or with an option. Both count for the exit status. A `note`
    needs no action.

    Attributes:
        code: One of `barnax.notices.kinds()`.
        values: Numbers and names, with units in the keys; None is a missing value.
        subject: The file, record or parameter concerned.
        row: Source row of the first occurrence, counted as in `Record.row`.
        rating: Severity; by default the usual one of its code.
        sheet: Sheet of that row, if there are several.

    >>> sides = Notice("repeats.both-sides", {"changes": 3}, "us06.csv", row=12)
    >>> sides.code, sides.values["changes"], sides.severity
    ('repeats.both-sides', 3, 'note')
    >>> print(sides)  # doctest: +ELLIPSIS
    us06.csv: row 12: 3 changes of step with both sides on one time stamp: ...
    """

    code: str
    values: Mapping[str, Any] = field(default_factory=dict)
    subject: str = ""
    row: int | None = None
    rating: Severity | None = None
    sheet: str | None = None

    def __post_init__(self):
        plain = {
            name: getattr(value, "item", lambda value=value: value)()
            for name, value in self.values.items()
            if value is not None
        }
        object.__setattr__(self, "values", plain)
        object.__setattr__(self, "subject", printable(self.subject))
        object.__setattr__(self, "rating", self.severity)
        # Fails here, and not on reading, if its words need a missing value.
        str(self)

    def __hash__(self) -> int:
        return hash((self.code, self.subject, self.row, *self.values.values()))

    def __repr__(self) -> str:
        return f"Notice({self.code!r}, {str(self)!r})"

    def __str__(self) -> str:
        """Subject, position, finding, and remedy in one line."""
        where = "" if self.row is None else f"row {self.row}"
        where += f" of sheet '{self.sheet}'" if self.sheet else ""
        said = "; ".join(filter(None, (self.what, self.remedy)))
        return ": ".join(filter(None, (self.subject, where, said)))

    @property
    def kind(self) -> Kind:
        return kinds()[self.code]

    @property
    def severity(self) -> Severity:
        return self.rating or cast(Severity, self.kind.worded(self.kind.severity, self.values))

    @property
    def what(self) -> str:
        """The finding in words."""
        return self.kind.worded(self.kind.says, self.values)

    @property
    def remedy(self) -> str:
        """The remedy: an action, or an option by its Python name in backticks."""
        return self.kind.worded(self.kind.remedy, self.values)

    @property
    def check(self) -> str:
        """The name of the rule behind it."""
        return self.code.partition(".")[0].replace("-", " ")

    @property
    def counts(self) -> bool:
        """True if it is more than a note."""
        return self.severity != "note"

    @property
    def is_kept(self) -> bool:
        """True for a note about an assumption or a change, which the record repeats."""
        return self.kind.is_kept and not self.counts

    def about(self, subject: str) -> Self:
        """The notice about a file or record."""
        return replace(self, subject=subject)

    def rated(self, severity: Severity) -> Self:
        """The notice, more or less severe than usual."""
        return replace(self, rating=severity)

    def error(self, end: str = "") -> InputError:
        """The refusal with this message."""
        refusal = InputError(f"{self}{end}")
        refusal.notice = self
        return refusal


def sentences_of(notices: Iterable[Any]) -> list[str]:
    """The sentences of notices; one sentence, with all their names, for several files with the same
    finding.

    >>> sentences_of([Notice("role.same-record", {"other": "c"}, name) for name in "ab"])[0][:7]
    'a, b: t'
    """
    alike: dict[Any, list[Any]] = {}
    for notice in notices:
        has_subject = isinstance(notice, Notice) and notice.subject
        alike.setdefault((notice.code, notice.what) if has_subject else notice, []).append(notice)
    sentences: list[str] = []
    for several in alike.values():
        subjects = dict.fromkeys(getattr(notice, "subject", "") for notice in several)
        if len(subjects) > 1:
            several = [replace(several[0], subject=listed(subjects), row=None, sheet=None)]
        sentences += map(str, several)
    return sentences


def refusal_of(notices: Iterable[Notice], file: str, end: str = "") -> InputError | None:
    """The refusal by the first error among the notices of a file, or by all errors about its
    columns, which are named together; None if there is no error."""
    errors = [one.about(file) for one in notices if one.severity == "error"]
    if not errors:
        return None
    first, *others = errors
    are_said = [one for one in others if one.check == first.check == "columns"]
    refusal = InputError("\n".join(f"{one}{end}" for one in (first, *are_said)))
    refusal.notice = first
    return refusal


def raise_first_error(notices: Iterable[Notice], file: str) -> None:
    """Raise the refusal for the errors among the notices of a file, if there are any."""
    if (refusal := refusal_of(notices, file, ".")) is not None:
        raise refusal
