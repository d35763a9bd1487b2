"""The best circuit over a grid of time constants, polished and proved, and the assumptions tested
by it."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from ..cell import get_circuit
from ..cell.characterize import without_drop
from ..cell.model import NEAR_DEGC
from ..errors import InputError, attempt
from ..execution import in_float64
from ..metrics import Count, Volts
from ..model.descent import GridSizes, LogScales, lowest_scales, polish
from ..model.prepared import PreparedRecord, prepare_record
from ..model.sampling import other_sampling
from ..notices import Notice
from ..records import Decision
from ..records.lag import answers_ohm, late_r0_ohm
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
from ..search.evaluate import both_directions, evaluate
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


# A circuit's resistance counts after this long at constant current; slower pairs imitate the OCV.
DROP_S = 1000.0
# A drop left in the OCV changes the resistances by a tenth of itself.
DROP_ROUNDS = 2


@in_float64
def without_sweep_drop(problem: "Problem") -> "Problem":
    """The problem with the OCV at rest if slow sweeps measured it under load.

    The drop of a sweep comes from the circuit that best fits the records nearest to its
    temperature. If the box is too wide for that fit, the sweeps are left unchanged.
    """
    cells = (problem.cell, *problem.cell.elsewhere)
    improved = problem
    has_drop = problem.is_compressible and any(cell.has_sweep_drop for cell in cells)
    for _ in range(DROP_ROUNDS if has_drop else 0):
        at_rest = [
            without_drop(cell, _slow_resistance_ohm(improved, cell.temperature_degc))
            if cell.has_sweep_drop
            else cell
            for cell in cells
        ]
        cell = replace(at_rest[0], elsewhere=tuple(at_rest[1:]))
        records = tuple(
            prepare_record(prepared.record, cell, prepared.circuit, prepared.window)
            for prepared in problem.prepared_records
        )
        improved = replace(problem, cell=cell, prepared_records=records)
    return improved


def _slow_resistance_ohm(problem: "Problem", temperature_degc: float | None) -> float:
    """The resistance after `DROP_S` of the best circuit of the records nearest to a temperature."""
    records = problem.prepared_records
    if temperature_degc is not None:
        degc = np.array([prepared.temperature_degc for prepared in records], float)
        apart = np.nan_to_num(np.abs(degc - temperature_degc))
        is_near = apart <= apart.min() + NEAR_DEGC
        records = tuple(itertools.compress(records, is_near))
    objective = ConstantObjective.of(replace(problem, prepared_records=records))
    best, *_ = lowest_scales(objective, GRID, apart=False, factor=1.0)
    circuit = objective.circuit(objective.solve(best))
    shown = -np.expm1(-DROP_S / np.array(circuit.tau_s))
    return circuit.r0 + float(shown @ circuit.r)


# A direction is better if it lowers the RMSE by more than this.
SAME_FIT = 1e-6


def with_better_directions(problem: "Problem") -> "Problem":
    """The problem with each open direction before the start set to the better-fitting one, record
    by record."""
    for index, prepared in enumerate(problem.prepared_records):
        records = list(problem.prepared_records)
        records[index], other = both_directions(prepared)
        best = problem
        if other is not None and problem.is_compressible:
            others = (*records[:index], other, *records[index + 1 :])
            tried = replace(problem, prepared_records=others)
            before_v, other_v = (
                find_global_optimum(directed, prove=False).rmse_v for directed in (problem, tried)
            )
            is_better = other_v < before_v * (1 - SAME_FIT)
            best, rest_v = (tried, before_v) if is_better else (problem, other_v)
            records[index] = best.prepared_records[index].fitting_better(rest_v)
        problem = best.keeping_computed(prepared_records=tuple(records))
    return problem


# The errors with both holds are compared in this many parts of each record. A mean logarithm beyond
# the second number and this many standard errors was never wrong on 120 simulated cells whose
# voltage does not lag; on an even clock few reach it.
PARTS, FAR, SHARP = 24, 0.05, 4.0
# On a clock this even, at intervals this short, both holds fit alike and cannot be distinguished.
EVEN, SHORT_S = 0.01, 1.5


def hold_warning(problem: "Problem", r0_ohm: float, other_ohm: float) -> Notice:
    """The notice that the other sampling would give an R0 outside the interval."""
    records = [
        prepared.record
        for prepared in problem.prepared_records
        if prepared.record.hold.strength == "assumed"
    ]
    return Notice(
        "hold.undecided",
        {
            "counters": None if any(record.charge_ah is None for record in records) else "there",
            "circuit": problem.circuit,
            "own_ohm": r0_ohm,
            "other_ohm": other_ohm,
            "hold": other_sampling(records[0].hold.value),
        },
        ", ".join(record.name for record in records),
    )


def with_better_hold(problem: "Problem") -> "Problem":
    """The problem with the hold that the voltage supports, in records whose hold is merely assumed.

    The holds are distinguished by the OCV, whose slope differs along the record, and by an uneven
    clock. If the evidence is weak the problem is returned unchanged, as it is with a dynamic
    hysteresis, which can turn within a sample and then fits one hold only. An OCV identified with
    the record is biased to the assumed hold, and is no evidence.
    """
    records = problem.prepared_records
    is_open = [prepared.record.hold.strength == "assumed" for prepared in records]
    has_rate, is_fitted = get_circuit(problem.circuit).has_rate, problem.cell.ocv_is_fitted
    if has_rate or not any(is_open) or not any(_can_tell(each, is_fitted) for each in records):
        return problem
    reason = "the voltage follows it far better than the other"
    assumed = records[is_open.index(True)].record.hold
    turned = Decision(other_sampling(assumed.value), "weak", reason)
    others = []
    for each, one in zip(records, is_open, strict=True):
        given = replace(each.record, hold=turned), problem.cell, problem.circuit
        other = attempt(prepare_record, *given, each.settled_window) if one else each
        if isinstance(other, InputError):
            return problem
        others.append(other)
    if not problem.is_compressible:
        return problem
    other = replace(problem, prepared_records=tuple(others))
    before_v, other_v = map(_moved_errors_v, (problem, other))
    pairs = zip(before_v, other_v, is_open, strict=True)
    ratios = np.concatenate([_log_ratios(mine, others) for mine, others, one in pairs if one])
    mean, spread = np.mean(ratios), np.std(ratios, ddof=1) / np.sqrt(len(ratios))
    if not abs(mean) > max(FAR, SHARP * spread):
        return problem
    if mean > 0:
        return other
    settled = replace(assumed, strength="weak", reason=reason)
    kept = [
        replace(each, record=replace(each.record, hold=settled)) if one else each
        for each, one in zip(records, is_open, strict=True)
    ]
    return problem.keeping_computed(prepared_records=tuple(kept))


def _moved_errors_v(problem: "Problem") -> list[np.ndarray]:
    """The differences between samples of the best circuit's errors, record by record."""
    best = find_global_optimum(problem, prove=False).parameters
    errors = [evaluate(prepared, best) for prepared in problem.prepared_records]
    return [np.diff(one.error_v[one.prepared.scored]) for one in errors]


def _can_tell(prepared: PreparedRecord, ocv_is_fitted: bool) -> bool:
    """True if the voltage may distinguish the holds; a voltage that lags is evidence for one of
    them."""
    interval_s, usual_s = prepared.record.interval_s, prepared.median_interval_s
    is_even = np.quantile(np.abs(interval_s - usual_s), 0.99) <= EVEN * usual_s
    has_slope = usual_s > SHORT_S and not ocv_is_fitted
    return has_slope or not is_even or late_r0_ohm(answers_ohm(prepared.record)) is not None


def _log_ratios(one_v: np.ndarray, other_v: np.ndarray) -> np.ndarray:
    """The logarithm of the squared errors of one hold over the other's, in each part of a record.

    The errors are differences between samples: slow parts do not depend on the hold.
    """
    count = min(len(one_v), len(other_v))
    edges = np.linspace(0, count, min(PARTS, count) + 1).astype(int)[:-1]
    one, other = (np.add.reduceat(error_v[:count] ** 2, edges) for error_v in (one_v, other_v))
    least = np.finfo(float).tiny
    return np.log(np.maximum(one, least) / np.maximum(other, least))
