"""The landscape over the time constants, the search for its lowest point, and what was assumed."""

import itertools
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Literal

import numpy as np
from jaxtyping import Float

from ..blas import one_blas_thread
from ..cell import CircuitParameters, without_drop
from ..cell.model import NEAR_DEGC
from ..display import Brief
from ..errors import InputError
from ..execution import in_float64
from ..model.box_least_squares import errors_of, least_in_boxes, normal_equations
from ..model.descent import polish
from ..model.grid import GridSizes, minima_of, points_in_order
from ..model.prepared import both_directions, prepare_record
from ..model.problem import Problem, rmse_by_scan
from ..search.refine import AtBound, Optimum, RefinedSeed, at_bound, distinct_optima, largest_change
from .certificate import CERTIFIED_GAP, certify
from .objective import ConstantObjective
from .proof import SMALLEST_RMSE_V, Proof

# Grid points of a time constant by the number of pairs, and of gamma. A unit response varies
# over a factor of e in tau; four pairs are still sampled twice as densely as that.
GRID = GridSizes({1: 192, 2: 96, 3: 28, 4: 18}, {1: 96, 2: 48, 3: 20, 4: 12}, 24)
# Points that are solved at a time.
CHUNK = 8192
# Local minima of the grid up to this many times its lowest error are polished, but never more of
# them than this.
FACTOR = 1.5
MAX_MINIMA = 32
# Boxes of a proof: two pairs need hundreds, three and gamma thousands, four tens of thousands.
MAX_BOXES = 50_000

Status = Literal["certified", "grid-verified"]
_rmse_v = attrgetter("rmse_v")


@dataclass(frozen=True, eq=False, repr=False)
class Landscape(Brief):
    """RMSE in V with the best resistances, at every point of a grid.

    One axis a pair, in the order of the pairs, then gamma's where the circuit has one. `rmse_v`
    and `resistances_ohm` (R0, R1, ... first) are NaN where pairs of one box would be out of order.
    `elements` are those of the circuit, none where all are RC pairs.
    """

    tau_s: tuple[Float[np.ndarray, "taus"], ...]
    gamma: Float[np.ndarray, "gammas"] | None
    rmse_v: Float[np.ndarray, "*grid"]
    resistances_ohm: Float[np.ndarray, "resistances *grid"]
    elements: tuple[str, ...] = ()

    def circuit(self, point: tuple[int, ...]) -> CircuitParameters:
        """The best circuit at a point of the grid."""
        taus = [float(axis[index]) for axis, index in zip(self.tau_s, point, strict=False)]
        r0, *r = self.resistances_ohm[:, *point].tolist()
        gamma = None if self.gamma is None else float(self.gamma[point[-1]])
        return CircuitParameters.of_tau(r0, r, taus, gamma, self.elements)

    def minima(self, factor: float) -> list[tuple[int, ...]]:
        """The points no neighbor of which is lower, best first; level ground counts once.

        Only those with at most `factor` times the lowest error.
        """
        return minima_of(self.rmse_v, factor)


def landscape_of(objective: ConstantObjective) -> Landscape:
    """The landscape of a problem, whichever its objective, from the compressed form."""
    pairs = objective.bounds.pairs
    places = GRID.places(((axis.low, axis.high) for axis in objective.axes), pairs)
    # One thread: what a library does with several would change the last bits.
    with one_blas_thread():
        tables = [
            axis.columns(place)[..., 0] for axis, place in zip(objective.axes, places, strict=True)
        ]
    shape = tuple(len(place) for place in places)
    points = points_in_order(shape, objective.interchangeable, apart=False)
    rmse_v = np.full(shape, np.nan)
    resistances_ohm = np.full((pairs + 1, *shape), np.nan)
    for first in range(0, points.shape[1], CHUNK):
        here = points[:, first : first + CHUNK]
        columns, base = objective.columns(
            [table[index] for table, index in zip(tables, here, strict=True)]
        )
        at = np.stack([place[index] for place, index in zip(places, here, strict=True)])
        box = objective.coefficient_box(at)
        found = least_in_boxes(*normal_equations(columns, base), *box)
        errors_v = errors_of(columns, base, found)
        rmse_v[tuple(here)] = np.linalg.norm(errors_v, axis=1)
        resistances_ohm[:, *here] = found[: pairs + 1]
    return Landscape(
        tau_s=tuple(np.exp(place) for place in places[:pairs]),
        gamma=np.exp(places[pairs]) if len(places) > pairs else None,
        rmse_v=rmse_v,
        resistances_ohm=resistances_ohm,
        elements=objective.bounds.elements,
    )


