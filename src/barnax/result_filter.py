"""A result's circuit as the model of a filter, with its expected errors on other records."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .cell.parameters import OCV_CORRECTION
from .errors import InputError, require_choice
from .filters import Kind
from .filters.model import CAPACITY, GRID, OFFSET, ErrorModel, FilterModel, make_model
from .fit.registration import FULL_SD
from .inputs import InputFile, require_records, require_voltages, source_of, warnings_about
from .model.window import Window, merged
from .notices import Notice
from .plan import planned_window
from .records import Given, Record, Source
from .results import Result
from .settings import Reading

# No tester resolves less, and a measurement without any noise would be trusted without limit.
LEAST_NOISE_V = 1e-4
# Prior standard deviation of a capacity, relative; resistances and times have that of their fit.
CAPACITY_SD = 0.05
LEAST_SD, LARGEST_SD = 0.02, 0.5


@dataclass(frozen=True)
class FilterSettings:
    """The Kalman filter that replays a record.

    Args:
        kind: A Gaussian sum of extended Kalman filters ("sum"), one extended ("ekf") or one
            unscented ("ukf") Kalman filter.
        estimate: Parameters to estimate: "offset" (of the current), "capacity", and resistances and
            time constants such as "R0" or "tau1".
        soc_sd: Standard deviation of the SOC at the start, a fraction.
        tables: Use the tables over SOC if the result has them.

    Raises `InputError` for an unknown kind and for `soc_sd` outside 0 to 1.
    """

    kind: Kind = "sum"
    estimate: tuple[str, ...] = (OFFSET, CAPACITY)
    soc_sd: float = 0.15
    tables: bool = True

    def __post_init__(self):
        require_choice("filter", self.kind, ("sum", "ekf", "ukf"))
        if not 0 < self.soc_sd <= 1:
            raise InputError(f"soc_sd {self.soc_sd:g} must be above 0 and at most 1")


# The errors of a circuit on a record to which it was not fitted, as multiples of the residuals on
# its own: from sample to sample, lasting for a second at least, and over 100 s. Chosen on two
# drives of one cell at 0, 25 and 45 degC, each from the other, and one LFP drive
# (`benchmarks.filters`): half or twice of each keeps RMS and band within a few tenths.
WHITE, WHITE_S = 4.0, 1.0
LASTING, LASTING_S = 3.0, 100.0
# The share of half the measured gap by which the OCV may be off: that of a circuit without
# hysteresis moves within the gap, and the gap of a slow sweep is not that of a drive. The rate of a
# hysteresis that no record has turned is undetermined.
HYSTERESIS, UNTURNED = 0.5, 0.75


def window_of(
    result: Result,
    record: Record | Source,
    source: Source | Record,
    reading: Reading,
    chosen: Window | None = None,
) -> Window:
    """The window of a record: the chosen one; else its own, as registered, if its content is among
    the result's inputs; else that of a plan for its source. The capacity and the rest current are
    by default those common to all records of the result."""
    windows = (part.window for part in result.inputs if part.window and part.is_of(record))
    window = chosen or next(windows, None)
    if window is None:
        return planned_window(source, result.cell, reading, result.common_window)
    return merged(result.common_window, window)


def read_for(
    result: Result, given: Given, chosen: Window | None, reading: Reading
) -> tuple[Record, Window, list[Notice]]:
    """A record for a result's circuit, its window, and the warnings of the checks."""
    source = given if isinstance(given, Record) else source_of(given, {}, reading)
    require_records(reading.lags_s, {source.name})
    file = InputFile.of(source, "validation", reading)
    require_voltages([file.content])
    window = window_of(result, file.content, source, reading, chosen)
    warnings = warnings_about([file], result.cell, None, window, reading, result.measured_at)
    return file.content, window, warnings


def axis_sd_of(result: Result, capacity_ah: float) -> float:
    """The standard deviation between the SOC counted over a capacity and that of the OCV.

    This is the scatter of the SOC called full and, if the records identified on were registered on
    the OCV test because their charge contradicts it, the effect of a capacity other than theirs
    over the whole axis.
    """
    windows = (part.window for part in result.inputs if part.window and part.window.registration)
    off = [abs(capacity_ah / window.capacity_ah - 1) for window in windows if window.capacity_ah]
    return float(np.hypot(FULL_SD, max(off, default=0.0) / np.sqrt(3)))


