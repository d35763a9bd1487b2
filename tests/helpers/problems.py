"""What a made record says of a cell: its voltage on a drive, by the reference alone."""

from dataclasses import replace

import numpy as np

from barnax import Window, make_problem
from helpers.reference import drop_v, looped_response, make_record

CLOCKS = ("even", "uneven", "gaps")
R0_OHM, R_OHM, TAU_S = 0.05, (0.01, 0.02), (5.0, 80.0)


def drive_a(samples, seed=0, interval=10):
    """A current that jumps every few samples between rest, discharge and charge."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.choice([0.0, 2.0, 3.0, -1.0], samples // interval + 1), interval)[:samples]


def drive_record(clock, samples, seed, hold="forward"):
    """A made-up drive cycle: steps, rests and noise, on one of `CLOCKS`."""
    rng = np.random.default_rng(seed)
    interval_s = np.full(samples - 1, 1.0)
    if clock != "even":
        interval_s = rng.choice([0.5, 1.0, 1.0001, 2.0], samples - 1)
    if clock == "gaps":
        interval_s[rng.integers(0, samples - 1, 3)] = rng.uniform(30, 200, 3)
    time_s = np.append(0.0, np.cumsum(interval_s))
    current_a = np.repeat(rng.choice([0.0, 0.5, 3.0, -1.5], samples // 10 + 1), 10)[:samples]
    current_a = current_a + 1e-3 * rng.standard_normal(samples)
    voltage_v = 3.7 - 0.06 * current_a + 0.05 * np.sin(time_s / 300)
    voltage_v = voltage_v + 2e-3 * rng.standard_normal(samples)
    return make_record(time_s, current_a, voltage_v, hold=hold)


def simulated_record(
    cell, time_s, current_a, soc, direction, circuit=(R0_OHM, R_OHM, TAU_S), noise_v=0.0, **changes
):
    """A record of `cell` from `soc` on, whose hysteresis follows the current's last direction."""
    time_s, current_a = np.asarray(time_s, float), np.asarray(current_a, float)
    charge_ah = np.append(0.0, np.cumsum(current_a[:-1] * np.diff(time_s))) / 3600
    directions = []
    for flowing_a in current_a:
        direction = -np.sign(flowing_a) if flowing_a else direction
        directions.append(direction)
    soc = soc - charge_ah / cell.capacity_ah
    source_v = cell.average_ocv_v(soc) + np.array(directions) * cell.hysteresis_v(soc) / 2
    drop = drop_v(looped_response, time_s, current_a, circuit)
    noise = noise_v * np.random.default_rng(0).standard_normal(len(time_s))
    return make_record(time_s, current_a, source_v - drop + noise, **changes)


def other_problem(problem, circuit="so-rc", voltage_v=None, **given):
    """The problem of the same 1,500 s with another voltage, circuit or box."""
    record, prepared = problem.prepared.record, problem.prepared
    if voltage_v is not None:
        whole_v = record.voltage_v.copy()
        whole_v[prepared.span] = voltage_v
        record = replace(record, voltage_v=whole_v)
    window = Window(initial_soc=prepared.start.soc, score_to_s=1500.5)
    return make_problem(record, problem.cell, circuit, window=window, **given)
