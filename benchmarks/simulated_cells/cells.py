"""Cells of known truth, their dynamic records and their OCV tests.

The circuit is R0, one to three RC pairs, the OCV and a hysteresis; the current is constant between
the times at which it switches, for which the pairs are exact. Discharge current is positive until
it is written down.
"""

from dataclasses import dataclass

import numpy as np
import polars as pl

HYSTERESES = ("none", "moving", "switched")
INTERVALS_S = (0.1, 1.0, 10.0, 30.0, 0.5, 2.0, 5.0)


@dataclass(frozen=True)
class Cell:
    """What is true of one cell, and how it was measured.

    `gap_v` is the hysteresis voltage between the branches, `rate` that of a moving one per unit of
    SOC. The load switches every `load_s` or a multiple of it, which is one sample except where a
    load is faster than the log. A sample's voltage is from just after the load switched, and its
    current the one that follows, in a forward log; in a backward log both are from just before.
    `lag` is the share of a sample by which the voltage is older than the current.
    """

    number: int
    capacity_ah: float
    r0: float
    r: tuple[float, ...]
    tau_s: tuple[float, ...]
    hysteresis: str
    gap_v: float
    rate: float
    ocv_test: str
    interval_s: float
    load_s: float
    hours: float
    hold: str
    lag: float
    step_a: float
    offset_a: float
    noise_v: float

    def words(self) -> str:
        """The traits of a cell in a row of a table."""
        load = "" if self.load_s >= self.interval_s else f", load of {self.load_s:g} s"
        lag = f", lag {self.lag:.0%}" if self.lag else ""
        current = f", offset {1e3 * self.offset_a:+.1f} mA" if self.offset_a else ""
        return (
            f"{len(self.r)} pairs, {self.hysteresis} hysteresis, {self.ocv_test}, "
            f"{self.interval_s:g} s {self.hold}{load}{lag}{current}"
        )


