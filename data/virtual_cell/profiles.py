"""The currents of the two dynamic records, one value a second, discharge positive."""

import numpy as np
from numpy.typing import NDArray

IDENTIFICATION_SEED = 20240602
VALIDATION_SEED = 20240603

# The USABC dynamic stress test: (seconds, percent of the peak discharge power), 360 s in all;
# here the percentages scale a current.
DST = (
    *((16, 0.0), (28, 12.5), (12, 25.0), (8, -12.5), (16, 0.0), (24, 12.5), (12, 25.0)),
    *((8, -12.5), (16, 0.0), (24, 12.5), (12, 25.0), (8, -12.5), (16, 0.0), (36, 12.5)),
    *((8, 100.0), (24, 62.5), (8, -25.0), (32, 25.0), (8, -50.0), (44, 0.0)),
)
DST_CYCLES = 48
WEAKER_FROM_CYCLE = 42
CHARGE_AFTER_CYCLES = (17, 33)
PEAK_A = 4.0

DRIVE_S = 14_700
CHARGE_AFTER_S = (6_000, 11_000)
NO_REGENERATION_ABOVE_SOC = 0.9
RAMP_S = 0.1


def identification_current(capacity_ah: float) -> NDArray[np.float64]:
    """48 DST cycles, each of its own amplitude, with two charges of 15 min between them.

    The last six cycles are weaker, so that the cell does not reach its cut-off.
    """
    rng = np.random.default_rng(IDENTIFICATION_SEED)
    pieces = [np.zeros(60)]
    for cycle in range(DST_CYCLES):
        weaker = cycle >= WEAKER_FROM_CYCLE
        peak_a = PEAK_A * (rng.uniform(0.7, 0.8) if weaker else rng.uniform(0.85, 1.15))
        pieces += [np.full(duration, peak_a * percent / 100) for duration, percent in DST]
        if cycle in CHARGE_AFTER_CYCLES:
            pieces += [np.full(900, -1.0), np.zeros(120)]
    pieces.append(np.zeros(300))
    return _without_regeneration_near_full(np.concatenate(pieces), capacity_ah)


def validation_current(capacity_ah: float) -> NDArray[np.float64]:
    """Random trips (accelerate, cruise, brake, stop) with two charges of 12 min between them."""
    rng = np.random.default_rng(VALIDATION_SEED)
    pieces, elapsed_s = [np.zeros(60)], 60
    charges_at_s = list(CHARGE_AFTER_S)
    while elapsed_s < DRIVE_S:
        if charges_at_s and elapsed_s > charges_at_s[0]:
            charges_at_s.pop(0)
            piece = np.concatenate([np.zeros(180), np.full(720, -0.8), np.zeros(180)])
        else:
            piece = _trip(rng)
        pieces.append(piece)
        elapsed_s += piece.size
    drive = np.round(np.concatenate(pieces)[:DRIVE_S], 3)
    return _without_regeneration_near_full(np.concatenate([drive, np.zeros(300)]), capacity_ah)


def as_breakpoints(current_a: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows of time in s and current in A: each value holds for its second, then a short ramp.

    The ramp of 0.1 s ends on the sample, so that the solver meets no jump.
    """
    rows = [(0.0, current_a[0])]
    for k in np.flatnonzero(np.diff(current_a)) + 1:
        rows += [(k - RAMP_S, current_a[k - 1]), (float(k), current_a[k])]
    if rows[-1][0] < current_a.size - 1:
        rows.append((float(current_a.size - 1), current_a[-1]))
    return np.array(rows)


def _trip(rng: np.random.Generator) -> NDArray[np.float64]:
    accelerate_s, cruise_s = rng.integers(5, 20), rng.integers(10, 120)
    brake_s, stop_s = rng.integers(3, 14), rng.integers(3, 35)
    accelerate_a, cruise_a = rng.uniform(1.0, 4.5), rng.uniform(0.15, 1.1)
    brake_a = rng.uniform(0.5, 2.2)
    in_steps_of_3 = np.arange(accelerate_s) // 3 * 3
    in_steps_of_5 = np.arange(cruise_s) // 5 * 5
    wave = 0.35 * np.sin(2 * np.pi * in_steps_of_5 / rng.uniform(12, 40))
    gusts = 0.15 * rng.standard_normal(cruise_s)[in_steps_of_5]
    return np.concatenate(
        [
            accelerate_a * np.linspace(0.3, 1, accelerate_s)[in_steps_of_3],
            cruise_a * (1 + wave + gusts),
            -brake_a * np.linspace(1, 0.2, brake_s),
            np.full(stop_s, 0.03),
        ]
    )


def _without_regeneration_near_full(
    current_a: NDArray[np.float64], capacity_ah: float
) -> NDArray[np.float64]:
    """The profile from a full cell with its charging currents cut while SOC is above 0.9."""
    allowed, soc = current_a.copy(), 1.0
    for k, value in enumerate(current_a):
        if value < 0 and soc > NO_REGENERATION_ABOVE_SOC:
            allowed[k] = 0.0
        soc -= allowed[k] / 3600 / capacity_ah
    return allowed
