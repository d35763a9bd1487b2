"""A test as steps of constant current: its pieces, its predicted course, and the limits that it
keeps."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import jax
import numpy as np
from jaxtyping import Array, Float

from ..bundled import bundled_file
from ..cell import CellModel
from ..errors import InputError
from ..model.prepared import PreparedRecord
from ..records import read_record
from ..records.lag import lagged
from .information import NEARLY_SOC, Prior, Samples, Soc

INTERVAL_S = 1.0
# Plotted voltages are within this of the predicted ones.
DRAWN_V = 3e-3
# A test starts full, and ends at this low SOC.
HIGH_SOC, LOW_SOC = 1.0, 0.05
# Usual tests are long, and are evaluated at this interval.
COARSE_S = 2.0
# A cell of this many Ah in moving air warms by this many K per W per Ah, with this time constant in
# s: an 18650 cell. Heat grows with the capacity, cooling with the surface: other cells scale by its
# cube root.
WARMING_AH, WARMING_K, WARMING_S = 2.5, 30.0, 540.0
SHORTEST_MOVE_S = 5
# Lowest and highest voltage of a layered-oxide cell, and of one whose OCV when full is below the
# last.
WINDOW_V, LFP_WINDOW_V, LFP_FULL_V, NEARLY_FULL = (2.5, 4.2), (2.0, 3.65), 3.8, 0.97
# Any cell is flat for a few minutes: an LFP cell must also have been seen nearly empty.
SEEN_EMPTY_V = 3.1
# A cycler holds no step shorter than this, and levels are multiples of that share.
SHORTEST_S = 2.0
LEVEL = 0.05
# Duration of a piece of a drive cycle.
DRIVE_S = 120
# A rate in 1/h of the capacity, or pairs of SOC and rate with linear interpolation.
Rate = float | Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Step:
    """A current held for some time.

    Args:
        block: The piece of the test it belongs to.
        duration_s: Its duration.
        current_a: The current, positive on discharge.
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
        discharge_c: Largest discharge in 1/h of the capacity; pairs of SOC and rate if it depends
            on the SOC, with linear interpolation.
        charge_c: Largest charge, likewise.
        warming_k: Largest temperature rise of the cell in moving air in the worst case.
        margin_v: Least distance of the worst case from both voltages.
        beyond_soc: Largest excursion of pieces from their stretch of SOC, if rates depend on it.
        share: Share of the rates that is used.

    Raises `InputError` for voltages that leave nothing between them, and for invalid rates.
    """

    low_v: float
    high_v: float
    discharge_c: Rate = 1.0
    charge_c: Rate = 0.5
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
            pairs = _pairs(rate)
            if not pairs or not all(0 <= soc <= 1 and 0 <= c < math.inf for soc, c in pairs):
                raise InputError(
                    f"`{name}` {rate}: a rate is 0 or more, and states of charge are from 0 to 1"
                )

    def rates_a(self, capacity_ah: float, soc: Soc) -> tuple[Soc, Soc]:
        """The largest discharge and charge in A given for these states of charge."""
        discharge_c, charge_c = (
            np.interp(soc, *np.transpose(_pairs(rate)))
            for rate in (self.discharge_c, self.charge_c)
        )
        return discharge_c * capacity_ah, charge_c * capacity_ah

    def allowed(self, prior: Prior, high_soc: float, low_soc: float) -> tuple[float, float]:
        """The largest discharge and charge in A between two states of charge, with worst-case
        resistances."""
        soc = np.linspace(low_soc, high_soc, 5)
        tables, capacity_ah = prior.tables, prior.cell.capacity_ah
        total = np.sum([tables.at(name, soc) for name in tables.resistances], axis=0)
        worst = total * np.interp(soc, tables.nodes, prior.worst)
        down = np.min((prior.ocv_end_v(soc, -1) - self.low_v - self.margin_v) / worst)
        up = np.min((self.high_v - self.margin_v - prior.ocv_end_v(soc, 1)) / worst)
        near = np.linspace(low_soc - self.beyond_soc, high_soc + self.beyond_soc, 21)
        rates = map(np.min, self.rates_a(capacity_ah, near))
        discharge_a, charge_a = (
            max(0.0, min(float(limit), self.share * float(rate)))
            for limit, rate in zip((down, up), rates, strict=True)
        )
        # A cell that is full, or at the highest SOC with a known OCV, cannot be charged.
        is_full = high_soc + self.beyond_soc >= prior.planned_soc[1] - NEARLY_SOC
        return discharge_a, charge_a * (not is_full)


def _pairs(rate: Rate) -> list[tuple[float, float]]:
    """A rate over SOC, including one with a single value."""
    return [(0.0, float(rate))] if isinstance(rate, int | float) else sorted(rate)


def voltage_limits_of(cell: CellModel, chemistry: str = "") -> tuple[float, float]:
    """The lowest and the highest voltage usual for a chemistry, else for such an OCV.

    An OCV unknown at full may be of either kind, unless it exceeds the limits of one: the narrower
    limits are taken.
    """
    if chemistry:
        return LFP_WINDOW_V if chemistry == "lfp" else WINDOW_V
    highest_soc = cell.soc_range[1]
    highest_v = float(cell.average_ocv_v(np.array([highest_soc]))[0])
    # For a cell without an OCV test, the fullest observed point may be far from full.
    if highest_soc > NEARLY_FULL and not cell.ocv_is_fitted:
        return LFP_WINDOW_V if highest_v < LFP_FULL_V else WINDOW_V
    if highest_v > LFP_WINDOW_V[1]:
        return WINDOW_V
    lowest_v = float(cell.average_ocv_v(np.array([cell.soc_range[0]]))[0])
    is_lfp = cell.has_flat_ocv and (not cell.ocv_is_fitted or lowest_v < SEEN_EMPTY_V)
    return LFP_WINDOW_V if is_lfp else (WINDOW_V[0], LFP_WINDOW_V[1])


def hours_of(steps: Sequence[Step]) -> float:
    return sum(step.duration_s for step in steps) / 3600


def sampled(steps: Sequence[Step], interval_s: float = INTERVAL_S) -> Samples:
    """The current at every sample; the end of the last step is the last sample."""
    counts = [round(step.duration_s / interval_s) for step in steps]
    return np.append(np.repeat([step.current_a for step in steps], counts), steps[-1].current_a)


def voltage_along(prior: Prior, loaded: PreparedRecord, worst: int = 0) -> Samples:
    """The voltage predicted by the prior, every second; with `worst` the lowest (-1) or highest
    (+1) for worst-case resistances."""
    soc, tables = loaded.soc, prior.tables
    driven_a = loaded.current_a * (np.interp(soc, tables.nodes, prior.worst) if worst else 1.0)
    first, *drops = [tables.at(name, soc) * driven_a for name in tables.resistances]
    total = sum(map(lagged, drops, np.array(tables.tau_s) / INTERVAL_S), first)
    half_gap_v = prior.cell.branch_gap_v(soc) / 2 if worst else 0.0
    ocv_v = prior.ocv_end_v(soc, worst) if worst else prior.ocv_v(soc)
    return ocv_v + worst * half_gap_v - total


def bends(voltages_v: np.ndarray, start: int, last: int) -> list[int]:
    """The first and the last sample, and those in between needed for straight lines within
    `DRAWN_V` of the voltages (Douglas and Peucker 1973, but along the voltage)."""
    lines_v = np.linspace(voltages_v[:, start], voltages_v[:, last], last - start + 1, axis=1)
    off_v = np.abs(voltages_v[:, start : last + 1] - lines_v).max(axis=0)
    bend = start + int(off_v.argmax())
    if not off_v.max() > DRAWN_V:
        return [start, last]
    return [*bends(voltages_v, start, bend), *bends(voltages_v, bend, last)[1:]]


def warming_of(prior: Prior, current_a: Samples, voltage_v: Samples, soc: Samples) -> float:
    """The largest predicted rise of the temperature in K at these currents and voltages."""
    heat_w = current_a * (prior.ocv_v(soc) - voltage_v)
    capacity_ah = prior.cell.capacity_ah
    times = (capacity_ah / WARMING_AH) ** (1 / 3)
    lagging_w = lagged(heat_w, times * WARMING_S / INTERVAL_S)
    return float(np.max(lagging_w)) * times * WARMING_K / capacity_ah


def hppc_steps(
    capacity_ah: float,
    discharge_a: float,
    charge_a: float,
    high_soc: float = HIGH_SOC,
    low_soc: float = LOW_SOC,
) -> list[Step]:
    """A usual pulse test: at every 10 % an hour of rest, 30 s of discharge, 40 s of rest, 10 s of
    charge, and a move at C/3."""
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
    """Other bundled drive cycles with this largest current, from one SOC down to another."""
    current_a = read_record(bundled_file("identification")).current_a
    whole = np.tile(current_a / current_a.max() * largest_a, 4)
    soc = high_soc - np.cumsum(whole) / 3600 / capacity_ah
    last = int(np.argmax(soc < low_soc)) or len(whole)
    return [Step("drive cycle", COARSE_S, level_a) for level_a in whole[:last:2].tolist()]


def move(name: str, charge_ah: float, rate_a: float) -> Step:
    """A step that removes a charge (adds it, if negative) at up to a current; none for a charge of
    a few seconds."""
    seconds = math.ceil(3600 * abs(charge_ah) / rate_a)
    if seconds < SHORTEST_MOVE_S:
        return Step(name, 0.0, 0.0)
    return Step(name, float(seconds), float(f"{charge_ah * 3600 / seconds:.5g}"))


@dataclass(frozen=True)
class Block:
    """Steps of constant current: the duration and level of each.

    Args:
        name: Its name.
        durations_s: Duration of each step.
        levels: Its level: a share of the largest current allowed at the block's state of charge; 1
            is the largest discharge, -1 the largest charge, 0 a rest.

    >>> Block("pulse", (10.0, 40.0), (1.0, 0.0)).duration_s
    50.0
    """

    name: str
    durations_s: tuple[float, ...]
    levels: tuple[float, ...]

    @property
    def duration_s(self) -> float:
        return sum(self.durations_s)

    def currents(self, discharge_a: float, charge_a: float) -> Float[np.ndarray, "steps"]:
        """The current of every step in A, given the allowed discharge and charge."""
        level = np.array(self.levels)
        return np.where(level > 0, level * discharge_a, level * charge_a)

    def steps(self, discharge_a: float, charge_a: float) -> list[Step]:
        """The steps, given the allowed discharge and charge."""
        currents_a = self.currents(discharge_a, charge_a).tolist()
        return [Step(self.name, *held) for held in zip(self.durations_s, currents_a, strict=True)]


def candidate_blocks(
    key: Array, drive: Float[np.ndarray, "seconds"] | None = None
) -> tuple[Block, ...]:
    """The blocks that a design chooses from by default.

    Pulses and rests, pseudo-random binary currents with several clocks, random steps, a multisine
    and, if `drive` is given, pieces of a drive cycle.

    Args:
        key: Random key.
        drive: A drive cycle, a level for every second, 1 its largest discharge.
    """
    binary_key, step_key, sine_key, piece_key = jax.random.split(key, 4)
    pulses_s = (10.0, 40.0, 10.0, 40.0)
    blocks = [
        Block("slow discharge", (300.0,), (0.2,)),
        Block("short pulses", pulses_s, (1.0, 0.0, -1.0, 0.0)),
        Block("small pulses", pulses_s, (0.5, 0.0, -0.5, 0.0)),
        Block("long pulse", (60.0, 120.0), (1.0, 0.0)),
    ]
    for number, (clock_s, length_s) in enumerate(((4, 64), (12, 144), (40, 240))):
        block_key, count = jax.random.fold_in(binary_key, number), length_s // clock_s
        is_high = np.asarray(jax.random.permutation(block_key, np.arange(count) % 2 == 0))
        for floor, suffix in ((-1.0, ""), (0.0, ", no charge")):
            levels = np.where(is_high, 1.0, floor)
            blocks.append(_joined(f"binary {clock_s} s{suffix}", [float(clock_s)] * count, levels))
    for number, (longest_s, length_s) in enumerate(((30, 120), (120, 360))):
        block_key = jax.random.fold_in(step_key, number)
        blocks.append(_random_steps(block_key, longest_s, length_s))
    blocks.append(_multisine(sine_key, 256))
    if drive is not None and len(drive) > DRIVE_S:
        starts = jax.random.randint(piece_key, (2,), 0, len(drive) - DRIVE_S)
        for number, start in enumerate(np.asarray(starts).tolist(), 1):
            piece = np.clip(drive[start : start + DRIVE_S], -1.0, 1.0)
            blocks.append(_joined(f"drive cycle {number}", [1.0] * DRIVE_S, piece))
    return tuple(blocks)


def _random_steps(key: Array, longest_s: float, length_s: float) -> Block:
    """Steps of random levels, with short lengths as likely as long ones."""
    length_key, level_key = jax.random.split(key)
    count = int(length_s // SHORTEST_S)
    drawn = jax.random.uniform(length_key, (count,))
    lengths = np.round(3.0 * (longest_s / 3.0) ** np.asarray(drawn))
    count = int(np.searchsorted(np.cumsum(lengths), length_s)) + 1
    lengths = lengths[:count]
    levels = np.asarray(jax.random.uniform(level_key, (count,), minval=-1.0, maxval=1.0))
    return _joined(f"random steps up to {longest_s:g} s", lengths.tolist(), levels)


def _multisine(key: Array, length_s: int) -> Block:
    """Sines of equal amplitude from 16 s to the length, octave by octave, with random phases."""
    periods = length_s / 2.0 ** np.arange(int(np.log2(length_s / 16)) + 1)
    phases = np.asarray(jax.random.uniform(key, (len(periods), 1))) * 2 * np.pi
    time_s = np.arange(0.0, length_s, 4.0)
    level = np.sum(np.sin(2 * np.pi * time_s / periods[:, None] + phases), axis=0)
    return _joined("multisine", [4.0] * len(level), level / np.abs(level).max())


def _joined(name: str, lengths: Sequence[float], levels: Float[np.ndarray, "steps"]) -> Block:
    """A block of these steps; neighbors with the same rounded level are one step."""
    rounded = np.round(np.round(levels / LEVEL) * LEVEL + 0.0, 6).tolist()
    runs = groupby(zip(lengths, rounded, strict=True), lambda step: step[1])
    joined = [(float(sum(length for length, _ in run)), level) for level, run in runs]
    return Block(name, *zip(*joined, strict=True))
