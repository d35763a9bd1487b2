"""Methods that solve for the resistances at given time constants: by a search, by subspaces."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.optimize import least_squares

from ..cell import CircuitParameters
from ..execution import in_float64
from ..model.box_least_squares import least_in_boxes, with_free_values
from ..model.descent import GridSizes, minima_of, points_in_order
from ..model.problem import Problem
from ..model.simulate import RCParameters, SimulationInput, overpotential, unit_response
from ..search.evaluate import evaluate
from .method import Answer, MethodFailure, deterministic
from .regression import answer_of, even_samples

# Grid points a time constant, by the number of pairs, and grid points of the hysteresis' rate.
TAUS = {1: 48, 2: 24, 3: 14, 4: 11}
GRID = GridSizes(TAUS, TAUS, 8)
# Of the grid points that are better than all around them, this many are polished.
POLISHED = 4
TOLERANCE = 1e-12

Point = Float[np.ndarray, "outer"]


def triangular_factor(
    matrix: Float[np.ndarray, "rows columns"],
) -> Float[np.ndarray, "few columns"]:
    """R of the QR factorization: all that least squares in the columns needs to know."""
    return np.asarray(np.linalg.qr(matrix, mode="r"))


_responses = eqx.filter_jit(jax.vmap(unit_response, in_axes=(0, None, None)))


@eqx.filter_jit
def _bases(
    gammas: Float[Array, "gammas"], inputs: SimulationInput
) -> Float[Array, "gammas samples"]:
    no_current = RCParameters(r0=jnp.asarray(0.0), r=(), tau=())

    def base(gamma):
        return inputs.base_error_v + overpotential(replace(no_current, gamma=gamma), inputs)

    return jax.vmap(base)(gammas)


def variable_projection(problem: Problem) -> Answer:
    """The best circuit of a search over ln tau alone (Golub and Pereyra, SIAM J. Numer. Anal. 10
    (1973) 413).

    At each set of time constants the resistances are the exact optimum of a bounded linear
    least-squares problem. The outer search is a grid over the ordered time constants, evenly
    spaced in ln tau, whose best local minima SciPy's trust-region least squares then polishes
    with finite differences; a dynamic hysteresis adds ln gamma to the search. It draws nothing.
    One evaluation is one pair's response on the grid, and one residual in the polish.
    """
    search = OuterSearch(problem)
    ends = [search.polish(start) for start in search.grid_minima()]
    best = min(ends, key=lambda point: np.linalg.norm(search.residual(point)))
    parameters = search.circuit(best)
    rmse_v = evaluate(problem.prepared, parameters).metrics.rmse_v
    return Answer(parameters, rmse_v, search.evaluations)


class OuterSearch:
    """The search over points (ln tau1, ln tau2, ..., ln gamma) of a problem, by the scan.

    The error is base(gamma) + R0 times the current + the sum of R_i times the response of a pair of
    1 ohm. All are in V and ohm over the scored samples, scaled so that the sum of squares is the
    RMSE squared. `evaluations` counts responses on the grid, and residuals.
    """

    def __init__(self, problem: Problem):
        self.inputs, self.bounds = problem.all_inputs[0], problem.bounds
        self.pairs, self.ordered = self.bounds.pairs, self.bounds.interchangeable_pairs
        ranges = [self.bounds.tau_range_s(pair) for pair in range(self.pairs)]
        if self.bounds.gamma_range is not None:
            ranges.append(self.bounds.gamma_range)
        self.low, self.high = np.log(ranges).T
        self.evaluations = 0

    @in_float64
    def columns(self, tau_s: Float[np.ndarray, "taus"]) -> Float[np.ndarray, "samples columns"]:
        """The current, then the response of a pair of 1 ohm for every time constant."""
        responses = _responses(jnp.asarray(tau_s), self.inputs.held_a, self.inputs.intervals)
        return self._scored([self.inputs.current_a, *responses])

    @in_float64
    def bases(self, gammas: Float[np.ndarray, "gammas"]) -> Float[np.ndarray, "samples bases"]:
        """The error of a circuit without resistances, for every rate of the hysteresis.

        One column for a circuit without dynamic hysteresis, which has no rates.
        """
        if not len(gammas):
            return self._scored([self.inputs.base_error_v])
        return self._scored(_bases(jnp.asarray(gammas), self.inputs))

    def _scored(self, signals) -> Float[np.ndarray, "samples signals"]:
        chosen, weight = np.stack(signals, axis=1), self.inputs.weight
        chosen = chosen if weight is None else chosen[np.asarray(weight) > 0]
        return chosen / np.sqrt(len(chosen))

    def residual(self, point: Point) -> Float[np.ndarray, "samples"]:
        """The error with the best resistances there; its sum of squares is the RMSE squared."""
        columns, base, values = self._solve(point)
        return base + columns @ values

    def circuit(self, point: Point) -> CircuitParameters:
        """The circuit of a point and the best resistances there."""
        _, _, (r0, *r) = self._solve(point)
        tau_s = np.exp(point[: self.pairs])
        gamma = float(np.exp(point[-1])) if len(point) > self.pairs else None
        found = CircuitParameters.of_tau(r0, r, tau_s, gamma)
        return found.ordered() if self.ordered else found

    def grid_minima(self) -> list[Point]:
        """The best grid points that are better than all around them."""
        axes = GRID.places(zip(self.low, self.high, strict=True), self.pairs)
        taus, gammas = axes[: self.pairs], axes[self.pairs :]
        # Pairs with one box share their responses.
        own = taus[:1] if self.ordered else taus
        begin = np.cumsum([1, *(len(axis) for axis in own)])
        starts = np.resize(begin[: len(own)], self.pairs)
        columns = self.columns(np.exp(np.concatenate(own)))
        bases = self.bases(np.exp(gammas).ravel())
        self.evaluations += columns.shape[1] - 1 + (bases.shape[1] if gammas else 0)
        # All grid points share one triangular factor, a few hundred numbers, and its products.
        factor = triangular_factor(np.concatenate([columns, bases], axis=1))
        products = factor.T @ factor
        shape = tuple(len(axis) for axis in axes)
        points = points_in_order(shape, self.ordered, apart=True)
        at = points[: self.pairs]
        chosen = np.concatenate([np.zeros_like(at[:1]), starts[:, None] + at])
        base = columns.shape[1] + (points[-1] if gammas else np.zeros_like(at[0]))
        box = self.bounds.resistance_box(np.exp(np.stack([*map(np.take, taus, at)])))
        values = least_in_boxes(products[chosen[:, None], chosen], products[chosen, base], *box)
        errors = np.full(shape, np.inf)
        error = factor[:, base] + np.einsum("rup,up->rp", factor[:, chosen], values)
        errors[*points] = np.linalg.norm(error, axis=0)
        return [np.array([*map(np.take, axes, point)]) for point in minima_of(errors)[:POLISHED]]

    def polish(self, start: Point) -> Point:
        """The local minimum near a point, inside the box."""
        is_free = self.high > self.low
        if not np.any(is_free):
            return start

        def at(free: np.ndarray) -> Point:
            point = start.copy()
            point[is_free] = free
            return point

        unit_v = max(float(np.linalg.norm(self.residual(start))), TOLERANCE)
        low, high = self.low[is_free], self.high[is_free]
        end = least_squares(
            lambda free: self.residual(at(free)) / unit_v,
            np.clip(start[is_free], low, high),
            bounds=(low, high),
            xtol=TOLERANCE,
            ftol=TOLERANCE,
            gtol=TOLERANCE,
            max_nfev=100,
        )
        return at(end.x)

    def _solve(self, point: Point) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Columns, base and the best resistances at a point."""
        self.evaluations += 1
        tau_s, gamma = np.exp(point[: self.pairs]), np.exp(point[self.pairs :])
        columns, base = self.columns(tau_s), self.bases(gamma)[:, 0]
        low, high = self.bounds.resistance_box(tau_s)
        factor = triangular_factor(np.column_stack([columns, base]))
        products = (factor.T @ factor)[:-1, :, None]
        ends = low[:, None], high[:, None]
        values = least_in_boxes(products[:, :-1], products[:, -1], *ends)[:, 0]
        is_free = (low < values) & (values < high)
        exact = with_free_values(factor[:, :-1], factor[:, -1], values, is_free)
        # Columns that hardly differ may ask for values outside.
        return columns, base, exact if np.all((low <= exact) & (exact <= high)) else values


