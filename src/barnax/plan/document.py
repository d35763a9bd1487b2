"""A plan: which file serves for what, in which window and why; as TOML, and read back."""

import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, get_args

import tomlkit
from pydantic import StrictFloat, StrictInt, StrictStr, TypeAdapter
from tomlkit.items import Table

from ..display import Brief
from ..errors import InputError, as_keys, printable, toml_reason
from ..inputs import file_names, window_of, windows_by_name
from ..job import Job
from ..records import Source
from ..result_parts import PlannedFile, Use
from ..settings import WINDOW_OPTIONS, Window

ROLES: tuple[Use, ...] = get_args(Use)
# What says where a simulation starts: one such option of the user's replaces all planned ones.
_START = ("start_time_s", "start_after_step", "initial_soc")

# Arguments of `identify`, by name.
Options = Mapping[str, Any]


@dataclass(frozen=True)
class Part:
    """A file, or a part of one, and what it serves for.

    `kind` says what it is: a drive cycle, a pulse test, unreadable and so on. `span_s` cuts a file
    that holds several tests, on its own clock. `window` is that of a simulation, for identification
    and validation; `plans_soc` says that its SOC at the start is the plan's own, and not given.
    `source` is what was read of the file, if it was.
    """

    path: Path
    name: str
    role: Use
    kind: str
    reason: str
    window: Window = field(default_factory=Window)
    span_s: tuple[float, float] | None = None
    temperature_degc: float | None = None
    plans_soc: bool = False
    source: Source | None = field(default=None, repr=False, compare=False)

    @property
    def is_simulated(self) -> bool:
        """Whether it has a window."""
        return self.role in ("identification", "validation")


@dataclass(frozen=True, repr=False)
class Plan(Brief):
    """Roles and windows of some files, and what is run on them: `identify`, or `hppc`.

    Args:
        command: What is run.
        parts: Every file, or part of one, with its role and window.
        options: Arguments of `identify`, such as the capacity in Ah.
        reasons: Why these, by option.
        missing: Which test must be measured before the plan can be run; empty if it can be run.
    """

    command: Literal["identify", "hppc"]
    parts: tuple[Part, ...]
    options: Options = field(default_factory=dict)
    reasons: Mapping[str, str] = field(default_factory=dict)
    missing: str = ""

    def of_role(self, role: Use) -> tuple[Part, ...]:
        """The parts that serve for a role."""
        return tuple(part for part in self.parts if part.role == role)

    @property
    def lines(self) -> list[str]:
        """Every file in a line, with what it is and why it serves or not."""
        return [f"{part.name}: {part.role} ({part.kind}): {part.reason}" for part in self.parts]

    @property
    def stored(self) -> tuple[PlannedFile, ...]:
        """Every file as a result keeps it."""
        names = ("name", "role", "kind", "reason", "temperature_degc", "plans_soc")
        return tuple(
            PlannedFile(**{name: getattr(part, name) for name in names}) for part in self.parts
        )

    def changed(self, window: Window | Mapping[str, Window] | None, **options: Any) -> "Plan":
        """The plan with what a user has chosen otherwise, by record or for all; None is no choice.

        A window for a record that is not simulated is left to be refused where the plan is run.
        """
        windows = windows_by_name(window)
        common = windows.get("")
        if common is not None and common.capacity_ah is not None:
            # One for all records is an option of the whole run.
            options = {"capacity": common.capacity_ah, **options}
            windows[""] = replace(common, capacity_ah=None)
        parts = []
        for part in self.parts:
            own = window_of(windows, part.name)
            if part.is_simulated:
                planned = part.plans_soc and own.initial_soc is None
                part = replace(part, window=merged(part.window, own), plans_soc=planned)
            parts.append(part)
        given = {name: value for name, value in options.items() if value is not None}
        reasons = {**self.reasons, **dict.fromkeys(given, "given")}
        return replace(self, parts=tuple(parts), options={**self.options, **given}, reasons=reasons)


def merged(planned: Window, chosen: Window) -> Window:
    """A planned window with what was chosen in its place."""
    given = {
        each.name: value
        for each in fields(Window)
        if (value := getattr(chosen, each.name)) is not None
    }
    if given.keys() & {"start_time_s", "start_after_step"}:
        given = {**dict.fromkeys(_START), **given}
    return replace(planned, **given)


_HEAD = (
    "A barnax plan. Edit it if you like, and run it with `barnax identify FILE`.",
    "The roles are identification, validation, OCV test and not used.",
    "A window accepts start_time, start_after_step, initial_soc, score_steps, score_from, score_to",
    "and the other options of a record. Times are on the file's own clock.",
)


# What a key of a plan takes, in words and as a type.
_NUMBER = ("a number", TypeAdapter(StrictFloat))
_WHOLE = ("a whole number", TypeAdapter(StrictInt))
_WHOLES = ("whole numbers, as [7, 8]", TypeAdapter(tuple[StrictInt, ...]))
_PAIR = ("two numbers, as [0.1, 1.0]", TypeAdapter(tuple[StrictFloat, StrictFloat]))
_TEXT = ("text in quotes", TypeAdapter(StrictStr))
_Kinds = Mapping[str, tuple[str, TypeAdapter[Any]]]