@dataclass(frozen=True, eq=False, repr=False)
class GlobalOptimum(Brief):
    """The best circuit in a box, what is proved about it, and the landscape around it.

    Attributes:
        optima: The distinct local optima up to `FACTOR` times the best, which comes first; their
            errors are computed by the scan.
        at_bound: Parameters of the best at a bound.
        proof: What the search for a proof came to, None without one.
        landscape: The lowest RMSE over the time constants.
    """

    optima: tuple[Optimum, ...]
    at_bound: tuple[AtBound, ...]
    proof: Proof[RefinedSeed] | None
    landscape: Landscape

    @property
    def parameters(self) -> CircuitParameters:
        return self.optima[0].parameters

    @property
    def rmse_v(self) -> float:
        return self.optima[0].rmse_v

    @property
    def local_optima(self) -> tuple[Optimum, ...]:
        """The other optima."""
        return self.optima[1:]

    @property
    def lower_bound_v(self) -> float:
        """A lower bound of the RMSE of any circuit in the box; 0 where nothing was proved."""
        return 0.0 if self.proof is None else self.proof.lower_bound_v

    @property
    def proved_gap(self) -> float:
        """The largest share of the RMSE that a better circuit could save."""
        return max(0.0, -optimality_gap(self.lower_bound_v, self.rmse_v))

    @property
    def status(self) -> Status:
        return "certified" if self.proved_gap <= CERTIFIED_GAP else "grid-verified"

    @property
    def boxes(self) -> int | None:
        """Number of boxes of time constants that the proof took; None without a proof."""
        return None if self.proof is None else self.proof.boxes


def optimality_gap(rmse_v: float, optimum_v: float) -> float:
    """The distance of an RMSE above that of the optimum, as a fraction of the latter.

    Args:
        rmse_v: An RMSE.
        optimum_v: The optimum's. One below `SMALLEST_RMSE_V` counts as that: smaller differences
            are rounding errors.

    >>> round(optimality_gap(10.1e-3, 10e-3), 6)
    0.01
    """
    return (rmse_v - optimum_v) / max(optimum_v, SMALLEST_RMSE_V)


@in_float64
def find_global_optimum(
    problem: Problem, *, prove: bool = True, max_boxes: int = MAX_BOXES
) -> GlobalOptimum:
    """The best circuit in the box, from the refined minima of a grid, and a proof of it.

    It uses no random numbers and does not depend on the problem's own objective.

    Args:
        problem: A problem from `make_problem`.
        prove: Add a lower bound on every circuit's RMSE by branch and bound. If it ends within
            `CERTIFIED_GAP` of the best, the status is "certified", else "grid-verified".
        max_boxes: At most so many boxes of time constants for the proof.

    Raises `InputError` if the box is too wide to compress.
    """
    # Kept with the problem: where the direction before the start is open, it was looked for before.
    if "minima" not in vars(problem):
        objective = ConstantObjective.of(problem)
        landscape = landscape_of(objective)
        starts = landscape.minima(FACTOR)[:MAX_MINIMA]
        ends = _polish(problem, objective, [landscape.circuit(point) for point in starts])
        vars(problem)["minima"] = objective, landscape, ends
    objective, landscape, ends = vars(problem)["minima"]
    proof = None
    if prove:
        ends = [*ends]

        def descend(met: CircuitParameters) -> RefinedSeed:
            # The grid can miss a basin; a proof cannot.
            ends.extend(_polish(problem, objective, [met]))
            return min(ends, key=_rmse_v)

        proof = certify(objective, min(ends, key=_rmse_v), descend, max_boxes)
    optima = distinct_optima(ends)
    optima = tuple(optimum for optimum in optima if optimum.rmse_v <= FACTOR * optima[0].rmse_v)
    bounded = at_bound(problem.log_coordinates, optima[0].parameters)
    return GlobalOptimum(optima, bounded, proof, landscape)


