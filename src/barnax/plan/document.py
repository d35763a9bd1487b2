"""A plan: the role, window and reason of every file; written to TOML and read back."""

import functools
import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, get_args, get_type_hints

import tomlkit
from pydantic import TypeAdapter, ValidationError

from ..display import Brief
from ..errors import InputError, as_keys, attempt, naming, printable, toml_reason
from ..inputs import file_names
from ..job import OPTIONS, PLANNED, FileRole, Job, Use, window_of, windows_by_name
from ..model.window import START, Windows, merged
from ..notices import Notice
from ..records.log import NEXT_FILE
from ..records.source import find_planned
from ..settings import WINDOW_OPTIONS, Window

ROLES: tuple[Use, ...] = get_args(Use)

# Reason for an option that a user chose.
GIVEN = "given"
# Arguments of `identify`, by name.
Options = Mapping[str, Any]


@dataclass(frozen=True, repr=False)
class Plan(Brief):
    """Roles and windows of files, and the command to run on them: `identify`, or `hppc`.

    Args:
        command: Command to run.
        parts: Every file, or part of one, with its role and window.
        options: Arguments of `identify`, such as the capacity in Ah.
        reasons: Reasons for these, by option.
        missing: Test that must be measured before the plan can be run; empty if it can be run.
        window: Values given for all records.
        warnings: Warnings about the locations of its files.
    """

    command: Literal["identify", "hppc"]
    parts: tuple[FileRole, ...]
    options: Options = field(default_factory=dict)
    reasons: Mapping[str, str] = field(default_factory=dict)
    missing: str = ""
    window: Window = field(default_factory=Window)
    warnings: tuple[Notice, ...] = ()

    def of_role(self, role: Use) -> tuple[FileRole, ...]:
        """The parts with a role."""
        return tuple(part for part in self.parts if part.role == role)

    @property
    def unused(self) -> dict[str, str]:
        """The files that are not used, grouped if their reasons differ only by a temperature."""
        files: dict[str, list[str]] = {}
        for part in self.of_role("not used"):
            at = named_degc(part.temperature_degc)
            what = f" ({part.kind}{at})" if part.kind else at
            reason = part.reason
            if at:
                reason = reason.replace(f"measured{at}", "measured at another temperature")
            files.setdefault(reason, []).append(f"{part.name}{what}")
        return {reason: ", ".join(several) for reason, several in files.items()}

    @property
    def lines(self) -> list[str]:
        """Every file with its kind and the reason for its role: one line each, except for files
        that are not used for the same reason."""
        used = [part for part in self.parts if part.role != "not used"]
        lines = [f"{part.name}: {part.role} ({part.kind}): {part.reason}" for part in used]
        return [*lines, *(f"{names}: not used: {why}" for why, names in self.unused.items())]

    @property
    def stored(self) -> tuple[FileRole, ...]:
        """Every file as stored in a result; empty if the roles were given."""
        kept = ("name", "role", "kind", "reason", "temperature_degc", "plans_soc")
        facts = ({name: getattr(part, name) for name in kept} for part in self.parts)
        is_chosen = any(part.reason for part in self.parts)
        return tuple(FileRole(**each) for each in facts) if is_chosen else ()

    @property
    def on_one(self) -> "Plan":
        """A copy that identifies on the first record and validates on all others."""
        first, *others = self.of_role("identification")
        why = f"validated on, for {first.name} is identified on"
        parts = (
            replace(part, role="validation", reason=f"{why}: {part.reason}")
            if part in others
            else part
            for part in self.parts
        )
        return replace(self, parts=tuple(sorted(parts, key=lambda part: ROLES.index(part.role))))

    def changed(self, window: Windows, **options: Any) -> "Plan":
        """The plan with the user's choices applied, by record or for all; None is no choice.

        A window for a record that is not simulated is rejected when the plan is run.
        """
        windows = windows_by_name(window)
        common = windows.get("") or Window()
        if common.capacity_ah is not None:
            # A value for all records is an option of the whole run.
            options = {"capacity": common.capacity_ah, **options}
            windows[""] = common = replace(common, capacity_ah=None)
        parts = []
        for part in self.parts:
            chosen = window_of(windows, part.name)
            if part.is_simulated or (part.role == "OCV test" and part.name in windows):
                plans_soc = part.plans_soc and chosen.initial_soc is None
                part = replace(part, window=merged(part.window, chosen), plans_soc=plans_soc)
            parts.append(part)
        given = {name: value for name, value in options.items() if value is not None}
        return replace(
            self,
            parts=tuple(parts),
            options={**self.options, **given},
            reasons={**self.reasons, **dict.fromkeys(given, GIVEN)},
            window=merged(self.window, common),
        )


def named_degc(degc: float | None) -> str:
    """A temperature in words, with the preposition; empty if it is unknown."""
    return "" if degc is None else f" at {degc:.3g} degC"


