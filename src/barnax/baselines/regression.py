"""Linear methods: least squares of the circuit's difference equation, at once (LS) and recursive
(RLS), and subspaces (N4SID)."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Bool, Float

from ..cell import CircuitParameters
from ..execution import in_float64
from ..global_optimum.objective import ConstantObjective
from ..model.prepared import PreparedRecord
from ..model.problem import Problem
from ..search.evaluate import evaluate
from .method import Answer, MethodFailure, deterministic

# Intervals this close to the median, relative to it, count as equal to it; a tester's clock
# jitters.
EVEN = 0.05
# With a smaller share of the scored samples, the answer would be for another record.
LEAST_SHARE = 0.5
# R C is a product, and may miss a bound of tau by its rounding.
ROUNDING = 1e-9
# Ljung's usual range is 0.98 to 0.995; at one sample a second those forget within the slower time
# constant of a cell. This remembers a thousand samples.
FORGETTING = 0.999
SLOW_FORGETTING = 0.9999
# Variance of the first guess, in units of each scaled coefficient: uninformative.
VARIANCE = 1e6
# Samples after which the first guess is forgotten; the answer is averaged from there on.
MEMORY = round(1 / (1 - FORGETTING))
# Rows of the past and of the future per pair: twice the order is the least that can work.
HORIZON = 15
# Time constants this close together, relative to them, are one pole within rounding.
APART = 1e-6

Coefficients = Float[np.ndarray, "... coefficients"]


@dataclass(frozen=True, eq=False)
class EvenSamples:
    """Drop (source minus terminal voltage, in V) and current (in A) on an almost even clock.

    `is_row` is True for samples that, with the `lags` before them, are scored and evenly spaced, so
    that a difference equation holds there. The current flows in the interval after a sample if
    `is_forward`, else in the one before.
    """

    time_s: Float[np.ndarray, "samples"]
    drop_v: Float[np.ndarray, "samples"]
    current_a: Float[np.ndarray, "samples"]
    is_row: Bool[np.ndarray, "samples"]
    interval_s: float
    is_forward: bool
    notes: tuple[str, ...]


def even_samples(prepared: PreparedRecord, lags: int) -> EvenSamples:
    """The scored samples of a record, with those marked whose `lags` intervals are even.

    Nothing is resampled: a voltage between samples was not measured, and interpolating it biases
    the poles. Raises `MethodFailure` if too few samples are left, and for a circuit whose source
    depends on identified parameters.
    """
    if prepared.hysteresis_amplitude_v is not None:
        raise MethodFailure(
            "it needs the open-circuit voltage in advance, but a dynamic hysteresis changes it"
        )
    interval_s = np.diff(prepared.time_s)
    scored = prepared.scored
    within = scored[1:] & scored[:-1]
    if not np.any(within):
        raise MethodFailure("no scored samples follow one another")
    median_s = float(np.median(interval_s[within]))
    is_even = within & (np.abs(interval_s - median_s) <= EVEN * median_s)
    is_row = np.zeros(len(scored), bool)
    is_row[lags:] = np.lib.stride_tricks.sliding_window_view(is_even, lags).all(axis=1)
    rows, samples = np.count_nonzero(is_row), np.count_nonzero(scored)
    if rows < LEAST_SHARE * samples:
        raise MethodFailure(
            f"the clock is uneven: only {rows} of {samples} scored samples follow {lags} intervals "
            f"within {100 * EVEN:.0f} % of the median {median_s:.4g} s, and a difference equation "
            "needs one interval"
        )
    notes = ()
    if rows < samples - lags:
        notes = (f"fitted to the {rows} of {samples} scored samples that are evenly spaced",)
    return EvenSamples(
        time_s=prepared.time_s,
        drop_v=prepared.source_v - prepared.voltage_v,
        current_a=prepared.current_a,
        is_row=is_row,
        interval_s=median_s,
        is_forward=prepared.record.hold.value == "forward",
        notes=notes,
    )


def regression(
    problem: Problem,
) -> tuple[EvenSamples, Float[np.ndarray, "rows coefficients"], Float[np.ndarray, "rows"]]:
    """The samples, and columns and target of the difference equation at all valid rows.

    The columns belong to a_(n-1), ..., a_0, b_n, ..., b_0. Raises `MethodFailure` if a parameter is
    held, which a difference equation cannot represent.
    """
    if problem.bounds.fixed:
        held = ", ".join(f"{name} = {value:g}" for name, value in problem.bounds.fixed.items())
        raise MethodFailure(
            f"a regression of the difference equation cannot hold {held}; use another method, such "
            "as varpro, or leave out `fix`"
        )
    pairs = problem.bounds.pairs
    samples = even_samples(problem.prepared, pairs)
    is_row = samples.is_row[pairs:]
    columns, target = difference_equation(samples.drop_v, samples.current_a, pairs)
    return samples, columns[is_row], target[is_row]


def difference_equation(
    drop_v: Float[np.ndarray, "samples"], current_a: Float[np.ndarray, "samples"], pairs: int
) -> tuple[Float[np.ndarray, "rows coefficients"], Float[np.ndarray, "rows"]]:
    """Columns and target at every sample with at least as many samples before it as there are
    pairs."""

    def differences(values: np.ndarray, order: int) -> np.ndarray:
        return np.diff(values, order)[: len(drop_v) - pairs]

    columns = [-differences(drop_v, order) for order in range(pairs - 1, -1, -1)]
    columns += [differences(current_a, order) for order in range(pairs, -1, -1)]
    return np.stack(columns, axis=1), differences(drop_v, pairs)


def circuit_values(
    coefficients: Coefficients, samples: EvenSamples, pairs: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """R0, every pair's R and every pair's tau in s, from fast to slow, for any number of rows.

    NaN if a pole is complex, negative or unstable and so corresponds to no time constant.
    """
    a, b = coefficients[..., :pairs], coefficients[..., pairs:]
    companion = np.zeros((*a.shape[:-1], pairs, pairs))
    companion[..., 0, :] = -a
    companion[..., np.arange(1, pairs), np.arange(pairs - 1)] = 1.0
    root = np.linalg.eigvals(companion)
    is_real = np.all(np.abs(root.imag) == 0, axis=-1, keepdims=True)
    pole = np.sort(root.real, axis=-1)
    is_decay = is_real & np.all((pole > -1) & (pole < 0), axis=-1, keepdims=True)
    with np.errstate(all="ignore"):
        pole = np.where(is_decay, pole, np.nan)
        numerator = sum(b[..., order, None] * pole ** (pairs - order) for order in range(pairs + 1))
        gap = pole[..., :, None] - pole[..., None, :] + np.eye(pairs)
        step = 1.0 if samples.is_forward else 1 + pole
        r = numerator / (-pole * step * np.prod(gap, axis=-1))
        r0 = b[..., 0] - (0.0 if samples.is_forward else np.sum(-pole * r, axis=-1))
        tau_s = -samples.interval_s / np.log1p(pole)
    return r0, r, tau_s


def circuit_of(
    r0: float | np.ndarray, r: np.ndarray, tau_s: np.ndarray, gamma: float | None = None
) -> CircuitParameters:
    """The circuit with these values. Raises `MethodFailure` if no circuit has them."""
    if not np.all(np.isfinite(np.hstack([r0, r, tau_s]))):
        raise MethodFailure(
            "the difference equation it finds has complex, negative or unstable poles, which are "
            "not time constants; noise and model error cause this"
        )
    resistances = [float(value) for value in (r0, *r)]
    if min(resistances) <= 0:
        values = ", ".join(
            f"R{index} {1e3 * value:.4g} mohm" for index, value in enumerate(resistances)
        )
        raise MethodFailure(f"the difference equation it finds has a negative resistance: {values}")
    return CircuitParameters.of_tau(resistances[0], resistances[1:], tau_s, gamma)


def outside_box(parameters: CircuitParameters, problem: Problem) -> tuple[str, ...]:
    """A note if parameters lie outside the search box, which a linear method does not use."""
    values = parameters.to_dict() | parameters.named_tau_s
    outside = ", ".join(
        f"{name} = {values[name]:.4g} ({low:.4g} to {high:.4g})"
        for name, (low, high) in problem.bounds.ranges.items()
        if not low * (1 - ROUNDING) <= values[name] <= high * (1 + ROUNDING)
    )
    return (f"outside the search box, which it does not use: {outside}",) if outside else ()


def answer_of(problem: Problem, parameters: CircuitParameters, notes: tuple[str, ...]) -> Answer:
    """The one answer of a method that draws nothing and simulates only its answer."""
    rmse_v = evaluate(problem.prepared, parameters).metrics.rmse_v
    notes = (*notes, *outside_box(parameters, problem))
    return Answer(parameters, rmse_v, evaluations=0, notes=notes)


def least_squares(problem: Problem) -> Answer:
    """The circuit whose difference equation has the least sum of squared equation errors.

    One linear regression, no simulation, and no box. It minimizes the error of predicting the next
    sample from the measured ones before it, not that of a simulation: noise in the regressors
    biases the poles toward fast ones (Ljung, System Identification, 1999, section 7.3), so its RMSE
    is not minimal even if it answers. Raises `MethodFailure` if the equation corresponds to no
    circuit, or a parameter is held.
    """
    samples, columns, target = regression(problem)
    # Columns in volts, amperes and their differences span many decades.
    scale = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    coefficients = np.linalg.lstsq(columns / scale, target)[0] / scale
    parameters = circuit_of(*circuit_values(coefficients, samples, problem.bounds.pairs))
    return answer_of(problem, parameters, samples.notes)


LS = deterministic(
    "ls",
    "Batch least squares of the discretised transfer function (Ljung, 1999, section 7.3)",
    least_squares,
)


@in_float64
def recursive_least_squares(problem: Problem, *, poles: float, gains: float) -> Answer:
    """The circuit that recursive least squares tracks, averaged.

    Ljung, System Identification (1999), section 11.2, as Yang, Tang and Zhang, Energies 14 (2021)
    1054, use it for a second-order RC circuit; the first guess is zero, and `poles` and `gains` are
    the forgetting factors of a and b. `rls` has one for all. `wrls` is the weighted recursive least
    squares of Verbrugge and Koch (2006), whose parameters each have a time weighting: the variance
    is divided by the root of both coefficients' factors (Saelid and Foss, 1983). Their factors are
    for another circuit, so ours are used: the poles are forgotten ten times as slowly, because the
    time constants of a cell change less than its resistances. The answer is that of `averaged`; it
    has the same bias as `ls`. Raises `MethodFailure` if a parameter is held.
    """
    samples, columns, target = regression(problem)
    pairs = problem.bounds.pairs
    scale = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), np.finfo(float).tiny)
    factors = jnp.repeat(jnp.array([poles, gains]), jnp.array([pairs, pairs + 1]))
    tracked = _track(jnp.asarray(columns / scale), jnp.asarray(target), factors)
    values = circuit_values(np.asarray(tracked) / scale, samples, pairs)
    return averaged(problem, values, samples.notes)


def averaged(
    problem: Problem,
    tracked: tuple[np.ndarray, ...],
    notes: tuple[str, ...] = (),
    gamma: float | None = None,
) -> Answer:
    """The answer of an online method: medians over time of R0, every pair's R and every tau.

    Rows count from when the first guess is forgotten (or from half of a shorter record) if their
    values are those of a circuit; noise can make these few, and a note gives their number. Raises
    `MethodFailure` if there are none.
    """
    r0, r, tau_s = tracked
    is_circuit = np.isfinite(r0) & (r0 > 0) & np.all(np.isfinite(r) & (r > 0), axis=1)
    late = np.arange(len(r0)) >= min(MEMORY, len(r0) // 2)
    counted = late & is_circuit
    if not np.any(counted):
        raise MethodFailure(
            "the equation it tracks is not a circuit at any sample: its poles are complex, "
            "negative or unstable, or a resistance is negative"
        )
    parameters = circuit_of(
        np.median(r0[counted]),
        np.median(r[counted], axis=0),
        np.median(tau_s[counted], axis=0),
        gamma,
    ).ordered()
    note = (
        f"averaged over the {np.count_nonzero(counted)} of {np.count_nonzero(late)} samples at "
        "which its equation is a circuit"
    )
    return answer_of(problem, parameters, (note, *notes))


def update(state, row, forgetting):
    """Coefficients and their variance after one more row, of a regressor and its target."""
    (coefficients, variance), (regressor, value) = state, row
    variance = variance / forgetting
    seen = variance @ regressor
    gain = seen / (1 + regressor @ seen)
    coefficients = coefficients + gain * (value - regressor @ coefficients)
    variance = variance - gain[:, None] * seen
    # Rounding would make it asymmetric, and then indefinite.
    return coefficients, (variance + variance.T) / 2


@jax.jit
def _track(columns, target, factors):
    """Coefficients after every row; each has its own forgetting factor."""
    size = columns.shape[1]
    forgetting = jnp.sqrt(factors[:, None] * factors[None, :])

    def step(state, row):
        state = update(state, row, forgetting)
        return state, state[0]

    start = (jnp.zeros(size), VARIANCE * jnp.eye(size))
    return lax.scan(step, start, (columns, target))[1]


RLS = deterministic(
    "rls",
    f"Recursive least squares, forgetting factor {FORGETTING} (Yang, Tang and Zhang, 2021)",
    partial(recursive_least_squares, poles=FORGETTING, gains=FORGETTING),
)

WRLS = deterministic(
    "wrls",
    "Recursive least squares, a forgetting factor per coefficient (Verbrugge and Koch, 2006)",
    partial(recursive_least_squares, poles=SLOW_FORGETTING, gains=FORGETTING),
)


def subspace_method(problem: Problem) -> Answer:
    """The circuit whose poles span the future voltages that the past predicts.

    N4SID (Van Overschee and De Moor, Subspace Identification, 1996, section 4.3) with the weights
    of MOESP: current and drop (source minus terminal voltage) in block rows of the past and the
    future, the future drops projected along the future currents onto the past, and the poles from
    the shift of the leading singular vectors, as many as there are pairs. With the poles the
    resistances are those of least squares over the record, inside the box. As in Li et al. (2016),
    cited for it as reference 19 of Li et al. (2023), the order is that of the circuit; `HORIZON`
    block rows per pair are ours. Poles that are complex, negative or unstable correspond to no
    circuit: raises `MethodFailure`, also for an uneven clock, for a current that never changes, for
    a record too short for the block rows, and for a box too wide to compress.
    """
    if not problem.is_compressible:
        raise MethodFailure("the box of time constants is too wide for it; narrow the bounds")
    pairs = problem.bounds.pairs
    rows = HORIZON * pairs
    samples = even_samples(problem.prepared, 2 * rows - 1)
    if not np.ptp(samples.current_a):
        raise MethodFailure("the current never changes, and without a change it shows no pole")
    if (even := np.count_nonzero(samples.is_row)) < 4 * rows:
        raise MethodFailure(
            f"it needs {4 * rows} samples with {2 * rows - 1} evenly before each; there are {even}"
        )
    poles = np.linalg.eigvals(
        state_matrix(samples.current_a, samples.drop_v, samples.is_row, rows, pairs)
    )
    if np.any(poles.imag != 0) or np.any((poles.real <= 0) | (poles.real >= 1)):
        shown = ", ".join(f"{pole:.4g}" for pole in poles)
        raise MethodFailure(
            f"the poles it finds ({shown}) are not decays, so they are not time constants; noise "
            "and model error cause this"
        )
    tau_s = np.sort(-samples.interval_s / np.log(poles.real))
    shown = ", ".join(f"{tau:.4g} s" for tau in tau_s)
    objective = ConstantObjective.of(problem)
    low, high = np.transpose([(axis.low, axis.high) for axis in objective.axes])
    inside = np.clip(np.log(tau_s), low, high)
    if np.any(np.diff(inside) < APART):
        raise MethodFailure(f"its time constants, {shown}, are one inside the search box")
    notes = samples.notes
    if np.any(np.abs(inside - np.log(tau_s)) > APART):
        notes = (*notes, f"its time constants, {shown}, are moved into the search box")
    circuit = objective.circuit(objective.solve(tuple(inside.tolist()), exact=True))
    return answer_of(problem, circuit, notes)


def state_matrix(
    current_a: Float[np.ndarray, "samples"],
    drop_v: Float[np.ndarray, "samples"],
    is_row: Bool[np.ndarray, "samples"],
    rows: int,
    order: int,
) -> Float[np.ndarray, "order order"]:
    """The state matrix, up to a change of basis, of a system with one input and one output.

    `is_row` is True for samples that can be used together with the 2 `rows` - 1 before them.
    """
    windows = np.lib.stride_tricks.sliding_window_view
    use = np.flatnonzero(is_row) - (2 * rows - 1)
    current, drop = (
        windows(signal / max(float(np.std(signal)), np.finfo(float).tiny), 2 * rows)[use]
        for signal in (current_a, drop_v)
    )
    past = np.hstack([current[:, :rows], drop[:, :rows]])
    whole = np.hstack([current[:, rows:], past, drop[:, rows:]])
    factor = np.asarray(np.linalg.qr(whole, mode="r")).T
    projected = factor[3 * rows :, rows : 3 * rows]
    observed = np.linalg.svd(projected)[0][:, :order]
    return np.linalg.lstsq(observed[:-1], observed[1:])[0]


N4SID = deterministic(
    "n4sid",
    "Subspace identification, N4SID (Van Overschee and De Moor, 1996; Li et al., 2016)",
    subspace_method,
)
