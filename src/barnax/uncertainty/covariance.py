"""Standard errors and intervals of every parameter, for independent and for correlated residuals.

The white-noise covariance s^2 (J'J)^-1 takes every sample for independent. The covariance that
intervals are made of is the sandwich (J'J)^-1 J' G J (J'J)^-1 with G the covariance of the noise
that `noise` fits to the residuals; it goes with Student's t of as many degrees of freedom as that
fit has. J are derivatives by logarithms, so standard errors are relative and intervals positive.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import stdtrit

from ..cell import CircuitParameters
from .linearization import Held, Linearization, named_values
from .noise import Noise, fit_noise

CONFIDENCE = 0.95
# Singular values of the scaled Jacobian under this share of the largest are rounding.
SMALLEST_SHARE = 1e-9
# An interval that leaves more than this factor open on either side determines nothing.
WIDEST_FACTOR = 100.0


@dataclass(frozen=True)
class Estimate:
    """One parameter and how well the data determine it.

    `relative_error` is the standard error of the logarithm, `white_noise_relative_error` that for
    independent residuals; `low` and `high` bound the confidence interval, None where the data
    leave it open. `held` says why a parameter was not free; those have no errors. A quantity made
    of free and held parameters has the errors of its free ones.
    """

    name: str
    value: float
    held: Held | None = None
    relative_error: float | None = None
    white_noise_relative_error: float | None = None
    degrees_of_freedom: float | None = None
    low: float | None = None
    high: float | None = None

    @property
    def standard_error(self) -> float | None:
        """In the parameter's unit."""
        return None if self.relative_error is None else self.value * self.relative_error

    @property
    def inflation(self) -> float | None:
        """The standard error over the white-noise one."""
        if self.relative_error is None or not self.white_noise_relative_error:
            return None
        return self.relative_error / self.white_noise_relative_error

    @property
    def is_determined(self) -> bool:
        return self.low is not None


@dataclass(frozen=True)
class NoiseParts:
    """The parts of the fitted noise: correlation time, 0 for the white one, and deviation."""

    correlation_s: tuple[float, ...]
    sd_v: tuple[float, ...]


@dataclass(frozen=True)
class Uncertainty:
    """Errors of all parameters and time constants.

    `correlation` is that of the logarithms of the `free` parameters.
    """

    confidence: float
    samples: int
    estimates: tuple[Estimate, ...]
    free: tuple[str, ...]
    correlation: tuple[tuple[float, ...], ...]
    noise: NoiseParts

    def __getitem__(self, name: str) -> Estimate:
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise KeyError(f"{name!r}; there are {', '.join(each.name for each in self.estimates)}")


@dataclass(frozen=True, eq=False)
class Covariance:
    """Covariances of the free parameters' logarithms, and the noise that they follow from.

    `matrix` reckons with the correlation of the residuals, `white_noise_matrix` does not.
    """

    linearization: Linearization
    noise: Noise
    matrix: Float[np.ndarray, "free free"]
    white_noise_matrix: Float[np.ndarray, "free free"]
    _to_noise: Float[np.ndarray, "columns free"]

    @classmethod
    def of(cls, linearization: Linearization) -> "Covariance":
        """The covariance at an optimum."""
        values, vectors = _basis(linearization.slope_v)
        noise = fit_noise(
            linearization.error_v, vectors, linearization.time_s, linearization.longest_s
        )
        to_noise = np.linalg.inv(values).T
        free = linearization.samples - len(linearization.names)
        variance_v2 = float(linearization.error_v @ linearization.error_v) / max(free, 1)
        return cls(
            linearization=linearization,
            noise=noise,
            matrix=to_noise.T @ noise.spread_v2 @ to_noise,
            white_noise_matrix=variance_v2 * to_noise.T @ to_noise,
            _to_noise=to_noise,
        )

    def estimate(self, name: str, value: float, direction: Float[np.ndarray, "free"]) -> Estimate:
        """The estimate of a quantity whose logarithm moves by `direction` . (free logarithms)."""
        linearization = self.linearization
        error, white_noise_error = (
            # Along what the data determine best, rounding can leave a variance below zero.
            math.sqrt(max(float(direction @ matrix @ direction), 0.0))
            for matrix in (self.matrix, self.white_noise_matrix)
        )
        freedom = self.noise.degrees_of_freedom(self._to_noise @ direction)
        freedom = max(1.0, min(freedom, linearization.samples - len(linearization.names)))
        half_width = float(stdtrit(freedom, (1 + CONFIDENCE) / 2)) * error
        is_open = not half_width < math.log(WIDEST_FACTOR)
        return Estimate(
            name=name,
            value=value,
            relative_error=error,
            white_noise_relative_error=white_noise_error,
            degrees_of_freedom=freedom,
            low=None if is_open else float(value * np.exp(-half_width)),
            high=None if is_open else float(value * np.exp(half_width)),
        )

    def estimates(self, parameters: CircuitParameters) -> tuple[Estimate, ...]:
        """Those of all parameters of the circuit and its time constants."""

        def one(name: str, value: float) -> Estimate:
            direction, held = self.linearization.direction_of(name)
            if held is not None and not np.any(direction):
                return Estimate(name, value, held)
            return self.estimate(name, value, direction)

        return tuple(one(name, value) for name, value in named_values(parameters).items())

    def summary(self, parameters: CircuitParameters) -> Uncertainty:
        """All of it that is stored."""
        sd = np.sqrt(np.maximum(np.diag(self.matrix), 0.0))
        correlation = self.matrix / np.where(sd > 0, np.outer(sd, sd), 1.0)
        return Uncertainty(
            confidence=CONFIDENCE,
            samples=self.linearization.samples,
            estimates=self.estimates(parameters),
            free=self.linearization.names,
            correlation=tuple(tuple(row) for row in correlation.tolist()),
            noise=NoiseParts(
                correlation_s=tuple(self.noise.correlation_s.tolist()),
                sd_v=tuple(np.sqrt(self.noise.variance_v2).tolist()),
            ),
        )


def _basis(
    slope_v: Float[np.ndarray, "samples free"],
) -> tuple[Float[np.ndarray, "free free"], Float[np.ndarray, "samples free"]]:
    """T and orthonormal Q with J = Q T; T is invertible even where J has no full rank.

    Directions that move nothing get a singular value so small that their errors are enormous.
    """
    scale = np.linalg.norm(slope_v, axis=0)
    left, singular, right = np.linalg.svd(slope_v / scale, full_matrices=False)
    singular = np.maximum(singular, SMALLEST_SHARE * singular.max(initial=0.0))
    return (singular[:, None] * right) * scale, left