def error_model_of(result: Result) -> ErrorModel:
    """The error model of an identification.

    White and lasting parts are multiples of the residuals in a tenth of SOC. The bias is that of
    the OCV: the standard error and the bias of its correction at a node, which allow for the
    correlation of the residuals, and beyond the visited nodes a walk by its median step from node
    to node. Residuals alone would underestimate it, because the correction was fitted to them. A
    circuit without a correction has its residuals as lasting errors. The uncertainty of the
    hysteresis is added.

    Raises `InputError` for a result without an assessment.
    """
    fit = result.fit
    if result.constant.assessment is None:
        raise InputError(
            "this result has no residual statistics, which set the filter's noise; "
            "identify again with `trust` 'basic'"
        )
    bands = result.fits.by_soc
    # Outside the range of the fit its nearest error is used; a result may have none by SOC.
    by_soc = {((band.low or 0.0) + (band.high or 1.0)) / 2: band.rmse_v for band in bands}
    by_soc = by_soc or {0.5: result.constant.metrics.identification.rmse_v}
    residual_v = np.interp(GRID, list(by_soc), list(by_soc.values()))
    residual_v = np.maximum(residual_v, LEAST_NOISE_V)
    bias_v = LASTING * residual_v
    determined = [each for each in fit.of_table(OCV_CORRECTION) if each.low is not None]
    if determined:
        soc = np.array([interval.soc for interval in determined])
        bias_v = np.interp(
            GRID, soc, [np.hypot(interval.standard_error, interval.bias) for interval in determined]
        )
        nodes = np.array(fit.tables.nodes)
        behind = np.interp(GRID, nodes, np.arange(len(nodes)))
        behind -= np.clip(behind, *np.interp(soc[[0, -1]], nodes, np.arange(len(nodes))))
        values = [interval.value for interval in determined]
        step_v = np.median(np.abs(np.diff(values, prepend=values[:1])))
        bias_v = np.hypot(bias_v, step_v * np.sqrt(np.abs(behind)))
    is_turned = result.over is None or fit.tables.gamma is None or fit.determines_rate
    share = HYSTERESIS if is_turned else UNTURNED
    half_v = result.cell_at().branch_gap_v(np.clip(GRID, 0.0, 1.0)) / 2
    return ErrorModel(
        WHITE,
        (LASTING_S,),
        (LASTING,),
        soc=tuple(GRID.tolist()),
        scale=tuple(residual_v.tolist()),
        bias_v=tuple(np.hypot(bias_v, share * half_v).tolist()),
        white_s=WHITE_S,
        axis_sd=FULL_SD,
    )


def model_of(
    result: Result, slow: Sequence[str] = (), capacity_ah: float | None = None
) -> FilterModel:
    """The model of a stored result, which counts with another capacity than its cell's if one is
    given. Call inside float64.

    `slow` are the parameters to estimate. The prior deviation of an offset is the current below
    which the cell counts as resting, that of a capacity `CAPACITY_SD`, and that of the others the
    one of their fit, between 2 and 50 %. Raises `InputError` for one that the circuit does not
    have, and for a result without an assessment.
    """
    errors, cell = error_model_of(result), result.cell_at()
    if capacity_ah is not None:
        cell = replace(cell, capacity_ah=capacity_ah)
        errors = replace(errors, axis_sd=axis_sd_of(result, capacity_ah))
    fitted = {
        fact.name.partition(" [")[0]: fact.standard_error / fact.value if fact.value else None
        for fact in result.without_tables().fit.constant_facts
    }
    rest_a, slow_sd = result.start_rest_current_a, []
    choices = [OFFSET, CAPACITY, *(name for name in fitted if name[0] in "Rt")]
    for name in slow:
        require_choice("estimate", name, choices)
        relative = float(np.clip(fitted.get(name) or LEAST_SD, LEAST_SD, LARGEST_SD))
        slow_sd.append({OFFSET: rest_a, CAPACITY: CAPACITY_SD}.get(name, relative))
    return make_model(
        cell,
        result.model,
        result.circuit_parameters,
        errors,
        rest_current_a=rest_a,
        slow=slow,
        slow_sd=slow_sd,
    )
