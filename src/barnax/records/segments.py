"""The segments of a record: runs, rests, directions, and charges that end full."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from .record import Record

# Long enough for a robust spread of the current's noise, short against a rest.
_WINDOW_SAMPLES = 32


@dataclass(frozen=True)
class FullCharge:
    """The marks of a charge that ends full: a voltage that is held while the current tapers.

    Attributes:
        least_s: It lasts so long; what a brake gives back is shorter.
        held_v: The held voltage stays within this.
        least_held_s: For so long; an LFP cell is full within minutes of holding its voltage.
        tapered: The current falls below this share.
        near_v: The last voltage is so near the record's highest.
        held_near_v: So near is a held voltage, which brakes of a cold cell exceed.
        least_hours: Its last current would take so long for the capacity.
    """

    least_s: float = 300.0
    held_v: float = 0.01
    least_held_s: float = 60.0
    tapered: float = 0.5
    near_v: float = 0.02
    held_near_v: float = 0.06
    least_hours: float = 10.0

    def has_tapered(self, first_a: float, last_a: float) -> bool:
        return abs(last_a) < self.tapered * abs(first_a)


FULL_CHARGE = FullCharge()


def runs(
    holds: Bool[np.ndarray, "places"],
) -> tuple[Int[np.ndarray, "runs"], Int[np.ndarray, "runs"]]:
    """First and last place of each unbroken run where `holds` is true, in order."""
    edges = np.flatnonzero(np.diff(holds, prepend=False, append=False))
    return edges[::2], edges[1::2] - 1


def equal_runs(
    values: Float[np.ndarray, "places"] | Int[np.ndarray, "places"],
) -> tuple[Int[np.ndarray, "runs"], Int[np.ndarray, "runs"]]:
    """First and last place of each run of equal values."""
    changes = np.flatnonzero(np.diff(values) != 0)
    return np.append(0, changes + 1), np.append(changes, len(values) - 1)


# Steps of the current are changes by this share of the largest. Those of a load reach over this
# share of the charge, from the first of these quantiles to the last: a few may stand apart.
_STEP_SHARE, LEAST_REACH, _ENDS = 0.1, 0.05, (0.05, 0.95)
# Fewer steps are no load.
_FEWEST_STEPS = 10


def reach_of_steps(
    current_a: Float[np.ndarray, "samples"], charge: Float[np.ndarray, "samples"]
) -> float:
    """The charge, or the SOC, over which most of the current's steps reach; zero of few steps, as
    a charge at one current has them at its ends.

    >>> round(reach_of_steps(np.resize([0.0, 1.0], 21), np.linspace(0.0, 1.0, 21)), 3)
    0.855
    """
    step_a = np.abs(np.diff(current_a))
    at = charge[1:][step_a > _STEP_SHARE * np.max(np.abs(current_a), initial=0.0)]
    return reach(at) if len(at) >= _FEWEST_STEPS else 0.0


def reach(at: Float[np.ndarray, "steps"]) -> float:
    """The charge, or the SOC, over which steps at these reach, but for a few at either end."""
    return float(np.ptp(np.quantile(at, _ENDS)))


def rest_current_a(record: Record, capacity_ah: float) -> float:
    """The current below which a cell counts as resting, in A.

    C/100, and never under five times the current's noise at rest: a tester's offset is not a
    direction.

    >>> from barnax.bundled import bundled_file
    >>> from barnax.records import read_record
    >>> record = read_record(bundled_file("ocv_discharge"))
    >>> rest_current_a(record, capacity_ah=2.0)
    0.02
    """
    return max(capacity_ah / 100, 5 * _noise_at_rest_a(record, capacity_ah))


def _noise_at_rest_a(record: Record, capacity_ah: float) -> float:
    """The median robust noise of short windows of small, steady current; zero without such.

    The windows lie below C/20 throughout and below C/50 in the median. Differences of neighbors
    over sqrt(2) give the noise of white noise and little of a drift or a slow dither.
    """
    windows = record.samples // _WINDOW_SAMPLES
    current = record.current_a[: windows * _WINDOW_SAMPLES].reshape(windows, _WINDOW_SAMPLES)
    is_small = (np.abs(current) < capacity_ah / 20).all(axis=1)
    current = current[is_small]
    steps = np.diff(current, axis=1)
    noise_a = 1.4826 * np.median(np.abs(steps), axis=1) / np.sqrt(2)
    # Half against half: the means of white noise hardly differ, those of a swing do.
    half = _WINDOW_SAMPLES // 2
    drift_a = np.abs(current[:, :half].mean(axis=1) - current[:, half:].mean(axis=1))
    is_low = np.abs(np.median(current, axis=1)) < capacity_ah / 50
    is_steady = is_low & (drift_a <= 3 * noise_a * np.sqrt(2 / half))
    return float(np.median(noise_a[is_steady])) if is_steady.any() else 0.0


def is_rested(record: Record, threshold_a: float) -> Bool[np.ndarray, "samples"]:
    """True where the current's magnitude is below `threshold_a`.

    >>> from barnax.bundled import bundled_file
    >>> from barnax.records import read_record
    >>> record = read_record(bundled_file("ocv_discharge"))
    >>> bool(is_rested(record, threshold_a=0.02)[0])
    True
    """
    return np.abs(record.current_a) < threshold_a


def current_direction(
    record: Record, threshold_a: float, initial: int = 1
) -> Float[np.ndarray, "samples"]:
    """The last direction of the current: +1 charging, -1 discharging (Sig of Eq. 5).

    Below `threshold_a` the last direction goes on; before the first one it is `initial`, +1 for
    a cell that comes from a charge.

    >>> from barnax.bundled import bundled_file
    >>> from barnax.records import read_record
    >>> record = read_record(bundled_file("ocv_discharge"))
    >>> direction = current_direction(record, threshold_a=0.02)
    >>> float(direction[0]), float(direction[-1])
    (1.0, -1.0)
    """
    moving = ~is_rested(record, threshold_a) & (record.current_a != 0)
    last_moving = np.maximum.accumulate(np.where(moving, np.arange(record.samples), -1))
    direction = -np.sign(record.current_a[last_moving])
    return np.where(last_moving >= 0, direction, float(initial))


def rest_blocks(record: Record, threshold_a: float) -> list[tuple[int, int]]:
    """First and last sample of each unbroken rest, in order.

    >>> from barnax.bundled import bundled_file
    >>> from barnax.records import read_record
    >>> record = read_record(bundled_file("ocv_discharge"))
    >>> len(rest_blocks(record, threshold_a=0.02))
    22
    """
    first, last = runs(is_rested(record, threshold_a))
    return list(zip(first.tolist(), last.tolist(), strict=True))


def held_charges(record: Record, capacity_ah: float, rest_a: float) -> Iterator[int]:
    """The last samples of charges that end as a charge to full does: at a voltage that is held
    while the current tapers."""
    for first, last in zip(*runs(record.current_a < -rest_a), strict=True):
        current_a, voltage_v = (
            values[first : last + 1] for values in (record.current_a, record.voltage_v)
        )
        moving = np.flatnonzero(np.abs(voltage_v - voltage_v[-1]) > FULL_CHARGE.held_v)
        held = int(moving[-1]) + 1 if len(moving) else 0
        is_long = record.time_s[last] - record.time_s[first] >= FULL_CHARGE.least_s
        held_s = record.time_s[last] - record.time_s[first + held]
        end_a = -float(current_a[-1])
        is_tapered = FULL_CHARGE.has_tapered(float(current_a[held]), end_a)
        is_slow = end_a <= capacity_ah / FULL_CHARGE.least_hours
        is_held = held_s >= FULL_CHARGE.least_held_s
        if is_long and is_held and is_tapered and is_slow:
            yield int(last)
