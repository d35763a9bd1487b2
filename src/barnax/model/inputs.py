"""One record made ready to simulate: which part of it, its SOC, and a resting cell's voltage."""

from dataclasses import dataclass, replace
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..cell import CellModel, get_circuit
from ..cell.ocv_points import MINIMUM_REST_S
from ..errors import InputError
from ..records import Record, current_direction, is_rested, rest_current_a
from .simulate import HysteresisInput, Intervals, SimulationInput

# Scored samples may leave the range of the OCV points by this much SOC; a branch is constant there.
OCV_MARGIN = 0.05
# Leaving it by less is rounding, and worth no warning.
NO_MARGIN = 1e-4
# So near full or empty, the last current was the one that leads there.
NEAR_AN_END = 0.02
# A given SOC is in doubt where the rested voltage is so far from its OCV, and tells another SOC.
DOUBTFUL_V, DOUBTFUL_SOC = 0.01, 0.02
# A rested voltage so far above or below the OCV is not of this cell, or of another temperature.
BEYOND_OCV_V = 0.005
FEWEST_SAMPLES = 10


@dataclass(frozen=True)
class Window:
    """Which part of a record is simulated, where errors count, and what is known of its start.

    The simulation starts at `start_time_s` (the file's own clock) or at the last sample of the
    last block of step `start_after_step`, with `initial_soc` there. Errors count at the samples
    of `score_steps`, between `score_from_s` and `score_to_s`, and at states of charge within
    `score_soc`; by default at all of them. `rest_current_a` overrides the current below which the
    cell counts as resting; `initial_direction` is the last current before the record, +1 charging,
    -1 discharging; `capacity_ah` is the cell's when the record was measured, by default that of the
    cell model. Raises `InputError` where these contradict each other.
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

    def __post_init__(self):
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
        for name in ("rest_current", "capacity"):
            value = getattr(self, f"{name}_a" if name == "rest_current" else f"{name}_ah")
            if value is not None and not 0 < value < np.inf:
                raise InputError(f"`{name}` {value} must be positive")
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
        )


# How the direction before the start is known: given; from the load before it; from a start at full
# or empty; because a fit with the other is worse; or not at all.
DirectionSource = Literal["given", "load before", "full or empty", "better fit", "assumed"]


@dataclass(frozen=True)
class Start:
    """The state in which a simulation starts, and where that is known from.

    `voltage_v` and `row` are those of the rested sample that the SOC comes from. `direction` is the
    last current before the start, +1 charging, -1 discharging; where both were tried, the RMSE
    with the other is `other_rmse_v`.
    """

    soc: float
    soc_source: Literal["given", "rested voltage"]
    direction: Literal[-1, 1]
    direction_source: DirectionSource
    row: int
    voltage_v: float
    other_rmse_v: float | None = None


@dataclass(frozen=True, eq=False)
class PreparedRecord:
    """The simulated span of one record, first to last scored sample.

    `source_v` is the open-circuit voltage with the circuit's hysteresis term, a dynamic one
    standing still; `direction` the last direction of the current (+1 charging, -1 discharging).
    `hysteresis_amplitude_v` is None for circuits without dynamic hysteresis.
    """

    record: Record
    circuit: str
    window: Window
    start: Start
    first: int
    soc: Float[np.ndarray, "simulated"]
    direction: Float[np.ndarray, "simulated"]
    source_v: Float[np.ndarray, "simulated"]
    hysteresis_amplitude_v: Float[np.ndarray, "simulated"] | None
    scored: Bool[np.ndarray, "simulated"]
    rest_current_a: float
    capacity_ah: float
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

    def simulation_input(
        self, shortest_tau_s: float, highest_gamma: float | None = None
    ) -> SimulationInput:
        """The device arrays of this span, exact for time constants from `shortest_tau_s` on.

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
            hysteresis_input=jnp.asarray(toward - self.start.direction),
            intervals=Intervals.gather(passed, 1 / highest_gamma, 0.0),
        )


