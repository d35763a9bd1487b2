"""A refined circuit seen from close by: its errors and their slopes."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..cell import CircuitParameters
from ..execution import compile_for, in_float64
from ..model.inputs import PreparedRecord
from ..model.problem import Objective, Problem, rc_parameters, residuals
from ..model.search_space import Coordinates
from ..search.refine import AT_BOUND


@dataclass(frozen=True, eq=False)
class Linearization:
    """Errors at the refined answer and their derivatives by what the data could move.

    `names` are the free parameters in `log` coordinates: resistances, time constants (or
    capacitances, where those are bounded) and gamma; `slope_v` holds dU by d ln of each, over the
    scored samples, measured minus simulated like `error_v`. `held` says for every parameter that
    is not free why not. `time_s` joins the clocks of all records, further apart than `longest_s`,
    the duration of the longest of them.
    """

    point: Float[np.ndarray, "coordinates"]
    free: tuple[int, ...]
    names: tuple[str, ...]
    held: dict[str, str]
    time_s: Float[np.ndarray, "scored"]
    longest_s: float
    error_v: Float[np.ndarray, "scored"]
    slope_v: Float[np.ndarray, "scored free"]

    @property
    def samples(self) -> int:
        return len(self.error_v)

    @property
    def logarithms(self) -> Float[np.ndarray, "free"]:
        """The free parameters' logarithms at the answer."""
        return self.point[list(self.free)]


@in_float64
def linearize(
    problem: Problem, parameters: CircuitParameters, freed: Sequence[str] = ()
) -> Linearization:
    """The errors of a refined circuit and their derivatives, always by the scan.

    A parameter at a bound of its box is held there, for the box decides its value, unless it is
    `freed`; so is one that no scored sample depends on.
    """
    objective = problem.objective_in("log", "scan")
    box = objective.coordinates
    point = np.asarray(box.encode(rc_parameters(parameters)))
    here = jnp.asarray(point)
    program = compile_for(_errors_and_slopes, here, objective)
    error, slope = (np.asarray(part) for part in program(here, objective))
    scored = np.concatenate([prepared.scored for prepared in problem.prepared_records])
    unit = np.sqrt(problem.scored)
    error_v, slope_v = unit * error[scored], unit * slope[scored]
    held = dict.fromkeys(problem.bounds.fixed, "fixed") | _at_bound(box, point)
    held = {name: why for name, why in held.items() if name not in freed or why == "fixed"}
    held |= {
        name: "no scored sample depends on it"
        for index, name in enumerate(box.names)
        if name not in held and not np.any(slope_v[:, index])
    }
    free = tuple(index for index, name in enumerate(box.names) if name not in held)
    return Linearization(
        point=point,
        free=free,
        names=tuple(box.names[index] for index in free),
        held=held,
        time_s=_one_clock(problem.prepared_records),
        longest_s=max(prepared.scored_duration_s for prepared in problem.prepared_records),
        error_v=error_v,
        slope_v=slope_v[:, list(free)],
    )


@in_float64
def compile_linearization(problem: Problem) -> None:
    """Make the program of `linearize`, which takes seconds and waits for no answer."""
    objective = problem.objective_in("log", "scan")
    compile_for(_errors_and_slopes, objective.coordinates.lower, objective)


def _errors_and_slopes(
    point: Float[Array, "free"], objective: Objective
) -> tuple[Float[Array, "samples"], Float[Array, "samples free"]]:
    return residuals(point, objective), jax.jacfwd(residuals)(point, objective)


def _at_bound(box: Coordinates, point: Float[np.ndarray, "coordinates"]) -> dict[str, str]:
    fraction = (point - np.asarray(box.lower)) / np.asarray(box.upper - box.lower)
    return {
        name: f"at its {'lower' if part < 0.5 else 'upper'} bound"
        for name, part in zip(box.names, fraction, strict=True)
        if not AT_BOUND < part < 1 - AT_BOUND
    }


def _one_clock(prepared_records: tuple[PreparedRecord, ...]) -> Float[np.ndarray, "scored"]:
    """Times of all scored samples, no lag within a record being one between records."""
    gap_s = max(
        prepared.scored_duration_s + 2 * prepared.median_interval_s for prepared in prepared_records
    )
    times, start_s = [], 0.0
    for prepared in prepared_records:
        time_s = prepared.time_s[prepared.scored]
        times.append(start_s + time_s - time_s[0])
        start_s = times[-1][-1] + gap_s
    return np.concatenate(times)
