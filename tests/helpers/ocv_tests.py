"""Records of cells whose open-circuit voltage is known exactly."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl

from barnax.records import Decision, Hold, Record
from helpers.reference import make_record

CAPACITY_AH = 2.0
RESISTANCE_OHM = 0.05
W_NODES_V = (0.0, 0.02, 0.012, 0.008, 0.0)
W_AT_KNOTS_V = (0.0, 0.02, 0.012, 0.012, 0.008, 0.0)
KNOTS = (0.0, 0.1, 0.35, 0.75, 0.95, 1.0)


def average_v(soc: np.ndarray) -> np.ndarray:
    return 3.2 + 0.9 * soc - 0.5 * soc**2 + 0.55 * soc**3


def hysteresis_v(soc: np.ndarray) -> np.ndarray:
    return np.interp(soc, KNOTS, W_AT_KNOTS_V)


def branch_v(soc: np.ndarray, direction: np.ndarray | int) -> np.ndarray:
    return average_v(soc) + direction * hysteresis_v(soc) / 2


# Tables of that OCV: one curve, and both branches.
SOC = np.linspace(0, 1, 41)
ONE = pl.DataFrame({"SOC [-]": SOC, "OCV [V]": average_v(SOC)})
TWO = pl.DataFrame(
    {"SOC [-]": SOC, "charge OCV [V]": branch_v(SOC, 1), "discharge OCV [V]": branch_v(SOC, -1)}
)


def record_of(
    intervals_a: Sequence[float] | np.ndarray,
    *,
    start_soc: float = 1.0,
    direction: int = 1,
    interval_s: float | np.ndarray = 60.0,
    capacity_ah: float = CAPACITY_AH,
    voltage: Callable[[np.ndarray, np.ndarray], np.ndarray] = branch_v,
    hold: Hold = "forward",
    name: str = "test.csv",
) -> Record:
    """The record of a cell driven by these currents, discharge positive; it ends at rest.

    `direction` is the one before the record; by default it begins full, after a charge.
    """
    current_a = np.asarray(intervals_a, dtype=float)
    seconds = np.broadcast_to(interval_s, current_a.shape)
    time_s = np.concatenate([[0.0], np.cumsum(seconds)])
    passed_ah = np.concatenate([[0.0], np.cumsum(current_a * seconds)]) / 3600
    signs = np.concatenate([[direction], -np.sign(current_a)])
    last_moved = np.maximum.accumulate(np.where(signs != 0, np.arange(len(signs)), 0))
    sampled_a = np.append(current_a, 0.0) if hold == "forward" else np.append(0.0, current_a)
    ocv_v = voltage(start_soc - passed_ah / capacity_ah, signs[last_moved])
    record = make_record(time_s, sampled_a, ocv_v - RESISTANCE_OHM * sampled_a, name=name)
    sign, decided = (Decision(each, "strong", "made so") for each in ("charge-positive", hold))
    return replace(record, sign=sign, hold=decided)


def driven(*parts: Sequence[float] | np.ndarray, **options: Any) -> Record:
    """The record of these currents after each other."""
    return record_of(np.concatenate(parts), **options)


# An hour, by the minute.
REST = np.zeros(60)


def steady(direction: int, hours: float, share: float = 1.0) -> np.ndarray:
    """`share` of the capacity in one go, by the minute."""
    return np.full(round(60 * hours), -direction * share * CAPACITY_AH / hours)


def pulses(direction: int, count: int = 20, *, share: float = 1.0, rest: int = 60) -> np.ndarray:
    """Equal pulses that move `share` of the capacity, each followed by `rest` minutes of rest."""
    minutes = 6
    pulse_a = -direction * share * CAPACITY_AH / count / (minutes / 60)
    return np.tile(np.concatenate([np.full(minutes, pulse_a), np.zeros(rest)]), count)


def stepwise(
    moves: Sequence[Sequence[float]],
    *,
    start_soc: float,
    hold: Hold = "forward",
    size: float = 1.0,
    first_rest_s: float = 3600.0,
    rest_s: float = 3600.0,
) -> Record:
    """One sample a step, as sparing loggers store it, of a cell of `size` times the capacity.

    After a first rest each entry of `moves` charges by these shares of the capacity, one after
    the other, then rests.
    """
    capacity_ah, move_s = size * CAPACITY_AH, 360.0
    current_a, seconds = [0.0], [first_rest_s]
    for shares in moves:
        current_a += [-share * capacity_ah * 3600 / move_s for share in shares] + [0.0]
        seconds += [move_s] * len(shares) + [rest_s]
    return record_of(
        current_a,
        start_soc=start_soc,
        interval_s=np.array(seconds),
        capacity_ah=capacity_ah,
        hold=hold,
    )


def both_ways(hold: Hold = "forward", count: int = 20, *, returned: float = 1.0) -> Record:
    """A discharge from full to empty and a charge back, in one record that begins at rest."""
    return driven(REST, pulses(-1, count), pulses(+1, count, share=returned), hold=hold)


def discharge_only(**changes: object) -> Record:
    return driven(REST, pulses(-1), **({"name": "discharge.csv"} | changes))


def charge_only(**changes: object) -> Record:
    options = {"start_soc": 0.0, "direction": -1, "name": "charge.csv"} | changes
    return driven(REST, pulses(+1), **options)


def slow_sweep(direction: int, **changes: object) -> Record:
    """From end to end in 20 hours, an hour of rest before and after."""
    options = {"start_soc": float(direction < 0), "direction": direction} | changes
    return driven(REST, steady(direction, 20), REST, **options)


def between_cutoffs(discharged: float = 0.97) -> Record:
    """A test whose last pulse stops short at empty and at full."""
    last_out, last_in = (
        np.concatenate([pulses(way, 1, share=0.05, rest=0)[:3], REST]) for way in (-1, +1)
    )
    out, back = (pulses(way, 10, share=discharged) for way in (-1, +1))
    return driven(REST, out, last_out, back, last_in)


def conditioned(rest: np.ndarray = REST) -> Record:
    """A C/20 discharge, a C/2 charge, then pulses down and up."""
    parts = REST, steady(-1, 20), rest, steady(+1, 2), REST, pulses(-1), pulses(+1)
    return driven(*parts, name="long.csv")