# Options of the run, by the names of `barnax.identify`.
_OF_RUN: _Kinds = {
    "capacity": _NUMBER,
    "ocv_capacity": _NUMBER,
    "series": _WHOLE,
    **dict.fromkeys(
        (
            *("model", "method", "setup", "over", "trust", "ocv_fit", "hysteresis_fit", "columns"),
            *("current_sign", "ocv_current_sign", "validate_current_sign", "current_hold"),
        ),
        _TEXT,
    ),
}
# Options of a record, in the order of a `Window`, whose fields they are.
_OPTION_OF = {name: option for option, (name, *_) in WINDOW_OPTIONS.items()}
_FIELD_OF = {_OPTION_OF[each.name]: each.name for each in fields(Window) if each.name in _OPTION_OF}
# What a file's table may hold.
_OF_FILE: _Kinds = {
    "file": _TEXT,
    "name": _TEXT,
    "role": _TEXT,
    "span": _PAIR,
    **dict.fromkeys(_FIELD_OF, _NUMBER),
    "start_after_step": _WHOLE,
    "initial_direction": _WHOLE,
    "score_steps": _WHOLES,
    "score_soc": _PAIR,
}


def plan_to_toml(plan: Plan) -> str:
    """The plan as TOML; `plan_from_toml` makes the same of it.

    Args:
        plan: A plan from `plan.plan`.

    Raises `InputError` for a file whose name TOML cannot hold.
    """
    for part in plan.parts:
        try:
            str(part.path).encode()
        except UnicodeEncodeError as problem:
            raise InputError(
                f"{printable(str(part.path))}: this name is not UTF-8, as a plan is; rename the "
                "file, or run the folder as it is"
            ) from problem
    document = tomlkit.document()
    for line in (*_HEAD, *filter(None, (plan.missing,))):
        document.add(tomlkit.comment(printable(line)))
    document.add(tomlkit.nl())
    document.add("command", tomlkit.item(plan.command))
    for name, value in plan.options.items():
        item = tomlkit.item(value)
        if name in plan.reasons:
            item.comment(printable(plan.reasons[name]))
        document.add(name, item)
    tables = tomlkit.aot()
    for part in plan.parts:
        tables.append(_table(part))
    document.add("files", tables)
    # Comments are printable already: what is left stands in quotes.
    return "".join(
        letter if letter == "\n" or letter.isprintable() else f"\\U{ord(letter):08x}"
        for letter in tomlkit.dumps(document)
    )


def _table(part: Part) -> Table:
    table = tomlkit.table()
    table.add(tomlkit.comment(printable(f"{part.kind}: {part.reason}")))
    table.add("file", str(part.path))
    table.add("role", part.role)
    if part.span_s is not None:
        table.add("name", part.name)
        table.add("span", list(part.span_s))
    for option, name in _FIELD_OF.items():
        value = getattr(part.window, name)
        if value is not None:
            table.add(option, list(value) if isinstance(value, tuple) else value)
    return table


def plan_from_toml(path: str | Path) -> Plan:
    """The plan in a TOML file.

    Args:
        path: The file. The files that it names lie beside it, else where the command runs.

    Raises `InputError` that names the file, the key and what it takes.
    """
    path = Path(path)
    shown = printable(path.name)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as problem:
        reason = getattr(problem, "strerror", None) or toml_reason(problem)
        raise InputError(
            f"{shown}: cannot be read as a plan in TOML ({reason}); correct it"
        ) from problem
    listed = content.pop("files", [])
    command = content.pop("command", "identify")
    if command not in ("identify", "hppc"):
        raise InputError(f"{shown}: command {command!r} is not known; there are identify, hppc")
    options = _read(shown, content, _OF_RUN)
    try:
        _ = Job(**options)
    except InputError as problem:
        raise InputError(f"{shown}: {as_keys(str(problem))}") from problem
    if not isinstance(listed, list) or not all(isinstance(each, dict) for each in listed):
        raise InputError(f"{shown}: each file needs a line [[files]] above it")
    parts = tuple(_part(shown, path.parent, each) for each in listed)
    roles = {part.role for part in parts}
    for role in ("identification", "OCV test"):
        # A pulse test shows its own OCV.
        if role not in roles and (role, command) != ("OCV test", "hppc"):
            raise InputError(f"{shown}: no file has the role {role}; give one file that role")
    return Plan(command, _named(parts), options)


def _part(shown: str, folder: Path, table: Mapping[str, Any]) -> Part:
    given = _read(shown, table, _OF_FILE)
    missing = [key for key in ("file", "role") if key not in given]
    if missing:
        raise InputError(f"{shown}: a table [[files]] has no {missing[0]!r}")
    file, role = given.pop("file"), given.pop("role")
    if role not in ROLES:
        raise InputError(
            f"{shown}: role {role!r} of {file} is not known; there are {', '.join(ROLES)}"
        )
    name, span = given.pop("name", ""), given.pop("span", None)
    if span and not name:
        raise InputError(f"{shown}: a part of {file} needs a 'name' beside its span")
    try:
        window = Window(**{_FIELD_OF[option]: value for option, value in given.items()})
    except InputError as problem:
        raise InputError(f"{shown}: {file}: {as_keys(str(problem))}") from problem
    place = folder / file
    return Part(place if os.path.isfile(place) else Path(file), name, role, "", "", window, span)


def _named(parts: tuple[Part, ...]) -> tuple[Part, ...]:
    """The parts by the names that results will call their files."""
    names = file_names([part.path for part in parts if part.role != "not used"])
    return tuple(
        part if part.name else replace(part, name=names.get(part.path, part.path.name))
        for part in parts
    )


def _read(shown: str, table: Mapping[str, Any], known: _Kinds) -> dict[str, Any]:
    """The table's values as what their keys take."""
    unknown = sorted(table.keys() - known.keys())
    if unknown:
        raise InputError(
            f"{shown}: {unknown[0]!r} is not a key of a plan here; there are {', '.join(known)}"
        )
    values = {}
    for key, value in table.items():
        words, kind = known[key]
        try:
            values[key] = kind.validate_python(value)
        except ValueError as problem:
            raise InputError(f"{shown}: {key} is {value!r}; it takes {words}") from problem
    return values
