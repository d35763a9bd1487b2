"""The field's three tests of one made cell: C/20, pulses (HPPC) or long pulses (GITT), a drive."""

import numpy as np
import polars as pl

from helpers.made_cell import ocv_v
from helpers.reference import banded_response, drop_v

CAPACITY_AH = 2.5
R0_OHM, R_OHM, TAU_S = 0.025, (0.015, 0.02), (20.0, 300.0)
NAMES = ("time [s]", "current [A]", "voltage [V]")
NOISE_V = 1e-3


def made(loads, start=1.0, capacity_ah=CAPACITY_AH, seed=0):
    """Time, current (charge positive) and voltage of a cell under loads of (seconds, A, interval),
    discharge positive. Its resistances are those of a cell of `CAPACITY_AH`, scaled."""
    intervals_s = [np.full(round(seconds / step), step) for seconds, _, step in loads]
    amperes = [
        np.resize(load, len(own)) for (_, load, _), own in zip(loads, intervals_s, strict=True)
    ]
    interval_s, current_a = np.concatenate(intervals_s), np.concatenate(amperes)
    time_s = np.append(0.0, np.cumsum(interval_s))
    soc = start - np.append(0.0, np.cumsum(current_a * interval_s)) / 3600 / capacity_ah
    current_a = np.append(current_a, current_a[-1])
    circuit = (R0_OHM, R_OHM, TAU_S)
    drop = drop_v(banded_response, time_s, current_a, circuit) * CAPACITY_AH / capacity_ah
    noise_v = NOISE_V * np.random.default_rng([seed, round(1e3 * capacity_ah)]).standard_normal(
        len(soc)
    )
    return time_s, -current_a, ocv_v(soc) - drop + noise_v


def slow_sweep(capacity_ah=CAPACITY_AH, back=False, only_back=False):
    """C/20 from full to empty, and back, or only back, every 2 min."""
    move = (20 * 3600 * 0.995, capacity_ah / 20, 120.0)
    rest, charge = (3600, 0.0, 120.0), (move[0], -move[1], move[2])
    if only_back:
        return made([rest, charge, rest], 0.005, capacity_ah)
    loads = [rest, move, rest]
    return made([*loads, charge, rest] if back else loads, 1.0, capacity_ah)


def pulses(capacity_ah=CAPACITY_AH, charged=False):
    """HPPC: ten levels of a discharge and a charge pulse, from full, or after a charge to it."""
    level = [(10, capacity_ah, 0.5), (40, 0.0, 1.0), (10, -0.75 * capacity_ah, 0.5), (600, 0.0, 10)]
    loads = [(1900, 0.0, 10)]
    start = 1.0
    if charged:
        loads = [(1900, 0.0, 10), (4680, -0.5 * capacity_ah, 10)]
        taper_a = -0.5 * capacity_ah * np.exp(-np.arange(180) / 60)
        loads += [(1800, taper_a, 10), (3600, 0.0, 10)]
        start -= 0.65 + float(-taper_a.sum() * 10 / 3600 / capacity_ah)
    for number in range(10):
        share = 1.0 if number < 9 else 0.8
        loads += [*level, (360, share * capacity_ah, 2.0), (3600, 0.0, 20)]
    return made(loads, start, capacity_ah, seed=1)


def long_pulses(minutes=6.0, rate=1.0, capacity_ah=CAPACITY_AH, count=10):
    """GITT: long pulses from full, with 40 min of rest after each."""
    loads = [(1900, 0.0, 10)]
    for _ in range(count):
        loads += [(60 * minutes, rate * capacity_ah, 1.0), (2400, 0.0, 10)]
    return made(loads, 1.0, capacity_ah, seed=4)


def drive(capacity_ah=CAPACITY_AH, small_s=0, rest_s=0, seed=3, minutes=100):
    """A drive from full to about 15 %, first a small current (C/95) or a rest."""
    rng = np.random.default_rng(seed)
    rates = np.repeat(rng.choice([-0.6, 0.0, 0.5, 1.0, 2.2], 4 * minutes), 15)
    rates[:15] = 1.0
    moved = rates * 0.85 / (rates.sum() / 3600)
    loads = [(minutes * 60, moved * capacity_ah, 1.0)]
    loads = [(small_s, capacity_ah / 95, 1.0)] * bool(small_s) + loads
    return made([(rest_s, 0.0, 1.0)] * bool(rest_s) + loads, 1.0, capacity_ah, seed=2)


def write(path, test, names=NAMES, scale=1.0):
    """A test as CSV; its current in A times `scale`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    time_s, current_a, voltage_v = test
    columns = time_s, scale * current_a, np.round(voltage_v, 5)
    pl.DataFrame(dict(zip(names, columns, strict=True))).write_csv(path)