_HEAD = (
    "A barnax plan. Edit it if you like, and run it with `barnax identify FILE`.",
    "It has the options of `barnax identify` by their names, and a table [[files]] for every file.",
    "The roles are identification, validation, OCV test and not used. Options of a record, such as",
    "start_time, initial_soc and score_to, stand above for all, or in a file's table for it alone.",
    "Times are on the file's own clock. The results repeat kind and reason.",
)


# Options of a record, in the order of a `Window`, by their fields.
_OPTION_OF = {name: option for option, (name, *_) in WINDOW_OPTIONS.items()}
_FIELD_OF = {_OPTION_OF[one.name]: one.name for one in fields(Window) if one.name in _OPTION_OF}
# Findings about a file: results report them again.
_FINDINGS = ("kind", "reason", "sha256", "temperature_degc", "plans_soc", "sampling")
# The types of options of a record, of the run by the names of `barnax.identify` (including one
# capacity for all records) in addition to a plan's own keys, and of the keys in a file's table.
_PART = get_type_hints(FileRole)
_OF_RECORD = {option: get_type_hints(Window)[name] for option, name in _FIELD_OF.items()}
_OF_PLAN = {"command": get_type_hints(Plan)["command"], "reasons": dict[str, str]}
_OF_RUN = {**_OF_PLAN, **_OF_RECORD, **{name: OPTIONS[name] for name in PLANNED}}
_OF_FILE = {
    **{"file": str | tuple[str, ...], "name": str, "role": Use, "span": _PART["span_s"]},
    **_OF_RECORD,
    **{name: _PART[name] for name in _FINDINGS},
}


def plan_to_toml(plan: Plan) -> str:
    """The plan as TOML; `plan_from_toml` restores it.

    Args:
        plan: A plan from `plan.plan`.

    Raises `InputError` for a file whose name TOML cannot represent.
    """
    for path in (str(path) for part in plan.parts for path in part.paths):
        if path.encode(errors="replace").decode() != path:
            raise InputError(
                f"{printable(path)}: this name is not UTF-8, as a plan is; rename the file, or run "
                "the folder as it is"
            )
    document = tomlkit.document()
    for line in (*_HEAD, *filter(None, (plan.missing,))):
        document.add(tomlkit.comment(printable(line)))
    document.add(tomlkit.nl())
    document.add("command", tomlkit.item(plan.command))
    values = {name: value for name, value in plan.options.items() if value is not None}
    for name, value in (values | _values(plan.window)).items():
        document.add(name, tomlkit.item(str(value) if isinstance(value, Path) else value))
    reasons = {name: reason for name, reason in plan.reasons.items() if reason != GIVEN}
    if reasons:
        document.add("reasons", tomlkit.item(reasons))
    document.add("files", tomlkit.item([_table(part, _values(plan.window)) for part in plan.parts]))
    # Comments are printable already: everything else is in quotes.
    return "".join(
        letter if letter == "\n" or letter.isprintable() else f"\\U{ord(letter):08x}"
        for letter in tomlkit.dumps(document)
    )


def _table(part: FileRole, common: Mapping[str, Any]) -> dict[str, Any]:
    paths = [*map(str, part.paths)]
    table: dict[str, Any] = {"file": paths if part.more else paths[0], "role": part.role}
    if part.span_s is not None:
        table |= {"name": part.name, "span": list(part.span_s)}
    values = _values(part.window)
    starts = [option for option, name in _FIELD_OF.items() if name in START]
    if all(values.get(option) == common.get(option) for option in starts):
        values = {option: value for option, value in values.items() if value != common.get(option)}
    facts = ((name, getattr(part, name)) for name in _FINDINGS)
    # 0 degC is a value.
    findings = {name: v for name, v in facts if v not in (None, "") and v is not False}
    return table | values | findings


def _values(window: Window) -> dict[str, Any]:
    """The values of a window, by the names of options."""
    values = ((option, getattr(window, name)) for option, name in _FIELD_OF.items())
    return {option: value for option, value in values if value is not None}


def plan_from_toml(path: str | Path) -> Plan:
    """The plan in a TOML file.

    Args:
        path: The file. Files are looked for beside it or relative to the working directory; one
            that does not exist there is searched in these folders and in the folder above the
            plan's, by its name and its digest. If the plan has no digest, a warning names the file
            that was used.

    Raises `InputError` that names the file, the key and the accepted values.
    """
    path = Path(path)
    shown, content = printable(path.name), _content(path)
    listed = content.pop("files", [])
    options = _read(shown, content, _OF_RUN)
    command, reasons = options.pop("command", "identify"), options.pop("reasons", {})
    of_records = [name for name in _FIELD_OF if name in options and name not in PLANNED]
    common = {_FIELD_OF[name]: options.pop(name) for name in of_records}
    warnings: tuple[Notice, ...] = ()
    if isinstance(options.get("bounds"), str):
        bounds = Path(options["bounds"])
        options["bounds"], warnings = find_planned(bounds, bounds.name, beside=path.parent)
    with naming(shown, as_keys):
        _, window = Job(**options), Window(**common)
    if not isinstance(listed, list) or not all(isinstance(entry, dict) for entry in listed):
        raise InputError(f"{shown}: each file needs a line [[files]] above it")
    parts = tuple(_part(shown, entry, window) for entry in listed)
    if not any(part.role == "identification" for part in parts):
        raise InputError(f"{shown}: no file has the role identification; give one file that role")
    reasons = dict.fromkeys(options, GIVEN) | _read(shown, reasons, dict.fromkeys(options, str))
    parts, taken = _named(parts, path.parent)
    return Plan(command, parts, options, reasons, window=window, warnings=(*warnings, *taken))


