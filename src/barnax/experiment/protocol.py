"""A test as steps of constant current: composed, simulated, and held within limits."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..bundled import bundled_file
from ..errors import InputError
from ..records import read_record
from .information import NEARLY_SOC, Believed, lagged, soc_along

INTERVAL_S = 1.0
# Drawn voltages are within this of the predicted ones.
DRAWN_V = 3e-3
# A test starts full, and ends so low.
HIGH_SOC, LOW_SOC = 1.0, 0.05
# Usual tests last long, and are looked at in so many seconds.
COARSE_S = 2.0
# A cell of so many Ah in moving air warms by so many K for a W an Ah, in so many s: an 18650 cell.
# Heat grows with the capacity, cooling with the surface: others by the cube root of theirs.
WARMING_AH, WARMING_K, WARMING_S = 2.5, 30.0, 540.0
SHORTEST_MOVE_S = 5


@dataclass(frozen=True)
class Step:
    """A current held for a while.

    Args:
        block: The piece of the test that it is of.
        duration_s: Its duration.
        current_a: The current.
    """

    block: str
    duration_s: float
    current_a: float


@dataclass(frozen=True)
class Limits:
    """Limits that a test must keep.

    Args:
        low_v: Lowest voltage.
        high_v: Highest voltage.
        discharge_c: Largest discharge in 1/h of the capacity; pairs of SOC and rate where it
            follows the SOC, linear between them.
        charge_c: Largest charge, likewise.
        warming_k: How much the worst case may warm the cell in moving air.
        margin_v: How far from both voltages the worst case stays.
        beyond_soc: How far pieces may leave their stretch of SOC, where rates follow it.
        share: Of the rates, what is used.

    Raises `InputError` for voltages that leave nothing between them, and for rates that are none.
    """

    low_v: float
    high_v: float
    discharge_c: float | Sequence[tuple[float, float]] = 1.0
    charge_c: float | Sequence[tuple[float, float]] = 0.5
    warming_k: float | None = None
    margin_v: float = 0.02
    beyond_soc: float = 0.0
    share: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.low_v < self.high_v < math.inf:
            raise InputError(
                f"`low_voltage` {self.low_v:g} V must be positive and under `high_voltage` "
                f"{self.high_v:g} V"
            )
        if self.warming_k is not None and not self.warming_k > 0:
            raise InputError(f"`max_warming` {self.warming_k:g} K must be above 0")
        named = {"max_discharge": self.discharge_c, "max_charge": self.charge_c}
        for name, rate in named.items():
            pairs = [(0.0, rate)] if isinstance(rate, int | float) else [*rate]
            if not pairs or not all(0 <= soc <= 1 and 0 <= c < math.inf for soc, c in pairs):
                raise InputError(
                    f"`{name}` {rate}: a rate is 0 or more, and states of charge are from 0 to 1"
                )

    def rates_a(
        self, capacity_ah: float, soc: Float[np.ndarray, "*any"]
    ) -> tuple[Float[np.ndarray, "*any"], Float[np.ndarray, "*any"]]:
        """The largest discharge and charge in A that are named for these states of charge."""
        return _at(self.discharge_c, soc) * capacity_ah, _at(self.charge_c, soc) * capacity_ah

    def allowed(self, believed: Believed, high_soc: float, low_soc: float) -> tuple[float, float]:
        """The largest discharge and charge in A between two states of charge, where resistances are
        as large as they may be."""
        soc = np.linspace(low_soc, high_soc, 5)
        tables, capacity_ah = believed.tables, believed.cell.capacity_ah
        total = np.sum([tables.at(n, soc) for n in tables.tables if n.startswith("R")], axis=0)
        worst = total * np.interp(soc, tables.nodes, believed.worst)
        down = np.min((believed.ocv_end_v(soc, -1) - self.low_v - self.margin_v) / worst)
        up = np.min((self.high_v - self.margin_v - believed.ocv_end_v(soc, 1)) / worst)
        near = np.linspace(low_soc - self.beyond_soc, high_soc + self.beyond_soc, 21)
        rates = map(np.min, self.rates_a(capacity_ah, near))
        discharge_a, charge_a = (
            max(0.0, min(float(limit), self.share * float(rate)))
            for limit, rate in zip((down, up), rates, strict=True)
        )
        # A cell that is full, or as full as its OCV is known, cannot be charged.
        is_full = high_soc + self.beyond_soc >= believed.planned_soc[1] - NEARLY_SOC
        return discharge_a, charge_a * (not is_full)


def _at(rate: float | Sequence[tuple[float, float]], soc: np.ndarray) -> np.ndarray:
    if isinstance(rate, int | float):
        return np.full(len(soc), float(rate))
    return np.interp(soc, *np.transpose(sorted(rate)))


def hours_of(steps: Sequence[Step]) -> float:
    return sum(step.duration_s for step in steps) / 3600


def sampled(steps: Sequence[Step], interval_s: float = INTERVAL_S) -> Float[np.ndarray, "samples"]:
    """The current at every sample; the last step's end is the last one."""
    counts = [round(step.duration_s / interval_s) for step in steps]
    return np.append(np.repeat([step.current_a for step in steps], counts), steps[-1].current_a)


