"""One request: all arguments of `identify`, from any caller.

Python's keywords, the command line, a plan, a row of a fleet and `hppc` each make a `Job`.
"""

import difflib
import functools
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, ParamSpec, Self, TypeVar, get_type_hints

from .bounds_file import GivenRanges
from .cell import CellModel, get_circuit
from .display import brief
from .errors import InputError, choices_in, require_choice, require_number
from .execution import Watch, unwatched
from .fit.settings import TableSettings
from .model.search_space import Range
from .model.window import Window, Windows
from .records import Given, Hold
from .schema import Unstored
from .settings import CellSettings, Reading, Scope, Settings, TableOptions

# Roles of a file in a folder.
Use = Literal["identification", "OCV test", "validation", "not used"]
# Roles that have a window.
SIMULATED: tuple[Use, ...] = ("identification", "validation")

Asked = ParamSpec("Asked")
Value = TypeVar("Value")
AnyJob = TypeVar("AnyJob", bound="Job")


class _Signature:
    """The arguments of a class's `__init__`, whatever its `__new__` takes."""

    def __get__(self, _: object, owner: type) -> inspect.Signature:
        signature = inspect.signature(owner.__init__)
        return signature.replace(parameters=[*signature.parameters.values()][1:])


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Job(TableOptions, CellSettings, Reading, Scope, Settings):
    """A request to `identify`, with the fields of `Settings`, `Reading` and others by name.

    `chosen` has the options that were given, and `ranges` the content of `bounds`, read once.

    Args:
        records: Files, `Record`s or data frames to identify on, one or several. None: the bundled
            cell. For a folder, a plan, or files without `ocv`, roles and windows are chosen
            (`plan.plan`).
        ocv: Files, records, data frames or tables of the OCV test of the same cell.
        validate: Files, records or data frames to validate on.
        window: The part of a record that is simulated: one for all records, or a mapping from
            record names to windows, with "" for the others.
        capacity: Capacity of the cell in Ah when the records were measured.
        bounds: Lowest and highest value by PyBaMM's names (`"R0 [Ohm]"`, `"C1 [F]"`, `"tau1 [s]"`),
            or a TOML file of them.
        fix: Parameters that keep a value, by the same names.
        cell: A known cell, which needs no `ocv`.
        watch: Called with the title of every stage and its number of steps; returns a context
            manager that gives a function to call with the steps done.
        settings: Several of these options in one object; those given by name replace them.
        reading: Likewise for reading files.
        tables: Likewise for tables, with bounds and fixed values of tables alone.

    Raises `TypeError` for an unknown option, with the nearest one, and `InputError` for an invalid
    value.
    """

    records: Given | Sequence[Given] = field(default=(), kw_only=False)
    ocv: Given | Sequence[Given] = ()
    validate: Given | Sequence[Given] = ()
    window: Windows = None
    capacity: float | None = None
    bounds: Mapping[str, Range] | str | Path | None = None
    fix: Mapping[str, float] | None = None
    cell: CellModel | None = None
    watch: Watch = unwatched
    settings: Settings | None = None
    reading: Reading | None = None
    tables: TableSettings | None = None

    if TYPE_CHECKING:
        ranges: GivenRanges = field(init=False)

    def __repr__(self) -> str:
        return f"Job({', '.join(f'{name}={brief(value)}' for name, value in self.chosen.items())})"

    def __eq__(self, other: object) -> bool:
        return self is other

    __hash__ = object.__hash__

    if not TYPE_CHECKING:
        __signature__ = _Signature()

        def __new__(cls, *given, **options):
            cls.require_names(options)
            job = super().__new__(cls)
            vars(job)["_chosen"] = {*options, *(["records"] if given else ())}
            return job

    def __post_init__(self) -> None:
        values = vars(self)
        # Options given by name replace those of a settings object.
        parts = (Settings, self.settings), (Reading, self.reading), (TableOptions, self.tables)
        for kind, part in parts:
            names = {field.name for field in fields(kind) if part} - values["_chosen"]
            values |= {name: getattr(part, name) for name in names}
            values["_chosen"] |= {name for name in names if values[name] != getattr(kind, name)}
        if self.setup is not None:
            values |= {"model": self.model or "iso-rc", "ocv_fit": self.ocv_fit or "polynomial"}
        for name in values["_chosen"]:
            require_value(name, values[name])
        super().__post_init__()
        values["ranges"] = GivenRanges.of(self.bounds)
        are_chosen = self.table_settings != TableSettings()
        if are_chosen and self.over is None and self.model is not None:
            raise InputError("settings of tables need `over` 'soc'; give it too, or no `model`")

    @property
    def chosen(self) -> dict[str, Any]:
        """The options that were given, by name."""
        return {name: value for name, value in vars(self).items() if name in vars(self)["_chosen"]}

    @property
    def table_settings(self) -> TableSettings:
        """Settings of the tables' fit. Raises `InputError` if they do not go together."""
        return replace(self.tables or TableSettings(), **vars(self.part(TableOptions)))

    @property
    def given_ah(self) -> float | None:
        """The capacity in Ah given for all records, as an option or in the common window."""
        return window_of(self.window, "").capacity_ah if self.capacity is None else self.capacity

    def part(self, kind: Callable[..., Value]) -> Value:
        """The options of one kind, such as `Reading`, by themselves."""
        return kind(**{one.name: getattr(self, one.name) for one in fields(kind)})  # pyrefly: ignore

    def changed(self, **options: Any) -> Self:
        """A copy with other options; a default stays one."""
        return type(self)(**{**self.chosen, **options})

    @classmethod
    def require_names(cls, options: Mapping[str, Any]) -> None:
        """Raise `TypeError` for an unknown option, with the nearest known one."""
        allowed = [field.name for field in fields(cls)]
        for name in sorted(options.keys() - {*allowed}):
            near = difflib.get_close_matches(name, allowed, 1)
            remedy = f"; did you mean {near[0]}?" if near else f"; there are {', '.join(allowed)}"
            if name in {field.name for field in fields(Window)}:
                remedy = f"; give window=barnax.Window({name}=...)"
            raise TypeError(f"there is no option {name}{remedy}")


