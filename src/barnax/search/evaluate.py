"""One circuit simulated on records, with its errors, and the scored samples of several records
joined."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from ..cell import CellModel, CircuitParameters, get_circuit
from ..cell.curves import KNOTS
from ..cell.parameters import HALF_HYSTERESIS, OHMIC
from ..cell.soc_axis import is_above
from ..cell.tables import hats
from ..display import Brief
from ..errors import InputError, attempt
from ..metrics import TO_SD, Metrics, measure, t_quantile
from ..model.prepared import PreparedRecord, prepare_record
from ..model.reference import errors_along, simulate_circuit
from ..model.window import Window
from ..notices import Notice
from ..records import Record
from ..settings import MAX_MOVED_SOC

# The shift of a start from which its effect is computed.
PROBE_SOC = 0.002
# With fewer current steps nothing can be said about R0.
FEWEST_STEPS = 3
# A lag is looked for within this many samples.
LAG_SAMPLES = 0.1


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation(Brief):
    """A circuit simulated on a record, and its errors.

    Attributes:
        prepared: The record in its window.
        simulated_v: The terminal voltage at every simulated sample.
        warnings: What is doubtful about a record to validate on, with what to do.
        registered: How far its start would have to move for the least error, in SOC, and the RMSE
            in V from there.
    """

    prepared: PreparedRecord
    simulated_v: Float[np.ndarray, "simulated"]
    warnings: tuple[Notice, ...] = ()
    registered: tuple[float, float] | None = None

    @property
    def error_v(self) -> Float[np.ndarray, "simulated"]:
        """Measured minus simulated voltage."""
        return self.prepared.voltage_v - self.simulated_v

    @cached_property
    def metrics(self) -> Metrics:
        """Errors over the scored samples."""
        soc, rmse_v = self.registered or (None, None)
        name = self.prepared.record.name
        return pooled([self], name, start_moved_soc=soc, registered_v=rmse_v)


@dataclass(frozen=True, eq=False, repr=False)
class Evaluations(Brief):
    """A circuit simulated on records.

    Attributes:
        identification: On those identified on.
        validation: On those validated on.
    """

    identification: tuple[Evaluation, ...]
    validation: tuple[Evaluation, ...] = ()

    @classmethod
    def of(
        cls,
        evaluated: Callable[[PreparedRecord], Evaluation],
        identified: Sequence[PreparedRecord],
        validated: Sequence[PreparedRecord],
    ) -> "Evaluations":
        """The evaluations of a circuit; on a validation record from the better direction and
        start."""
        others = [
            with_registered(evaluate_from_either(prepared, evaluated), evaluated)
            for prepared in validated
        ]
        return cls(tuple(map(evaluated, identified)), tuple(others))


def evaluate(prepared: PreparedRecord, parameters: CircuitParameters) -> Evaluation:
    """A circuit simulated on a prepared record, with its errors.

    Args:
        prepared: The record in its window, such as one of a problem.
        parameters: The circuit.

    Raises `InputError` if the measured voltage is constant.
    """
    from ..model.problem import require_changing_voltage

    require_changing_voltage(prepared)
    simulated_v = simulate_circuit(prepared, parameters)
    return Evaluation(prepared, simulated_v)


def both_directions(prepared: PreparedRecord) -> tuple[PreparedRecord, PreparedRecord | None]:
    """The record, and the same record from the other direction, if that is open.

    If the other one changes nothing, there is none, and the record says so.
    """
    if prepared.start.direction_source != "assumed":
        return prepared, None
    window = replace(prepared.window, initial_direction=-prepared.start.direction)
    given = prepared.record, prepared.cell, prepared.circuit
    other = attempt(prepare_record, *given, window)
    if isinstance(other, InputError):
        return prepared, None
    if np.array_equal(prepared.source_v, other.source_v) and prepared.start.soc == other.start.soc:
        start = replace(prepared.start, direction_source="without effect")
        return replace(prepared, start=start), None
    start = replace(other.start, direction_source="assumed")
    return prepared, replace(other, window=prepared.window, start=start)


def evaluate_from_either(
    prepared: PreparedRecord, evaluated: Callable[[PreparedRecord], Evaluation]
) -> Evaluation:
    """A circuit on a record it was not fitted to, from the direction that fits better if it is
    open."""
    prepared, other = both_directions(prepared)
    given = evaluated(prepared)
    if other is None:
        return given
    tried = evaluated(other)
    best, rest = (tried, given) if tried.metrics.rmse_v < given.metrics.rmse_v else (given, tried)
    return replace(best, prepared=best.prepared.fitting_better(rest.metrics.rmse_v))


def with_registered(
    evaluation: Evaluation, evaluated: Callable[[PreparedRecord], Evaluation]
) -> Evaluation:
    """The evaluation with the gain of moving the start, by a Gauss-Newton step, because the error
    is nearly linear in it. If the step leaves the OCV, or gains nothing, the start remains."""
    prepared = evaluation.prepared

    def moved(soc: float) -> Evaluation | None:
        record = prepared.registered(prepared.start.soc + soc, prepared.capacity_ah)
        return None if record is None else evaluated(record)

    stays = replace(evaluation, registered=(0.0, evaluation.metrics.rmse_v))
    # Towards the middle, where the OCV continues.
    step = PROBE_SOC if prepared.start.soc < 0.5 else -PROBE_SOC
    probed = moved(step)
    if probed is None:
        return stays
    probed_v, given_v = _in_both(probed, evaluation)
    slope_v = (probed_v - given_v) / step
    size = float(slope_v @ slope_v)
    soc = -float(slope_v @ given_v) / size if size else 0.0
    soc = min(max(soc, -MAX_MOVED_SOC), MAX_MOVED_SOC)
    shifted = moved(soc)
    if shifted is None:
        return stays
    before, after = _in_both(evaluation, shifted)
    # Other samples may then be scored.
    is_less = float(after @ after) < float(before @ before)
    is_less &= shifted.metrics.rmse_v < evaluation.metrics.rmse_v
    return replace(evaluation, registered=(soc, shifted.metrics.rmse_v)) if is_less else stays


def _in_both(*evaluations: Evaluation) -> Iterator[Float[np.ndarray, "scored"]]:
    """The errors at the samples that both score, which can depend on the SOC."""
    count = min(len(evaluation.prepared.scored) for evaluation in evaluations)
    scored = np.all([evaluation.prepared.scored[:count] for evaluation in evaluations], axis=0)
    return (evaluation.error_v[:count][scored] for evaluation in evaluations)


def step_warnings(
    evaluation: Evaluation, parameters: CircuitParameters, least_share: float = 1.0
) -> Iterator[Notice]:
    """A notice if R0 is larger than the record shows after current steps; with a law of
    resistances, larger than the circuit's response to them.

    Two intervals are compared: the lower end of R0, of which it is `least_share`, and the 95 %
    interval of the median over all steps. A single step is no limit, because it includes the
    relaxation of earlier loads.
    """
    prepared = evaluation.prepared
    before, after = prepared.steps
    if len(before) < FEWEST_STEPS:
        return
    step_a, after_s = (
        values[after] - values[before] for values in (prepared.current_a, prepared.time_s)
    )
    simulated_ohm, shown_ohm = (
        (voltage_v[before] - voltage_v[after]) / step_a
        for voltage_v in (evaluation.simulated_v, prepared.voltage_v)
    )
    has_law = parameters.dependence is not None
    r0_ohm = simulated_ohm if has_law else parameters.at(OHMIC, prepared.soc[before])
    above_ohm = least_share * r0_ohm - shown_ohm
    median_ohm = float(np.median(above_ohm))
    # For a median of normal values, and a robust one: steps of an empty cell scatter far more.
    freedom, spread_ohm = len(before) - 1, TO_SD * np.median(np.abs(above_ohm - median_ohm))
    error_ohm = math.sqrt(math.pi / 2 / freedom) * float(spread_ohm)
    if median_ohm > t_quantile(freedom) * error_ohm:
        facts = {"own_ohm": simulated_ohm, "shown_ohm": shown_ohm, "after_s": after_s}
        medians = {name: float(np.median(values)) for name, values in facts.items()}
        yield Notice("answer.r0-above-steps", medians, prepared.record.name)


def pooled(evaluations: Sequence[Evaluation], name: str, **more: Any) -> Metrics:
    """The metrics over all scored samples of several records, under one name, with `more` of their
    fields."""
    scored = [(one, one.prepared.scored) for one in evaluations]
    measured_v = np.concatenate([one.prepared.voltage_v[here] for one, here in scored])
    simulated_v = np.concatenate([one.simulated_v[here] for one, here in scored])
    is_high = is_above(np.concatenate([one.prepared.soc[here] for one, here in scored]))
    above_v = (measured_v - simulated_v)[is_high]
    more["rmse_above_10_soc_v"] = float(np.sqrt(np.mean(above_v**2))) if len(above_v) else None
    return measure(measured_v, simulated_v, record=name, **more)


def validate(
    record: Record,
    cell: CellModel,
    circuit: str,
    parameters: CircuitParameters,
    window: Window | None = None,
) -> Evaluation:
    """Identified parameters simulated on another record of the same cell, with their errors.

    Args:
        record: The record.
        cell: A cell from `characterize`.
        circuit: Name of the circuit, such as "so-rc".
        parameters: The circuit's parameters.
        window: The part of the record that is simulated; by default all of it.

    Raises `InputError` if the window or the range of the OCV does not fit the record.
    """
    return evaluate(prepare_record(record, cell, circuit, window or Window()), parameters)


def open_starts(
    prepared_records: Sequence[PreparedRecord],
) -> tuple[Float[np.ndarray, "scored starts"], Float[np.ndarray, "starts"]]:
    """Columns that move the errors by one standard error of each start estimated from voltages, and
    each start's distance from its estimate, in standard errors."""
    # Half the digits suffice for an error of an error.
    by_start_v = [
        -float(prepared.start.soc_sd)
        * prepared.cell.ocv_slope(prepared.soc[prepared.scored])[:, None].astype(np.float32)
        for prepared in prepared_records
    ]
    columns = np.asarray(block_diag(*by_start_v))
    is_open = np.any(columns != 0, axis=0)
    shifts_sd = np.zeros(len(prepared_records))
    for number, prepared in enumerate(prepared_records):
        moved = prepared.window.registration
        if moved is not None and moved.given_sd:
            shifts_sd[number] = (prepared.start.soc - moved.given_soc) / moved.given_sd
    return columns[:, is_open], shifts_sd[is_open]


