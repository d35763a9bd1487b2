"""Cells of the table from runs, their ranks, and whether they agree with the printed ones."""

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from .paper import Cell

LOG_FUNCTIONS = ("F2", "F4")
# On F8 a zero prints as 8.88e-16 in MATLAB and 4.44e-16 in NumPy: the rounding of a constant.
ACKLEY_ROUNDING = 1e-15
CLOSE = 3.0
# Share of groups that must have a logarithm.
LEAST_WITH_LOGARITHM = 0.8


def cell_of(final: NDArray) -> Cell:
    """Best, mean and sample standard deviation of the runs' final losses."""
    with np.errstate(under="ignore"):
        return Cell(float(final.min()), float(final.mean()), float(final.std(ddof=1)))


def without_rounding(function: str, cell: Cell) -> Cell:
    """The cell with what is only rounding set to zero."""
    tiny = ACKLEY_ROUNDING if function == "F8" else np.finfo(float).tiny
    return Cell(*(0.0 if abs(value) < tiny else value for value in cell))


def ranks(means: NDArray) -> NDArray:
    """Ranks of the means, the best 1; equal ones share the better rank, as in the paper."""
    return scipy.stats.rankdata(means, method="min").astype(int)


def z_score(printed: float, groups: NDArray, in_log10: bool) -> float:
    """How many standard deviations over the groups the printed value lies from their mean.

    Zero against all zeros is 0; a printed value no group varies toward is infinitely far. Where
    over a fifth of the groups are zero they have no logarithm to score by: NaN.
    """
    if in_log10:
        if printed == 0 or (groups == 0).all():
            return 0.0 if printed == 0 and (groups == 0).any() else np.inf
        if np.mean(groups > 0) < LEAST_WITH_LOGARITHM:
            return np.nan
        printed, groups = np.log10(printed), np.log10(groups[groups > 0])
    spread = groups.std(ddof=1) if len(groups) > 1 else 0.0
    difference = printed - groups.mean()
    if difference == 0:
        return 0.0
    return float(difference / spread) if spread > 0 else float(np.copysign(np.inf, difference))


def scores(
    function: str, printed: Cell, group_cells: list[Cell], deviations: float = 1.0
) -> dict[str, float]:
    """The z-score of each statistic, in log10 for F2 and F4; that of the mean in both ways.

    The linear score cannot tell a printed 1e-90 from groups near 1e-30 that scatter by as much;
    the logarithm can, so a cell must pass both. The scores are in units of so many `deviations`.
    """
    printed = without_rounding(function, printed)
    groups = np.array([without_rounding(function, cell) for cell in group_cells])
    found = {
        name: z_score(printed[column], groups[:, column], function in LOG_FUNCTIONS)
        for column, name in enumerate(Cell._fields)
    }
    # The deviation of numbers near 1e-290 underflows; both tables show it as zero.
    if printed.std == 0 and (groups[:, 2] == 0).all():
        found["std"] = 0.0
    all_positive = printed.mean > 0 and (groups[:, 1] > 0).all()
    found["mean_log10"] = z_score(printed.mean, groups[:, 1], in_log10=all_positive)
    return {name: score / deviations for name, score in found.items()}


def agrees(found: dict[str, float]) -> bool:
    """Whether the mean, in both scores, is close enough to be the same experiment."""
    return max(abs(found["mean"]), abs(found["mean_log10"])) <= CLOSE


def resampled_cells(final: NDArray, groups: int = 200) -> list[Cell]:
    """Cells of groups drawn with replacement from the runs, to judge a cell by 30 runs alone."""
    generator = np.random.default_rng(0)
    draws = generator.integers(0, len(final), (groups, len(final)))
    return [cell_of(final[draw]) for draw in draws]
