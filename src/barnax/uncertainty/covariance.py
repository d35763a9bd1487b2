"""Standard errors and intervals of every parameter, for independent and for correlated residuals.

The white-noise covariance s^2 (J'J)^-1 assumes independent samples. Intervals use the sandwich
(J'J)^-1 J' G J (J'J)^-1 with G the covariance of the noise that `noise` fits to the residuals, and
Student's t with the degrees of freedom of that fit. J are the errors' derivatives by logarithms, so
standard errors are relative and intervals positive.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import block_diag

from ..cell import CircuitParameters, get_circuit
from ..cell.elements import names_beside
from ..display import Brief
from ..errors import InputError
from ..execution import as_input, compile_for, in_float64
from ..metrics import CONFIDENCE
from ..search.evaluate import nuisance_columns, one_clock, open_starts
from .noise import Noise, fit_noise

if TYPE_CHECKING:
    from ..model.problem import Problem

# Singular values of the scaled Jacobian below this share of the largest are rounding.
SMALLEST_SHARE = 1e-9
# A parameter whose interval extends by more than this factor to either side is not determined.
WIDEST_FACTOR = 100.0
# Voltages and derivatives beyond this are about to overflow.
LARGEST_NUMBER = 1e20
# A parameter that moves the voltage by less than this (RMS, for a factor of e) is unseen: far below
# rounding, but its squares are still representable.
LEAST_V = 1e-18
# The reason why a parameter is not free; "unseen" if no scored sample depends on it.
Held = Literal["fixed", "at lower bound", "at upper bound", "unseen"]


@dataclass(frozen=True, eq=False, repr=False)
class Linearization(Brief):
    """Errors of a circuit and their derivatives by everything that the data could move.

    `names` are the free parameters in `log` coordinates: resistances, time constants (or
    capacitances, if those are bounded) and gamma; `slope_v` holds dU by d ln of each, over the
    scored samples, measured minus simulated like `error_v`. `held` gives the reason why any other
    parameter is not free. `time_s` joins the clocks of all records, further apart than `longest_s`,
    the duration of the longest of them. `is_informative` are the samples with information about the
    circuit: those of a rest before the first load have none. `by_nuisance_v` is the effect on the
    errors of one standard error of each nuisance: of the starts, and with a moving hysteresis all
    of `nuisance_columns`; `nuisances_sd` is their distance from the given values, in standard
    errors.
    """

    point: Float[np.ndarray, "coordinates"]
    free: tuple[int, ...]
    names: tuple[str, ...]
    held: dict[str, Held]
    by_nuisance_v: Float[np.ndarray, "scored nuisances"]
    nuisances_sd: Float[np.ndarray, "nuisances"]
    time_s: Float[np.ndarray, "scored"]
    longest_s: float
    error_v: Float[np.ndarray, "scored"]
    slope_v: Float[np.ndarray, "scored free"]
    is_informative: Bool[np.ndarray, "scored"]

    @property
    def samples(self) -> int:
        return len(self.error_v)

    def direction_of(self, name: str) -> tuple[Float[np.ndarray, "free"], Held | None]:
        """The change of a parameter's logarithm with the free ones', and the reason if it is held.

        C and tau of a pair depend on each other: ln tau = ln R + ln C.
        """
        if name in self.names:
            return np.eye(len(self.names))[self.names.index(name)], None
        if name in self.held:
            return np.zeros(len(self.names)), self.held[name]
        names = names_beside(name)
        other, sign = (names.capacitance, 1) if name == names.tau else (names.tau, -1)
        moved, reason = self.direction_of(str(other))
        by_resistance, why = self.direction_of(names.resistance)
        return moved + sign * by_resistance, reason or why


def named_values(parameters: CircuitParameters) -> dict[str, float]:
    """Every parameter under PyBaMM's name, each time constant after its capacitance."""
    values, tau_s = {}, parameters.named_tau_s
    for name, value in parameters.to_dict().items():
        values[name] = value
        if name.startswith("C"):
            tau = names_beside(name).tau
            values[tau] = tau_s[tau]
    return values


