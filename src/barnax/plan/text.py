"""A plan as a TOML file, with its reasons as comments, and read back."""

import os
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, get_args

import tomlkit
from tomlkit.items import Table

from ..cell.circuits import CIRCUITS
from ..cell.curves import HysteresisFit, OcvFit
from ..errors import InputError, as_keys, printable, toml_reason
from ..gather import OVER_TEMPERATURE, file_names
from ..model.window import Window
from ..optimizers import OPTIMIZERS
from ..records.dialects.dialect import Sign
from ..records.record import Hold
from .parts import ROLES, Part, Plan

_HEAD = (
    "A barnax plan. Edit it if you like, and run it with `barnax identify FILE`.",
    "The roles are identification, validation, OCV test and not used.",
    "A window accepts start_time, start_after_step, initial_soc, score_steps, score_from, score_to",
    "and the other options of a record. Times are on the file's own clock.",
)


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError
    return float(value)


def _whole(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError
    return value


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError
    return value


def _pair(value: Any) -> tuple[float, float]:
    low, high = value
    return _number(low), _number(high)


def _wholes(value: Any) -> tuple[int, ...]:
    return tuple(map(_whole, value))


# What a file's table may hold beside its window, and what each key takes.
_OF_FILE: Mapping[str, Callable[[Any], Any]] = {
    "file": _text,
    "name": _text,
    "role": _text,
    "span": _pair,
}
# Options of the run, by the names of `barnax.identify`.
_OPTIONS: Mapping[str, Callable[[Any], Any]] = {
    "capacity": _number,
    "ocv_capacity": _number,
    "ocv_fit": _text,
    "hysteresis_fit": _text,
    "model": _text,
    "over": _text,
    "method": _text,
    "trust": _text,
    "current_hold": _text,
    "current_sign": _text,
    "ocv_current_sign": _text,
    "validate_current_sign": _text,
    "columns": _text,
}
_SIGNS = ("auto", *get_args(Sign))
_CHOICES: Mapping[str, tuple[str, ...]] = {
    "ocv_fit": get_args(OcvFit),
    "hysteresis_fit": get_args(HysteresisFit),
    "model": tuple(CIRCUITS),
    "over": ("soc", OVER_TEMPERATURE),
    "method": tuple(OPTIMIZERS),
    "trust": ("none", "basic", "full"),
    "current_hold": ("auto", *get_args(Hold)),
    "current_sign": _SIGNS,
    "ocv_current_sign": _SIGNS,
    "validate_current_sign": _SIGNS,
}
_READ: Mapping[str, Callable[[Any], Any]] = {
    "start_after_step": _whole,
    "initial_direction": _whole,
    "score_steps": _wholes,
    "score_soc": _pair,
}
_UNITS = ("_degc", "_ah", "_s", "_a")


def _option_of(name: str) -> str:
    """A field of a `Window` as the command line calls it."""
    return next((name.removesuffix(unit) for unit in _UNITS if name.endswith(unit)), name)


# Fields of a window by the name of their option.
_WINDOW = {_option_of(each.name): each.name for each in fields(Window)}


def plan_to_toml(plan: Plan) -> str:
    """The plan as TOML; `plan_from_toml` makes the same of it."""
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
    return tomlkit.dumps(document)


def _table(part: Part) -> Table:
    table = tomlkit.table()
    table.add(tomlkit.comment(printable(f"{part.kind}: {part.reason}")))
    table.add("file", str(part.path))
    table.add("role", part.role)
    if part.span_s is not None:
        table.add("name", part.name)
        table.add("span", list(part.span_s))
    for option, name in _WINDOW.items():
        value = getattr(part.window, name)
        if value is not None:
            table.add(option, list(value) if isinstance(value, tuple) else value)
    return table


def plan_from_toml(path: str | Path) -> Plan:
    """The plan in a TOML file. Its files lie beside it, else where the command runs.

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
    options = _read(shown, content, _OPTIONS)
    try:
        require_choices(options)
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


def require_choices(options: Mapping[str, Any]) -> None:
    """Raise `InputError` for an option of a run that is none of its choices."""
    for name, value in options.items():
        if name in _CHOICES and value not in _CHOICES[name]:
            raise InputError(
                f"`{name}` {value!r} is not known; there are {', '.join(_CHOICES[name])}"
            )


def _part(shown: str, folder: Path, table: Mapping[str, Any]) -> Part:
    known = {option: _READ.get(option, _number) for option in _WINDOW}
    given = _read(shown, table, {**_OF_FILE, **known})
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
        window = Window(**{_WINDOW[option]: value for option, value in given.items()})
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


def _read(
    shown: str, table: Mapping[str, Any], known: Mapping[str, Callable[[Any], Any]]
) -> dict[str, Any]:
    """The table's values as what their keys take."""
    unknown = sorted(table.keys() - known.keys())
    if unknown:
        raise InputError(
            f"{shown}: {unknown[0]!r} is not a key of a plan here; there are {', '.join(known)}"
        )
    values = {}
    for key, value in table.items():
        try:
            values[key] = known[key](value)
        except (TypeError, ValueError) as problem:
            kind = known[key].__name__.strip("_")
            words = {
                "whole": "a whole number",
                "wholes": "whole numbers, as [7, 8]",
                "pair": "two numbers, as [0.1, 1.0]",
                "text": "text in quotes",
            }
            raise InputError(
                f"{shown}: {key} is {value!r}; it takes {words.get(kind, 'a number')}"
            ) from problem
    return values
