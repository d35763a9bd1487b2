"""Whether two samples could be one, and how long a search is expected to run."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.stats
from numpy.typing import NDArray


class Difference(NamedTuple):
    """A two-sided Mann-Whitney test on one problem or on several.

    `larger_share` is how often a loss of the first sample exceeds one of the second, equal ones
    counting half (Vargha and Delaney, 2000): 0.5 where there is no difference.
    """

    larger_share: float
    p: float


def difference(first: NDArray, second: NDArray) -> Difference:
    """The test on one problem."""
    return joint_difference([(first, second)])


def joint_difference(pairs: Sequence[tuple[NDArray, NDArray]]) -> Difference:
    """The test over several problems at once (van Elteren, 1960, where all have equal sizes).

    The statistics of the problems, which must be independent, are added up, and so are their
    variances, corrected for ties; the normal approximation gives p.
    """
    excess = variance = comparisons = 0.0
    for first, second in pairs:
        product, size = len(first) * len(second), len(first) + len(second)
        ranks = scipy.stats.rankdata(np.concatenate([first, second]))
        larger = ranks[: len(first)].sum() - len(first) * (len(first) + 1) / 2
        _, tied = np.unique(ranks, return_counts=True)
        excess += larger - product / 2
        variance += product / 12 * (size + 1 - (tied**3 - tied).sum() / (size * (size - 1)))
        comparisons += product
    score = excess / np.sqrt(variance) if variance > 0 else 0.0
    p = float(2 * scipy.stats.norm.sf(abs(score)))
    return Difference(0.5 + excess / comparisons, p)


def expected_running_time(hits: NDArray, evaluations: NDArray) -> NDArray:
    """Evaluations spent until a target was reached, or else in all, over the successes.

    As COCO defines it (Hansen et al., 2009), over the last axis; `hits` is NaN where a run did not
    get there. Infinite without a success.
    """
    is_hit = np.isfinite(hits)
    spent = np.where(is_hit, hits, evaluations).sum(axis=-1)
    with np.errstate(divide="ignore"):
        return spent / is_hit.sum(axis=-1)


def ratio_interval(
    hits: NDArray, evaluations: NDArray, resamples: int = 10_000
) -> tuple[float, float]:
    """Where the ratio of two expected running times falls in 95 % of cases by chance alone.

    Both are of as many runs as are given, drawn from these with replacement; where no run got
    there, anything could be.
    """
    draws = np.random.default_rng(0).integers(0, len(hits), (2, resamples, len(hits)))
    first, second = expected_running_time(hits[draws], evaluations[draws])
    is_finite = np.isfinite(first) & np.isfinite(second)
    if not is_finite.any():
        return 0.0, np.inf
    low, high = np.quantile(first[is_finite] / second[is_finite], [0.025, 0.975])
    return float(low), float(high)
