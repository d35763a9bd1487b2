"""A pulse test of a made cell, whose resistances and time constants are known."""

import numpy as np

from barnax.records import Decision, Record

CAPACITY_AH = 2.0
TAU_S = (4.0, 60.0)
R1_OHM, R2_OHM = 0.01, 0.02
GIVEN = Decision("forward", "given", "made so")


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
    time_s = np.array(time_s[:-1])
    current_a = np.array(current_a)
    dt = np.diff(time_s, append=time_s[-1] + 1)
    soc = 1 - np.concatenate([[0], np.cumsum(current_a * dt)[:-1]]) / 3600 / CAPACITY_AH
    voltage_v = 3.2 + (0.9 + lift_v) * soc - factor * r0_ohm(soc) * current_a
    for r, tau_s in zip((R1_OHM, R2_OHM), TAU_S, strict=True):
        u, course = 0.0, []
        for amps, gap_s in zip(current_a, dt, strict=True):
            course.append(u)
            u = np.exp(-gap_s / tau_s) * u + (1 - np.exp(-gap_s / tau_s)) * factor * r * amps
        voltage_v = voltage_v - np.array(course)
    return Record(
        name="made" if degc is None else f"made at {degc:g}",
        time_s=time_s,
        current_a=current_a,
        voltage_v=voltage_v,
        temperature_degc=None if degc is None else np.full(len(time_s), degc),
        step=None,
        row=np.arange(len(time_s)) + 2,
        sign=GIVEN,
        hold=GIVEN,
        sha256="",
    )
