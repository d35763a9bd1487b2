"""The state in which a simulation starts: its SOC, the direction before it, and their sources."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..cell import CellModel
from ..cell.ocv_points import MINIMUM_REST_S
from ..errors import InputError
from ..records import Record, is_rested
from .ends import SocSource, known_soc
from .window import Window

# So near full or empty, the last current was the one that leads there.
NEAR_AN_END = 0.02
# A given SOC is in doubt where the rested voltage is so far from its OCV, and tells another SOC.
DOUBTFUL_V, DOUBTFUL_SOC = 0.01, 0.02
# A rested voltage so far above or below the OCV is not of this cell, or of another temperature.
BEYOND_OCV_V = 0.005

# How the direction before the start is known: given; from the load before it; from a start at full
# or empty; because a fit with the other is worse; or not at all, whether or not that matters.
DirectionSource = Literal[
    "given", "load before", "full or empty", "better fit", "without effect", "assumed"
]


@dataclass(frozen=True)
class Start:
    """The state in which a simulation starts, and where that is known from.

    `voltage_v` and `row` are those of the sample that the SOC comes from, at rest or at an end of
    the state of charge. `direction` is the last current before the start, +1 charging, -1
    discharging; where both were tried, the RMSE with the other is `other_rmse_v`.
    """

    soc: float
    soc_source: Literal["given", "rested voltage"] | SocSource
    direction: Literal[-1, 1]
    direction_source: DirectionSource
    row: int
    voltage_v: float
    other_rmse_v: float | None = None


def find_start(
    record: Record, cell: CellModel, window: Window, capacity_ah: float, first: int, rest_a: float
) -> Start:
    """The state at the start. Raises `InputError` where the SOC is neither given nor shown.

    A rested cell is on the OCV branch of the direction it comes from. Where it has not rested, the
    SOC is carried to the start from where the record shows it.
    """
    direction, source = _direction_before(record, window, first, rest_a)
    row, voltage_v = int(record.row[first]), float(record.voltage_v[first])
    unrested = _unrested(record, first, rest_a)
    is_short = record.time_s[first] - record.time_s[0] < MINIMUM_REST_S
    known = None
    if window.initial_soc is None and (unrested or is_short):
        # Of a record's opening rest nobody knows how long it was; counters tell more.
        only = not unrested
        known = known_soc(record, cell, capacity_ah, first, rest_a, only_counters=only)
        if only and known is not None and _denies(cell, voltage_v, known.soc):
            known = None
    if window.initial_soc is not None:
        soc, soc_source = window.initial_soc, "given"
    elif known is not None:
        soc, soc_source = known.soc, known.source
        row, voltage_v = int(record.row[known.known_at]), float(record.voltage_v[known.known_at])
    elif not unrested:
        soc, soc_source = _soc_from_rest(record, cell, first, direction), "rested voltage"
    else:
        raise InputError(f"{unrested}; give `initial_soc`")
    if source == "assumed" and min(soc, 1 - soc) < NEAR_AN_END:
        direction, source = (1 if soc > 0.5 else -1), "full or empty"
        if soc_source == "rested voltage":
            soc = _soc_from_rest(record, cell, first, direction)
    return Start(soc, soc_source, direction, source, row, voltage_v)


def _direction_before(
    record: Record, window: Window, first: int, rest_a: float
) -> tuple[Literal[-1, 1], DirectionSource]:
    """The last current before the start; where the record has none, the given one or a guess."""
    # The current of the start's own sample flows before it only under a backward hold.
    before = slice(0, first + 1 if record.hold.value == "backward" else first)
    moving = np.flatnonzero(~is_rested(record, rest_a)[before] & (record.current_a[before] != 0))
    if len(moving) and first > 0:
        return -1 if record.current_a[moving[-1]] > 0 else 1, "load before"
    if window.initial_direction is not None:
        return window.initial_direction, "given"
    # Of a record that starts under load nothing is known but the load.
    return -1 if record.current_a[first] >= rest_a else 1, "assumed"


def _unrested(record: Record, first: int, rest_a: float) -> str:
    """Why the voltage at the start does not tell the state of charge; empty where it does."""
    row = record.row[first]
    is_loaded = ~is_rested(record, rest_a)[: first + 1]
    if is_loaded[first]:
        return (
            f"{record.name}: the simulation starts at row {row} under "
            f"{record.current_a[first]:+.3g} A (discharge positive), so the voltage there does "
            "not give the state of charge"
        )
    if np.any(is_loaded):
        rest_s = record.time_s[first] - record.time_s[np.flatnonzero(is_loaded)[-1]]
        if rest_s < MINIMUM_REST_S:
            return (
                f"{record.name}: at row {row}, where the simulation starts, the cell has rested "
                f"for only {rest_s:.0f} s, but its voltage gives the state of charge only after "
                f"{MINIMUM_REST_S:.0f} s"
            )
    return ""


def _soc_from_rest(record: Record, cell: CellModel, first: int, direction: int) -> float:
    try:
        return cell.soc_from_rest_voltage(float(record.voltage_v[first]), direction)
    except InputError as problem:
        raise InputError(f"{record.name}: row {record.row[first]}: {problem}") from problem


def _denies(cell: CellModel, voltage_v: float, soc: float) -> bool:
    """Whether a rested voltage lies off both branches at a SOC, by voltage and by SOC."""
    try:
        ends = [cell.soc_from_rest_voltage(voltage_v, direction) for direction in (-1, 1)]
    except InputError:  # far from where the other branch ends
        return False
    expected_v = [float(curve(np.array([soc]))[0]) for curve in (cell.discharge, cell.charge)]
    is_far = not min(expected_v) - DOUBTFUL_V <= voltage_v <= max(expected_v) + DOUBTFUL_V
    return is_far and not min(ends) - DOUBTFUL_SOC <= soc <= max(ends) + DOUBTFUL_SOC


def start_warnings(
    record: Record, cell: CellModel, window: Window, first: int, start: Start, rest_a: float
) -> list[str]:
    """What a rested voltage at the start has against the SOC that is taken for it."""
    if _unrested(record, first, rest_a):
        return []
    branch = cell.charge if start.direction > 0 else cell.discharge
    low_v, high_v = (float(branch(np.array([end]))[0]) for end in cell.soc_range)
    beyond_v = max(start.voltage_v - high_v, low_v - start.voltage_v)
    place = f"{record.name}: the cell rests at {start.voltage_v:.4f} V at row {start.row}"
    if beyond_v > BEYOND_OCV_V:
        return [
            f"{place}, {1e3 * beyond_v:.0f} mV beyond its OCV of {low_v:.4f} to {high_v:.4f} V; "
            "check that the OCV test is of this cell and temperature"
        ]
    if window.initial_soc is None:
        return []
    if not _denies(cell, start.voltage_v, start.soc):
        return []
    soc = cell.soc_from_rest_voltage(start.voltage_v, start.direction)
    return [
        f"{place}, which corresponds to a state of charge of {soc:.3f}, but `initial_soc` is "
        f"{start.soc:g}; leave it out to use the rested voltage"
    ]
