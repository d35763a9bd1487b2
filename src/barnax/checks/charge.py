"""Ampere-hours: by integration, by counters, relative to the capacity, and in rests with a
current."""

from collections.abc import Iterator

import numpy as np

from ..cell.soc_axis import CAPACITY_WARNING, CHARGE, CLOSURE, DISCHARGE
from ..metrics import TO_SD
from ..notices import Notice
from ..records.counters import gain_ah
from ..records.record import runs
from ..records.samples import STEADY_SHARE
from .check_input import CheckInput

# As shares of the whole charge in both directions. Testers integrate between the samples that they
# log, so a fast current with slow samples differs by a percent.
_COUNTERS_DIFFER, _COUNTERS_NOTED = 0.03, 0.01
# Counters are rounded at both ends; this many quanta are not a difference.
_QUANTA = 3
# A factor that every tenth of the charge has within this is a wrong unit or range, not a gap.
_SCALED, _PARTS = 0.1, 10
# A counter this far from zero at the start began before the record.
_BEGUN_SHARE = 0.01
_HARDLY_MOVES, _MOVED_V = 0.02, 0.3


def find_counters(given: CheckInput) -> Iterator[Notice]:
    """Counters of the tester that disagree with the integrated current, or began earlier."""
    record, counters = given.record, given.samples.counters
    in_ah, out_ah = given.charged_ah, given.discharged_ah
    # All the charge by the other hold.
    other = "forward" if record.hold.value == "backward" else "backward"
    held_ah = float(np.sum(np.abs(given.samples.held_ah(other))))
    if not counters.both:
        ratio = counters.net_ratio(record.moved_ah, given.samples.is_loaded)
        if ratio is not None and abs(ratio - 1) > _SCALED:
            held_ratio = ratio * held_ah / (in_ah + out_ah)
            is_held = abs(held_ratio - 1) < abs(ratio - 1) / 3
            by = {"hold": other, "held_ratio": held_ratio} if is_held else {"inverse": 1 / ratio}
            column = given.samples.header("net capacity")
            yield given.at(0, "counters.net", ratio=ratio, column=column, **by)
        return
    gained_ah, spent_ah = map(gain_ah, counters.both)
    total_ah = gained_ah + spent_ah
    # The names of the counters are the tester's; the sign of the current is settled elsewhere.
    apart_ah = max(abs(in_ah - gained_ah), abs(out_ah - spent_ah))
    swapped_ah = max(abs(in_ah - spent_ah), abs(out_ah - gained_ah))
    if total_ah > 0 and apart_ah > max(_QUANTA * counters.quantum_ah, _COUNTERS_NOTED * total_ah):
        values = {"integrated_in_ah": in_ah, "integrated_out_ah": out_ah}
        values |= {"counted_in_ah": gained_ah, "counted_out_ah": spent_ah}
        values |= {"apart_share": apart_ah / total_ah, "cause": "unknown"}
        ratio = (in_ah + out_ah) / total_ah
        if apart_ah <= _COUNTERS_DIFFER * total_ah:
            values["cause"] = "slight"
        elif swapped_ah < _COUNTERS_DIFFER * total_ah:
            values["cause"] = "exchanged"
        elif abs(ratio - 1) > _SCALED and _is_scaled(given, ratio):
            values |= {"cause": "factor", "ratio": ratio, "inverse": 1 / ratio}
        elif abs(held_ah / total_ah - 1) < abs(ratio - 1) / 3:
            values |= {"cause": "hold", "hold": other, "held_ah": held_ah}
        yield given.at(0, "counters.apart", **values)
    first_ah = {"in_ah": counters.both[0][0], "out_ah": counters.both[1][0]}
    least_ah = _BEGUN_SHARE * given.scale_ah
    begun_ah = {name: count_ah for name, count_ah in first_ah.items() if count_ah > least_ah}
    if begun_ah:
        began = "both" if len(begun_ah) > 1 else next(iter(begun_ah))
        yield given.at(0, "counters.begun", begun=began, clock_s=record.time_s[0], **begun_ah)


