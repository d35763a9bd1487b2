"""Gaps in a record, clocks that no tester kept, and readings that are too coarse."""

from collections.abc import Iterator

import numpy as np

from ..notices import Notice
from ..records.lag import LASTING, LATE_SURE, answers_ohm, late_r0_ohm
from ..records.quantities import FAHRENHEIT, KELVIN
from ..records.record import equal_runs
from ..records.silence import gaps_in
from .check_input import FINE_S, CheckInput

# An interval in more than this share of all is part of the tester's sampling.
_MANY = 0.1
# The content of a gap does not matter below this share of the capacity, and this jump of voltage.
_HIDDEN_SHARE, _HIDDEN_V = 1e-3, 0.02
# A steady load through a gap may have been interrupted; from this share of the capacity on it
# matters.
_HELD_SHARE = 0.01
# Omitted loads that are worth a warning, as a share of the capacity.
_SKIPPED_SHARE = 0.03
# Intervals this long under load, next to others a tenth as long, hide the course of the load.
_COARSE_S, _FINE_SHARE = 30.0, 0.1

# Pairs of measured cells respond in the second sample with at most half this share of the first
# response more than in the fifth, at 0.1 to 1 s and down to -10 degC; a filtered voltage responds
# with more.
_SLOW_SHARE = 0.3
# No pair takes back so large a share of the first response in the next sample.
_BACK_SHARE = 0.1
# From this interval on, part of a sample may be a pair, or a load that changes between rows.
_ALIKE_S = 0.5

# Findings that bias R0, but not the OCV.
OF_R0 = frozenset({"late-voltage.step", "smoothed-current.back"})


def find_gaps(given: CheckInput) -> Iterator[Notice]:
    """Intervals without samples where samples were to be expected."""
    record = given.record
    interval_s, gaps = record.interval_s, gaps_in(record.interval_s)
    if record.flowing is not None:
        rests = np.flatnonzero(record.flowing < 1)
        longest = rests[int(np.argmax(interval_s[rests]))]
        values = {"longest_s": interval_s[longest], "longest_row": record.row[longest + 1]}
        values |= {"gaps": len(rests), "charge": "resting"}
        yield given.at(int(rests[0]) + 1, "gaps.missing", **values)
        gaps = np.setdiff1d(gaps, rests)
    # Most samples are as far apart as the closer ones.
    gaps = gaps[interval_s[gaps] > np.median(interval_s)]
    if not 0 < len(gaps) <= max(1, _MANY * len(interval_s)):
        return
    jump_v = np.abs(np.diff(given.record.source_v)[gaps])
    is_between_rests = given.segments.is_rested[gaps] & given.segments.is_rested[gaps + 1]
    # Between rests at two voltages a load was left out.
    is_lost = is_between_rests & (jump_v > _HIDDEN_V)
    counted_ah, doubt_ah = record.charge_ah, 0.0
    if counted_ah is not None:
        # The tester's counter continued, unless it stood still or restarted.
        is_lost &= np.abs(np.diff(counted_ah)[gaps]) <= _HELD_SHARE * given.scale_ah
    else:
        # The charge is uncertain by the range of the current next to the gap, except between rests
        # at one voltage.
        beside = np.clip(gaps[:, None] + np.arange(-2, 4), 0, record.samples - 1)
        doubt_a = np.ptp(record.current_a[beside], axis=1)
        doubt_a[is_between_rests & ~is_lost] = 0
        doubt_ah = float(np.sum(doubt_a * interval_s[gaps])) / 3600
    moved_ah = given.charged_ah + given.discharged_ah
    worst = gaps[int(np.argmax(interval_s[gaps]))]
    values = {"longest_s": interval_s[worst], "longest_row": record.row[worst + 1]}
    charge = "idle"
    held_ah = float(np.abs(given.record.moved_ah[gaps]).sum())
    if doubt_ah > _HIDDEN_SHARE * given.scale_ah or np.any(jump_v > _HIDDEN_V):
        charge = "doubted"
        if counted_ah is not None:
            charge = "standing" if is_lost.any() else "counted"
        elif is_lost.any() or not _HIDDEN_SHARE * given.scale_ah <= doubt_ah <= moved_ah:
            charge = "unknown"
        values |= {"moved_v": jump_v.max(), "doubt_ah": doubt_ah}
    elif counted_ah is None and held_ah > _HELD_SHARE * given.scale_ah:
        charge, values["held_ah"] = "steady", held_ah
    yield given.at(int(gaps[0]) + 1, "gaps.missing", **values, gaps=len(gaps), charge=charge)


