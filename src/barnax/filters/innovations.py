"""Tests of a filter's innovations: whether they are white, and as large as it expects."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import chdtrc, chdtri

LAGS = 20
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Innovations:
    """Innovations over their expected deviation, against white noise of variance one.

    `first_lag` is their autocorrelation from one sample to the next; that of white noise stays
    within `bound`. `p_value` is that of Ljung and Box's statistic (1978) over `lags` lags: below
    0.05 they are not white. `mean_square` is the mean normalised innovation squared, whose 95 %
    interval is `mean_square_bounds` where the filter's deviations are right.
    """

    samples: int
    first_lag: float
    bound: float
    lags: int
    p_value: float
    mean_square: float
    mean_square_bounds: tuple[float, float]

    @property
    def are_white(self) -> bool:
        return self.p_value >= 1 - CONFIDENCE


def examine_innovations(normalised: Float[np.ndarray, "samples"]) -> Innovations:
    """Both tests on innovations divided by their expected deviations.

    Over `LAGS` lags, or as many as half of a shorter record has.

    >>> found = examine_innovations(np.random.default_rng(0).normal(size=1000))
    >>> found.are_white, found.mean_square_bounds[0] < found.mean_square
    (True, True)
    """
    count = len(normalised)
    around = normalised - normalised.mean()
    power = float(around @ around)
    lags = np.arange(1, min(LAGS, count // 2) + 1)
    correlation = np.array([around[lag:] @ around[:-lag] for lag in lags]) / (power or 1.0)
    statistic = count * (count + 2) * float(np.sum(correlation**2 / (count - lags)))
    low, high = mean_bounds(count)
    return Innovations(
        samples=count,
        first_lag=float(correlation[0]),
        bound=float(np.sqrt(chdtri(1, 1 - CONFIDENCE) / count)),
        lags=len(lags),
        p_value=float(chdtrc(len(lags), statistic)),
        mean_square=float(np.mean(normalised**2)),
        mean_square_bounds=(low, high),
    )


def mean_bounds(count: int) -> tuple[float, float]:
    """The 95 % interval of the mean of so many chi-square values of one degree of freedom.

    Bar-Shalom, Li and Kirubarajan (2001), section 5.4: the test of estimation errors over
    Monte-Carlo runs, and of innovations over time.

    >>> [round(bound, 2) for bound in mean_bounds(100)]
    [0.74, 1.3]
    """
    above = np.array([(1 + CONFIDENCE) / 2, (1 - CONFIDENCE) / 2])
    low, high = chdtri(count, above) / count
    return float(low), float(high)
