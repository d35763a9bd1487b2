"""Holes in a record, clocks that no tester kept, and readings that are too coarse."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int

from ..errors import counted
from ..records import Record
from ..records.findings import Finding
from ..records.lag import find_lag
from .check_input import CheckInput
from .roles import FINE_S

# An interval is a gap if it is this much longer than the usual ones on both of its sides.
_GAP, _BESIDE = 3.0, 7
# Such intervals are gaps only if of those within so much of their length more than this share are.
_ALIKE, _FEW_ALIKE = 0.02, 0.05
# More than this share of all intervals is how the tester samples.
_MANY = 0.1
# What a gap hides is of no account below this share of the capacity, and this jump of voltage.
_HIDDEN_SHARE, _HIDDEN_V = 1e-3, 0.02
# A steady load through a gap may have been interrupted; this share of the capacity is of account.
_HELD_SHARE = 0.01
# Loads left out that are worth a warning, as a share of the capacity.
_SKIPPED_SHARE = 0.03
# Intervals this long under load, beside others a tenth as long, hide what the load did.
_COARSE_S, _FINE_SHARE = 30.0, 0.1

# The answers to a step are looked at in so many samples, of so many places where the current moves
# by more than this share of the largest.
_ANSWERS, _FEWEST_STEPS, _STEP_SHARE = 5, 50, 0.05
# A pair answers in the sample after a step at most so often what it does in the next one, unless it
# is over within two samples. More than this share of the whole, at so many deviations, is late.
_LASTING, _LATE_SHARE, _LATE_SURE = 2.0, 0.03, 4.0
# From this interval on, a current that differs from both its neighbors in so many of the samples
# under load, by this share of the largest, also changed between them.
_SLOW_S, _ALONE, _ALONE_SHARE = 2.5, 0.5, 0.1

Intervals = Float[np.ndarray, "intervals"]


def find_gaps(given: CheckInput) -> Iterator[Finding]:
    """Intervals without samples where samples were to be expected."""
    record = given.record
    interval_s = record.interval_s
    gaps = _gaps(interval_s)
    # Most samples lie as far apart as the shorter ones.
    gaps = gaps[interval_s[gaps] > np.median(interval_s)]
    if not 0 < len(gaps) <= max(1, _MANY * len(interval_s)):
        return
    jump_v = np.abs(np.diff(given.source_v)[gaps])
    # The charge is in doubt by as much as the current moves beside the gap, and not between rests
    # of one voltage.
    beside = np.clip(gaps[:, None] + np.arange(-2, 4), 0, record.samples - 1)
    doubt_a = np.ptp(record.current_a[beside], axis=1)
    is_between_rests = given.is_rested[gaps] & given.is_rested[gaps + 1]
    doubt_a[is_between_rests & (jump_v <= _HIDDEN_V)] = 0
    # Between rests of two voltages a load was left out.
    is_lost = is_between_rests & (jump_v > _HIDDEN_V)
    charge_ah = record.charge_ah
    is_counted = charge_ah is not None
    if charge_ah is not None:
        # The tester counted on, unless its counter stood still or began anew.
        is_lost &= np.abs(np.diff(charge_ah)[gaps]) <= _HELD_SHARE * given.scale_ah
        doubt_a[:] = 0
    doubt_ah = float(np.sum(doubt_a * interval_s[gaps])) / 3600
    moved_ah = given.charged_ah + given.discharged_ah
    worst = gaps[int(np.argmax(interval_s[gaps]))]
    where = f"a gap of {interval_s[worst]:.4g} s"
    if len(gaps) > 1:
        row = int(record.row[worst + 1])
        where = f"{len(gaps)} gaps, the longest {interval_s[worst]:.4g} s before row {row}"
    remedy = "score up to it only (`score_to`), or start behind it (`start_time`)"
    if len(gaps) > 1:
        remedy = "score a part between them only (`score_from`, `score_to`)"
    first = int(gaps[0]) + 1
    held_ah = float(np.abs(given.moved_ah[gaps]).sum())
    if doubt_ah > _HIDDEN_SHARE * given.scale_ah or np.any(jump_v > _HIDDEN_V):
        lost = f"up to {doubt_ah:.2g} Ah are in doubt"
        if is_counted:
            tell = "hardly move" if is_lost.any() else "tell the charge"
            lost = f"the tester's counters {tell}"
        elif is_lost.any() or not _HIDDEN_SHARE * given.scale_ah <= doubt_ah <= moved_ah:
            lost = "what passed meanwhile was not logged"
        what = f"{where}; the voltage moves by up to {1e3 * jump_v.max():.3g} mV across, and {lost}"
        yield given.at(first, "warning", what, remedy)
    elif not is_counted and held_ah > _HELD_SHARE * given.scale_ah:
        what = f"{where} under a steady load: {held_ah:.3g} Ah are assumed to have passed"
        yield given.at(first, "warning", what, f"if the test was paused there, {remedy}")
    else:
        yield given.at(first, "note", f"{where}, in which nothing seems to happen")


def find_skipped(given: CheckInput) -> Iterator[Finding]:
    """Loads that the logger left out, and the tester counted."""
    skipped_ah = given.record.skipped_ah
    if skipped_ah is None:
        return
    places = np.flatnonzero(skipped_ah)
    counted_ah, more_ah = given.moved_ah[places], skipped_ah[places]
    shown_ah = float(np.abs(counted_ah - more_ah).sum())
    what = (
        f"in {counted(len(places), 'interval')} the tester counted "
        f"{np.abs(counted_ah).sum():.4g} Ah where the samples show {shown_ah:.4g} Ah: its counters "
        "tell the charge there"
    )
    is_much = np.abs(more_ah).sum() > _SKIPPED_SHARE * given.scale_ah
    severity = "warning" if is_much else "note"
    yield given.at(int(places[0]) + 1, severity, what, "give the file with every sample, if any")


# A voltage that moves so far from one sample to the next, and by so many times its noise,
_BREAK_V, _BREAK_NOISE = 0.1, 12.0
# steady over so many samples on either side, stays there;
_SIDE, _UNSTEADY = 10, 0.25
# and the current explains it if it is no more than so many times what the resistance makes.
_UNEXPLAINED = 3.0


def find_breaks(given: CheckInput) -> Iterator[Finding]:
    """Places where the voltage goes elsewhere between two samples, and no current says why."""
    record = given.record
    moved_v = np.abs(np.diff(given.source_v))
    places = np.flatnonzero(moved_v > max(_BREAK_V, _BREAK_NOISE * given.samples.noise_v))
    # In a long interval a cell relaxes so far.
    places = places[record.interval_s[places] <= FINE_S]
    places = np.setdiff1d(places, _gaps(record.interval_s))
    places = places[(places >= _SIDE - 1) & (places + _SIDE < record.samples)]
    window = places[:, None] + np.arange(1 - _SIDE, 1 + _SIDE)
    around_v, around_a = given.source_v[window], record.current_a[window]
    unsteady_v = np.maximum(
        np.ptp(around_v[:, :_SIDE], axis=1), np.ptp(around_v[:, _SIDE:], axis=1)
    )
    explained_v = _UNEXPLAINED * given.response_ohm * np.ptp(around_a, axis=1)
    is_break = (unsteady_v < _UNSTEADY * moved_v[places]) & (explained_v < moved_v[places])
    places = places[is_break]
    if len(places) and given.resistance_ohm:
        at = int(places[0]) + 1
        what = (
            f"the voltage goes from {record.voltage_v[at - 1]:.4g} to {record.voltage_v[at]:.4g} V "
            f"in {record.interval_s[at - 1]:.3g} s, stays there, and no current explains it "
            f"({counted(len(places), 'such place')}): rows are missing, or another run begins"
        )
        remedy = "split the file, score up to here (`score_to`), or start behind it (`start_time`)"
        yield given.at(at, "warning", what, remedy)


def find_coarse_intervals(given: CheckInput) -> Iterator[Finding]:
    """Long intervals under load in a record that is elsewhere sampled finely."""
    record = given.record
    interval_s = record.interval_s
    is_loaded = ~given.is_rested[1:] & ~given.is_rested[:-1]
    is_coarse = is_loaded & (interval_s >= _COARSE_S)
    fine_s = float(np.quantile(interval_s, 0.1))
    if is_coarse.sum() < 2 or fine_s > _FINE_SHARE * _COARSE_S:
        return
    long_s = float(np.median(interval_s[is_coarse]))
    what = (
        f"{int(is_coarse.sum())} intervals of {long_s:.3g} s under load beside others of "
        f"{fine_s:.3g} s: what happened inside them was not logged"
    )
    remedy = "leave them out with `score_steps`, `score_from` or `score_to`"
    yield given.at(int(np.argmax(is_coarse)) + 1, "note", what, remedy)


def late_answers_ohm(record: Record) -> tuple[float, float, float] | None:
    """What the voltage shows of a step of the current at once, one sample later and after that.

    None where nothing is late. The answers of the samples from a step on are least squares on the
    differences between samples: R0 and what follows at once in the first, in the others what the RC
    pairs add, which falls off with their time constants. A second answer far above what the third
    leaves it is late.
    """
    interval_s, moved_a = record.interval_s, np.diff(record.current_a)
    usual_s = float(np.median(interval_s))
    near = np.lib.stride_tricks.sliding_window_view
    if len(moved_a) < _ANSWERS + _FEWEST_STEPS:
        return None
    is_even = np.all(np.abs(near(interval_s, _ANSWERS) - usual_s) < 0.1 * usual_s, axis=1)
    steps_a = near(moved_a, _ANSWERS)[:, ::-1]
    least_a = _STEP_SHARE * float(np.max(np.abs(record.current_a)))
    is_used = is_even & (np.max(np.abs(steps_a), axis=1) > least_a)
    if is_used.sum() < _FEWEST_STEPS:
        return None
    # The current before and a constant stand for what is slow.
    before_a = record.current_a[: len(steps_a)]
    design = np.column_stack([steps_a, before_a, np.ones(len(steps_a))])[is_used]
    moved_v = np.diff(record.voltage_v)[_ANSWERS - 1 :][is_used]
    if np.linalg.matrix_rank(design) < design.shape[1]:
        return None
    inverse = np.linalg.inv(design.T @ design)
    answers = -inverse @ (design.T @ moved_v)
    late = np.zeros(len(answers))
    late[1:3] = 1, -_LASTING
    error_v = moved_v + design @ answers
    variance = float(error_v @ error_v) / (len(moved_v) - len(answers)) * (late @ inverse @ late)
    ohm, whole = float(late @ answers), float(answers[0] + answers[1])
    if not ohm > max(_LATE_SHARE * whole, _LATE_SURE * np.sqrt(variance)) or answers[0] <= 0:
        return None
    first, second, third = answers[:3].tolist()
    return first, second, third


def find_late_voltage(given: CheckInput) -> Iterator[Finding]:
    """A voltage that shows part of a step of the current only in the next sample."""
    if given.voltage_lag_s is not None:
        return
    lag = find_lag(given.record)
    usual_s = float(np.median(given.record.interval_s))
    if lag is not None:
        at_once, beside = 1e3 * lag.at_once_ohm, 1e3 * lag.beside_ohm
        older, next_to, loss = "newer", "before", "leave errors at every step"
        if lag.share > 0:
            older, next_to = "older", "later"
            loss = f"make R0 some {100 * lag.share:.0f} % too low"
        what = (
            f"of a current step the voltage shows {at_once:.3g} mOhm at once and {beside:.3g} mOhm "
            f"one sample ({usual_s:.3g} s) {next_to}: it is {abs(lag.seconds):.3g} s {older} than "
            f"the current of its row, which as they are would {loss}"
        )
        remedy = (
            "the current is taken at its moments, and R0 is all that shows within a sample; "
            f"`voltage_lag={lag.seconds:.3g}` says so, 0 takes them as logged"
        )
        yield Finding("warning", what, remedy)
        return
    answers_ohm = late_answers_ohm(given.record)
    if answers_ohm is None:
        return
    first, second, third = (1e3 * each for each in answers_ohm)
    late = second - _LASTING * third
    what = (
        f"after a current step the voltage shows {first:.3g} mOhm at once, {second:.3g} mOhm more "
        f"one sample ({usual_s:.3g} s) later and {third:.3g} mOhm more after that: it lags by part "
        f"of a sample, or pairs are faster than the log, and R0 is up to "
        f"{100 * late / (first + late):.0f} % too low"
    )
    remedy = "use a record that logs current and voltage at one moment, or one sampled faster"
    yield Finding("warning", what, remedy)


def find_fast_load(given: CheckInput) -> Iterator[Finding]:
    """A current that changes as often as it is logged, slowly: what flowed between is not known."""
    record = given.record
    usual_s = float(np.median(record.interval_s))
    is_changed = np.abs(np.diff(record.current_a)) > _ALONE_SHARE * given.samples.peak_a
    is_alone = is_changed[1:] & is_changed[:-1]
    is_loaded = ~given.is_rested[1:-1]
    share = float(np.mean(is_alone[is_loaded])) if is_loaded.any() else 0.0
    if usual_s < _SLOW_S or share < _ALONE:
        return
    what = (
        f"the current differs from both its neighbors in {100 * share:.0f} % of the samples under "
        f"load, which are {usual_s:.3g} s apart: it changes faster than it is sampled, and every "
        "resistance can be wrong by more than its interval"
    )
    yield Finding("warning", what, "log it faster, or a mean current over each interval")


def find_rebuilt_clock(given: CheckInput) -> Iterator[Finding]:
    """A clock laid evenly inside each step, at a slightly different pace in each.

    A tester's clock jitters, or ticks at one pace throughout.
    """
    record = given.record
    if record.step is None:
        return
    starts = np.flatnonzero(np.diff(record.step, prepend=record.step[0] - 1) != 0)
    lengths = np.diff(np.append(starts, record.samples))
    starts, lengths = starts[lengths >= 20], lengths[lengths >= 20]
    if len(starts) < 3:
        return
    inside = np.concatenate([np.arange(a + 1, a + n) for a, n in zip(starts, lengths, strict=True)])
    pace_s = np.diff(record.time_s)[inside - 1]
    edges = np.concatenate([[0], np.cumsum(lengths - 1)[:-1]])
    low_s, high_s = np.minimum.reduceat(pace_s, edges), np.maximum.reduceat(pace_s, edges)
    # Parquet and workbooks keep some 1e-11 of a stamp; text a millisecond, which is too coarse.
    is_even = high_s - low_s <= 1e-6 * high_s
    spread = float(np.ptp(low_s)) / float(np.median(low_s))
    if is_even.all() and 1e-5 < spread < 0.05:
        what = (
            f"time is laid evenly inside each of {len(starts)} steps, at {low_s.min():.6g} to "
            f"{low_s.max():.6g} s a sample: it was rebuilt, not logged"
        )
        yield given.at(int(starts[0]), "note", what, "trust no time constant near one interval")


def _gaps(interval_s: Intervals) -> Int[np.ndarray, "gaps"]:
    """The intervals far longer than the usual one before and the usual one after them."""
    # Only what is long against the shortest in a hundred is worth a look at its neighbors.
    likely = np.flatnonzero(interval_s > _GAP * np.quantile(interval_s, 0.01))
    padded = np.concatenate([np.full(_BESIDE, np.nan), interval_s, np.full(_BESIDE, np.nan)])
    near = likely[:, None] + np.arange(_BESIDE)
    before, after = padded[near], padded[near + _BESIDE + 1]
    # An interval at either end has neighbors on one side only.
    before[likely == 0] = -np.inf
    after[likely == len(interval_s) - 1] = -np.inf
    usual_s = np.maximum(np.nanmedian(before, axis=1), np.nanmedian(after, axis=1))
    gaps = likely[interval_s[likely] > _GAP * usual_s]
    # Intervals of a length that is common elsewhere are how the tester samples.
    alone, all_s = (np.sort(each) for each in (interval_s[gaps], interval_s))
    counts = (
        np.searchsorted(each, interval_s[gaps] * (1 + _ALIKE), "right")
        - np.searchsorted(each, interval_s[gaps] * (1 - _ALIKE))
        for each in (alone, all_s)
    )
    among_gaps, among_all = counts
    return gaps[among_gaps > _FEW_ALIKE * among_all]


_COARSE_V, _COARSE_SHARE = 0.9e-3, 5e-3
_TEMPERATURE_DEGC, ZERO_K = (-60.0, 120.0), 273.15
# A record over more than so many degrees, but for some of its samples, is of no one temperature.
_WIDE_DEGC, _ENDS = 15.0, (0.05, 0.95)


def find_resolution(given: CheckInput) -> Iterator[Finding]:
    """Readings so coarse that they show in the results."""
    magnitude_a = np.abs(given.record.current_a)
    loaded_a = float(np.median(magnitude_a[magnitude_a > 0.05 * given.samples.peak_a]))
    share = given.resolution_a / loaded_a
    if given.resolution_v < _COARSE_V and share < _COARSE_SHARE:
        return
    what = (
        f"coarse readings: voltage in steps of {1e3 * given.resolution_v:.2g} mV, current in steps "
        f"of {1e3 * given.resolution_a:.2g} mA ({100 * share:.2g} % of the usual load)"
    )
    yield Finding("note", what, "no fit can be better than its readings")


def find_temperature(given: CheckInput) -> Iterator[Finding]:
    """Temperatures that no cell has, or of which no one is the record's."""
    temperature = given.record.temperature_degc
    if temperature is None:
        return
    low, high = _TEMPERATURE_DEGC
    outside = (temperature < low) | (temperature > high)
    if outside.any():
        what = (
            f"a temperature of {temperature[np.argmax(outside)]:.4g} degC "
            f"({int(outside.sum())} samples outside {low:g} to {high:g} degC)"
        )
        remedy = "check the sensor, or delete the column"
        if low < temperature.min() - ZERO_K and temperature.max() - ZERO_K < high:
            remedy = "it looks like kelvin: rename the column, as 'Temperature / K'"
        yield given.at(outside, "warning", what, remedy)
        return
    low, high = np.quantile(temperature, _ENDS)
    if high - low > _WIDE_DEGC:
        what = f"the temperature goes from {low:.3g} to {high:.3g} degC, and a circuit holds at one"
        yield Finding("warning", what, "give a part of one temperature (`start_time`, `score_to`)")
