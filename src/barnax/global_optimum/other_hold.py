"""The hold of a record's current, where only the voltage can tell it: tried both ways."""

from dataclasses import replace

import numpy as np

from ..cell import get_circuit
from ..errors import InputError
from ..model.prepared import PreparedRecord, prepare_record
from ..model.problem import Problem
from ..model.sampling import other_sampling
from ..notices import Notice, notice
from ..records import Decision
from ..records.lag import late_answers_ohm
from ..search.evaluate import evaluate
from .search import find_global_optimum

# The errors of both holds are compared in so many parts of each record. A mean logarithm beyond so
# much, at so many standard errors, was never wrong on 120 simulated cells whose voltage does not
# lag; on an even clock few reach it.
PARTS, FAR, SHARP = 24, 0.05, 4.0
# On a clock so even, at intervals so short, both holds fit alike, and nothing tells them apart.
EVEN, SHORT_S = 0.01, 1.5


def hold_warning(problem: Problem, own_ohm: float, other_ohm: float) -> Notice:
    """The notice that the other sampling would give an R0 outside the interval."""
    records = [
        prepared.record
        for prepared in problem.prepared_records
        if prepared.record.hold.strength == "assumed"
    ]
    return notice(
        "hold.undecided",
        ", ".join(record.name for record in records),
        counters=None if any(record.charge_ah is None for record in records) else "there",
        circuit=problem.circuit,
        own_ohm=own_ohm,
        other_ohm=other_ohm,
        hold=other_sampling(records[0].hold.value),
    )


def with_better_hold(problem: Problem) -> Problem:
    """The problem with the hold that its voltage tells, in the records whose own is only assumed.

    What tells the holds apart is the OCV, whose slope differs along the record, and an uneven
    clock. Where these say little the problem is as it was, and so it is with a dynamic hysteresis,
    which can turn within a sample and then follows one hold only. An OCV that was identified with
    the record follows the hold that was assumed, and tells nothing.
    """
    records = problem.prepared_records
    is_open = [prepared.record.hold.strength == "assumed" for prepared in records]
    has_rate, is_own = get_circuit(problem.circuit).has_rate, problem.cell.is_of_records
    if has_rate or not any(is_open) or not any(_can_tell(each, is_own) for each in records):
        return problem
    reason = "the voltage follows it far better than the other"
    assumed = records[is_open.index(True)].record.hold
    turned = Decision(other_sampling(assumed.value), "weak", reason)
    try:
        other = replace(
            problem,
            prepared_records=tuple(
                prepare_record(
                    replace(each.record, hold=turned), problem.cell, problem.circuit,
                    each.settled_window,
                ) if one else each
                for each, one in zip(records, is_open, strict=True)
            ),
        )  # fmt: skip
        own_v, other_v = map(_moved_errors_v, (problem, other))
    except InputError:
        return problem
    pairs = zip(own_v, other_v, is_open, strict=True)
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


def _moved_errors_v(problem: Problem) -> list[np.ndarray]:
    """The differences between samples of the best circuit's errors, record by record."""
    best = find_global_optimum(problem, prove=False).parameters
    errors = [evaluate(prepared, best) for prepared in problem.prepared_records]
    return [np.diff(one.error_v[one.prepared.scored]) for one in errors]


def _can_tell(prepared: PreparedRecord, is_own_ocv: bool) -> bool:
    """True where the voltage may tell the hold: one that lags speaks for one of them."""
    interval_s, usual_s = prepared.record.interval_s, prepared.median_interval_s
    is_even = np.quantile(np.abs(interval_s - usual_s), 0.99) <= EVEN * usual_s
    has_slope = usual_s > SHORT_S and not is_own_ocv
    return has_slope or not is_even or late_answers_ohm(prepared.record) is not None


def _log_ratios(own_v: np.ndarray, other_v: np.ndarray) -> np.ndarray:
    """The logarithm of the squared errors of one hold over the other's, in each part of a record.

    The errors are differences between samples: what is slow depends on the hold no more.
    """
    count = min(len(own_v), len(other_v))
    edges = np.linspace(0, count, min(PARTS, count) + 1).astype(int)[:-1]
    own, other = (np.add.reduceat(error_v[:count] ** 2, edges) for error_v in (own_v, other_v))
    least = np.finfo(float).tiny
    return np.log(np.maximum(own, least) / np.maximum(other, least))