def _content(path: Path) -> dict[str, Any]:
    """The content of a TOML file. Raises `InputError` if it cannot be read."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as problem:
        reason = getattr(problem, "strerror", None) or toml_reason(problem)
        how = f"cannot be read as a plan in TOML ({reason}); correct it"
        raise InputError(f"{printable(path.name)}: {how}") from problem


def folders_in(path: Path) -> tuple[Path, ...]:
    """The folders of the files that a plan names, relative to its own and to the working directory;
    empty if the file is not a plan."""
    content = attempt(_content, path)
    listed = None if isinstance(content, InputError) else content.get("files")
    tables = [one for one in listed if isinstance(one, dict)] if isinstance(listed, list) else []
    given = (table.get("file") for table in tables)
    several = (one if isinstance(one, list) else [one] for one in given)
    files = [Path(one) for names in several for one in names if isinstance(one, str)]
    return tuple(dict.fromkeys(at.parent for one in files for at in (path.parent / one, one)))


def _part(shown: str, table: Mapping[str, Any], common: Window) -> FileRole:
    given = _read(shown, table, _OF_FILE)
    missing = [key for key in ("file", "role") if not given.get(key)]
    if missing:
        raise InputError(f"{shown}: a table [[files]] has no {missing[0]!r}")
    files, role = given.pop("file"), given.pop("role")
    file, *more = [files] if isinstance(files, str) else files
    name, span = given.pop("name", ""), given.pop("span", None)
    findings = {key: given.pop(key) for key in _FINDINGS if key in given}
    if span and not name:
        raise InputError(f"{shown}: a part of {file} needs a 'name' beside its span")
    with naming(f"{shown}: {file}", as_keys):
        window = Window(**{_FIELD_OF[option]: value for option, value in given.items()})
    paths = {"path": Path(file), "more": tuple(map(Path, more))}
    part = FileRole(**paths, name=name, role=role, window=window, span_s=span, **findings)
    return replace(part, window=merged(common, window)) if part.is_simulated else part


def _named(
    parts: tuple[FileRole, ...], folder: Path
) -> tuple[tuple[FileRole, ...], tuple[Notice, ...]]:
    """The parts with their located files, by the names that results will use for them, and
    warnings."""
    used = (path for part in parts if part.role != "not used" for path in part.paths)
    names = file_names(used)
    named, warnings = [], dict[Notice, None]()
    # A file is read once, however many parts of it are planned.
    find = functools.cache(functools.partial(find_planned, beside=folder))
    for part in parts:
        digests = part.sha256.split() or [""] * len(part.paths)
        if len(digests) != len(part.paths):
            raise InputError(f"{part.path}: a plan has one digest for each file of a log, or none")
        file_labels = [names.get(path, path.name) for path in part.paths]
        locations = [find(*each) for each in zip(part.paths, file_labels, digests, strict=True)]
        (path, *more), taken = zip(*locations, strict=True)
        name = part.name or NEXT_FILE.join(file_labels)
        named.append(replace(part, path=path, more=tuple(more), name=name))
        if part.role != "not used":
            warnings |= dict.fromkeys(notice for several in taken for notice in several)
    return tuple(named), tuple(warnings)


def _read(shown: str, table: Mapping[str, Any], hints: Mapping[str, Any]) -> dict[str, Any]:
    """The table's values as the types of their keys, strictly."""
    unknown = sorted(table.keys() - hints.keys())
    if unknown:
        raise InputError(
            f"{shown}: {unknown[0]!r} is not a key of a plan here; there are {', '.join(hints)}"
        )
    values = {}
    for key, value in table.items():
        try:
            # TOML has arrays for tuples, as JSON has.
            kind = TypeAdapter(hints[key])
            values[key] = kind.validate_json(json.dumps(value), strict=True)
        except ValidationError as problem:
            wanted = " or ".join(dict.fromkeys(one["msg"] for one in problem.errors()))
            wanted = wanted.replace("Input should be ", "").replace("an object", "a table")
            raise InputError(f"{shown}: {key} is {value!r}; give {wanted}") from problem
        except TypeError as problem:
            raise InputError(f"{shown}: {key} is {value}, a date; put it in quotes") from problem
    return values
