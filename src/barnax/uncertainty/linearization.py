"""The errors of a circuit and their derivatives by its free parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import jax
import numpy as np
from jaxtyping import Array, Float

from ..cell import CircuitParameters
from ..errors import InputError
from ..execution import as_input, compile_for, in_float64
from ..model.inputs import PreparedRecord
from ..model.padding import records_in
from ..model.problem import Objective, Problem, point_blocks, residuals
from ..search.refine import at_bound

# Voltages and derivatives beyond this are overflows on their way.
LARGEST_NUMBER = 1e20
# A parameter that moves the voltage by less than this (RMS, for a factor of e) is not seen: far
# below rounding, but squares of it are still numbers.
LEAST_V = 1e-18
# Why a parameter is not free; "unseen" is one that no scored sample depends on.
Held = Literal["fixed", "at lower bound", "at upper bound", "unseen"]


@dataclass(frozen=True, eq=False)
class Linearization:
    """Errors of a circuit and their derivatives by what the data could move.

    `names` are the free parameters in `log` coordinates: resistances, time constants (or
    capacitances, where those are bounded) and gamma; `slope_v` holds dU by d ln of each, over the
    scored samples, measured minus simulated like `error_v`. `held` says of every other parameter
    why it is not free. `time_s` joins the clocks of all records, further apart than `longest_s`,
    the duration of the longest of them.
    """

    point: Float[np.ndarray, "coordinates"]
    free: tuple[int, ...]
    names: tuple[str, ...]
    held: dict[str, Held]
    time_s: Float[np.ndarray, "scored"]
    longest_s: float
    error_v: Float[np.ndarray, "scored"]
    slope_v: Float[np.ndarray, "scored free"]

    @property
    def samples(self) -> int:
        return len(self.error_v)

    @property
    def logarithms(self) -> Float[np.ndarray, "free"]:
        """The free parameters' logarithms."""
        return self.point[list(self.free)]

    @property
    def interval_s(self) -> float:
        """The median sampling interval."""
        return float(np.median(np.diff(self.time_s)))

    def direction_of(self, name: str) -> tuple[Float[np.ndarray, "free"], Held | None]:
        """How the logarithm of a parameter moves with the free ones', and why it is held if it is.

        C and tau of a pair follow from each other: ln tau = ln R + ln C.
        """
        if name in self.names:
            return np.eye(len(self.names))[self.names.index(name)], None
        if name in self.held:
            return np.zeros(len(self.names)), self.held[name]
        pair = name[3] if name.startswith("tau") else name[1]
        other, sign = (f"C{pair} [F]", 1) if name.startswith("tau") else (f"tau{pair} [s]", -1)
        moved, reason = self.direction_of(other)
        by_resistance, why = self.direction_of(f"R{pair} [Ohm]")
        return moved + sign * by_resistance, reason or why


def named_values(parameters: CircuitParameters) -> dict[str, float]:
    """Every parameter under PyBaMM's name, each time constant after its capacitance."""
    values: dict[str, float] = {}
    for name, value in parameters.to_dict().items():
        values[name] = value
        if name.startswith("C"):
            pair = int(name[1])
            values[f"tau{pair} [s]"] = parameters.tau_s[pair - 1]
    return values


@in_float64
def linearize(
    problem: Problem, parameters: CircuitParameters, freed: Sequence[str] = ()
) -> Linearization:
    """The errors of a circuit of the box and their derivatives, always by the scan.

    A parameter at a bound is held there, for the bound decides its value, unless it is `freed`; so
    is one that no scored sample depends on. Raises `InputError` where an error or a derivative is
    no number that can be squared.
    """
    objective = problem.padded_objective()
    box = objective.coordinates
    point = np.asarray(point_blocks([parameters], box)[0])[0]
    here = as_input(point)
    program = compile_for(_errors_and_slopes, here, objective)
    error, slope = (np.asarray(part) for part in program(here, objective))
    # Each record is as long as its padding made it.
    lengths = [len(inputs.current_a) for inputs in records_in(objective.evaluator)]
    scored = np.concatenate(
        [
            np.pad(prepared.scored, (0, length - len(prepared.scored)))
            for prepared, length in zip(problem.prepared_records, lengths, strict=True)
        ]
    )
    unit = np.sqrt(problem.scored)
    error_v, slope_v = unit * error[scored], unit * slope[scored]
    if not (np.all(np.abs(error_v) < LARGEST_NUMBER) and np.all(np.abs(slope_v) < LARGEST_NUMBER)):
        raise InputError(
            "the circuit's voltage or its derivatives with respect to the parameters are not "
            "finite, so its intervals cannot be computed; narrow the bounds"
        )
    is_seen = np.sqrt(np.mean(slope_v**2, axis=0)) > LEAST_V
    held: dict[str, Held] = dict.fromkeys(problem.bounds.fixed, "fixed")
    for each in at_bound(box, parameters):
        if each.name in box.names and each.name not in freed:
            held[each.name] = "at lower bound" if each.side == "lower" else "at upper bound"
    held |= {
        name: "unseen"
        for index, name in enumerate(box.names)
        if name not in held and not is_seen[index]
    }
    free = tuple(index for index, name in enumerate(box.names) if name not in held)
    return Linearization(
        point=point,
        free=free,
        names=tuple(box.names[index] for index in free),
        held=held,
        time_s=one_clock(problem.prepared_records),
        longest_s=max(prepared.scored_duration_s for prepared in problem.prepared_records),
        error_v=error_v,
        slope_v=slope_v[:, list(free)],
    )


@in_float64
def compile_linearization(problem: Problem) -> None:
    """Make the program of `linearize`, which takes seconds and waits for no answer."""
    objective = problem.padded_objective()
    compile_for(_errors_and_slopes, objective.coordinates.lower, objective)


def _errors_and_slopes(
    point: Float[Array, "free"], objective: Objective
) -> tuple[Float[Array, "samples"], Float[Array, "samples free"]]:
    return residuals(point, objective), jax.jacfwd(residuals)(point, objective)


def one_clock(prepared_records: Sequence[PreparedRecord]) -> Float[np.ndarray, "scored"]:
    """Times of all scored samples, no lag within a record being one between records."""
    gap_s = max(
        prepared.scored_duration_s + 2 * prepared.median_interval_s for prepared in prepared_records
    )
    times, start_s = [], 0.0
    for prepared in prepared_records:
        time_s = prepared.time_s[prepared.scored]
        first_s = time_s[0]
        # In place: a long record has no room for copies.
        time_s += start_s
        time_s -= first_s
        times.append(time_s)
        start_s = times[-1][-1] + gap_s
    return np.concatenate(times)
