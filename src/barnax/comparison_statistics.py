"""Whether one row of a comparison is better than another, and where in SOC its errors lie."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

Samples = Float[np.ndarray, "samples"]

# Bands of SOC: the paper's own errors sit below 0.2.
BANDS = ((0.0, 0.1), (0.1, 0.2), (0.2, 1.0))
CONFIDENCE = 0.95
REPLICATES = 2000


@dataclass(frozen=True)
class BandError:
    """Errors of one simulation at the scored samples whose SOC lies in [low, high).

    The lowest band holds what is below it too, the highest what is above. The errors are None
    where the band holds no sample; `mean_v` is measured minus simulated voltage.
    """

    low: float
    high: float
    samples: int
    rmse_v: float | None
    mean_v: float | None
    max_v: float | None


@dataclass(frozen=True)
class Resampled:
    """Two rows' errors over time, with 95 % intervals of a moving-block bootstrap.

    `difference_v2` is the mean of the first row's squared errors minus the second's;
    `difference_v` the same as a difference of RMSE. Negative: the first row is better.
    """

    difference_v2: float
    low_v2: float
    high_v2: float
    difference_v: float
    low_v: float
    high_v: float
    block_samples: int

    @property
    def is_real(self) -> bool:
        """Whether the interval leaves out zero."""
        return self.low_v2 > 0 or self.high_v2 < 0


@dataclass(frozen=True)
class SeedPairs:
    """Two rows' RMSE paired seed by seed, in V; negative: the first row is better.

    `wins` counts the seeds where the first row is better, `losses` where the second is.
    `p_value` is Wilcoxon's signed-rank test's (1945), two-sided; 1 where no seed differs.
    """

    median_v: float
    wins: int
    losses: int
    p_value: float