@in_float64
def linearize(
    problem: "Problem", parameters: CircuitParameters, freed: Sequence[str] = ()
) -> Linearization:
    """The errors of a circuit of the box and their derivatives, always by the scan.

    A parameter at a bound is held there, because the bound decides its value, unless it is `freed`;
    so is one on which no scored sample depends. Raises `InputError` if the square of an error or a
    derivative is not a finite number.
    """
    from ..model.problem import errors_and_slopes, point_blocks
    from ..search.seeds import at_bound

    objective = problem.padded_objective()
    box = objective.coordinates
    point = np.asarray(point_blocks([parameters], box)[0])[0]
    here = as_input(point)
    program = compile_for(errors_and_slopes, here, objective)
    error, slope = (np.asarray(part) for part in program(here, objective))
    scored = np.concatenate([np.asarray(inputs.weight) for inputs in problem.padded_inputs]) > 0
    unit = np.sqrt(problem.scored)
    error_v, slope_v = unit * error[scored], unit * slope[scored]
    if not (np.all(np.abs(error_v) < LARGEST_NUMBER) and np.all(np.abs(slope_v) < LARGEST_NUMBER)):
        raise InputError(
            "the circuit's voltage or its derivatives with respect to the parameters are not "
            "finite, so its intervals cannot be computed; narrow the bounds"
        )
    is_seen = np.sqrt(np.mean(slope_v**2, axis=0)) > LEAST_V
    held: dict[str, Held] = dict.fromkeys(problem.bounds.fixed, "fixed")
    for bound in at_bound(box, parameters):
        if bound.name in box.names and bound.name not in freed:
            held[bound.name] = "at lower bound" if bound.side == "lower" else "at upper bound"
    held |= {
        name: "unseen"
        for index, name in enumerate(box.names)
        if name not in held and not is_seen[index]
    }
    free = tuple(index for index, name in enumerate(box.names) if name not in held)
    is_informative = np.concatenate(
        [prepared.is_informative[prepared.scored] for prepared in problem.prepared_records]
    )
    nuisances = open_starts(problem.prepared_records)
    # The errors that constants leave with a switched hysteresis look like that hysteresis.
    if get_circuit(problem.circuit).has_rate:
        further = nuisance_columns(problem.prepared_records, parameters)
        is_many = np.count_nonzero(is_informative) > len(free) + further[0].shape[1]
        nuisances = further if is_many else nuisances
    return Linearization(
        point=point,
        free=free,
        names=tuple(box.names[index] for index in free),
        held=held,
        by_nuisance_v=nuisances[0],
        nuisances_sd=nuisances[1],
        time_s=one_clock(problem.prepared_records),
        longest_s=max(prepared.scored_duration_s for prepared in problem.prepared_records),
        error_v=error_v,
        slope_v=slope_v[:, list(free)],
        is_informative=is_informative,
    )


@in_float64
def compile_linearization(problem: "Problem") -> None:
    """Compile the program of `linearize`, which takes seconds and needs no answer."""
    from ..model.problem import errors_and_slopes

    objective = problem.padded_objective()
    compile_for(errors_and_slopes, objective.coordinates.lower, objective)