def windows_by_name(window: Windows) -> dict[str, Window]:
    """The windows by the names of records, the common one under an empty name.

    Raises `InputError` for anything other than a window.
    """
    by_name = dict(window) if isinstance(window, Mapping) else {"": window or Window()}
    for one in by_name.values():
        if not isinstance(one, Window):
            raise InputError(f"window {one!r} is none; give barnax.Window(initial_soc=...)")
    return by_name


def window_of(window: Windows, name: str) -> Window:
    """The window of a record: that of its name, else the common one."""
    windows = windows_by_name(window)
    return windows.get(name, windows.get("")) or Window()


@dataclass(frozen=True, kw_only=True)
class FileRole:
    """A file, or a part of one, with its role: in a plan, and as stored in a result.

    `kind` is the kind of file: a drive cycle, a pulse test, unreadable and so on, and `plans_soc`
    is True if its SOC at the start comes from the plan, and was not given. The others belong to
    plans only. `window` is that of a simulation, for identification and validation. `span_s` cuts a
    file that holds several tests, on its own clock. `source` is the content that was read from the
    file, if any, and `sha256` the file's digest, if known; for a log cut into several files, of
    which `more` are the further ones, it holds those of all. `sampling` is the hold of its current
    derived from the steps of a designed test; it applies to all files with the same columns, as
    they share a logger.
    """

    name: str
    role: Use
    kind: str = ""
    reason: str = ""
    temperature_degc: float | None = None
    plans_soc: bool = False
    path: Unstored[Path] = Path()
    window: Unstored[Window] = field(default_factory=Window)
    span_s: Unstored[tuple[float, float] | None] = None
    source: Unstored[Given] = field(default=None, repr=False, compare=False)
    sha256: Unstored[str] = ""
    sampling: Unstored[Hold | None] = None
    more: Unstored[tuple[Path, ...]] = ()

    @property
    def paths(self) -> tuple[Path, ...]:
        """All files of its log."""
        return (self.path, *self.more)

    @property
    def is_simulated(self) -> bool:
        """True if its role is one with a window."""
        return self.role in SIMULATED


# The options of `identify` with their types.
OPTIONS: Mapping[str, Any] = get_type_hints(Job)
# Options that a plan holds: all except data, and callbacks while it runs.
_GROUPS = (Settings, Reading, CellSettings, Scope, TableOptions)
PLANNED = (*(field.name for kind in _GROUPS for field in fields(kind)), "capacity", "bounds", "fix")


def require_value(name: str, value: Any) -> None:
    """Raise `InputError` if an option takes a number or has few values, and the value is not one of
    them."""
    if name == "model" and value is not None:
        get_circuit(str(value))
        return
    hint = OPTIONS.get(name)
    require_number(name, value, hint)
    choices = choices_in(hint)
    if name == "method":
        from .optimizers import OPTIMIZERS

        choices = tuple(OPTIMIZERS)
    if value is not None and choices:
        require_choice(name, value, choices)


# The section of a docstring that explains arguments.
_ARGS = r"Args:\n((?:    .*(?:\n|$))+)"


def explained(thing: Any) -> dict[str, str]:
    """Explanations in docstrings of a function's arguments, or a class's fields and its bases'.

    >>> explained(Settings)["iterations"]
    'Generations (500).'
    """
    explanations: dict[str, str] = {}
    for owner in getattr(thing, "__mro__", (thing,)):
        section = re.search(_ARGS, inspect.cleandoc(owner.__doc__ or ""))
        entries = re.findall(r"    (\w+): (.*(?:\n {8}.*)*)", section[1] if section else "")
        explanations = {name: " ".join(text.split()) for name, text in entries} | explanations
    return explanations


def takes_options(
    make: Callable[Asked, AnyJob],
) -> Callable[[Callable[[AnyJob], Value]], Callable[Asked, Value]]:
    """Let a function of a job be called with the job's own options, each with its type."""

    def decorate(run: Callable[[AnyJob], Value]) -> Callable[Asked, Value]:
        @functools.wraps(run)
        def function(*given: Asked.args, **options: Asked.kwargs) -> Value:
            if given and isinstance(given[0], Job):
                # For a job of another kind, the options that both have.
                names = inspect.signature(make).parameters
                chosen = {name: one for name, one in given[0].chosen.items() if name in names}
                given, options = (), {**chosen, **options}  # pyrefly: ignore
            return run(make(*given, **options))

        described = explained(run)
        more = {name: text for name, text in explained(make).items() if name not in described}
        lines = [f"    {name}: {text}\n" for name, text in more.items()]
        doc = inspect.cleandoc(run.__doc__ or "")
        function.__doc__ = re.sub(_ARGS, lambda match: match[0] + "".join(lines), doc)
        function.__signature__ = inspect.signature(make)  # pyrefly: ignore
        return function

    return decorate