def _is_scaled(given: CheckInput, ratio: float) -> bool:
    """True if the integral is this share of the counted charge in every part of the record."""
    counted_ah = given.samples.counters.increments_ah(with_net=False)
    assert counted_ah is not None, "both counters are there"
    passed_ah = np.cumsum(np.abs(counted_ah))
    edges = np.searchsorted(passed_ah, passed_ah[-1] * np.arange(_PARTS) / _PARTS)
    charges = given.record.moved_ah, counted_ah
    moved_ah, counted_ah = (np.add.reduceat(np.abs(charge_ah), edges) for charge_ah in charges)
    return bool(np.all(np.abs(moved_ah / counted_ah / ratio - 1) < _SCALED))


def find_capacity(given: CheckInput) -> Iterator[Notice]:
    """Charge that does not fit the given capacity."""
    if given.capacity_ah is None or given.record.span_ah == 0:
        return
    share = given.record.span_ah / given.capacity_ah
    values = {"moved_ah": given.record.span_ah, "share": share, "capacity_ah": given.capacity_ah}
    if share > 1 + CAPACITY_WARNING:
        discharged_ah = given.record.discharged_ah
        at = max(int(np.argmax(discharged_ah)), int(np.argmin(discharged_ah)))
        yield given.at(at, "capacity.moved", **values, amount="more")
    elif share < _HARDLY_MOVES:
        travel_v = given.samples.bulk_time[1]
        is_doubtful = share < _HARDLY_MOVES / 2 and travel_v >= _MOVED_V
        values |= {"amount": "hardly" if is_doubtful else "little", "travel_v": travel_v}
        yield given.at(0, "capacity.moved", **values)


def find_closure(given: CheckInput) -> Iterator[Notice]:
    """A full discharge and a full charge in one record with different charge."""
    of_direction = {sweep.direction: sweep for sweep in given.ocv.sweeps}
    if len(of_direction) < 2:
        return
    out, into = of_direction[DISCHARGE], of_direction[CHARGE]
    error = into.passed_ah / out.passed_ah - 1
    if abs(error) <= CLOSURE:
        return
    later = max(out.points[0].row, into.points[0].row)
    at = int(np.searchsorted(given.record.row, later)) if len(given.samples.table.sheets) < 2 else 0
    values = {"error_share": error}
    for way, sweep in (("out", out), ("in", into)):
        values[f"{way}_ah"] = sweep.passed_ah
        values[f"{way}_from_v"] = sweep.points[0].voltage_v
        values[f"{way}_to_v"] = sweep.points[-1].voltage_v
    yield given.at(at, "closure.open", **values)


# A rest is possible where a current below C/20 and below a fair part of the peak is steady for this
# many samples.
_LOAD_HOURS, _SMALL_SHARE, _FEWEST = 20.0, 0.15, 5
# The shortest rest, the share of the time at rest that has to have the offset, and the share that
# may have none.
_LONG_S, _MOST, _FEW = 60.0, 0.5, 0.05
# An offset is larger than one step of the reading, and than noise.
_OFFSET_QUANTA, _SIGMAS = 1.5, 5.0
# Only this many of the longest runs are examined.
_ENOUGH = 1000
# In the second half of a rest the voltage hardly moves, unlike in a slow sweep, and the current is
# steady, unlike in a taper.
_SETTLED_V, _SPREAD = 0.01, 0.3
# An offset's ampere-hours over the record, as shares of the capacity.
_DRIFT, _NOTED_DRIFT = 0.01, 5e-3


def find_rests(given: CheckInput) -> Iterator[Notice]:
    """A current that is not zero while the cell rests, or so noisy that it hides the rests."""
    if rests := _rests(given):
        yield from _offset(given, rests)
    if given.given_rest_a is None and given.segments.rest_a > 1.01 * given.scale_ah / 100:
        yield given.at(given.segments.is_rested, "rests.noisy", rest_a=given.segments.rest_a)