def prepare_record(
    record: Record, cell: CellModel, circuit: str, window: Window | None = None
) -> PreparedRecord:
    """A record made ready. Raises `InputError` where window, SOC or OCV range do not fit it."""
    window = window or Window()
    capacity_ah = window.capacity_ah or cell.capacity_ah
    rest_a = window.rest_current_a or rest_current_a(record, capacity_ah)
    first = first_sample(record, window)
    start = _start(record, cell, window, first, rest_a)
    soc = soc_along(record, capacity_ah, first, start.soc)
    scored = scored_samples(record, window, first, soc)
    warnings = _start_warnings(record, cell, window, first, start, rest_a)
    warnings += _check_soc(record, cell, capacity_ah, soc, scored)
    _require_positive_voltage(record, scored)
    if not np.any(record.current_a[scored]):
        raise InputError(
            f"{record.name}: every current that counts is zero, so nothing can be learned; give a "
            "record under load, or widen the window"
        )

    span = slice(first, int(np.flatnonzero(scored)[-1]) + 1)
    if np.count_nonzero(scored) < FEWEST_SAMPLES or span.stop - first < FEWEST_SAMPLES:
        raise InputError(
            f"{record.name}: fewer than {FEWEST_SAMPLES} samples are left to score; widen the "
            "window"
        )
    direction = current_direction(record, rest_a, start.direction)[span]
    model = get_circuit(circuit)
    source_v = model.source_voltage(cell, soc[span], direction)
    amplitude_v = None
    if model.hysteresis_amplitude is not None:
        amplitude_v = model.hysteresis_amplitude(cell, soc[span])
        source_v = source_v + start.direction * amplitude_v
    return PreparedRecord(
        record=record,
        circuit=circuit,
        window=window,
        start=start,
        first=first,
        soc=soc[span],
        direction=direction,
        source_v=source_v,
        hysteresis_amplitude_v=amplitude_v,
        scored=scored[span],
        rest_current_a=rest_a,
        capacity_ah=capacity_ah,
        warnings=tuple(warnings),
    )


def other_direction(prepared: PreparedRecord, cell: CellModel) -> PreparedRecord | None:
    """The same record coming from the other direction, where that is open and changes anything."""
    if prepared.start.direction_source != "assumed":
        return None
    window = replace(prepared.window, initial_direction=-prepared.start.direction)
    try:
        other = prepare_record(prepared.record, cell, prepared.circuit, window)
    except InputError:
        return None
    start = replace(other.start, direction_source="assumed")
    other = replace(other, window=prepared.window, start=start)
    is_same = np.array_equal(other.source_v, prepared.source_v) and other.start.soc == (
        prepared.start.soc
    )
    return None if is_same else other


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


def soc_along(
    record: Record, capacity_ah: float, first: int, soc: float
) -> Float[np.ndarray, "samples"]:
    """SOC by ampere-hours, from `soc` at the sample `first` (Li et al., 2023, Eq. 20)."""
    discharged_ah = record.discharged_ah
    return soc - (discharged_ah - discharged_ah[first]) / capacity_ah


def require_changing_voltage(prepared: PreparedRecord) -> None:
    """Raise `InputError` where the scored voltage is flat: errors on it mean nothing."""
    voltage_v = prepared.voltage_v[prepared.scored]
    if np.ptp(voltage_v) == 0:
        raise InputError(
            f"{prepared.record.name}: the voltage is {voltage_v[0]:g} V at every scored sample; "
            "widen the window or check the file"
        )


def _start(record: Record, cell: CellModel, window: Window, first: int, rest_a: float) -> Start:
    """The state at the start. Raises `InputError` where the SOC is neither given nor shown.

    A rested cell is on the OCV branch of the direction it comes from.
    """
    direction, source = _direction_before(record, window, first, rest_a)
    row, voltage_v = int(record.row[first]), float(record.voltage_v[first])
    if window.initial_soc is not None:
        soc, soc_source = window.initial_soc, "given"
    else:
        _require_rest(record, first, rest_a)
        soc, soc_source = _soc_from_rest(record, cell, first, direction), "rested voltage"
    if source == "assumed" and min(soc, 1 - soc) < NEAR_AN_END:
        direction, source = (1 if soc > 0.5 else -1), "full or empty"
        if soc_source == "rested voltage":
            soc = _soc_from_rest(record, cell, first, direction)
    return Start(soc, soc_source, direction, source, row, voltage_v)


def _direction_before(
    record: Record, window: Window, first: int, rest_a: float
) -> tuple[Literal[-1, 1], DirectionSource]:
    """The last current before the start; where the record has none, the given one or a guess."""
    # The current of the start's own sample flows before it only under a backward hold.
    before = slice(0, first + 1 if record.hold.value == "backward" else first)
    moving = np.flatnonzero(~is_rested(record, rest_a)[before] & (record.current_a[before] != 0))
    if len(moving) and first > 0:
        return -1 if record.current_a[moving[-1]] > 0 else 1, "load before"
    if window.initial_direction is not None:
        return window.initial_direction, "given"
    # Of a record that starts under load nothing is known but the load.
    return -1 if record.current_a[first] >= rest_a else 1, "assumed"


