"""The best circuit over a grid of time constants, polished and proved."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from ..execution import in_float64
from ..metrics import Count, Volts
from ..model.descent import GridSizes, LogScales, lowest_scales, polish
from ..schema import MaybeInfinite
from ..search.answers import (
    SAME_RMSE,
    AtBound,
    Optimum,
    RefinedSeed,
    Refinement,
    WithOptima,
    distinct_optima,
    largest_change,
)
from .certificate import CERTIFIED_GAP, certify
from .objective import ConstantObjective
from .proof import SMALLEST_RMSE_V

if TYPE_CHECKING:
    from ..model.problem import Problem

# Grid points per time constant by the number of pairs, and of gamma. A unit response varies over a
# factor of e in tau; four pairs are still sampled twice as densely as that.
GRID = GridSizes({1: 192, 2: 96, 3: 28, 4: 18}, {1: 96, 2: 48, 3: 20, 4: 12}, 24)
# Local minima of the grid up to this many times its lowest error are polished, at most the second
# number of them.
FACTOR = 1.5
MAX_MINIMA = 32
# Boxes of a proof: two pairs need hundreds, three and gamma thousands, four tens of thousands.
MAX_BOXES = 50_000

Status = Literal["certified", "grid-verified"]
_rmse_v = attrgetter("rmse_v")


@dataclass(frozen=True, eq=False, repr=False)
class GlobalOptimum(WithOptima):
    """The best circuit in a box, and the proof about it.

    Attributes:
        optima: The distinct local optima up to `FACTOR` times the best, which comes first; their
            errors are computed by the scan.
        at_bound: Parameters of the best at a bound.
        status: "certified" by branch and bound, or "grid-verified".
        lower_bound_v: No circuit in the box has a lower RMSE; 0 if nothing was proved.
        boxes: Boxes of time constants in the proof; None without a proof.
        median_gap: Optimality gap of the median seed before refinement; all gaps are infinite if no
            seeds were run.
        best_gap: Optimality gap of the best seed before refinement.
        refined_gap: Optimality gap of the best refined seed.
        seeds_there: Refined seeds that reached the optimum.
    """

    optima: Annotated[tuple[Optimum, ...], Field(min_length=1)]  # pyrefly: ignore
    at_bound: tuple[AtBound, ...]
    status: Status
    lower_bound_v: Volts
    boxes: Count | None
    median_gap: MaybeInfinite = math.inf
    best_gap: MaybeInfinite = math.inf
    refined_gap: MaybeInfinite = math.inf
    seeds_there: Count = 0

    @property
    def local_optima(self) -> tuple[Optimum, ...]:
        """The other optima."""
        return self.optima[1:]

    @property
    def proved_gap(self) -> float:
        """The largest share of the RMSE that a better circuit could save."""
        return max(0.0, -optimality_gap(self.lower_bound_v, self.rmse_v))

    def beside(self, refinement: Refinement) -> "GlobalOptimum":
        """A copy with the gaps of the seeds, and with the local optima that they reached."""
        gaps = [optimality_gap(seed.rmse_v, self.rmse_v) for seed in refinement.search.seeds]
        optima = list(self.optima)
        for minimum in refinement.optima:
            errors_v = [optimum.rmse_v for optimum in optima]
            if all(abs(minimum.rmse_v / other - 1) > SAME_RMSE for other in errors_v if other):
                optima.append(minimum)
        reached_v = self.rmse_v * (1 + SAME_RMSE)
        return replace(
            self,
            optima=(optima[0], *sorted(optima[1:], key=_rmse_v)),
            median_gap=float(np.median(gaps)),
            best_gap=min(gaps),
            refined_gap=optimality_gap(refinement.rmse_v, self.rmse_v),
            seeds_there=sum(seed.rmse_v <= reached_v for seed in refinement.seeds),
        )


def optimality_gap(rmse_v: float, optimum_v: float) -> float:
    """The relative distance of an RMSE above the optimum's.

    Args:
        rmse_v: An RMSE.
        optimum_v: RMSE of the optimum. One below `SMALLEST_RMSE_V` counts as that: smaller
            differences are rounding errors.

    >>> round(optimality_gap(10.1e-3, 10e-3), 6)
    0.01
    """
    return (rmse_v - optimum_v) / max(optimum_v, SMALLEST_RMSE_V)


@in_float64
def find_global_optimum(
    problem: "Problem", *, prove: bool = True, max_boxes: int = MAX_BOXES
) -> GlobalOptimum:
    """The best circuit in the box, from the refined minima of a grid, and a proof of it.

    It uses no random numbers and does not depend on the problem's own objective.

    Args:
        problem: A problem from `make_problem`.
        prove: Add a lower bound on every circuit's RMSE by branch and bound. If it ends within
            `CERTIFIED_GAP` of the best, the status is "certified", else "grid-verified".
        max_boxes: Most boxes of time constants for the proof.

    Raises `InputError` if the box is too wide to compress.
    """
    from ..search.seeds import at_bound

    # Stored with the problem: if the direction before the start was open, they were computed
    # before.
    if "minima" not in vars(problem):
        objective = ConstantObjective.of(problem)
        starts = lowest_scales(objective, GRID, apart=False, factor=FACTOR)[:MAX_MINIMA]
        vars(problem)["minima"] = objective, _polish(problem, objective, starts)
    objective, ends = vars(problem)["minima"]
    proof = None
    if prove:
        ends = [*ends]

        def descend(met: LogScales) -> RefinedSeed:
            # The grid can miss a basin; a proof cannot.
            ends.extend(_polish(problem, objective, [met]))
            return min(ends, key=_rmse_v)

        proof = certify(objective, min(ends, key=_rmse_v), descend, max_boxes)
    optima = distinct_optima(ends)
    optima = tuple(optimum for optimum in optima if optimum.rmse_v <= FACTOR * optima[0].rmse_v)
    bounded = at_bound(problem.log_coordinates, optima[0].parameters)
    lower_bound_v = 0.0 if proof is None else proof.lower_bound_v
    gap = -optimality_gap(lower_bound_v, optima[0].rmse_v)
    return GlobalOptimum(
        optima=optima,
        at_bound=bounded,
        status="certified" if gap <= CERTIFIED_GAP else "grid-verified",
        lower_bound_v=lower_bound_v,
        boxes=None if proof is None else proof.boxes,
    )


def _polish(
    problem: "Problem", objective: ConstantObjective, starts: Sequence[LogScales]
) -> list[RefinedSeed]:
    """The ends of descents from the given scales, with the errors of the scan."""
    ends, moved, are_flat = [], [], []
    for log_scales in starts:
        start = objective.solve(log_scales)
        met = polish(objective, start)
        exact = objective.solve(met.log_scales, met.active_set, exact=True)
        ends.append(objective.circuit(exact))
        moved.append(largest_change(objective.circuit(start), ends[-1]))
        are_flat.append(objective.is_flat(exact))
    from ..model.problem import rmse_by_scan

    return [*map(RefinedSeed, rmse_by_scan(problem, ends), ends, moved, are_flat)]