VARPRO = deterministic(
    "varpro",
    "Variable projection (Golub and Pereyra, 1973), bounded resistances, polished grid in tau",
    variable_projection,
)


# Rows of the past and of the future, for every pair: twice the order is the least that can work.
HORIZON = 15
# Time constants this close together, relative to them, are one pole to rounding.
APART = 1e-6


def subspace_method(problem: Problem) -> Answer:
    """The circuit whose poles span the future voltages that the past predicts.

    N4SID (Van Overschee and De Moor, Subspace Identification, 1996, section 4.3) with the weights
    of MOESP: current and drop (source minus terminal voltage) in block rows of the past and the
    future, the future drops projected along the future currents onto the past, and the poles from
    the shift of the leading singular vectors, as many as there are pairs. With the poles the
    resistances are those of least squares over the simulated record, inside the box. As in Li et
    al. (2016), whose reference number 19 Li et al. (2023) give for it, the order is that of the
    circuit; `HORIZON` block rows a pair are ours. Poles that are complex, negative or unstable
    belong to no circuit: raises `MethodFailure`, also for an uneven clock, for a current that never
    changes, and for a record too short for the block rows.
    """
    pairs = problem.bounds.pairs
    rows = HORIZON * pairs
    samples = even_samples(problem.prepared, 2 * rows - 1)
    if not np.ptp(samples.current_a):
        raise MethodFailure("the current never changes, and without a change it shows no pole")
    if (found := np.count_nonzero(samples.is_row)) < 4 * rows:
        raise MethodFailure(
            f"it needs {4 * rows} samples with {2 * rows - 1} evenly before each; there are {found}"
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
    search = OuterSearch(problem)
    inside = np.clip(np.log(tau_s), search.low, search.high)
    if np.any(np.diff(inside) < APART):
        raise MethodFailure(f"its time constants, {shown}, are one inside the search box")
    notes = samples.notes
    if np.any(np.abs(inside - np.log(tau_s)) > APART):
        notes = (*notes, f"its time constants, {shown}, are moved into the search box")
    return answer_of(problem, search.circuit(inside), notes)


def state_matrix(
    current_a: Float[np.ndarray, "samples"],
    drop_v: Float[np.ndarray, "samples"],
    is_row: Bool[np.ndarray, "samples"],
    rows: int,
    order: int,
) -> Float[np.ndarray, "order order"]:
    """The state matrix, up to a change of basis, of a system of one input and one output.

    `is_row` says of every sample whether it and the 2 `rows` - 1 before it can be used.
    """
    windows = np.lib.stride_tricks.sliding_window_view
    use = np.flatnonzero(is_row) - (2 * rows - 1)
    current, drop = (
        windows(signal / max(float(np.std(signal)), np.finfo(float).tiny), 2 * rows)[use]
        for signal in (current_a, drop_v)
    )
    past = np.hstack([current[:, :rows], drop[:, :rows]])
    factor = triangular_factor(np.hstack([current[:, rows:], past, drop[:, rows:]])).T
    projected = factor[3 * rows :, rows : 3 * rows]
    observed = np.linalg.svd(projected)[0][:, :order]
    return np.linalg.lstsq(observed[:-1], observed[1:])[0]


N4SID = deterministic(
    "n4sid",
    "Subspace identification, N4SID (Van Overschee and De Moor, 1996; Li et al., 2016)",
    subspace_method,
)
