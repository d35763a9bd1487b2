"""How sure every parameter is: the plain standard error, and the one to trust.

The plain covariance s^2 (J'J)^-1 takes every sample for a new piece of information. The trusted
one is the sandwich (J'J)^-1 J' G J (J'J)^-1 with G the covariance of the noise that `noise` fits to
the residuals; its intervals use Student's t with as many degrees of freedom as that fit has.
J are derivatives by logarithms, so standard errors are relative and intervals stay positive.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import stdtrit

from ..cell import CircuitParameters
from .linearization import Linearization
from .noise import Noise, fit_noise

CONFIDENCE = 0.95
# Singular values of the scaled Jacobian under this share of the largest are rounding.
SMALLEST_SHARE = 1e-9
# An interval that leaves more than this factor open on either side determines nothing.
WIDEST_FACTOR = 100.0


@dataclass(frozen=True)
class Estimate:
    """One parameter and how well the data determine it.

    `relative_error` is the trusted standard error of the logarithm, `white_noise_relative_error`
    the one for independent errors; `low` and `high` bound the confidence interval, None where the data
    leave it open. `held` says why a parameter was not free; those have no errors. A quantity made
    of free and held parameters has the errors of its free ones.
    """

    name: str
    value: float
    held: str | None = None
    white_noise_relative_error: float | None = None
    relative_error: float | None = None
    degrees_of_freedom: float | None = None
    low: float | None = None
    high: float | None = None

    @property
    def inflation(self) -> float | None:
        """How many times the trusted standard error is the plain one."""
        if self.relative_error is None or not self.white_noise_relative_error:
            return None
        return self.relative_error / self.white_noise_relative_error

    @property
    def is_determined(self) -> bool:
        return self.low is not None

    def to_dict(self) -> dict[str, Any]:
        """Plain values; standard errors in the parameter's unit."""
        trusted, plain = self.relative_error, self.white_noise_relative_error
        return {
            "value": self.value,
            "held": self.held,
            "standard_error": None if trusted is None else self.value * trusted,
            "plain_standard_error": None if plain is None else self.value * plain,
            "inflation": self.inflation,
            "degrees_of_freedom": self.degrees_of_freedom,
            "low": self.low,
            "high": self.high,
        }


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Errors of all parameters, of PyBaMM's names and the time constants.

    `covariance` and `white_noise_covariance` are of the logarithms of `names`, the free parameters.
    """

    estimates: tuple[Estimate, ...]
    names: tuple[str, ...]
    covariance: Float[np.ndarray, "free free"]
    white_noise_covariance: Float[np.ndarray, "free free"]
    noise: Noise
    samples: int
    _to_noise: Float[np.ndarray, "columns free"]

    def __getitem__(self, name: str) -> Estimate:
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise KeyError(f"{name!r}; there are {', '.join(each.name for each in self.estimates)}")

    @property
    def confidence(self) -> float:
        return CONFIDENCE

    @property
    def correlation(self) -> Float[np.ndarray, "free free"]:
        """Trusted correlation of the logarithms of `names`."""
        sd = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.where(sd > 0, np.outer(sd, sd), 1.0)

    @property
    def words(self) -> str:
        """How much the trusted errors differ from the plain ones."""
        inflations = [each.inflation for each in self.estimates if each.inflation is not None]
        if not inflations:
            return ""
        return (
            f"The {100 * CONFIDENCE:.0f} % intervals reckon with errors that stay alike from "
            "sample to sample; taking all samples for independent would give standard errors "
            f"{min(inflations):.2g} to {max(inflations):.2g} times smaller."
        )

    def of(self, name: str, value: float, direction: Float[np.ndarray, "free"]) -> Estimate:
        """The estimate of a quantity whose logarithm moves by `direction` . (free logarithms)."""
        plain = math.sqrt(float(direction @ self.white_noise_covariance @ direction))
        trusted = math.sqrt(float(direction @ self.covariance @ direction))
        freedom = self.noise.degrees_of_freedom(self._to_noise @ direction)
        freedom = max(1.0, min(freedom, self.samples - len(self.names)))
        half_width = stdtrit(freedom, (1 + CONFIDENCE) / 2) * trusted
        is_open = not half_width < math.log(WIDEST_FACTOR)
        low, high = (None, None) if is_open else value * np.exp([-half_width, half_width])
        return Estimate(
            name=name,
            value=value,
            white_noise_relative_error=plain,
            relative_error=trusted,
            degrees_of_freedom=freedom,
            low=None if low is None else float(low),
            high=None if high is None else float(high),
        )

    def to_dict(self) -> dict[str, Any]:
        return {
            "confidence": CONFIDENCE,
            "words": self.words,
            "parameters": {each.name: each.to_dict() for each in self.estimates},
            "free": list(self.names),
            "correlation": self.correlation.tolist(),
            "noise": {
                "correlation [s]": self.noise.correlation_s.tolist(),
                "sd [V]": np.sqrt(self.noise.variance_v2).tolist(),
            },
        }


def estimate_uncertainty(
    parameters: CircuitParameters, linearization: Linearization
) -> Uncertainty:
    """Standard errors, intervals and correlations of a refined circuit."""
    values, vectors = _basis(linearization.slope_v)
    noise = fit_noise(linearization.error_v, vectors, linearization.time_s, linearization.longest_s)
    to_noise = np.linalg.inv(values).T
    spread = to_noise.T @ noise.spread_v2 @ to_noise
    variance_v2 = float(linearization.error_v @ linearization.error_v) / max(
        linearization.samples - len(linearization.names), 1
    )
    bare = Uncertainty(
        estimates=(),
        names=linearization.names,
        covariance=spread,
        white_noise_covariance=variance_v2 * to_noise.T @ to_noise,
        noise=noise,
        samples=linearization.samples,
        _to_noise=to_noise,
    )
    estimates = []
    for name, value in named_values(parameters).items():
        direction, held = direction_of(name, linearization)
        if held is not None and not np.any(direction):
            estimates.append(Estimate(name, value, held))
        else:
            estimates.append(bare.of(name, value, direction))
    return Uncertainty(**{**vars(bare), "estimates": tuple(estimates)})


def named_values(parameters: CircuitParameters) -> dict[str, float]:
    """Every parameter under PyBaMM's name, each time constant after its capacitance."""
    values: dict[str, float] = {}
    for name, value in parameters.to_dict().items():
        values[name] = value
        if name.startswith("C"):
            pair = int(name[1])
            values[f"tau{pair} [s]"] = parameters.tau_s[pair - 1]
    return values


def direction_of(
    name: str, linearization: Linearization
) -> tuple[Float[np.ndarray, "free"], str | None]:
    """How the logarithm of a parameter moves with the free ones', and why it is held if it is.

    C and tau of a pair follow from each other: ln tau = ln R + ln C.
    """
    if name in linearization.names:
        return _unit(name, linearization), None
    if name in linearization.held:
        return np.zeros(len(linearization.names)), linearization.held[name]
    pair = name[3] if name.startswith("tau") else name[1]
    resistance = f"R{pair} [Ohm]"
    other, sign = (f"C{pair} [F]", 1) if name.startswith("tau") else (f"tau{pair} [s]", -1)
    moved, reason = direction_of(other, linearization)
    by_resistance, why = direction_of(resistance, linearization)
    return moved + sign * by_resistance, reason or why


def _unit(name: str, linearization: Linearization) -> Float[np.ndarray, "free"]:
    return np.eye(len(linearization.names))[linearization.names.index(name)]


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
