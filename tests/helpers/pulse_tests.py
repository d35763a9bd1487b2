"""A pulse test of a made cell, whose resistances and time constants are known."""

from dataclasses import replace

import numpy as np

from barnax.records import Record
from helpers.reference import banded_response, drop_v, make_record

CAPACITY_AH = 2.0
TAU_S = (4.0, 60.0)
R1_OHM, R2_OHM = 0.01, 0.02


def r0_ohm(soc):
    """Falls from 60 mOhm empty to 50 mOhm full, and bends at 50 % SOC."""
    return np.interp(soc, (0.0, 0.5, 1.0), (0.06, 0.05, 0.052))


def made_record(interval_s=0.5, factor=1.0, degc=None, lift_v=0.0) -> Record:
    """Eleven levels of pulses at 1C and of C/2 in between, with a linear OCV and no noise.

    All resistances are `factor` times as high, the OCV by `lift_v` higher when full.
    """
    level = [(10, 2.0), (40, 0.0), (10, -1.5), (600, 0.0)]
    loads = [(1900, 0.0)]
    for _ in range(10):
        loads += [*level, (712, 1.0), (1900, 0.0)]
    time_s, current_a = [0.0], []
    for seconds, amps in loads:
        # Dense in pulses, coarse in rests.
        step_s = interval_s if seconds <= 40 else 10.0
        count = round(seconds / step_s)
        current_a += [amps] * count
        time_s += (time_s[-1] + step_s * np.arange(1, count + 1)).tolist()
    time_s, current_a = np.array(time_s[:-1]), np.array(current_a)
    flowed_a = current_a[:-1] * np.diff(time_s)
    soc = 1 - np.concatenate([[0], np.cumsum(flowed_a)]) / 3600 / CAPACITY_AH
    circuit = (r0_ohm(soc), (R1_OHM, R2_OHM), TAU_S)
    drop = factor * drop_v(banded_response, time_s, current_a, circuit)
    name = "made" if degc is None else f"made at {degc:g}"
    record = make_record(time_s, current_a, 3.2 + (0.9 + lift_v) * soc - drop, name=name)
    return record if degc is None else replace(record, temperature_degc=np.full(len(time_s), degc))
