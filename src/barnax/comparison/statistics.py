"""Whether one row of a comparison is better than another, and where in SOC its errors lie."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy import stats

from ..refinement import SAME_RMSE
from .block_bootstrap import block_length, resampled_means

Samples = Float[np.ndarray, "samples"]

# Bands of SOC: the paper's own errors sit below 0.2.
BANDS = ((0.0, 0.1), (0.1, 0.2), (0.2, 1.0))
CONFIDENCE = 0.95


@dataclass(frozen=True)
class BandError:
    """Errors of one simulation at the scored samples whose SOC lies in [low_soc, high_soc).

    The lowest band holds what is below it too, the highest what is above. The errors are None
    where the band holds no sample; `mean_v` is measured minus simulated voltage.
    """

    low_soc: float
    high_soc: float
    samples: int
    rmse_v: float | None = None
    mean_v: float | None = None
    max_v: float | None = None


@dataclass(frozen=True)
class Resampled:
    """Two rows' errors over time, with 95 % intervals of a moving-block bootstrap.

    `difference_v2` is the mean of the first row's squared errors minus the second's;
    `difference_v` the same as a difference of RMSE. Negative: the first row is better. Where
    `is_block_capped`, errors stay alike for longer than the longest block that the rule allows,
    and the intervals are narrower than they should be. `is_real` says that the interval leaves
    out zero, and that the two RMSE are not one by `SAME_RMSE`.
    """

    difference_v2: float
    low_v2: float
    high_v2: float
    difference_v: float
    low_v: float
    high_v: float
    block_samples: int
    is_block_capped: bool
    is_real: bool


@dataclass(frozen=True)
class SeedPairs:
    """Two rows' RMSE paired seed by seed, in V; negative: the first row is better.

    `wins` counts the seeds where the first row is better by more than `SAME_RMSE`, `losses` where
    the second is.
    `p_value` is that of Wilcoxon's signed-rank test (Biometrics Bulletin 1 (1945) 80),
    two-sided; 1 where no seed differs.
    """

    median_v: float
    wins: int
    losses: int
    p_value: float


def errors_by_soc(
    error_v: Samples, soc: Samples, scored: Bool[np.ndarray, "samples"]
) -> tuple[BandError, ...]:
    """The errors of one simulation in every band of `BANDS`.

    >>> errors_by_soc(np.array([0.3, 0.1]), np.array([-0.01, 0.5]), np.full(2, True))[0].samples
    1
    """
    found = []
    for low, high in BANDS:
        above = -np.inf if low == BANDS[0][0] else low
        below = np.inf if high == BANDS[-1][1] else high
        inside = error_v[scored & (soc >= above) & (soc < below)]
        if not len(inside):
            found.append(BandError(low, high, 0))
            continue
        found.append(
            BandError(
                low_soc=low,
                high_soc=high,
                samples=len(inside),
                rmse_v=float(np.sqrt(np.mean(inside**2))),
                mean_v=float(np.mean(inside)),
                max_v=float(np.max(np.abs(inside))),
            )
        )
    return tuple(found)


def compare_over_time(first_error_v: Samples, second_error_v: Samples, seed: int = 0) -> Resampled:
    """Two rows' errors at the same samples, resampled in blocks (Kuensch, Ann. Stat. 17 (1989)
    1217).

    The block length is the one that suits the difference of their squared errors; `seed` is
    where the resampling begins to draw. The interval is that of the percentiles.
    """
    squares = np.stack([first_error_v**2, second_error_v**2])
    length, is_capped = block_length(squares[0] - squares[1])
    means = resampled_means(squares, length, np.random.default_rng(seed))
    tail = 100 * (1 - CONFIDENCE) / 2
    mean = np.mean(squares, axis=1)
    first_v, second_v = np.sqrt(mean)
    low_v2, high_v2 = np.percentile(means[0] - means[1], [tail, 100 - tail])
    low_v, high_v = np.percentile(np.sqrt(means[0]) - np.sqrt(means[1]), [tail, 100 - tail])
    return Resampled(
        difference_v2=float(mean[0] - mean[1]),
        low_v2=float(low_v2),
        high_v2=float(high_v2),
        difference_v=float(first_v - second_v),
        low_v=float(low_v),
        high_v=float(high_v),
        block_samples=length,
        is_block_capped=is_capped,
        is_real=bool((low_v2 > 0 or high_v2 < 0) and _differ(first_v, second_v)),
    )


def compare_over_seeds(
    first_v: Float[np.ndarray, "..."], second_v: Float[np.ndarray, "..."]
) -> SeedPairs | None:
    """Two rows' RMSE in V, seed by seed; one value alone stands beside every seed.

    None where neither row has seeds to pair, and where their numbers differ.

    >>> compare_over_seeds(np.array([1.0, 2.0]), np.array([3.0])).wins
    2
    """
    sizes = {len(first_v), len(second_v)} - {1}
    if len(sizes) != 1:
        return None
    difference_v = first_v - second_v
    is_different = _differ(first_v, second_v)
    p_value = 1.0
    if np.any(is_different):
        tested: Any = stats.wilcoxon(difference_v[is_different])
        p_value = tested.pvalue
    return SeedPairs(
        median_v=float(np.median(difference_v)),
        wins=int(np.count_nonzero(is_different & (difference_v < 0))),
        losses=int(np.count_nonzero(is_different & (difference_v > 0))),
        p_value=float(p_value),
    )


def _differ(
    first_v: Float[np.ndarray, "..."] | float, second_v: Float[np.ndarray, "..."] | float
) -> Any:
    """Where two RMSE are not one, rounding and unfinished descents aside."""
    return np.abs(first_v - second_v) > SAME_RMSE * np.minimum(first_v, second_v)
