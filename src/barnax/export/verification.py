"""Verification that an exported circuit is the identified one: simulations of both, compared."""

import importlib.metadata
import importlib.util
import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from ..errors import InputError, installing
from ..results import Result
from ..simulation import simulate_current
from .exporter import Exporter, HeldLoad, Simulate, caveats_of
from .tables import tables_of

# Interval of a verification's current, and the number of steps simulated in each.
INTERVAL_S = 2.0
FINER = 16
# One round of the test profile: seconds and current in units of 1C toward the far end of SOC.
ROUND = ((30.0, 0.0), (240.0, 1.0), (60.0, 0.0), (60.0, -1.0), (30.0, 0.2), (30.0, -0.2))
# The profile stays this share of the measured SOC range away from its end.
UNUSED_SHARE = 0.1


@dataclass(frozen=True)
class Verification:
    """The largest and the rms difference of terminal voltage between a package and barnax, in V.

    For tables at several temperatures it is the largest over the pulse test at each of them. Two
    more figures locate the difference: `without_hysteresis_v` is the same with the hysteresis
    voltage removed from barnax's circuit, `without_turns_v` leaves out the samples at which the
    current turns. There an instant hysteresis has turned in barnax, while a hysteresis that is a
    state turns only as charge passes.
    """

    package: str
    version: str
    samples: int
    temperatures_degc: tuple[float, ...]
    largest_v: float
    rms_v: float
    without_hysteresis_v: float
    without_turns_v: float

    @property
    def text(self) -> str:
        """The differences in a sentence."""
        return caveats_of("verified", self)[0]


def require_package(exporter: Exporter) -> tuple[str, Simulate]:
    """The package in which an export can be simulated, and its simulation. Raises `InputError` if
    it cannot be simulated here."""
    if exporter.package is None or exporter.simulate is None:
        raise InputError(
            f"`verify` works for pybamm and thevenin only, not for {exporter.name}; leave it out"
        )
    if importlib.util.find_spec(exporter.package) is None:
        raise InputError(
            f"`verify` needs the package {exporter.package}, which is not installed; install "
            f"it with {installing('verify')}, or leave `verify` out"
        )
    return exporter.package, exporter.simulate


def verify(
    result: Result, exporter: Exporter, content: bytes, profile: HeldLoad | None = None
) -> Verification:
    """The exported `content` simulated in its package and by barnax, from the result's initial SOC.

    `profile` defaults to `pulse_profile`. Raises `InputError` if the package is missing, or the
    profile leaves the SOC range of the cell.

    Args:
        result: The result that was exported.
        exporter: The exporter.
        content: The exported content.
        profile: The current to simulate; by default `pulse_profile`.
    """
    package, simulate = require_package(exporter)
    profile = profile or pulse_profile(result)
    measured_degc, differences = result.fits.temperatures_degc, []
    for degc in measured_degc or [profile.temperature_degc]:
        there = replace(profile, temperature_degc=degc)
        here = result
        if measured_degc:
            here = result.at_temperature(degc)
            # An export holds a single value of the capacity, and says so.
            cell = replace(here.cell, capacity_ah=tables_of(result).capacity_ah)
            here = here.model_copy(update={"cell": cell})
        # Counted charge may put a start slightly beyond full.
        soc = min(max(here.initial_soc, 0.0), 1.0) if exporter.starts_within else here.initial_soc
        differences.append(_differences(here, simulate, content, there, soc))
    differences_v, without_v, turns_v = (
        np.concatenate(parts) for parts in zip(*differences, strict=True)
    )
    return Verification(
        package=package,
        version=importlib.metadata.version(package),
        samples=len(profile.time_s),
        temperatures_degc=measured_degc,
        largest_v=_largest(differences_v),
        rms_v=math.sqrt(np.mean(np.nan_to_num(differences_v, nan=math.inf) ** 2)),
        without_hysteresis_v=_largest(without_v),
        without_turns_v=_largest(turns_v),
    )


def _differences(result: Result, simulate: Simulate, content: bytes, profile: HeldLoad, soc: float):
    """The differences at all samples, without hysteresis, and without turns."""
    there_v = simulate(content, profile)
    difference_v = there_v - simulate_here(result, profile, soc)
    without_v = there_v - simulate_here(result, profile, soc, without_hysteresis=True)
    return difference_v, without_v, difference_v[~_turns(profile, result.start.direction)]


def simulate_here(
    result: Result, profile: HeldLoad, soc: float | None = None, *, without_hysteresis: bool = False
) -> Float[np.ndarray, "samples"]:
    """barnax's own terminal voltage in V for a result's circuit, or its tables, on a profile, from
    an initial SOC.

    Intervals are divided into `FINER`: barnax holds a resistance over an interval, and a solver
    does not.
    """
    samples = np.arange(len(profile.time_s))
    time_s = np.interp(np.arange(FINER * samples[-1] + 1) / FINER, samples, profile.time_s)
    current_a = np.append(np.repeat(profile.current_a[:-1], FINER), profile.current_a[-1])
    # Exports contain no resistance law, as their caveats say.
    how = {"has_hysteresis": not without_hysteresis, "has_dependence": False}
    simulated = simulate_current(result, time_s, current_a, initial_soc=soc, **how)
    return simulated.voltage_v[::FINER]


def pulse_profile(result: Result) -> HeldLoad:
    """Pulses of 1C and C/5 both ways, with rests, from the initial SOC toward its far end."""
    cell = result.cell_at()
    low, high = cell.soc_range
    margin = UNUSED_SHARE * (high - low)
    soc = result.initial_soc
    is_discharge = soc >= (low + high) / 2
    way = soc - (low + margin) if is_discharge else high - margin - soc
    round_soc = sum(spent_s * rate for spent_s, rate in ROUND) / 3600
    rounds = max(1, math.floor(way / round_soc))
    one_c = cell.capacity_ah if is_discharge else -cell.capacity_ah
    parts = [np.full(round(spent_s / INTERVAL_S), rate * one_c) for spent_s, rate in ROUND]
    current_a = np.tile(np.concatenate(parts), rounds)
    return HeldLoad(INTERVAL_S * np.arange(len(current_a)), current_a)


def _turns(profile: HeldLoad, initial_direction: int) -> Bool[np.ndarray, "samples"]:
    """True where the current flows in the opposite direction to its last one."""
    way = -np.sign(profile.current_a)
    last = np.maximum.accumulate(np.where(way != 0, np.arange(len(way)), -1))
    direction = np.where(last < 0, initial_direction, way[last])
    return np.diff(direction, prepend=initial_direction) != 0


def _largest(difference_v: Float[np.ndarray, "samples"]) -> float:
    # A solver that ends early leaves NaN, which must not pass for agreement.
    return float(np.nan_to_num(np.abs(difference_v), nan=math.inf).max())