@dataclass(frozen=True)
class Estimate:
    """A parameter, its standard errors and its interval; undetermined numbers are None, such as the
    lower end for a resistance that may be zero.

    Attributes:
        name: PyBaMM's name, with its unit.
        value: The value, in that unit.
        held: The reason why it has no interval, if it has none.
        relative_error: Relative standard error, with the noise estimated from the residuals.
        white_noise_relative_error: Relative standard error if the residuals were white noise.
        degrees_of_freedom: Degrees of freedom of the noise level, for Student's t.
        low: Lower end of the 95 % interval, over both holds of the current if the hold is unknown.
        high: Upper end of that interval.
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
        """The standard error in the parameter's unit."""
        return None if self.relative_error is None else self.value * self.relative_error

    @property
    def inflation(self) -> float | None:
        """The standard error over the white-noise one."""
        if self.relative_error is None or not self.white_noise_relative_error:
            return None
        return self.relative_error / self.white_noise_relative_error

    def excludes(self, value: float) -> bool:
        """True if the interval has both ends, and the given value lies outside."""
        if self.low is None or self.high is None:
            return False
        return not self.low <= value <= self.high

    def spanning(self, values: Sequence[float]) -> "Estimate":
        """A copy with an interval extended to those of other values."""
        shares = [1.0, *(value / self.value for value in values)]
        low = None if self.low is None else min(shares) * self.low
        return replace(self, low=low, high=None if self.high is None else max(shares) * self.high)


def linear_end(value: float, half_width: float) -> float | None:
    """The upper end for a resistance that may be zero: the voltage is linear in it."""
    return value * (1 + half_width) if half_width < WIDEST_FACTOR else None


@dataclass(frozen=True)
class NoiseParts:
    """The parts of the fitted noise: correlation time, 0 for the white one, and deviation."""

    correlation_s: tuple[float, ...]
    sd_v: tuple[float, ...]


@dataclass(frozen=True, repr=False)
class Uncertainty(Brief):
    """Errors of all parameters and time constants.

    `correlation` is that of the logarithms of the `free` parameters.
    """

    confidence: float
    samples: int
    estimates: tuple[Estimate, ...]
    free: tuple[str, ...]
    correlation: tuple[tuple[float, ...], ...]
    noise: NoiseParts

    def spanning(self, others: Sequence[CircuitParameters]) -> "Uncertainty":
        """A copy with intervals extended to those of other, equally possible circuits.

        Each of them has an interval of the same relative width.
        """
        values = [named_values(other) for other in others]
        estimates = tuple(
            estimate.spanning([of[estimate.name] for of in values]) for estimate in self.estimates
        )
        return replace(self, estimates=estimates)

    def __getitem__(self, name: str) -> Estimate:
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise KeyError(f"{name!r}; there are {', '.join(one.name for one in self.estimates)}")


