"""Samples below 10 % SOC, where they would decide the time constants of the whole record.

Near empty the OCV and the resistances are too steep for lines between nodes. The errors there are
no noise but answers to the current, several times as large as elsewhere, and least squares make
them smaller at the cost of all other samples: with wrong time constants, and so wrong resistances
and OCV at every SOC. Where what is held out says so, they count less: by the ratio of the errors
above and below for their size, and once more because they follow the current. Where it favors
neither, intervals reach over both fits.
"""

from dataclasses import replace

import numpy as np

from ..model.descent import polish
from .cross_validation import WORTHWHILE, held_out_errors, squared_errors
from .facts import LowEnd
from .objective import Solution, TableObjective
from .search import find_best

# What counts still less would be lost in the rounding of all else.
LEAST_WEIGHT = 0.03
# The error on all that is held out may rise by this share.
ALIKE = 0.01


def without_low_end(objective: TableObjective, best: Solution) -> tuple[TableObjective, Solution]:
    """The objective and its best tables with a smaller weight of samples below 10 % SOC, where that
    lowers the error on what is held out above by more than `WORTHWHILE`; else as they are.

    Where it raises the error on all that is held out by more than `ALIKE`, neither is plainly
    better: all count evenly, and the tables with the smaller weight stand beside them.
    """
    is_searched = any(axis.high > axis.low for axis in objective.axes)
    if objective.settings.evenly or not is_searched:
        return objective, best
    evenly = held_out_errors(objective, best)
    if evenly is None or evenly.above_v is None:
        return objective, best
    squares_v2, counts = np.sum(squared_errors(objective, best), axis=1)
    below_v, above_v = np.sqrt(squares_v2 / np.maximum(counts, 1)).tolist()
    if below_v <= above_v:
        return objective, best
    weight, times = max((above_v / below_v) ** 2, LEAST_WEIGHT), below_v / above_v

    def counting(weight: float, other: Solution) -> TableObjective:
        taus_s = tuple(np.exp(other.log_scales[: objective.pairs]).tolist())
        return replace(objective, low_end=LowEnd(weight, times, taus_s))

    weighed = counting(weight, best)
    near = polish(weighed, weighed.solve(best.log_scales))
    tried = held_out_errors(weighed, near)
    if tried is None or (tried.above_v or 0.0) >= (1 - WORTHWHILE) * evenly.above_v:
        return objective, best
    found = find_best(weighed)
    if tried.rmse_v <= (1 + ALIKE) * evenly.rmse_v:
        return weighed, found
    return replace(counting(1.0, found), less_below=found), best