def find_skipped(given: CheckInput) -> Iterator[Notice]:
    """Loads that the logger left out, and the tester counted."""
    skipped_ah = given.record.skipped_ah
    if skipped_ah is None:
        return
    indices = np.flatnonzero(skipped_ah)
    counted_ah, more_ah = given.record.moved_ah[indices], skipped_ah[indices]
    shown_ah = float(np.abs(counted_ah - more_ah).sum())
    is_much = np.abs(more_ah).sum() > _SKIPPED_SHARE * given.scale_ah
    charges = {"counted_ah": np.abs(counted_ah).sum(), "shown_ah": shown_ah}
    notice = given.at(int(indices[0]) + 1, "skipped.load", intervals=len(indices), **charges)
    yield notice.rated("warning" if is_much else "note")


# A voltage that moves this far from one sample to the next, and by this many times its noise,
_BREAK_V, _BREAK_NOISE = 0.1, 12.0
# steady over this many samples on either side, stays there;
_SIDE, _UNSTEADY = 10, 0.25
# and the current explains it if the change is at most this many times R I.
_UNEXPLAINED = 3.0


def find_breaks(given: CheckInput) -> Iterator[Notice]:
    """Jumps of the voltage between two samples that no current explains."""
    record = given.record
    moved_v = np.abs(np.diff(given.record.source_v))
    indices = np.flatnonzero(moved_v > max(_BREAK_V, _BREAK_NOISE * given.samples.noise_v))
    # In a long interval a cell relaxes this far.
    indices = indices[record.interval_s[indices] <= FINE_S]
    indices = np.setdiff1d(indices, gaps_in(record.interval_s))
    indices = indices[(indices >= _SIDE - 1) & (indices + _SIDE < record.samples)]
    window = indices[:, None] + np.arange(1 - _SIDE, 1 + _SIDE)
    around_v, around_a = given.record.source_v[window], record.current_a[window]
    sides_v = around_v[:, :_SIDE], around_v[:, _SIDE:]
    unsteady_v = np.maximum(*(np.ptp(side_v, axis=1) for side_v in sides_v))
    explained_v = _UNEXPLAINED * given.response_ohm * np.ptp(around_a, axis=1)
    is_break = (unsteady_v < _UNSTEADY * moved_v[indices]) & (explained_v < moved_v[indices])
    indices = indices[is_break]
    if len(indices) and given.samples.resistance_ohm:
        at = int(indices[0]) + 1
        values = {"before_v": record.voltage_v[at - 1], "after_v": record.voltage_v[at]}
        values |= {"interval_s": record.interval_s[at - 1], "places": len(indices)}
        yield given.at(at, "breaks.voltage", "voltage", **values)


def find_coarse_intervals(given: CheckInput) -> Iterator[Notice]:
    """Long intervals under load in a record that is elsewhere sampled finely."""
    record = given.record
    interval_s = record.interval_s
    is_loaded = ~given.segments.is_rested[1:] & ~given.segments.is_rested[:-1]
    is_coarse = is_loaded & (interval_s >= _COARSE_S)
    fine_s = float(np.quantile(interval_s, 0.1))
    if is_coarse.sum() < 2 or fine_s > _FINE_SHARE * _COARSE_S:
        return
    long_s = float(np.median(interval_s[is_coarse]))
    values = {"intervals": is_coarse.sum(), "long_s": long_s, "fine_s": fine_s}
    yield given.at(int(np.argmax(is_coarse)) + 1, "coarse-intervals.load", **values)


def find_late_voltage(given: CheckInput) -> Iterator[Notice]:
    """A voltage that shows part of a current step only in the next samples, or responds over
    several as a filtered one does; or that takes back part of it in the next sample, which no cell
    does: the current was averaged or filtered before it was written."""
    lag = given.lag
    if lag is not None:
        values = {
            "lag_s": lag.seconds,
            "interval_s": given.samples.interval_s,
            "apart_s": abs(lag.seconds),
        }
        is_either = abs(lag.samples) < 1 and given.samples.interval_s >= _ALIKE_S
        values |= {"cause": "either" if is_either else None}
        values |= {"age": "older" if lag.samples > 0 else "newer"}
        if lag.samples > 0:
            values["missing_share"] = min(lag.samples, 1.0)
        yield Notice("late-voltage.apart", values)
        return
    answers = answers_ohm(given.record)
    if answers is None:
        return
    (first_ohm, second_ohm, third_ohm, _, last_ohm), covariance = answers
    values = {"first_ohm": first_ohm, "interval_s": given.samples.interval_s}
    slow_ohm = max(_SLOW_SHARE * first_ohm, LATE_SURE * np.sqrt(np.max(np.diag(covariance))))
    # A steep OCV adds the same to every response.
    is_slow, is_rising = second_ohm - last_ohm > slow_ohm, last_ohm - first_ohm > slow_ohm
    late_ohm = None if late_r0_ohm(answers) is None else second_ohm - LASTING * third_ohm
    if not given.is_lag_given and (late_ohm or (first_ohm > 0 and (is_slow or is_rising))):
        share = late_ohm and late_ohm / (first_ohm + late_ohm)
        more = {"second_ohm": second_ohm, "third_ohm": third_ohm, "missing_share": share}
        yield Notice("late-voltage.step", {**values, **more})
    back_ohm = max(_BACK_SHARE * first_ohm, LATE_SURE * np.sqrt(covariance[1, 1]))
    if first_ohm > 0 and -second_ohm > back_ohm:
        yield Notice("smoothed-current.back", {**values, "back_ohm": -second_ohm})


