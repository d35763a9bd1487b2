"""Assumptions about records that their voltages decide: the OCV at rest below a sweep under load,
the direction before the start, and the sampling of the current."""

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..cell import get_circuit
from ..cell.characterize import without_drop
from ..cell.model import NEAR_DEGC
from ..errors import InputError, attempt
from ..execution import in_float64
from ..model.descent import lowest_scales
from ..model.other_sampling import other_sampling
from ..model.prepared import PreparedRecord, prepare_record
from ..notices import Notice
from ..records import Decision
from ..records.lag import answers_ohm, late_r0_ohm
from ..search.evaluate import both_directions, evaluate
from .objective import ConstantObjective
from .search import GRID, find_global_optimum

if TYPE_CHECKING:
    from ..model.problem import Problem

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
    if has_rate or not any(is_open) or not any(_shows_hold(each, is_fitted) for each in records):
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


def _shows_hold(prepared: PreparedRecord, ocv_is_fitted: bool) -> bool:
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
