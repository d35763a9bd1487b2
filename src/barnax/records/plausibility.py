"""What a record must satisfy before anything is computed from it.

Each check takes the samples and gives them back, possibly fewer or with a warning, or raises
InputError with the file, the row, the value and the remedy.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ..errors import InputError
from .samples import Samples

FEWEST_SAMPLES = 10
# Far below what any tester resolves; squares of much less are lost.
_SHORTEST_S, _LEAST_A = 1e-6, 1e-12

# One cell: lithium chemistries lie in 0.5 to 6 V. Past 10 V it is a module, past 100 V a unit.
CELL_RANGE_V = (0.5, 6.0)
MODULE_V, MILLIVOLT_V = 10.0, 100.0

# The largest cells made hold a little over 1000 Ah; 500 A is the load of a large one, and a 2 Ah
# cell at 1C reads 2000 in milliamperes. A slow sweep of a small cell gives itself away by its
# ampere-hours instead: 2 Ah read as 2000.
_LOADED_A, _SWING_AH = 500.0, 1500.0

# What two samples of one time stamp may differ by and still be one sample, logged twice.
_SAME_VOLTAGE_V, _SAME_CURRENT_SHARE = 2e-3, 0.02


def check_samples(samples: Samples) -> Samples:
    """The samples, fit for use. Raises InputError where they are not."""
    if len(samples.time_s) == 0:
        raise InputError(
            f"{samples.file}: has a header and no samples below it; give the file with its data."
        )
    samples = _with_increasing_time(samples)
    if len(samples.time_s) < FEWEST_SAMPLES:
        raise InputError(
            f"{samples.file}: holds {len(samples.time_s)} samples, and a record needs at least "
            f"{FEWEST_SAMPLES}; give a longer one."
        )
    duration_s = float(samples.time_s[-1] - samples.time_s[0])
    if duration_s < _SHORTEST_S:
        raise InputError(
            f"{samples.file}: lasts {duration_s:.3g} s by '{samples.names['time']}', and no record "
            "is so short; give the column that holds the time, with its unit."
        )
    samples = _with_plausible_voltage(samples)
    return _with_plausible_current(samples)


@dataclass(frozen=True, eq=False)
class Repeats:
    """Where, interval by interval, a sample has the time stamp of the one before.

    `is_exact` where it repeats it wholly, `is_near` where current and voltage are alike within
    the tester's resolution, `is_conflict` where they are not.
    """

    is_exact: Bool[np.ndarray, "intervals"]
    is_near: Bool[np.ndarray, "intervals"]
    is_conflict: Bool[np.ndarray, "intervals"]


def find_repeats(samples: Samples) -> Repeats:
    """Which samples were logged twice."""
    current, voltage = samples.current_a, samples.voltage_v
    is_repeat = np.diff(samples.time_s) == 0
    is_exact = is_repeat & (np.diff(current) == 0) & (np.diff(voltage) == 0)
    current_tolerance = _SAME_CURRENT_SHARE * np.max(np.abs(current))
    is_near = (
        is_repeat
        & ~is_exact
        & (np.abs(np.diff(current)) <= current_tolerance * (1 + 1e-9))
        & (np.abs(np.diff(voltage)) <= _SAME_VOLTAGE_V * (1 + 1e-9))
    )
    return Repeats(is_exact, is_near, is_repeat & ~is_exact & ~is_near)


def _with_increasing_time(samples: Samples) -> Samples:
    """Samples logged twice are merged; after that the time must strictly increase."""
    repeats = find_repeats(samples)
    wrong = repeats.is_conflict | (np.diff(samples.time_s) < 0)
    if wrong.any():
        _refuse_time(samples, int(np.argmax(wrong)) + 1)
    is_exact, is_near = repeats.is_exact, repeats.is_near
    if is_exact.any():
        samples = samples.warn(f"{_count(is_exact, 'row')} merged: exact repeats of the row before")
    if is_near.any():
        first = samples.place(int(np.argmax(is_near)) + 1)
        samples = samples.warn(
            f"{_count(is_near, 'row')} dropped (first: {first}): the time stamp of the row "
            "before, with current and voltage alike within the tester's resolution"
        )
    return samples.keep(np.concatenate([[True], ~(is_exact | is_near)]))


def _refuse_time(samples: Samples, at: int) -> None:
    before, after = samples.time_s[at - 1], samples.time_s[at]
    if after < before:
        raise InputError(
            f"{samples.file}: {samples.place(at)}: time runs backwards, from {before:.10g} s to "
            f"{after:.10g} s. Sort the rows by time, split joined tests into files of their own, "
            f"or, if '{samples.names['time']}' restarts with each step, give the test's own clock."
        )
    raise InputError(
        f"{samples.file}: {samples.place(at)}: time {after:.10g} s stands twice with different "
        f"values ({samples.current_a[at - 1]:.6g} A, {samples.voltage_v[at - 1]:.6g} V, then "
        f"{samples.current_a[at]:.6g} A, {samples.voltage_v[at]:.6g} V); delete one of the two "
        "rows, or export the time with more digits."
    )


def _count(mask: Bool[np.ndarray, "places"], noun: str) -> str:
    count = int(mask.sum())
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _with_plausible_voltage(samples: Samples) -> Samples:
    voltage, name = samples.voltage_v, samples.names["voltage"]
    median = float(np.median(voltage))
    if abs(median) > MILLIVOLT_V:
        raise InputError(
            f"{samples.file}: half of the voltages in '{name}' are above {median:.6g} V, which "
            "looks like millivolts; rename the column to 'Voltage / mV'."
        )
    if abs(median) > MODULE_V:
        raise InputError(
            f"{samples.file}: half of the voltages in '{name}' are above {median:.6g} V, too much "
            "for one cell; give the voltage of one cell, not of several in series."
        )
    if median < 0:
        raise InputError(
            f"{samples.file}: half of the voltages in '{name}' are below {median:.6g} V, so the "
            "sense leads were swapped or the column is not the cell's voltage; turn its sign or "
            "give the right column."
        )
    worst = int(np.argmax(np.abs(voltage)))
    if abs(voltage[worst]) > MILLIVOLT_V:
        raise InputError(
            f"{samples.file}: {samples.place(worst)}: {voltage[worst]:.6g} V in '{name}' is no "
            "cell's voltage; correct or delete the row."
        )
    outside = (voltage < CELL_RANGE_V[0]) | (voltage > CELL_RANGE_V[1])
    if outside.any():
        first = int(np.argmax(outside))
        samples = samples.warn(
            f"{_count(outside, 'voltage')} outside {CELL_RANGE_V[0]} to {CELL_RANGE_V[1]} V "
            f"(first: {voltage[first]:.6g} V, {samples.place(first)})"
        )
    return samples


def _with_plausible_current(samples: Samples) -> Samples:
    magnitude, name = np.abs(samples.current_a), samples.names["current"]
    peak = float(magnitude.max())
    if peak < _LEAST_A:
        raise InputError(
            f"{samples.file}: every current in '{name}' is zero (or below {_LEAST_A:g} A), so "
            "nothing can be learned from the record; give the column that holds the measured "
            "current."
        )
    reasons = milliampere_reasons(samples)
    if reasons:
        worst = int(np.argmax(magnitude))
        raise InputError(
            f"{samples.file}: {samples.place(worst)}: {samples.current_a[worst]:.6g} A in '{name}':"
            f" {' and '.join(reasons)}, which looks like milliamperes; rename the column to "
            "'Current / mA'."
        )
    return samples


def milliampere_reasons(samples: Samples) -> list[str]:
    """Why the currents look like milliamperes under an ampere's name; empty where they do not.

    Some current must flow.
    """
    magnitude = np.abs(samples.current_a)
    loaded = float(np.median(magnitude[magnitude > 0.05 * magnitude.max()]))
    passed_ah = np.cumsum(samples.current_a[1:] * np.diff(samples.time_s)) / 3600
    swing_ah = float(np.ptp(passed_ah))
    reasons = []
    if loaded > _LOADED_A:
        reasons.append(f"the current under load is {loaded:.6g} A")
    if swing_ah > _SWING_AH:
        reasons.append(f"the record moves {swing_ah:.6g} Ah one way")
    ratio = throughput_ratio(samples)
    if ratio is not None and 200 < ratio < 5000:
        reasons.append(f"it integrates to {ratio:.4g} times the tester's own ampere-hours")
    return reasons


def throughput_ratio(samples: Samples) -> float | None:
    """Integrated |I| over what the tester counted in and out, where it counted enough to tell."""
    counters = samples.counters
    if counters.charged_ah is None or counters.discharged_ah is None:
        return None
    counted = _gains_ah(counters.charged_ah) + _gains_ah(counters.discharged_ah)
    interval_h = np.diff(samples.time_s) / 3600
    integrated = float(np.sum(np.abs(samples.current_a[1:]) * interval_h))
    # A counter printed to 0.1 mAh that moved a few times proves nothing.
    return integrated / counted if counted > 1e-3 else None


def _gains_ah(counter_ah: Float[np.ndarray, "samples"]) -> float:
    return float(np.sum(np.maximum(np.diff(counter_ah), 0)))