def _rests(given: CheckInput) -> list[tuple[int, int, float]]:
    """First and last sample of the runs that look like rests, and the median of their current."""
    record = given.record
    peak_a = given.samples.peak_a
    small_a = min(_turnover_ah(given) / _LOAD_HOURS, _SMALL_SHARE * peak_a)
    is_small = np.abs(record.current_a) < small_a
    is_quiet = is_small[1:] & is_small[:-1] & (np.abs(given.samples.step_a) < STEADY_SHARE * peak_a)
    first, last_interval = runs(is_quiet)
    last = last_interval + 1
    length_s = record.time_s[last] - record.time_s[first]
    chosen = last - first + 1 >= _FEWEST
    # Some short runs may be loads; they count only if there are no long ones.
    if np.any(chosen & (length_s >= _LONG_S)):
        chosen &= length_s >= _LONG_S
    indices = np.flatnonzero(chosen)
    indices = np.sort(indices[np.argsort(-length_s[indices], kind="stable")[:_ENOUGH]])
    rests, counters, moved_ah = [], given.samples.counters.both, record.moved_ah
    for a, b in zip(first[indices].tolist(), last[indices].tolist(), strict=True):
        half = slice((a + b) // 2, b + 1)
        current_a, voltage_v = record.current_a[half], record.voltage_v[half]
        middle_a, third = float(np.median(current_a)), max(len(current_a) // 3, 1)
        drift_a = abs(np.median(current_a[:third]) - np.median(current_a[-third:]))
        is_steady = drift_a <= _SPREAD * abs(middle_a) + 2 * given.resolution_a
        is_settled = np.ptp(voltage_v) <= _SETTLED_V + 4 * given.samples.noise_v
        # If the tester itself counted the charge, it is not a rest.
        counted_ah = sum(float(counter[b] - counter[a]) for counter in counters)
        is_counted = 0 < 0.5 * abs(float(moved_ah[a:b].sum())) < counted_ah
        if is_steady and is_settled and not is_counted:
            rests.append((a, b, middle_a))
    return rests


def _turnover_ah(given: CheckInput) -> float:
    """The capacity, or the charge in either direction: an offset may cancel the net charge."""
    return given.capacity_ah or max(given.charged_ah, given.discharged_ah)


def _offset(given: CheckInput, rests: list[tuple[int, int, float]]) -> Iterator[Notice]:
    """An offset, if most of the rests have it and hardly any is without."""
    record, turnover_ah = given.record, _turnover_ah(given)
    first, last, values_a = map(np.array, zip(*rests, strict=True))
    lengths_s = record.time_s[last] - record.time_s[first]
    order, all_s = np.argsort(values_a), lengths_s.sum()
    middle = int(np.searchsorted(np.cumsum(lengths_s[order]), all_s / 2))
    offset_a = float(values_a[order[middle]])
    near_a = _SPREAD * abs(offset_a) + 2 * given.resolution_a
    is_alike = np.abs(values_a - offset_a) <= near_a
    # Zero counts even in the shortest rests: a small current elsewhere is then a load.
    is_zero = np.abs(record.current_a) <= near_a
    zero_s = record.interval_s[is_zero[1:] & is_zero[:-1]].sum()
    if lengths_s[is_alike].sum() < _MOST * all_s or zero_s > _FEW * all_s:
        return
    # The largest median that noise may cause in this many samples at rest.
    peak_a, step_a = given.samples.peak_a, np.abs(given.samples.step_a)
    is_small = np.abs(record.current_a) < _SMALL_SHARE * peak_a
    quiet_a = step_a[is_small[1:] & (step_a < STEADY_SHARE * peak_a)]
    noise_a = TO_SD * float(np.median(quiet_a)) / np.sqrt(2)
    doubt_a = _SIGMAS * 1.25 * noise_a / float(np.sqrt(np.sum(last - first + 1)))
    if abs(offset_a) <= max(_OFFSET_QUANTA * given.resolution_a, doubt_a):
        return
    # Short runs above what counts as rest may as well be the small loads of a drive cycle.
    is_large = abs(offset_a) >= turnover_ah / 100
    if is_large and lengths_s.max() < _LONG_S:
        return
    drift_ah = abs(offset_a) * float(record.time_s[-1] - record.time_s[0]) / 3600
    share, is_much = drift_ah / turnover_ah, drift_ah > _DRIFT * turnover_ah
    value_a = -offset_a if record.sign.value == "charge-positive" else offset_a
    values = {"offset_a": value_a, "drift_ah": drift_ah, "rests": len(rests)}
    if is_much and given.ocv.sweeps:
        values |= {"soc_share": share, "ocv_v": share * given.samples.bulk_time[1]}
    if is_large and given.given_rest_a is None:
        values |= {"rest_a": 1.5 * abs(offset_a)}
    if is_large or is_much or drift_ah > _NOTED_DRIFT * turnover_ah:
        effect = None if is_large or is_much else "slight"
        at = int(first[np.argmax(is_alike)])
        yield given.at(at, "rests.offset", **values, effect=effect)
