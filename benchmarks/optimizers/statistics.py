"""What reviewers of evolutionary computation ask of a comparison."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.stats
from numpy.typing import NDArray


class Ranking(NamedTuple):
    """Mean ranks over the functions, Friedman's p value, and the critical difference by Nemenyi."""

    mean_ranks: NDArray
    p_value: float
    critical_difference: float


def rank_methods(means: NDArray) -> Ranking:
    """The ranking of methods by their mean errors `[functions, methods]` (Demsar, 2006)."""
    functions, methods = means.shape
    quantile = scipy.stats.studentized_range.ppf(0.95, methods, np.inf) / np.sqrt(2)
    return Ranking(
        scipy.stats.rankdata(means, axis=1).mean(axis=0),
        float(scipy.stats.friedmanchisquare(*means.T).pvalue),
        float(quantile * np.sqrt(methods * (methods + 1) / (6 * functions))),
    )


def signed_rank_p(first: NDArray, second: NDArray) -> float:
    """Wilcoxon's two-sided p value of paired numbers; 1 where all pairs are equal."""
    if np.array_equal(first, second):
        return 1.0
    return float(scipy.stats.wilcoxon(first, second).pvalue)


def holm(p_values: Sequence[float]) -> NDArray:
    """p values adjusted for their number by Holm's steps (1979)."""
    order = np.argsort(p_values)
    steps = np.sort(p_values) * np.arange(len(p_values), 0, -1)
    adjusted = np.empty(len(p_values))
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1)
    return adjusted


def a12(first: NDArray, second: NDArray) -> float:
    """The chance that a run of `first` ends lower than one of `second`, ties half (Vargha and
    Delaney, 2000)."""
    higher = scipy.stats.mannwhitneyu(second, first).statistic
    return float(higher / (len(first) * len(second)))


def expected_evaluations(hits: NDArray, budget: int) -> float:
    """Expected running time to a target as in COCO: evaluations of all runs by successful ones.

    `hits` are the evaluations after which each run reached it, infinite where it did not.
    """
    successes = np.isfinite(hits).sum()
    return float(np.minimum(hits, budget).sum() / successes) if successes else np.inf


def reached(hits: NDArray, evaluations: float) -> float:
    """Share of pairs of run and target that were reached within so many evaluations."""
    return float(np.mean(hits <= evaluations))