def nuisance_columns(
    prepared_records: Sequence[PreparedRecord], parameters: CircuitParameters
) -> tuple[Float[np.ndarray, "scored nuisances"], Float[np.ndarray, "nuisances"]]:
    """Such columns for all given quantities other than voltages: the starts, the hysteresis voltage
    of the OCV test at each of its knots, and lags, given or not."""
    by_start_v, shifts_sd = open_starts(prepared_records)
    columns = [by_start_v]
    # For a long record there is no memory for columns of zeros.
    is_fitted = HALF_HYSTERESIS in parameters.tables
    if get_circuit(prepared_records[0].circuit).has_hysteresis and not is_fitted:
        by_hysteresis_v = np.concatenate(
            [_by_hysteresis_v(prepared, parameters) for prepared in prepared_records]
        )
        columns.append(by_hysteresis_v[:, np.any(by_hysteresis_v != 0, axis=0)])
    if any(prepared.record.voltage_lag_s for prepared in prepared_records):
        lags_v = (_by_lag_v(prepared)[:, None] for prepared in prepared_records)
        by_lag_v = np.asarray(block_diag(*(lag_v.astype(np.float32) for lag_v in lags_v)))
        columns.append(by_lag_v[:, np.any(by_lag_v != 0, axis=0)])
    further = sum(column.shape[1] for column in columns[1:])
    return np.hstack(columns), np.append(shifts_sd, np.zeros(further))


