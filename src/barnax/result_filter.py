"""A result's circuit as the model of a filter, with its errors as the fit left them."""

from collections.abc import Sequence

import numpy as np

from .cell.tables import OCV_CORRECTION
from .errors import InputError
from .filters.model import CAPACITY, OFFSET, ErrorModel, FilterModel, make_model
from .results import Result

TENTHS = (np.arange(10) + 0.5) / 10
# No tester resolves less, and a measurement without any noise would be believed without limit.
LEAST_NOISE_V = 1e-4
# Parts of the error weaker than this share of the whole are left out: each costs a state.
WEAKEST_PART = 0.01
# Prior standard deviation of a capacity, relative; resistances and times have that of their fit.
CAPACITY_SD = 0.05
LEAST_SD, LARGEST_SD = 0.02, 0.5


def errors_of(result: Result) -> ErrorModel:
    """The error model of an identification; with tables over SOC, as large as theirs at every SOC.

    The parts are those of the noise fitted to the residuals, the white one as large as the
    residuals themselves: what the fit leaves for white is under a millivolt, and a filter that
    believed neighboring samples so closely would read a wrong hysteresis or resistance at every
    turn of the current for a change of SOC.

    A correction of the open-circuit voltage is counted as an error of its own size: by that the
    OCV test and the record identified on disagree, and on another record either may hold. The
    errors left on the one record, which it was fitted to, would say that it is known.

    The size in a tenth of SOC is that over it and its neighbors. What a circuit misses of the
    OCV changes sign over SOC, and so is small by itself in some tenth; on another drive it
    crosses zero elsewhere, and a filter that believed the voltage there would read the
    difference for a capacity.

    Raises `InputError` for a result without an assessment.
    """
    constant = result.constant
    if constant.assessment is None:
        raise InputError(
            "this result has no residual statistics, which set the filter's noise; "
            "identify again with `trust` 'basic'"
        )
    noise = constant.assessment.uncertainty.noise
    rmse_v = constant.metrics.identification.rmse_v
    stored = constant.assessment.diagnostics if result.tables is None else result.tables
    bands = stored.by_soc
    total_v2 = sum(sd**2 for sd in noise.sd_v)
    parts = [
        each
        for each in zip(noise.correlation_s, noise.sd_v, strict=True)
        if each[0] and each[1] ** 2 > WEAKEST_PART**2 * total_v2
    ]
    error_v = {round(10 * (each.low or 0.0)): each.rmse_v for each in bands}
    if result.tables is not None and OCV_CORRECTION in result.tables.fit.tables.tables:
        moved_v = result.tables.fit.tables.at(OCV_CORRECTION, TENTHS)
        error_v = {at: float(np.hypot(each, moved_v[at])) for at, each in error_v.items()}
    # Where the fit has seen nothing, its error as a whole has to do.
    tenths = np.array([error_v.get(tenth, rmse_v) / rmse_v for tenth in range(10)])
    around = [tenths[max(tenth - 1, 0) : tenth + 2] for tenth in range(10)]
    return ErrorModel(
        max(rmse_v, LEAST_NOISE_V),
        *(zip(*parts, strict=True) if parts else ((), ())),
        soc=tuple(TENTHS.tolist()),
        scale=tuple(float(np.sqrt(np.mean(each**2))) for each in around),
    )


def model_of(result: Result, slow: Sequence[str] = ()) -> FilterModel:
    """The model of a stored result. Call inside float64.

    `slow` are the parameters to estimate. The prior deviation of an offset is the current below
    which the cell counts as resting, of a capacity `CAPACITY_SD`, of the others that of their fit,
    between 2 and 50 %. Raises `InputError` for one that the circuit does not have, and for a result
    without an assessment.
    """
    errors = errors_of(result)
    assert result.constant.assessment is not None, "asked above"
    fitted = {
        each.name.partition(" [")[0]: each.relative_error
        for each in result.constant.assessment.uncertainty.estimates
    }
    rest_a, slow_sd = result.start_rest_current_a, []
    known = [OFFSET, CAPACITY, *(name for name in fitted if name[0] in "Rt")]
    for name in slow:
        if name not in known:
            raise InputError(f"`estimate` {name!r} is not known; there are {', '.join(known)}")
        relative = float(np.clip(fitted.get(name) or LEAST_SD, LEAST_SD, LARGEST_SD))
        slow_sd.append({OFFSET: rest_a, CAPACITY: CAPACITY_SD}.get(name, relative))
    return make_model(
        result.cell_at(),
        result.model,
        result.constant.circuit_parameters,
        errors,
        tables=None if result.tables is None else result.tables.fit.tables,
        rest_current_a=rest_a,
        slow=slow,
        slow_sd=slow_sd,
    )
