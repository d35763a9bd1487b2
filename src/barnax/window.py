"""Which part of a record is simulated, and at which of its samples errors count."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from .cell import CellModel
from .cell.rest_points import MINIMUM_REST_S
from .errors import InputError
from .records import Record
from .records.rests import is_rested


@dataclass(frozen=True)
class Window:
    """The user's choice of window; the same one serves every record of a command.

    The simulation starts at `start_time_s` (the file's own clock) or at the last sample of the
    last block of step `start_after_step`, with `initial_soc` there. Errors count at the samples
    of `score_steps` and between `score_from_s` and `score_to_s`; by default at all of them.
    `rest_current_a` overrides the current below which the cell counts as resting;
    `initial_direction` (+1 charging, -1 discharging) is the last current before the record.
    """

    start_time_s: float | None = None
    start_after_step: int | None = None
    initial_soc: float | None = None
    score_steps: tuple[int, ...] | None = None
    score_from_s: float | None = None
    score_to_s: float | None = None
    rest_current_a: float | None = None
    initial_direction: int = 1

    def __post_init__(self):
        if self.start_time_s is not None and self.start_after_step is not None:
            raise InputError("give --start-time or --start-after-step, not both")
        if self.initial_soc is not None and not 0 <= self.initial_soc <= 1:
            raise InputError(
                f"--initial-soc {self.initial_soc} is not a fraction; state of charge runs from "
                "0 (empty) to 1 (full)"
            )
        if self.initial_direction not in (1, -1):
            raise InputError(
                f"--initial-direction {self.initial_direction} is neither +1 (the cell was last "
                "charged) nor -1 (discharged)"
            )
        if self.rest_current_a is not None and not self.rest_current_a > 0:
            raise InputError(f"--rest-current {self.rest_current_a} A must be positive")
        if (
            self.score_from_s is not None
            and self.score_to_s is not None
            and self.score_to_s <= self.score_from_s
        ):
            raise InputError(
                f"--score-to {self.score_to_s} s must come after --score-from {self.score_from_s} s"
            )


def first_sample(record: Record, window: Window) -> int:
    """Index of the sample where the simulation starts. Raises `InputError` if there is none."""
    if window.start_time_s is not None:
        after = np.flatnonzero(record.time_s >= window.start_time_s)
        if not len(after) or window.start_time_s < record.time_s[0]:
            raise InputError(
                f"{record.name}: --start-time {window.start_time_s} s lies outside the record, "
                f"whose clock runs from {record.time_s[0]:g} to {record.time_s[-1]:g} s"
            )
        return int(after[0])
    if window.start_after_step is not None:
        inside = np.flatnonzero(_steps(record, "--start-after-step") == window.start_after_step)
        if not len(inside):
            raise InputError(_no_such_step(record, window.start_after_step))
        return int(inside[-1])
    return 0


def scored_samples(record: Record, window: Window, first: int) -> Bool[np.ndarray, "samples"]:
    """True where errors count, over the whole record. Raises `InputError` if nowhere."""
    scored = np.arange(record.samples) >= first
    if window.score_steps is not None:
        steps = _steps(record, "--score-steps")
        for step in window.score_steps:
            if not np.any(steps == step):
                raise InputError(_no_such_step(record, step))
        scored &= np.isin(steps, window.score_steps)
    if window.score_from_s is not None:
        scored &= record.time_s >= window.score_from_s
    if window.score_to_s is not None:
        scored &= record.time_s <= window.score_to_s
    if not np.any(scored):
        raise InputError(
            f"{record.name}: no sample is left to score after the start at "
            f"{record.time_s[first]:g} s; widen --score-steps, --score-from or --score-to"
        )
    return scored


def initial_soc(
    record: Record,
    cell: CellModel,
    window: Window,
    first: int,
    rest_current_a: float,
    direction: float,
) -> tuple[float, str]:
    """SOC at the start of the simulation, and where it came from, in words.

    `direction` (+1 after charging, -1 after discharging) says which OCV branch a rested cell is
    on. Raises `InputError` where the cell has not rested, as far as the record shows.
    """
    if window.initial_soc is not None:
        return window.initial_soc, "given"
    row = record.row[first]
    is_loaded = ~is_rested(record, rest_current_a)[: first + 1]
    if is_loaded[first]:
        raise InputError(
            f"{record.name}: the simulation starts at row {row} under "
            f"{record.current_a[first]:+.3g} A (discharge positive), so the voltage there does "
            "not tell the state of charge; give --initial-soc"
        )
    if np.any(is_loaded):
        rest_s = record.time_s[first] - record.time_s[np.flatnonzero(is_loaded)[-1]]
        if rest_s < MINIMUM_REST_S:
            raise InputError(
                f"{record.name}: at row {row}, where the simulation starts, the cell has rested "
                f"for {rest_s:.0f} s only, and its voltage tells the state of charge after "
                f"{MINIMUM_REST_S:.0f} s; give --initial-soc"
            )
    voltage_v = float(record.voltage_v[first])
    try:
        soc = cell.soc_from_rest_voltage(voltage_v, int(direction))
    except InputError as problem:
        raise InputError(f"{record.name}: row {row}: {problem}") from problem
    return soc, f"from the rested voltage {voltage_v:.4f} V at row {row}"


def soc_along(
    record: Record, capacity_ah: float, first: int, soc: float
) -> Float[np.ndarray, "samples"]:
    """SOC by ampere-hours, from `soc` at the sample `first` (Li et al., 2023, Eq. 20)."""
    discharged_ah = record.discharged_ah
    return soc - (discharged_ah - discharged_ah[first]) / capacity_ah


def _steps(record: Record, option: str) -> np.ndarray:
    if record.step is None:
        raise InputError(
            f"{record.name}: {option} needs a step column, and the file has none; use "
            "--start-time, --score-from and --score-to instead"
        )
    return record.step


def _no_such_step(record: Record, step: int) -> str:
    present = ", ".join(str(number) for number in np.unique(_steps(record, "the step number")))
    return f"{record.name}: there is no step {step}; the file has steps {present}"
