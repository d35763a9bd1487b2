"""Errors of simulated against measured voltage (Li et al., 2023, Eq. 22 to 26), and the quantiles
of intervals."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float
from pydantic import BeforeValidator, Field
from scipy.special import stdtrit

Voltage = Float[np.ndarray, "samples"]
# Valid errors and numbers of samples when read from a file.
Volts = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=0, lt=2**63)]
# Minus infinity for a constant voltage; null in JSON.
Determination = Annotated[
    float,
    Field(allow_inf_nan=True, json_schema_extra={"type": ["number", "null"]}),
    BeforeValidator(lambda value: -np.inf if value is None else value),
]
# Level of every interval, and half of one in standard deviations of a normal distribution.
CONFIDENCE, NORMAL_95 = 0.95, 1.96
# Standard deviation of a normal distribution over its median absolute deviation.
TO_SD = 1.4826


def t_quantile(freedom: float) -> float:
    """Half a confidence interval in standard errors, with `freedom` degrees of freedom."""
    return float(stdtrit(freedom, (1 + CONFIDENCE) / 2))


@dataclass(frozen=True, kw_only=True)
class Metrics:
    """Errors over the scored samples of one record, or of several together.

    Attributes:
        record: Name of the record.
        rmse_v: Root of the mean squared error.
        r2: One minus the squared error over the squared deviation of the voltage from its mean.
        r2_paper: The same as printed in Li et al. (2023), Eq. 24, which uses deviations from the
            mean of the *simulated* voltage.
        mape_percent: Mean absolute error, relative to the measured voltage.
        ce_v: Sum of the absolute errors, which grows with the number of samples.
        max_v: The largest error.
        samples: Number of scored samples.
        rmse_above_10_soc_v: RMSE above 10 % SOC.
        registered_v: RMSE with its start moved to where it is smallest, for a validation record.
        start_moved_soc: Shift of that start in SOC.
    """

    record: str = ""
    rmse_v: Volts
    r2: Determination
    r2_paper: Determination
    mape_percent: float
    ce_v: Volts
    max_v: Volts
    samples: Count
    rmse_above_10_soc_v: Volts | None = None
    registered_v: Volts | None = None
    start_moved_soc: float | None = None

    @property
    def above_v(self) -> float | None:
        """RMSE above 10 % SOC, under the name used by other errors."""
        return self.rmse_above_10_soc_v


def measure(measured_v: Voltage, simulated_v: Voltage, **more: Any) -> Metrics:
    """All metrics of one simulation that can be computed from the voltages, and `more` of its
    fields. Raises `ValueError` if there is nothing to compare.

    >>> import numpy as np
    >>> measure(np.array([3.0, 4.0]), np.array([3.0, 3.9])).max_v
    0.10000000000000009
    """
    if measured_v.shape != simulated_v.shape or measured_v.size == 0:
        raise ValueError(
            f"metrics need equally many measured and simulated samples, and at least one; "
            f"got shapes {measured_v.shape} and {simulated_v.shape}"
        )
    error_v = measured_v - simulated_v
    squares = float(np.sum(error_v**2))
    return Metrics(
        rmse_v=float(np.sqrt(squares / error_v.size)),
        r2=_determination(squares, measured_v, _mean(measured_v)),
        r2_paper=_determination(squares, measured_v, _mean(simulated_v)),
        mape_percent=float(100 * np.mean(np.abs(error_v / measured_v))),
        ce_v=float(np.sum(np.abs(error_v))),
        max_v=float(np.max(np.abs(error_v))),
        samples=int(error_v.size),
        **more,
    )


def _mean(voltage_v: Voltage) -> float:
    # Relative to the first sample, so that the mean of equal voltages is exactly theirs.
    return float(voltage_v[0] + np.mean(voltage_v - voltage_v[0]))


def _determination(squares: float, measured_v: Voltage, center_v: float) -> float:
    spread = float(np.sum((measured_v - center_v) ** 2))
    if spread == 0:
        # A constant record explains nothing: perfect only if it is met exactly.
        return 1.0 if squares == 0 else -np.inf
    return 1 - squares / spread


def robust_deviations(values: Float[np.ndarray, "_"]) -> Float[np.ndarray, "_"]:
    """The distance of each value from the median in robust deviations; zero without a spread.

    >>> robust_deviations(np.array([1.0, 2.0, 3.0, 4.0, 100.0])).round(1).tolist()
    [-1.3, -0.7, 0.0, 0.7, 65.4]
    """
    apart = values - np.median(values)
    sd = TO_SD * float(np.median(np.abs(apart)))
    return apart / sd if sd > 0 else np.zeros(len(values))