def _polish(
    problem: Problem, objective: ConstantObjective, circuits: list[CircuitParameters]
) -> list[RefinedSeed]:
    """The ends of descents from circuits, with the errors of the scan."""
    ends, are_flat = [], []
    with one_blas_thread():
        for circuit in circuits:
            rate = () if circuit.gamma is None else (circuit.gamma,)
            log_scales = tuple(np.log([*circuit.tau_s, *rate]).tolist())
            met = polish(objective, objective.solve(log_scales))
            exact = objective.solve(met.log_scales, met.sides, exact=True)
            ends.append(objective.circuit(np.array(exact.log_scales), exact.ohm))
            are_flat.append(objective.is_flat(exact))
    return [
        RefinedSeed(float(rmse_v), end, largest_change(circuit, end), is_flat)
        for rmse_v, circuit, end, is_flat in zip(
            rmse_by_scan(problem, ends), circuits, ends, are_flat, strict=True
        )
    ]


# What a circuit resists after so long a constant current; slower pairs imitate the OCV.
DROP_S = 1000.0
# A drop that is left in the OCV changes the resistances by a tenth of itself.
DROP_ROUNDS = 2


def without_sweep_drop(problem: Problem) -> Problem:
    """The problem with the OCV at rest where slow sweeps measured it under load.

    What a sweep lost is told by the circuit that fits best the records nearest to its temperature.
    Where the box is too wide to look for that, the sweeps stay as they are.
    """
    known = (problem.cell, *problem.cell.elsewhere)
    found = problem
    for _ in range(DROP_ROUNDS if any(cell.has_sweep_drop for cell in known) else 0):
        try:
            at_rest = [
                without_drop(cell, _slow_resistance_ohm(found, cell.temperature_degc))
                if cell.has_sweep_drop
                else cell
                for cell in known
            ]
        except InputError:
            return problem
        cell = replace(at_rest[0], elsewhere=tuple(at_rest[1:]))
        records = tuple(
            prepare_record(prepared.record, cell, prepared.circuit, prepared.window)
            for prepared in problem.prepared_records
        )
        found = replace(problem, cell=cell, prepared_records=records)
    return found


def best_on_grid(problem: Problem) -> CircuitParameters:
    """The best circuit of the landscape's grid, not polished."""
    landscape = landscape_of(ConstantObjective.of(problem))
    (lowest, *_) = landscape.minima(1.0)
    return landscape.circuit(lowest)


def _slow_resistance_ohm(problem: Problem, temperature_degc: float | None) -> float:
    """The resistance after `DROP_S` of the best circuit of the records nearest to a temperature."""
    records = problem.prepared_records
    if temperature_degc is not None:
        degc = np.array([prepared.temperature_degc for prepared in records], float)
        apart = np.nan_to_num(np.abs(degc - temperature_degc))
        is_near = apart <= apart.min() + NEAR_DEGC
        records = tuple(itertools.compress(records, is_near))
    found = best_on_grid(replace(problem, prepared_records=records))
    shown = -np.expm1(-DROP_S / np.array(found.tau_s))
    return found.r0 + float(shown @ found.r)


# A direction is the better one where it lowers the RMSE by more than this.
SAME_FIT = 1e-6


def with_better_directions(problem: Problem) -> Problem:
    """The problem with each open direction before the start as fits better, record by record."""
    for place, prepared in enumerate(problem.prepared_records):
        records = list(problem.prepared_records)
        own, other = both_directions(prepared, problem.cell)
        if other is None:
            records[place] = own
            problem = problem.keeping_computed(prepared_records=tuple(records))
            continue
        records[place] = other
        tried = replace(problem, prepared_records=tuple(records))
        try:
            own_v, other_v = (
                find_global_optimum(directed, prove=False).rmse_v for directed in (problem, tried)
            )
        except InputError:
            continue
        best, rest_v = (tried, own_v) if other_v < own_v * (1 - SAME_FIT) else (problem, other_v)
        records[place] = best.prepared_records[place].fitting_better(rest_v)
        problem = best.keeping_computed(prepared_records=tuple(records))
    return problem