def _by_hysteresis_v(
    prepared: PreparedRecord, parameters: CircuitParameters
) -> Float[np.ndarray, "scored knots"]:
    """The derivatives of the errors by the hysteresis voltage at every knot, whose standard error
    is its own size: sweeps include their drop, and at the ends rests of turning points belong to
    both branches.

    Without turns of the current it is part of the OCV, so only the deviation from the mean counts.
    """
    soc = prepared.soc[prepared.scored]
    gap_v = get_circuit(prepared.circuit).hysteresis.gap_v(prepared.cell, soc)
    state = hysteresis_state(prepared, parameters)[prepared.scored]
    sd_v = math.sqrt(np.mean(gap_v**2))
    columns_v = -sd_v / 2 * (state - np.mean(state))[:, None] * hats(soc, KNOTS)
    return columns_v.astype(np.float32)


def hysteresis_state(
    prepared: PreparedRecord, parameters: CircuitParameters
) -> Float[np.ndarray, "simulated"]:
    """The state in [-1, 1] that multiplies the hysteresis voltage."""
    if parameters.gamma is None:
        hysteresis = get_circuit(prepared.circuit).hysteresis
        return hysteresis.state(prepared.soc, prepared.direction)
    flat = replace(prepared, hysteresis_amplitude_v=np.ones_like(prepared.soc))
    none = replace(prepared, hysteresis_amplitude_v=np.zeros_like(prepared.soc))
    turned_v = errors_along(none, parameters) - errors_along(flat, parameters)
    return prepared.start.direction + turned_v


def _by_lag_v(prepared: PreparedRecord) -> Float[np.ndarray, "scored"]:
    """The derivatives of the errors by a lag, given or not, through the immediate response."""
    is_late = prepared.record.voltage_lag_s != 0.0
    moved_a = np.diff(prepared.current_a, prepend=prepared.current_a[:1])
    return LAG_SAMPLES * is_late * prepared.step_ohm * moved_a[prepared.scored]


def one_clock(prepared_records: Sequence[PreparedRecord]) -> Float[np.ndarray, "scored"]:
    """Times of all scored samples, with gaps between records longer than any lag within one."""
    gap_s = max(
        prepared.scored_duration_s + 2 * prepared.median_interval_s for prepared in prepared_records
    )
    times, start_s = [], 0.0
    for prepared in prepared_records:
        times.append(prepared.time_s[prepared.scored])
        # In place: a long record leaves no memory for copies.
        times[-1] += start_s - times[-1][0]
        start_s = times[-1][-1] + gap_s
    return np.concatenate(times)