def voltage_along(
    believed: Believed, current_a: Float[np.ndarray, "samples"], soc: float, worst: int = 0
) -> tuple[Float[np.ndarray, "samples"], Float[np.ndarray, "samples"]]:
    """The voltage and the state of charge that are believed to follow out of a rest; with `worst`
    the lowest (-1) or highest (+1) where every resistance is as large as it may be."""
    along, tables = soc_along(believed, current_a, soc), believed.tables
    factor = np.interp(along, tables.nodes, believed.worst) if worst else np.ones(len(along))
    names = [name for name in tables.tables if name.startswith("R")]
    first, *drops = [tables.at(name, along) * factor * current_a for name in names]
    total = sum(map(lagged, drops, tables.tau_s), first)
    half_gap_v = believed.cell.branch_gap_v(along) / 2 if worst else 0.0
    ocv_v = believed.ocv_end_v(along, worst) if worst else believed.ocv_v(along)
    return ocv_v + worst * half_gap_v - total, along


def bends(voltages_v: np.ndarray, start: int, last: int) -> list[int]:
    """The first and the last sample, and those between with which straight lines are within
    `DRAWN_V` of the voltages (Douglas and Peucker 1973, but along the voltage)."""
    lines_v = np.linspace(voltages_v[:, start], voltages_v[:, last], last - start + 1, axis=1)
    off_v = np.abs(voltages_v[:, start : last + 1] - lines_v).max(axis=0)
    bend = start + int(off_v.argmax())
    if not off_v.max() > DRAWN_V:
        return [start, last]
    return [*bends(voltages_v, start, bend), *bends(voltages_v, bend, last)[1:]]


def warming_of(
    believed: Believed,
    current_a: Float[np.ndarray, "samples"],
    voltage_v: Float[np.ndarray, "samples"],
    soc: Float[np.ndarray, "samples"],
) -> float:
    """By how many K at most a cell warms, of which that voltage is believed."""
    heat_w = current_a * (believed.ocv_v(soc) - voltage_v)
    capacity_ah = believed.cell.capacity_ah
    times = (capacity_ah / WARMING_AH) ** (1 / 3)
    lagging_w = lagged(heat_w, times * WARMING_S, INTERVAL_S)
    return float(np.max(lagging_w)) * times * WARMING_K / capacity_ah


def hppc_steps(
    capacity_ah: float,
    discharge_a: float,
    charge_a: float,
    high_soc: float = HIGH_SOC,
    low_soc: float = LOW_SOC,
) -> list[Step]:
    """A pulse test as it is usually run: at every 10 % an hour of rest, 30 s of discharge, 40 s of
    rest, 10 s of charge, and a move of C/3."""
    steps, levels = [], 1 + math.floor((high_soc - low_soc) / 0.1 + 1e-6)
    for level in range(levels):
        steps.append(Step("rest", 3600, 0.0))
        steps += [Step("pulse", 30, discharge_a), Step("pulse", 40, 0.0)]
        steps += [Step("pulse", 10, -charge_a if level else 0.0), Step("pulse", 40, 0.0)]
        if level < levels - 1:
            pulsed_ah = (30 * discharge_a - (10 * charge_a if level else 0)) / 3600
            steps.append(move("move", 0.1 * capacity_ah - pulsed_ah, capacity_ah / 3))
    return steps


def drive_levels() -> Float[np.ndarray, "seconds"]:
    """The bundled drive cycle, a level every second."""
    current_a = read_record(bundled_file("validation")).current_a
    return current_a / current_a.max()


def drive_steps(
    capacity_ah: float, largest_a: float, high_soc: float = HIGH_SOC, low_soc: float = LOW_SOC
) -> list[Step]:
    """Other bundled drive cycles with such a largest current, from one SOC down to another."""
    current_a = read_record(bundled_file("identification")).current_a
    whole = np.tile(current_a / current_a.max() * largest_a, 4)
    soc = high_soc - np.cumsum(whole) / 3600 / capacity_ah
    last = int(np.argmax(soc < low_soc)) or len(whole)
    return [Step("drive cycle", COARSE_S, level_a) for level_a in whole[:last:2].tolist()]


def move(name: str, charge_ah: float, rate_a: float) -> Step:
    """A step that takes a charge out (in, where it is negative) at up to a current; none for a
    charge of a few seconds."""
    seconds = math.ceil(3600 * abs(charge_ah) / rate_a)
    if seconds < SHORTEST_MOVE_S:
        return Step(name, 0.0, 0.0)
    return Step(name, float(seconds), float(f"{charge_ah * 3600 / seconds:.5g}"))
