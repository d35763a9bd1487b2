"""What was assumed about records, tried both ways at the global optimum."""

from dataclasses import dataclass, replace

from ..cell import CircuitParameters
from ..errors import InputError
from ..model.inputs import PreparedRecord, other_direction, prepare_record, settle_direction
from ..model.problem import BOX, Problem
from ..records import Decision
from ..records.record import Hold
from .search import find_global_optimum

# A direction is the better one where it lowers the RMSE by more than this.
SAME_FIT = 1e-6


def with_better_directions(problem: Problem) -> Problem:
    """The problem with each open direction before the start as fits better, record by record."""
    for place, prepared in enumerate(problem.prepared_records):
        other = other_direction(prepared, problem.cell)
        records = list(problem.prepared_records)
        if other is None:
            records[place] = settle_direction(prepared, problem.cell)
            if records[place] is not prepared:
                problem = problem.keeping_computed(prepared_records=tuple(records))
            continue
        turned = (*records[:place], other, *records[place + 1 :])
        tried = problem.keeping_computed(BOX, prepared_records=turned)
        try:
            own_v, other_v = (
                find_global_optimum(each, prove=False).rmse_v for each in (problem, tried)
            )
        except InputError:
            continue
        best, rest_v = (tried, own_v) if other_v < own_v * (1 - SAME_FIT) else (problem, other_v)
        chosen = best.prepared_records[place]
        start = replace(chosen.start, direction_source="better fit", other_rmse_v=rest_v)
        records[place] = replace(chosen, start=start)
        problem = best.keeping_computed(prepared_records=tuple(records))
    return problem


@dataclass(frozen=True)
class OtherHold:
    """The best circuit if the current flowed as it was not assumed to, and its RMSE."""

    value: Hold
    rmse_v: float
    parameters: CircuitParameters


def try_other_hold(problem: Problem) -> OtherHold | None:
    """What the answer would be with the other hold in every record whose own is only assumed.

    None where all are known, or where the box is too wide to look. It tells how much depends on
    the assumption, and not which hold is right: on simulated and measured cells whose hold is
    known, the wrong one fits a circuit's voltage as well or better.
    """
    assumed = [each.record.hold.strength == "assumed" for each in problem.prepared_records]
    if not any(assumed):
        return None
    first = problem.prepared_records[assumed.index(True)].record.hold.value
    value: Hold = "backward" if first == "forward" else "forward"

    def turned(prepared: PreparedRecord) -> PreparedRecord:
        hold = Decision(value, "given", "tried")
        record = replace(prepared.record, hold=hold)
        return prepare_record(record, problem.cell, problem.circuit, prepared.settled_window)

    try:
        records = [
            turned(each) if is_open else each
            for each, is_open in zip(problem.prepared_records, assumed, strict=True)
        ]
        tried = replace(problem, prepared_records=tuple(records))
        found = find_global_optimum(tried, prove=False)
    except InputError:
        return None
    return OtherHold(value, found.rmse_v, found.parameters)