@dataclass(frozen=True, eq=False, repr=False)
class Covariance(Brief):
    """Covariances of the free parameters' logarithms, and the noise behind them.

    Nuisances are estimated together with the parameters: each is one more unknown, with its given
    value as the prior. `matrix` includes the correlation of the residuals, `white_noise_matrix`
    does not. `step` and `nuisances_step` lead to the joint optimum, in logarithms and in standard
    errors of the nuisances, whose remaining errors are `nuisances_error`.
    """

    linearization: Linearization
    noise: Noise
    matrix: Float[np.ndarray, "free free"]
    white_noise_matrix: Float[np.ndarray, "free free"]
    step: Float[np.ndarray, "free"]
    nuisances_step: Float[np.ndarray, "nuisances"]
    nuisances_error: Float[np.ndarray, "nuisances"]
    _to_noise: Float[np.ndarray, "columns free"]
    _to_nuisances: Float[np.ndarray, "nuisances free"]

    @classmethod
    def of(cls, linearization: Linearization) -> "Covariance":
        """The covariance at an optimum."""
        here = linearization.is_informative
        error_v, time_s = linearization.error_v[here], linearization.time_s[here]
        values, vectors = _basis(
            np.hstack([linearization.slope_v, linearization.by_nuisance_v])[here]
        )
        noise = fit_noise(error_v, vectors, time_s, linearization.longest_s)
        count, free = len(values), len(linearization.names)
        # The strength of the noise, relative to which the priors of nuisances are weighted.
        weight_v2 = float(np.mean(np.diag(noise.spread_v2))) if count else 0.0
        priors = math.sqrt(weight_v2) * np.eye(count)[free:]
        orthogonal, triangle = np.linalg.qr(np.vstack([values, priors]))
        moved = np.linalg.solve(triangle, orthogonal.T)
        spread_v2 = np.asarray(block_diag(noise.spread_v2, weight_v2 * np.eye(count - free)))
        matrix = moved @ spread_v2 @ moved.T
        prior_v = math.sqrt(weight_v2) * linearization.nuisances_sd
        step = -moved @ np.append(vectors.T @ error_v, prior_v)
        to_noise, to_nuisances = np.split(moved[:free].T, [count])
        variance_v2 = float(error_v @ error_v) / max(len(error_v) - free, 1)
        return cls(
            linearization=linearization,
            noise=noise,
            matrix=matrix[:free, :free],
            white_noise_matrix=variance_v2 * to_noise.T @ to_noise,
            step=step[:free],
            nuisances_step=step[free:],
            nuisances_error=np.sqrt(np.diag(matrix)[free:]),
            _to_noise=to_noise,
            _to_nuisances=math.sqrt(weight_v2) * to_nuisances,
        )

    def reach(self, direction: Float[np.ndarray, "free"]) -> tuple[float, float, float]:
        """The standard error of `direction` . (free logarithms), half the interval of that, and the
        degrees of freedom of both."""
        by_nuisances = float(np.sum((self._to_nuisances @ direction) ** 2))
        samples = int(np.count_nonzero(self.linearization.is_informative))
        freedom = samples - len(self.linearization.names)
        return self.noise.reach(self._to_noise @ direction, by_nuisances, freedom)

    def estimate(self, name: str, value: float, direction: Float[np.ndarray, "free"]) -> Estimate:
        """The estimate of a quantity whose logarithm moves by `direction` . (free logarithms)."""
        error, half_width, freedom = self.reach(direction)
        # In the best-determined directions, rounding can leave a negative variance.
        white_noise_v2 = max(float(direction @ self.white_noise_matrix @ direction), 0.0)
        # Around the joint optimum, extended to the value.
        joint = float(direction @ self.step) if len(self.nuisances_error) else 0.0
        is_open = not half_width < math.log(WIDEST_FACTOR)
        high = None if is_open else float(value * np.exp(max(0.0, joint + half_width)))
        if is_open and name.endswith("[Ohm]"):
            high = linear_end(value, half_width)
        return Estimate(
            name=name,
            value=value,
            relative_error=error,
            white_noise_relative_error=math.sqrt(white_noise_v2),
            degrees_of_freedom=freedom,
            low=None if is_open else float(value * np.exp(min(0.0, joint - half_width))),
            high=high,
        )

    def estimate_of(self, name: str, value: float) -> Estimate:
        """The estimate of a parameter or time constant, without errors if it is held."""
        direction, held = self.linearization.direction_of(name)
        if held is not None and not np.any(direction):
            return Estimate(name, value, held)
        return self.estimate(name, value, direction)

    def summary(self, parameters: CircuitParameters) -> Uncertainty:
        """The part that is stored."""
        sd = np.sqrt(np.maximum(np.diag(self.matrix), 0.0))
        correlation = self.matrix / np.where(sd > 0, np.outer(sd, sd), 1.0)
        return Uncertainty(
            confidence=CONFIDENCE,
            samples=self.linearization.samples,
            estimates=tuple(
                self.estimate_of(name, value) for name, value in named_values(parameters).items()
            ),
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
    """T and orthonormal Q with J = Q T; T is invertible even if J is rank-deficient.

    Directions that move nothing get a singular value so small that their errors are enormous.
    """
    scale = np.linalg.norm(slope_v, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    left, singular, right = np.linalg.svd(slope_v / scale, full_matrices=False)
    singular = np.maximum(singular, SMALLEST_SHARE * singular.max(initial=0.0))
    return (singular[:, None] * right) * scale, left
