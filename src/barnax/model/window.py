"""Which part of a record is simulated, and where errors count."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from ..errors import InputError
from ..records import Record


def _numbers(text: str, kind: Callable[[str], Any], count: int | None = None) -> tuple[Any, ...]:
    values = tuple(kind(part) for part in text.split(","))
    if count is not None and len(values) != count:
        raise ValueError(text)
    return values


# What is known of a record, as options and tables give it: the field it is of a `Window`, how its
# text is read (`ValueError` where it is none), and an example of one.
OPTIONS: dict[str, tuple[str, Callable[[str], Any], str]] = {
    "capacity": ("capacity_ah", float, "5"),
    "temperature": ("temperature_degc", float, "25"),
    "start_time": ("start_time_s", float, "5"),
    "start_after_step": ("start_after_step", int, "5"),
    "initial_soc": ("initial_soc", float, "0.9"),
    "initial_direction": ("initial_direction", int, "-1"),
    "score_steps": ("score_steps", lambda text: _numbers(text, int), "7,8"),
    "score_from": ("score_from_s", float, "5"),
    "score_to": ("score_to_s", float, "5"),
    "score_soc": ("score_soc", lambda text: _numbers(text, float, 2), "0.1,1"),
    "rest_current": ("rest_current_a", float, "5"),
}


def is_temperature(degc: float) -> bool:
    """Whether it may be a cell's; what is not is of another unit, or of a sensor that is not there.

    >>> is_temperature(25.0), is_temperature(298.15)
    (True, False)
    """
    return -100 < degc < 200


@dataclass(frozen=True)
class Window:
    """The part of a record that is simulated and counted, and what is known about its start.

    Args:
        start_time_s: Where the simulation starts, on the file's own clock.
        start_after_step: It starts at the last sample of the last block of this step instead.
        initial_soc: State of charge at the start, a fraction.
        score_steps: Only samples of these steps count.
        score_from_s: Only samples from here on count.
        score_to_s: Only samples up to here count.
        score_soc: Only samples between these states of charge count.
        rest_current_a: The cell rests below this current.
        initial_direction: Direction of the load before the start: +1 charged, -1 discharged.
        capacity_ah: Capacity of the cell when the record was measured; by default the cell model's.
        temperature_degc: Temperature of the record; by default the median of its own column.

    Raises `InputError` if these contradict each other.
    """

    start_time_s: float | None = None
    start_after_step: int | None = None
    initial_soc: float | None = None
    score_steps: tuple[int, ...] | None = None
    score_from_s: float | None = None
    score_to_s: float | None = None
    score_soc: tuple[float, float] | None = None
    rest_current_a: float | None = None
    initial_direction: Literal[-1, 1] | None = None
    capacity_ah: float | None = None
    temperature_degc: float | None = None

    def __post_init__(self):
        for name in ("score_steps", "score_soc"):
            # As a warning about the file prints them.
            if isinstance(text := getattr(self, name), str):
                _, read, example = OPTIONS[name]
                try:
                    object.__setattr__(self, name, read(text))
                except ValueError:
                    raise InputError(f"`{name}` {text!r} is not as in {example}") from None
        if self.start_time_s is not None and self.start_after_step is not None:
            raise InputError("give `start_time` or `start_after_step`, not both")
        if self.initial_soc is not None and not 0 <= self.initial_soc <= 1:
            raise InputError(
                f"`initial_soc` {self.initial_soc} is not a fraction; state of charge runs from "
                "0 (empty) to 1 (full)"
            )
        if self.initial_direction not in (1, -1, None):
            raise InputError(
                f"`initial_direction` {self.initial_direction} is neither +1 (the cell was last "
                "charged) nor -1 (discharged)"
            )
        for name, value in (("rest_current", self.rest_current_a), ("capacity", self.capacity_ah)):
            if value is not None and not 0 < value < np.inf:
                raise InputError(f"`{name}` {value} must be positive")
        if not is_temperature(self.temperature_degc or 0.0):
            raise InputError(f"`temperature` {self.temperature_degc:g} must be the cell's, in degC")
        if self.score_soc is not None and not self.score_soc[0] < self.score_soc[1]:
            raise InputError(
                f"`score_soc` {self.score_soc[0]:g},{self.score_soc[1]:g}: the lower end comes "
                "first, as in 0.1,1"
            )
        if (
            self.score_from_s is not None
            and self.score_to_s is not None
            and self.score_to_s <= self.score_from_s
        ):
            raise InputError(
                f"`score_to` {self.score_to_s} s must come after `score_from` {self.score_from_s} s"
            )

    @property
    def is_chosen(self) -> bool:
        """Whether it says where to start or what to score."""
        return self != Window(
            rest_current_a=self.rest_current_a,
            initial_direction=self.initial_direction,
            capacity_ah=self.capacity_ah,
            temperature_degc=self.temperature_degc,
        )


def first_sample(record: Record, window: Window) -> int:
    """Index of the sample where the simulation starts. Raises `InputError` if there is none."""
    if window.start_time_s is not None:
        after = np.flatnonzero(record.time_s >= window.start_time_s)
        if not len(after) or window.start_time_s < record.time_s[0]:
            raise InputError(
                f"{record.name}: `start_time` {window.start_time_s} s lies outside the record, "
                f"whose clock runs from {record.time_s[0]:g} to {record.time_s[-1]:g} s"
            )
        return int(after[0])
    if window.start_after_step is not None:
        inside = np.flatnonzero(_steps(record, "start_after_step") == window.start_after_step)
        if not len(inside):
            raise InputError(_no_such_step(record, window.start_after_step))
        return int(inside[-1])
    return 0


def scored_samples(
    record: Record, window: Window, first: int, soc: Float[np.ndarray, "samples"]
) -> Bool[np.ndarray, "samples"]:
    """True where errors count, over the whole record. Raises `InputError` if nowhere."""
    scored = np.arange(record.samples) >= first
    if window.score_steps is not None:
        steps = _steps(record, "score_steps")
        for step in window.score_steps:
            if not np.any(steps == step):
                raise InputError(_no_such_step(record, step))
        scored &= np.isin(steps, window.score_steps)
    if window.score_from_s is not None:
        scored &= record.time_s >= window.score_from_s
    if window.score_to_s is not None:
        scored &= record.time_s <= window.score_to_s
    if window.score_soc is not None:
        low, high = window.score_soc
        scored &= (soc >= low) & (soc <= high)
    if not np.any(scored):
        raise InputError(
            f"{record.name}: no sample is left to score after the start at "
            f"{record.time_s[first]:g} s; widen `score_steps`, `score_from`, `score_to` or "
            "`score_soc`"
        )
    return scored


def _steps(record: Record, option: str) -> np.ndarray:
    if record.step is None:
        raise InputError(
            f"{record.name}: `{option}` needs a step column, and the file has none; use "
            "`start_time`, `score_from` and `score_to` instead"
        )
    return record.step


def _no_such_step(record: Record, step: int) -> str:
    present = ", ".join(str(number) for number in np.unique(_steps(record, "start_after_step")))
    return f"{record.name}: there is no step {step}; the file has steps {present}"
