"""OCV points of a slow constant-current sweep, such as C/20 or C/30."""

import numpy as np
from jaxtyping import Bool, Int

from ..records.record import Record
from ..records.rests import is_rested
from .sweep import CHARGE, DISCHARGE, Sweep, SweepPoint

# C/10 with the slack of a cell that holds a little less than its rating.
SHORTEST_HOURS = 9.5
POINTS = 101
# Samples without current inside a sweep, as a fraction: a tester pauses now and then.
PAUSES = 0.01
# Half the window each point is averaged over, as a fraction of the sweep.
HALF_WINDOW = 1e-3

Places = Int[np.ndarray, "stretches"]


def find_slow_sweeps(record: Record, rest_current_a: float, minimum_rest_s: float) -> list[Sweep]:
    """The slow sweeps of a record, cut-off to cut-off, in time order; often none.

    A slow sweep passes its charge in one direction, without long rests, at C/10 of that charge
    or less. Its voltage still holds the overpotential of that current.
    """
    is_loaded = ~is_rested(record, rest_current_a)
    if not is_loaded.any():
        return []
    first, last = _one_way_stretches(record, is_loaded, minimum_rest_s)
    is_backward = record.hold.value == "backward"
    begin = np.maximum(first - 1, 0) if is_backward else first
    end = last if is_backward else np.minimum(last + 1, record.samples - 1)
    discharged_ah = record.discharged_ah
    passed_ah = np.abs(discharged_ah[end] - discharged_ah[begin])
    loaded_a = np.abs(record.current_a) * is_loaded
    # Weighted by itself, lest pulses pass for slow between rests that a tester reads as loaded.
    usual_a = _sums(loaded_a**2, first, last) / _sums(loaded_a, first, last)
    pauses = 1 - _sums(is_loaded, first, last) / (last - first + 1)
    is_sweep = (usual_a * SHORTEST_HOURS <= passed_ah) & (pauses <= PAUSES)
    return [
        _thin(record, *map(int, ends))
        for ends in zip(*(at[is_sweep] for at in (first, last, begin, end)), strict=True)
    ]


def _sums(values: np.ndarray, first: Places, last: Places) -> np.ndarray:
    """The sum over each stretch."""
    total = np.concatenate([[0], np.cumsum(values)])
    return total[last + 1] - total[first]


def _one_way_stretches(
    record: Record, is_loaded: Bool[np.ndarray, "samples"], minimum_rest_s: float
) -> tuple[Places, Places]:
    """First and last loaded sample of each stretch of one direction without a long rest."""
    loaded = np.flatnonzero(is_loaded)
    turns = np.diff(np.sign(record.current_a[loaded])) != 0
    # A gap of the logger is no rest: some samples in it must show no current.
    rests = (np.diff(loaded) > 1) & (np.diff(record.time_s[loaded]) >= minimum_rest_s)
    cuts = np.flatnonzero(turns | rests)
    firsts = loaded[np.concatenate([[0], cuts + 1])]
    lasts = loaded[np.concatenate([cuts, [len(loaded) - 1]])]
    return firsts, lasts


def _thin(record: Record, first: int, last: int, begin: int, end: int) -> Sweep:
    """The sweep with its voltage averaged at points evenly spaced in charge.

    Fewer than `POINTS` where neighbors of them would be the same sample.
    """
    axis_ah = record.discharged_ah
    direction = CHARGE if axis_ah[end] < axis_ah[begin] else DISCHARGE
    charge_ah, voltage_v = axis_ah[first : last + 1], record.voltage_v[first : last + 1]
    half_ah = HALF_WINDOW * abs(axis_ah[end] - axis_ah[begin])
    points = []
    before = None
    for target_ah in np.linspace(charge_ah[0], charge_ah[-1], POINTS):
        nearest = int(np.argmin(np.abs(charge_ah - target_ah)))
        if nearest == before:
            continue
        before = nearest
        is_near = np.abs(charge_ah - target_ah) <= half_ah
        # The end points are the cut-offs; an average there would pull the curve inward.
        if target_ah in (charge_ah[0], charge_ah[-1]) or not is_near.any():
            is_near = np.arange(len(charge_ah)) == nearest
        points.append(
            SweepPoint(
                discharged_ah=float(charge_ah[is_near].mean()),
                voltage_v=float(voltage_v[is_near].mean()),
                source=record.name,
                row=int(record.row[first + nearest]),
                rest_s=0.0,
            )
        )
    return Sweep(
        "slow", direction, record.name, float(axis_ah[begin]), float(axis_ah[end]), tuple(points)
    )