def _require_rest(record: Record, first: int, rest_a: float) -> None:
    """Raise `InputError` where the cell has not rested at the start, as far as the record shows."""
    row = record.row[first]
    is_loaded = ~is_rested(record, rest_a)[: first + 1]
    if is_loaded[first]:
        raise InputError(
            f"{record.name}: the simulation starts at row {row} under "
            f"{record.current_a[first]:+.3g} A (discharge positive), so the voltage there does "
            "not tell the state of charge; give `initial_soc`"
        )
    if np.any(is_loaded):
        rest_s = record.time_s[first] - record.time_s[np.flatnonzero(is_loaded)[-1]]
        if rest_s < MINIMUM_REST_S:
            raise InputError(
                f"{record.name}: at row {row}, where the simulation starts, the cell has rested "
                f"for {rest_s:.0f} s only, and its voltage tells the state of charge after "
                f"{MINIMUM_REST_S:.0f} s; give `initial_soc`"
            )


def _soc_from_rest(record: Record, cell: CellModel, first: int, direction: int) -> float:
    try:
        return cell.soc_from_rest_voltage(float(record.voltage_v[first]), direction)
    except InputError as problem:
        raise InputError(f"{record.name}: row {record.row[first]}: {problem}") from problem


def _start_warnings(
    record: Record, cell: CellModel, window: Window, first: int, start: Start, rest_a: float
) -> list[str]:
    """What a rested voltage at the start has against the SOC that is taken for it."""
    try:
        _require_rest(record, first, rest_a)
    except InputError:
        return []
    branch = cell.charge if start.direction > 0 else cell.discharge
    low_v, high_v = (float(branch(np.array([end]))[0]) for end in cell.soc_range)
    beyond_v = max(start.voltage_v - high_v, low_v - start.voltage_v)
    place = f"{record.name}: the cell rests at {start.voltage_v:.4f} V at row {start.row}"
    if beyond_v > BEYOND_OCV_V:
        return [
            f"{place}, {1e3 * beyond_v:.0f} mV beyond its OCV of {low_v:.4f} to {high_v:.4f} V; "
            "check that the OCV test is of this cell and temperature"
        ]
    if window.initial_soc is None:
        return []
    try:
        ends = [cell.soc_from_rest_voltage(start.voltage_v, direction) for direction in (-1, 1)]
    except InputError:  # far from where the other branch ends
        return []
    given_v = [float(curve(np.array([start.soc]))[0]) for curve in (cell.discharge, cell.charge)]
    is_far = not min(given_v) - DOUBTFUL_V <= start.voltage_v <= max(given_v) + DOUBTFUL_V
    if is_far and not min(ends) - DOUBTFUL_SOC <= start.soc <= max(ends) + DOUBTFUL_SOC:
        soc = ends[1 if start.direction > 0 else 0]
        return [
            f"{place}, which tells a state of charge of {soc:.3f}, but `initial_soc` is "
            f"{start.soc:g}; leave it out to take the rested voltage's"
        ]
    return []


def _require_positive_voltage(record: Record, scored: Bool[np.ndarray, "samples"]) -> None:
    """Raise `InputError` where a scored voltage is no cell's; relative errors divide by it."""
    wrong = np.flatnonzero(scored & (record.voltage_v <= 0))
    if len(wrong):
        raise InputError(
            f"{record.name}: row {record.row[wrong[0]]} is scored at "
            f"{record.voltage_v[wrong[0]]:g} V, which is no cell's voltage ({len(wrong)} such "
            "samples); delete the row, or leave it out with `score_from`, `score_to` or "
            "`score_steps`"
        )


def _check_soc(
    record: Record, cell: CellModel, capacity_ah: float, soc: np.ndarray, scored: np.ndarray
) -> list[str]:
    low, high = cell.soc_range
    beyond = np.maximum(low - soc, soc - high)
    outside = scored & (beyond > 0)
    farthest = float(np.max(beyond, where=scored, initial=0))
    if farthest < NO_MARGIN:
        return []
    far = np.flatnonzero(scored & (beyond > OCV_MARGIN))
    if len(far):
        raise InputError(
            f"{record.name}: row {record.row[far[0]]} is scored at a state of charge of "
            f"{soc[far[0]]:.3f}, but the OCV points span only {low:.3f} to {high:.3f}; check "
            f"`capacity` ({capacity_ah:.4g} Ah) and `initial_soc`, give an OCV test that "
            "reaches there, or leave those samples out with `score_soc`, `score_steps` or "
            "`score_to`"
        )
    return [
        f"{record.name}: {np.count_nonzero(outside)} of {np.count_nonzero(scored)} scored samples "
        f"lie up to {farthest:.2g} SOC outside the OCV points ({low:.3f} to {high:.3f}), where the "
        "open-circuit voltage is held constant"
    ]


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