def draw(number: int) -> Cell:
    """The cell of a number: its traits in turn, its values drawn."""
    rng = np.random.default_rng([25, number])
    pairs, hysteresis = 1 + number % 3, HYSTERESES[number // 3 % 3]
    capacity_ah = float(rng.uniform(1.5, 6.0))
    r0 = float(rng.uniform(0.03, 0.12) / capacity_ah)
    tau_s = np.array([rng.uniform(8, 40), rng.uniform(100, 400), rng.uniform(800, 1800)])
    r = r0 * rng.uniform(0.25, 0.9, 3)
    interval_s = INTERVALS_S[number % len(INTERVALS_S)]
    is_fast = interval_s >= 10 and rng.random() < 0.25
    return Cell(
        number=number,
        capacity_ah=capacity_ah,
        r0=r0,
        r=tuple(r[:pairs].tolist()),
        tau_s=tuple(tau_s[:pairs].tolist()),
        hysteresis=hysteresis,
        gap_v=0.0 if hysteresis == "none" else float(rng.uniform(0.01, 0.05)),
        rate=float(np.exp(rng.uniform(np.log(10), np.log(100)))),
        ocv_test=("slow sweep", "pulses")[number // 9 % 2],
        interval_s=interval_s,
        load_s=1.0 if is_fast else interval_s,
        hours=1.0 if interval_s < 1 else float(rng.uniform(1, 3)),
        hold=("forward", "backward")[number // 2 % 2],
        lag=0.4 if rng.random() < 0.05 else 0.0,
        step_a=float(rng.choice([1e-4, 1e-3, 1e-2])),
        offset_a=float(rng.choice([0, 0, -1, 1])) * capacity_ah / 500,
        noise_v=float(rng.choice([2e-4, 1e-3, 2e-3])),
    )


def ocv_v(soc: np.ndarray, number: int) -> np.ndarray:
    """An OCV that rises with SOC, like that of NMC or NCA over graphite, each cell's its own."""
    steps = 0.05 + 0.05 * np.random.default_rng([26, number]).random(2)
    low, high = 0.22 * (1 - np.exp(-soc / 0.04)), 0.04 * np.exp((soc - 1) / 0.03)
    rises = sum(
        height / (1 + np.exp(-(soc - place) / 0.06))
        for height, place in zip(steps, (0.2, 0.58), strict=True)
    )
    return 3.05 + low + high + rises + 0.62 * soc


def voltage(
    cell: Cell, time_s: np.ndarray, held_a: np.ndarray, soc: float, side: float
) -> tuple[np.ndarray, np.ndarray]:
    """The voltage just after and just before every time, `held_a[k]` flowing after `time_s[k]`.

    The cell comes rested from `side`, +1 charged, -1 discharged.
    """
    step_s = np.diff(time_s, append=time_s[-1] + 1.0)
    passed = held_a * step_s / 3600 / cell.capacity_ah
    charge = soc - np.concatenate([[0.0], np.cumsum(passed)[:-1]])
    drop = np.zeros(len(time_s))
    for r, tau in zip(cell.r, cell.tau_s, strict=True):
        drop += _followed(np.exp(-step_s / tau), r * held_a, 0.0)
    toward, decay = -np.sign(held_a), np.ones(len(time_s))
    if cell.hysteresis == "switched":
        decay = np.where(held_a == 0, 1.0, 0.0)
    elif cell.hysteresis == "moving":
        decay = np.exp(-cell.rate * np.abs(passed))
    state = _followed(decay, toward, side)
    open_v = ocv_v(charge, cell.number) - drop
    after = np.where(toward != 0, toward, state) if cell.hysteresis == "switched" else state
    before_a = np.concatenate([[0.0], held_a[:-1]])
    return (
        open_v + after * cell.gap_v / 2 - cell.r0 * held_a,
        open_v + state * cell.gap_v / 2 - cell.r0 * before_a,
    )


def _followed(decay: np.ndarray, toward: np.ndarray, start: float) -> np.ndarray:
    """x[k + 1] = decay[k] x[k] + (1 - decay[k]) toward[k], before each step."""
    state, states = start, np.empty(len(decay))
    for place, (kept, target) in enumerate(zip(decay.tolist(), toward.tolist(), strict=True)):
        states[place] = state
        state = kept * state + (1 - kept) * target
    return states


def dynamic(cell: Cell) -> pl.DataFrame:
    """A drive from full: rest, pieces of load with brakes and stops, as a tester logs it."""
    rng = np.random.default_rng([27, cell.number])
    every = max(1, round(cell.interval_s / cell.load_s))
    total = int(3600 * cell.hours / cell.interval_s) * every
    shortest = 1 if cell.load_s >= 1 else round(2.0 / cell.load_s)
    pieces = [np.zeros(max(1, round(60 / cell.load_s)))]
    while sum(map(len, pieces)) < total:
        length = shortest * int(rng.integers(1, 12 if every == 1 else 3))
        rate = rng.choice([0.0, rng.uniform(0.1, 2.0), rng.uniform(-0.8, 0.0)], p=[0.2, 0.6, 0.2])
        pieces.append(np.full(length, rate * cell.capacity_ah))
    held_a = np.concatenate(pieces)[:total]
    held_a *= min(1.0, 0.8 * cell.capacity_ah * 3600 / _most_charge(held_a, cell))
    time_s = cell.load_s * np.arange(total)
    after, before = voltage(cell, time_s, held_a, 1.0, 1.0)
    if cell.hold == "forward":
        logged, logged_a = after[::every], held_a[::every]
    else:
        logged, logged_a = before[::every], np.concatenate([[0.0], held_a[:-1]])[::every]
    if cell.lag:
        logged = (1 - cell.lag) * logged + cell.lag * np.concatenate([logged[:1], logged[:-1]])
    return _measured(cell, rng, time_s[::every], logged_a + cell.offset_a, logged)


def _most_charge(held_a: np.ndarray, cell: Cell) -> float:
    """The most charge that has left the cell, in A s."""
    return max(float(np.max(np.cumsum(held_a)) * cell.load_s), 1.0)


def ocv_test(cell: Cell) -> pl.DataFrame:
    """From full to empty and back: at C/20, or in steps of 5 % with rests of two hours.

    A rest is logged as often as the load before it for its first ten minutes.
    """
    rng = np.random.default_rng([28, cell.number])
    every_s = 60.0 if cell.ocv_test == "slow sweep" else 10.0
    step_s = np.append(np.full(round(600 / every_s), every_s), np.full(110, 60.0))
    step_s[-1] = every_s
    rest = (step_s, np.zeros(len(step_s)))
    blocks = [rest]
    for direction in (1, -1):
        if cell.ocv_test == "slow sweep":
            blocks.append((np.full(1200, 60.0), np.full(1200, direction * cell.capacity_ah / 20)))
            blocks.append(rest)
        else:
            pulse = (np.full(90, 10.0), np.full(90, direction * cell.capacity_ah / 5))
            blocks += [pulse, rest] * 20
    step_s, held_a = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    time_s = np.concatenate([[0.0], np.cumsum(step_s)[:-1]])
    after, before = voltage(cell, time_s, held_a, 1.0, 1.0)
    if cell.hold == "forward":
        return _measured(cell, rng, time_s, held_a, after)
    return _measured(cell, rng, time_s, np.concatenate([[0.0], held_a[:-1]]), before)


def _measured(
    cell: Cell, rng: np.random.Generator, time_s: np.ndarray, amps: np.ndarray, volts: np.ndarray
) -> pl.DataFrame:
    """What the tester writes down: steps of the current, noise; discharge negative."""
    noisy_v = volts + cell.noise_v * rng.standard_normal(len(volts))
    current_a = cell.step_a * np.round(amps / cell.step_a)
    return pl.DataFrame(
        {
            "Test Time / s": np.round(time_s, 3),
            "Current / A": -current_a,
            "Voltage / V": np.round(noisy_v, 4),
        }
    )
