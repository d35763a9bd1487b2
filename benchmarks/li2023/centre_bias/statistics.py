"""Ranks and tests over paired runs."""

from typing import NamedTuple

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from benchmarks.li2023.test_functions import FUNCTIONS

from .runs import Losses

SUCCESS = 1e-3
SIGNIFICANT = 0.05


class Duel(NamedTuple):
    """One method against another on one function, over paired runs."""

    function: str
    other: str
    median_difference: float
    p: float
    p_holm: float

    @property
    def verdict(self) -> str:
        if self.p_holm >= SIGNIFICANT or self.median_difference == 0:
            return "tie"
        return "win" if self.median_difference < 0 else "loss"


def losses_of(results: Losses, condition: str, methods: list[str]) -> NDArray:
    """Losses by function, run and method."""
    return np.array(
        [
            np.transpose([results[condition, function, method] for method in methods])
            for function in FUNCTIONS
        ]
    )


def run_ranks(losses: NDArray) -> NDArray:
    """The rank of every method in every run of every function, the best 1, equal ones shared."""
    return scipy.stats.rankdata(losses, axis=-1)


def friedman(losses: NDArray) -> tuple[NDArray, float]:
    """Each method's average rank over functions, and the Friedman test's p that none differs.

    The blocks are the nine functions, with every method's mean rank over the runs; runs of one
    function are no independent problems.
    """
    per_function = run_ranks(losses).mean(axis=1)
    test = scipy.stats.friedmanchisquare(*per_function.T)
    return scipy.stats.rankdata(per_function, axis=1).mean(axis=0), float(test.pvalue)


def average_run_ranks(losses: NDArray) -> NDArray:
    """Each method's rank averaged over all runs of all functions."""
    return run_ranks(losses).mean(axis=(0, 1))


def critical_difference(methods: int, blocks: int) -> float:
    """How far two average ranks must lie apart, by Nemenyi's test at 5 % (Demsar, 2006, Eq. 5)."""
    quantile = scipy.stats.studentized_range.ppf(1 - SIGNIFICANT, methods, np.inf) / np.sqrt(2)
    return float(quantile * np.sqrt(methods * (methods + 1) / (6 * blocks)))


def duels(results: Losses, condition: str, method: str, others: list[str]) -> list[Duel]:
    """Wilcoxon's signed-rank test of `method` against each other on each function, after Holm."""
    found = []
    for function in FUNCTIONS:
        ours = results[condition, function, method]
        for other in others:
            theirs = results[condition, function, other]
            # Signs and ranks of the differences of logarithms weigh all magnitudes alike.
            difference = np.log10(ours + 1e-300) - np.log10(theirs + 1e-300)
            p = 1.0 if (difference == 0).all() else float(scipy.stats.wilcoxon(difference)[1])
            found.append((function, other, float(np.median(difference)), p))
    adjusted = holm(np.array([duel[-1] for duel in found]))
    return [
        Duel(function, other, ratio, raw, float(p))
        for (function, other, ratio, raw), p in zip(found, adjusted, strict=True)
    ]


def holm(p_values: NDArray) -> NDArray:
    """P-values adjusted by Holm's step-down method."""
    order = np.argsort(p_values)
    stepped = np.maximum.accumulate((len(p_values) - np.arange(len(p_values))) * p_values[order])
    adjusted = np.empty_like(p_values)
    adjusted[order] = np.minimum(stepped, 1)
    return adjusted


def summary_rows(results: Losses, conditions: tuple[str, ...]) -> list[dict]:
    """Mean, median, deviation, success rate and mean rank of every method on every function."""
    rows = []
    for condition in conditions:
        methods = methods_under(results, condition)
        ranks = run_ranks(losses_of(results, condition, methods)).mean(axis=1)
        for f, function in enumerate(FUNCTIONS):
            for m, method in enumerate(methods):
                final = results[condition, function, method]
                rows.append(
                    {
                        "condition": condition,
                        "function": function,
                        "method": method,
                        "mean": float(final.mean()),
                        "median": float(np.median(final)),
                        "std": float(final.std(ddof=1)),
                        "success_rate": float((final <= SUCCESS).mean()),
                        "mean_rank": float(ranks[f, m]),
                    }
                )
    return rows


def methods_under(results: Losses, condition: str) -> list[str]:
    """The methods that ran under a condition, in the order they did."""
    return list(dict.fromkeys(method for name, _, method in results if name == condition))
