"""A plan: which file serves for what, in which window, with which options, and why."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, get_args

from ..model.window import Window
from ..records import Source
from ..results import PlannedFile, Use

ROLES: tuple[Use, ...] = get_args(Use)
# What says where a simulation starts: one such option of the user's replaces all planned ones.
_START = ("start_time_s", "start_after_step", "initial_soc")


@dataclass(frozen=True)
class Part:
    """A file, or a part of one, and what it serves for.

    `kind` says what it is: a drive cycle, a pulse test, unreadable and so on. `span_s` cuts a file
    that holds several tests, on its own clock. `window` is that of a simulation, for identification
    and validation. `source` is what was read of the file, if it was.
    """

    path: Path
    name: str
    role: Use
    kind: str
    reason: str
    window: Window = field(default_factory=Window)
    span_s: tuple[float, float] | None = None
    temperature_degc: float | None = None
    source: Source | None = field(default=None, repr=False, compare=False)

    @property
    def is_simulated(self) -> bool:
        """Whether it has a window."""
        return self.role in ("identification", "validation")


@dataclass(frozen=True)
class Plan:
    """What to do with some files: run `identify`, or `hppc` if there are only pulse tests.

    `options` are arguments of `barnax.identify`, such as the capacity in Ah, and `reasons` say
    why, by option. `missing` says which test must be measured before the plan can be run; it
    is empty if it can be run.
    """

    command: Literal["identify", "hppc"]
    parts: tuple[Part, ...]
    options: Mapping[str, Any] = field(default_factory=dict)
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
        return tuple(
            PlannedFile(
                name=part.name,
                role=part.role,
                kind=part.kind,
                reason=part.reason,
                temperature_degc=part.temperature_degc,
            )
            for part in self.parts
        )

    def changed(self, window: Window | Mapping[str, Window] | None, **options: Any) -> "Plan":
        """The plan with what a user has chosen otherwise, by record or for all; None is no choice.

        A window for a record that is not simulated is left to be refused where the plan is run.
        """
        windows = {"": window} if isinstance(window, Window | None) else dict(window)
        common = windows.get("")
        if common is not None and common.capacity_ah is not None:
            # One for all records is an option of the whole run.
            options = {"capacity": common.capacity_ah, **options}
            windows[""] = replace(common, capacity_ah=None)
        parts = [
            replace(part, window=_merged(part.window, chosen))
            if (chosen := windows.get(part.name, windows.get(""))) is not None and part.is_simulated
            else part
            for part in self.parts
        ]
        given = {name: value for name, value in options.items() if value is not None}
        reasons = {**self.reasons, **dict.fromkeys(given, "given")}
        return replace(self, parts=tuple(parts), options={**self.options, **given}, reasons=reasons)


def _merged(planned: Window, chosen: Window) -> Window:
    """The planned window with what was chosen in its place."""
    given = {
        each.name: value
        for each in fields(Window)
        if (value := getattr(chosen, each.name)) is not None
    }
    if given.keys() & {"start_time_s", "start_after_step"}:
        given = {**dict.fromkeys(_START), **given}
    return replace(planned, **given)
