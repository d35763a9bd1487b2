"""Samples below 10 % SOC, where they would decide the time constants of the whole record.

Near empty the OCV and the resistances are too steep for lines between nodes. The errors there are
no noise but answers to the current, several times as large as elsewhere, and least squares make
them smaller at the cost of all other samples: with wrong time constants, and so wrong resistances
and OCV at every SOC. There they count less, by the ratio of the errors above and below for their
size, and once more because they follow the current. Everything above 10 % SOC is then found as if
they were not there, and what is below as well as before.
"""

from dataclasses import replace

import numpy as np

from ..model.descent import polish
from .cross_validation import squared_errors
from .objective import LowEnd, Solution, TableObjective
from .search import find_best

# They count less where the time constants that they set cost the others this share of sqrt(J).
COST = 1e-3
# What counts still less would be lost in the rounding of all else.
LEAST_WEIGHT = 0.03


def without_low_end(objective: TableObjective, best: Solution) -> tuple[TableObjective, Solution]:
    """The objective and its best tables with the weight that samples below 10 % SOC are worth."""
    if objective.settings.evenly:
        return objective, best
    squares_v2, counts = np.sum(squared_errors(objective, best), axis=1)
    if not np.all(counts) or not np.all(squares_v2):
        return objective, best
    below_v, above_v = np.sqrt(squares_v2 / counts).tolist()
    if below_v <= above_v:
        return objective, best
    weight = max((above_v / below_v) ** 2, LEAST_WEIGHT)
    taus_s = tuple(np.exp(best.log_scales[: objective.pairs]).tolist())
    weighed = replace(objective, low_end=LowEnd(weight, below_v / above_v, taus_s))
    start = weighed.solve(best.log_scales)
    if polish(weighed, start).rms_v >= (1 - COST) * start.rms_v:
        return objective, best
    return weighed, find_best(weighed)
