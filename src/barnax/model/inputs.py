"""One record made ready to simulate: which part of it, its SOC, and a resting cell's voltage."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..cell import CellModel
from ..cell.circuits import get_circuit
from ..cell.ocv_points import MINIMUM_REST_S
from ..errors import InputError
from ..records import Record
from ..records.rests import current_direction, is_rested, rest_current_a
from .simulate import HysteresisInput, Intervals, SimulationInput


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


# Scored samples may leave the range of the OCV points by this much SOC; a branch is constant there.
OCV_MARGIN = 0.05
# Leaving it by less is rounding, and worth no warning.
NO_MARGIN = 1e-4


@dataclass(frozen=True, eq=False)
class PreparedRecord:
    """The simulated stretch of one record, first to last scored sample.

    `source_v` is the open-circuit voltage with the circuit's hysteresis term, a dynamic one
    standing still; `direction` the last direction of the current (+1 charging, -1 discharging).
    `hysteresis_amplitude_v` is None for circuits without dynamic hysteresis.
    """

    record: Record
    circuit: str
    first: int
    soc: Float[np.ndarray, "simulated"]
    direction: Float[np.ndarray, "simulated"]
    source_v: Float[np.ndarray, "simulated"]
    hysteresis_amplitude_v: Float[np.ndarray, "simulated"] | None
    scored: Bool[np.ndarray, "simulated"]
    rest_current_a: float
    initial_soc: float
    initial_soc_reason: str
    warnings: tuple[str, ...]

    @property
    def span(self) -> slice:
        return slice(self.first, self.first + len(self.soc))

    @property
    def time_s(self) -> Float[np.ndarray, "simulated"]:
        return self.record.time_s[self.span]

    @property
    def current_a(self) -> Float[np.ndarray, "simulated"]:
        return self.record.current_a[self.span]

    @property
    def voltage_v(self) -> Float[np.ndarray, "simulated"]:
        return self.record.voltage_v[self.span]

    @property
    def scored_duration_s(self) -> float:
        times = self.time_s[self.scored]
        return float(times[-1] - times[0])

    @property
    def median_interval_s(self) -> float:
        return float(np.median(np.diff(self.time_s)))

    def inputs(self, shortest_tau_s: float, highest_gamma: float | None = None) -> SimulationInput:
        """The device arrays of this stretch, exact for time constants from `shortest_tau_s` on.

        With dynamic hysteresis, exact for rates up to `highest_gamma`.
        """
        return SimulationInput(
            current_a=jnp.asarray(self.current_a),
            held_a=jnp.asarray(self.held_a),
            source_v=jnp.asarray(self.source_v),
            base_error_v=jnp.asarray(self.voltage_v - self.source_v),
            weight=None if np.all(self.scored) else jnp.asarray(self.scored, float),
            scored=jnp.asarray(np.count_nonzero(self.scored), float),
            intervals=Intervals.measure(self.time_s, shortest_tau_s),
            hysteresis=None if highest_gamma is None else self._hysteresis(highest_gamma),
        )

    @property
    def held_a(self) -> Float[np.ndarray, "simulated"]:
        """The current that flows from each sample to the next; the last leads nowhere."""
        last = slice(self.first, self.first + len(self.soc) - 1)
        return np.append(self.record.interval_current_a[last], 0.0)

    def _hysteresis(self, highest_gamma: float) -> HysteresisInput:
        # Below the rest current a cell keeps its direction: noise and offsets turn nothing.
        is_moving = (np.abs(self.held_a) >= self.rest_current_a) & (self.held_a != 0)
        passed = np.where(is_moving, np.abs(np.diff(self.soc, append=self.soc[-1])), 0.0)
        toward = np.where(is_moving, -np.sign(self.held_a), self.direction)
        return HysteresisInput(
            amplitude_v=jnp.asarray(self.hysteresis_amplitude_v),
            hysteresis_input=jnp.asarray(toward - self.direction[0]),
            intervals=Intervals.gather(passed, 1 / highest_gamma, 0.0),
        )


def prepare_record(record: Record, cell: CellModel, circuit: str, window: Window) -> PreparedRecord:
    """A record made ready. Raises `InputError` where window, SOC or OCV range do not fit it."""
    rest_a = window.rest_current_a or rest_current_a(record, cell.capacity_ah)
    first = first_sample(record, window)
    scored = scored_samples(record, window, first)
    direction = current_direction(record, rest_a, window.initial_direction)
    start_soc, reason = initial_soc(record, cell, window, first, rest_a, direction[first])
    soc = soc_along(record, cell.capacity_ah, first, start_soc)
    warnings = _check_soc(record, cell, soc, scored)
    _require_positive_voltage(record, scored)

    span = slice(first, int(np.flatnonzero(scored)[-1]) + 1)
    if np.count_nonzero(scored) < 10 or span.stop - first < 10:
        raise InputError(
            f"{record.name}: fewer than 10 samples are left to score; widen the window"
        )
    direction = direction[span]
    model = get_circuit(circuit)
    source_v = model.source_voltage(cell, soc[span], direction)
    amplitude_v = None
    if model.hysteresis_amplitude is not None:
        amplitude_v = model.hysteresis_amplitude(cell, soc[span])
        source_v = source_v + direction[0] * amplitude_v
    return PreparedRecord(
        record=record,
        circuit=circuit,
        first=first,
        soc=soc[span],
        direction=direction,
        source_v=source_v,
        hysteresis_amplitude_v=amplitude_v,
        scored=scored[span],
        rest_current_a=rest_a,
        initial_soc=start_soc,
        initial_soc_reason=reason,
        warnings=warnings,
    )


def require_changing_voltage(prepared: PreparedRecord) -> None:
    """Raise `InputError` where the scored voltage is flat: errors on it mean nothing."""
    voltage_v = prepared.voltage_v[prepared.scored]
    if np.ptp(voltage_v) == 0:
        raise InputError(
            f"{prepared.record.name}: the voltage is {voltage_v[0]:g} V at every scored sample; "
            "widen the window or check the file"
        )


def _require_positive_voltage(record: Record, scored: Bool[np.ndarray, "samples"]) -> None:
    """Raise `InputError` where a scored voltage is no cell's; relative errors divide by it."""
    wrong = np.flatnonzero(scored & (record.voltage_v <= 0))
    if len(wrong):
        raise InputError(
            f"{record.name}: row {record.row[wrong[0]]} is scored at "
            f"{record.voltage_v[wrong[0]]:g} V, which is no cell's voltage ({len(wrong)} such "
            "samples); delete the row, or leave it out with --score-from, --score-to or "
            "--score-steps"
        )


def _check_soc(
    record: Record, cell: CellModel, soc: np.ndarray, scored: np.ndarray
) -> tuple[str, ...]:
    low, high = cell.soc_range
    beyond = np.maximum(low - soc, soc - high)
    outside = scored & (beyond > 0)
    farthest = float(np.max(beyond, where=scored, initial=0))
    if farthest < NO_MARGIN:
        return ()
    far = np.flatnonzero(scored & (beyond > OCV_MARGIN))
    if len(far):
        raise InputError(
            f"{record.name}: row {record.row[far[0]]} is scored at a state of charge of "
            f"{soc[far[0]]:.3f}, but the OCV points span only {low:.3f} to {high:.3f}; check "
            f"--capacity ({cell.capacity_ah:.4g} Ah) and --initial-soc, give an OCV test that "
            "reaches there, or leave those samples out: barnax check proposes where to start "
            "(--start-after-step) and what to score (--score-steps, --score-to)"
        )
    return (
        f"{record.name}: {np.count_nonzero(outside)} of {np.count_nonzero(scored)} scored samples "
        f"lie up to {farthest:.2g} SOC outside the OCV points ({low:.3f} to {high:.3f}), where the "
        "open-circuit voltage is held constant",
    )