def find_fast_load(given: CheckInput) -> Iterator[Notice]:
    """A current that changes as often as it is logged, slowly: its rows are means, or instantaneous
    samples with an unknown current in between."""
    hold, evidence = given.record.hold, given.record.evidence
    is_given = hold.strength == "given"
    slow = None if evidence is None else evidence.slow
    if slow is None or not (slow.changes_between and (is_given or hold.value != "forward")):
        return
    # Users who give "forward" know that the load switches in time with the log.
    is_reported = slow.kind == "instants" and not (is_given and hold.value == "forward")
    if is_reported or hold.strength == "assumed":
        values = {"interval_s": given.samples.interval_s, "rows": slow.kind}
        yield Notice("fast-load.rows", {**values, "hold": None if is_given else "open"})


# Shorter steps say little about the pace.
_FEWEST_IN_STEP = 20


def find_rebuilt_clock(given: CheckInput) -> Iterator[Notice]:
    """A clock that is evenly spaced within each step, at a slightly different pace in each.

    A tester's clock jitters, or runs at one pace throughout.
    """
    record = given.record
    if record.step is None:
        return
    starts, ends = equal_runs(record.step, _FEWEST_IN_STEP)
    if len(starts) < 3:
        return
    interval_s = record.interval_s
    paces_s = [interval_s[a:b] for a, b in zip(starts, ends, strict=True)]
    low_s, high_s = (np.array([*map(end, paces_s)]) for end in (np.min, np.max))
    # Parquet and workbooks keep about 1e-11 of a stamp; text a millisecond, which is too coarse.
    is_even = high_s - low_s <= 1e-6 * high_s
    spread = float(np.ptp(low_s)) / float(np.median(low_s))
    if is_even.all() and 1e-5 < spread < 0.05:
        values = {"steps": len(starts), "low_s": low_s.min(), "high_s": low_s.max()}
        yield given.at(int(starts[0]), "rebuilt-clock.even", **values)


_COARSE_V, _COARSE_SHARE = 0.9e-3, 5e-3
_TEMPERATURE_DEGC = (-60.0, 120.0)
# Cells are used up to 60 degC: higher values are rather a room's temperature in Fahrenheit.
_HOT_DEGC, _ROOM_DEGC = 65.0, 50.0
# A record over more than this many degrees, except for some of its samples, has no single
# temperature.
_WIDE_DEGC, _ENDS = 15.0, (0.05, 0.95)


def find_resolution(given: CheckInput) -> Iterator[Notice]:
    """Readings so coarse that they affect the results."""
    magnitude_a = np.abs(given.record.current_a)
    loaded_a = float(np.median(magnitude_a[magnitude_a > 0.05 * given.samples.peak_a]))
    share = given.resolution_a / loaded_a
    if given.resolution_v < _COARSE_V and share < _COARSE_SHARE:
        return
    steps = {"resolution_v": given.resolution_v, "resolution_a": given.resolution_a}
    yield Notice("resolution.coarse", {**steps, "load_share": share})


def find_temperature(given: CheckInput) -> Iterator[Notice]:
    """Temperatures that are impossible for a cell, or vary too much within the record."""
    temperature = given.record.temperature_degc
    if temperature is None:
        return
    low, high = _TEMPERATURE_DEGC
    bottom, top = np.quantile(temperature, _ENDS)
    outside, unit = (temperature < low) | (temperature > high), None
    if low < KELVIN.to_base(temperature.min()) and KELVIN.to_base(temperature.max()) < high:
        unit = "K"
    elif not outside.any() and bottom > _HOT_DEGC and FAHRENHEIT.to_base(top) < _ROOM_DEGC:
        high, outside, unit = _HOT_DEGC, temperature > _HOT_DEGC, "degF"
    if outside.any():
        values = {"temperature_degc": temperature[np.argmax(outside)], "samples": outside.sum()}
        values |= {"low_degc": low, "high_degc": high, "unit": unit}
        yield given.at(outside, "temperature.outside", **values)
    elif top - bottom > _WIDE_DEGC:
        yield Notice("temperature.varies", {"low_degc": bottom, "high_degc": top})
