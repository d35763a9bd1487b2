"""What was assumed about records, tried both ways at the global optimum."""

from dataclasses import replace

from ..errors import InputError
from ..model.inputs import other_direction, settle_direction
from ..model.problem import Problem
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
        tried = replace(problem, prepared_records=(*records[:place], other, *records[place + 1 :]))
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
        problem = replace(problem, prepared_records=tuple(records))
    return problem
