"""Ampere-hours: by integration, by the tester's counters, and against the capacity."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from ..cell.soc_axis import CAPACITY_WARNING, CLOSURE
from ..cell.sweep import CHARGE, DISCHARGE
from ..records.counters import counter_quantum_ah
from .case import Case
from .finding import Finding

# As shares of all the charge that went in and out. Testers integrate between the samples that
# they log, so that a fast current and slow samples differ by a percent.
_COUNTERS_DIFFER, _COUNTERS_NOTED = 0.03, 0.01
# Counters are printed to so much, and both ends are rounded.
_QUANTA = 3
# A counter that stands this far from zero at the start began before the record.
_BEGUN_SHARE = 0.01
_HARDLY_MOVES = 0.02


def find_counters(case: Case) -> Iterator[Finding]:
    """Counters of the tester that disagree with the integrated current, or began before."""
    counters = case.samples.counters
    if counters.charged_ah is None or counters.discharged_ah is None:
        return
    counted = _gain_ah(counters.charged_ah), _gain_ah(counters.discharged_ah)
    if sum(counted) > 0:
        yield from _against_integral(case, counted)
    begun = [
        f"{counter[0]:.4g} Ah {word}"
        for counter, word in ((counters.charged_ah, "in"), (counters.discharged_ah, "out"))
        if counter[0] > _BEGUN_SHARE * case.scale_ah
    ]
    if begun:
        yield case.at(
            0,
            "note",
            f"the record begins within a test: the tester had counted {' and '.join(begun)}, its "
            f"clock was at {case.record.time_s[0]:.6g} s",
            "give the file of the test's beginning too, where it matters",
        )


def _against_integral(case: Case, counted: tuple[float, float]) -> Iterator[Finding]:
    integrated = case.charged_ah, case.discharged_ah
    total_ah = sum(counted)
    # The names of the counters are the tester's; the sign of the current is settled elsewhere.
    apart_ah = max(abs(a - b) for a, b in zip(integrated, counted, strict=True))
    if apart_ah <= _QUANTA * counter_quantum_ah(case.samples.counters):
        return
    apart = apart_ah / total_ah
    swapped = max(abs(a - b) for a, b in zip(integrated, counted[::-1], strict=True)) / total_ah
    figures = (
        f"{integrated[0]:.4g} Ah in and {integrated[1]:.4g} Ah out by integration, "
        f"{counted[0]:.4g} and {counted[1]:.4g} by the tester's counters"
    )
    if swapped < min(apart, _COUNTERS_DIFFER) and apart > _COUNTERS_DIFFER:
        what = f"{figures}: its counters of charge and discharge are exchanged"
        yield case.at(0, "note", what)
        return
    ratio = sum(integrated) / total_ah
    if 1 / 5000 < ratio < 1 / 200:
        what = f"{figures}: the counters look like mAh"
        yield case.at(0, "warning", what, "write their unit into their names, as mAh")
    elif apart > _COUNTERS_DIFFER:
        other = "forward" if case.record.hold.value == "backward" else "backward"
        held = _throughput_ah(case, other)
        remedy = "look for gaps and for a current offset; trust the counters before the integral"
        if abs(held / total_ah - 1) < abs(ratio - 1) / 3:
            remedy = f"--current-hold {other}, which gives {held:.4g} Ah in and out"
        yield case.at(0, "warning", f"{figures}: {100 * apart:.1f} % apart", remedy)
    elif apart > _COUNTERS_NOTED:
        yield case.at(0, "note", f"{figures}: {100 * apart:.1f} % apart")


def find_capacity(case: Case) -> Iterator[Finding]:
    """Charge that does not fit the given capacity."""
    if case.capacity_ah is None or case.span_ah == 0:
        return
    share = case.span_ah / case.capacity_ah
    moves = f"the record moves {case.span_ah:.4g} Ah between its extremes, {100 * share:.1f} %"
    if share > 1 + CAPACITY_WARNING:
        discharged_ah = case.record.discharged_ah
        at = max(int(np.argmax(discharged_ah)), int(np.argmin(discharged_ah)))
        yield case.at(
            at,
            "warning",
            f"{moves} of the capacity of {case.capacity_ah:.4g} Ah",
            "correct --capacity, or the current's range, offset or unit",
        )
    elif share < _HARDLY_MOVES:
        yield case.at(0, "note", f"{moves} of the capacity: little of the cell is seen")


def find_closure(case: Case) -> Iterator[Finding]:
    """A full discharge and a full charge in one record that do not pass the same charge."""
    if isinstance(case.sweeps, str):
        return
    by_direction = {sweep.direction: sweep for sweep in case.sweeps}
    if len(by_direction) < 2:
        return
    out, into = by_direction[DISCHARGE], by_direction[CHARGE]
    error = into.passed_ah / out.passed_ah - 1
    if abs(error) <= CLOSURE:
        return
    ends = [
        f"{sweep.points[0].voltage_v:.3f} to {sweep.points[-1].voltage_v:.3f} V"
        for sweep in (out, into)
    ]
    later = max(out.points[0].row, into.points[0].row)
    at = int(np.searchsorted(case.record.row, later)) if len(case.samples.sheets) < 2 else 0
    yield case.at(
        at,
        "warning",
        f"the OCV test does not close: {out.passed_ah:.4g} Ah out ({ends[0]}), "
        f"{into.passed_ah:.4g} Ah in ({ends[1]}), {100 * error:+.1f} %",
        "check the current's range and offset, and whether both ends were reached; do not put "
        "both branches on one axis of charge",
    )


def _throughput_ah(case: Case, hold: str) -> float:
    current_a = case.record.current_a
    flowed_a = current_a[:-1] if hold == "forward" else current_a[1:]
    return float(np.sum(np.abs(flowed_a) * case.record.interval_s)) / 3600


def _gain_ah(counter_ah: Float[np.ndarray, "samples"]) -> float:
    return float(np.sum(np.maximum(np.diff(counter_ah), 0)))
