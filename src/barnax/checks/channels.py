"""Checks of the channels: a current that changes sign, spikes, stuck and clipped readings."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from ..notices import Notice, Severity
from ..records.dialects import CHARGE, DISCHARGE
from ..records.record import Indices, equal_runs, run_sums
from ..records.samples import Samples
from ..records.sign import step_votes
from .check_input import CheckInput

# How many steps of either kind make a pattern, at an end of the record and within it, and the share
# that has to agree.
_FEWEST, _FEWEST_WITHIN, _AGREEING = 3, 6, 0.9

Votes = Float[np.ndarray, "steps"]


def in_one_sign(samples: Samples) -> Samples:
    """The samples with one sign throughout, and an error if the sign was reversed over some
    rows."""
    at, votes = step_votes(samples)
    if len(votes) < 2 * _FEWEST:
        return samples
    usual = float(np.sign(votes.sum())) or 1.0
    first, last = _most_contrary(votes * usual)
    inside = votes[first : last + 1]
    outside = np.delete(votes, np.s_[first : last + 1])
    ends_within = first > 0, last < len(votes) - 1
    fewest = _FEWEST_WITHIN if all(ends_within) else _FEWEST
    is_turned = inside.mean() * usual < 0 and all(
        len(part) >= fewest and np.abs(part.mean()) >= 2 * _AGREEING - 1
        for part in (inside, outside)
    )
    if not is_turned:
        return samples
    kinds = [CHARGE if part.mean() > 0 else DISCHARGE for part in (outside, inside)]
    begin = int(at[first]) + 1 if ends_within[0] else 0
    end = int(at[last + 1]) + 1 if ends_within[1] else len(samples)
    values = {"inner": kinds[1], "inner_steps": len(inside)}
    values |= {"outer": kinds[0], "outer_steps": len(outside)}
    current_a = samples.current_a.copy()
    current_a[begin:end] *= -1
    where = "begins" if ends_within[0] else "ends"
    if all(ends_within):
        where, values["back_row"] = "within", samples.row[end]
    row = begin if ends_within[0] else end
    return samples.having(current=current_a).telling(row, "sign.turns", where=where, **values)


def _most_contrary(votes: Votes) -> tuple[int, int]:
    """First and last index of the run of votes with the lowest sum (Kadane's algorithm)."""
    before = np.concatenate([[0.0], np.cumsum(votes)])
    drop = before[1:] - np.maximum.accumulate(before)[:-1]
    last = int(np.argmin(drop))
    # Of equal sums the last, or the run would begin with votes that cancel each other.
    first = last - int(np.argmax(before[last::-1]))
    return first, last


_WIDTHS = (1, 2, 3)
# A spike's height, in volts and in noise; how steady the three samples on either side have to be,
# and how much of it the other channel may explain, as shares of the height.
_HEIGHT_V, _HEIGHT_NOISE, _BESIDE = 0.02, 12.0, 3
_STEADY, _EXPLAINED = 0.4, 0.3

Channel = Float[np.ndarray, "samples"]
Flags = Bool[np.ndarray, "samples"]
# Units of the channels in names of values.
_UNITS = {"voltage": "v", "current": "a"}


def find_spikes(given: CheckInput) -> Iterator[Notice]:
    """Voltages that leave their neighbors without a change of current; and currents that do so
    without a response of the voltage."""
    ohmic_v = given.record.current_a * given.samples.resistance_ohm
    both = {
        "voltage": _voltage_spikes(given),
        "current": _spikes(given, ohmic_v, given.record.voltage_v, after=1),
    }
    for channel, spiked in both.items():
        if spiked.any():
            values, unit, at = given.samples.values[channel], _UNITS[channel], int(spiked.argmax())
            spike = {f"spike_{unit}": values[at], f"beside_{unit}": values[at - 1]}
            spike |= {"channel": channel, "samples": spiked.sum()}
            yield given.at(at, "spikes.channel", channel, **spike)


def _voltage_spikes(given: CheckInput) -> Flags:
    """True where the voltage spikes."""
    # A current explains the voltage at that moment and later.
    answer_v = given.record.current_a * given.response_ohm
    return _spikes(given, given.record.source_v, answer_v, after=0)


def _spikes(given: CheckInput, values: Channel, other: Channel, after: int) -> Flags:
    """True where `values` in V leave steady neighbors and return, while `other` is steady up to
    `after` samples later."""
    least = max(_HEIGHT_V, _HEIGHT_NOISE * given.samples.noise_v)
    spiked = np.zeros(len(values), bool)
    for width in _WIDTHS:
        size = 2 * _BESIDE + width
        if len(values) < size:
            break
        # Only a jump can begin one; windows around all samples would be slow.
        starts = np.flatnonzero(np.abs(np.diff(values)) > least) + 1
        starts = starts[(starts >= _BESIDE) & (starts + size - _BESIDE <= len(values))]
        window = starts[:, None] - _BESIDE + np.arange(size)
        around = values[window]
        inside = around[:, _BESIDE : _BESIDE + width]
        beside = np.delete(around, np.s_[_BESIDE : _BESIDE + width], axis=1)
        above = inside.min(axis=1) - beside.max(axis=1)
        below = beside.min(axis=1) - inside.max(axis=1)
        height = np.maximum(above, below)
        meanwhile = other[window[:, _BESIDE - 1 : _BESIDE + width + after]]
        is_spike = (height > least) & (np.ptp(beside, axis=1) < _STEADY * height)
        is_spike &= np.ptp(meanwhile, axis=1) < _EXPLAINED * height
        spiked[window[is_spike, _BESIDE : _BESIDE + width]] = True
    return spiked


# The change of current that is significant if the voltage does not respond, in volts and in steps
# of resolution.
_EXPECTED_V, _EXPECTED_STEPS = 0.01, 10.0
_FEWEST_SAMPLES = 4
# A voltage that jumps this far, in both directions, under a steady current.
_JUMP_V, _JUMP_NOISE, _FEWEST_JUMPS = 5e-3, 8.0, 2


def find_stuck_voltage(given: CheckInput) -> Iterator[Notice]:
    """A voltage with a constant reading while the current changes."""
    if not given.samples.resistance_ohm:
        return
    voltage_v, current_a = given.record.voltage_v, given.record.current_a
    first, last = equal_runs(voltage_v, _FEWEST_SAMPLES + 2)
    # At its ends a run may include samples taken just before and after.
    first, last = first + 1, last - 1
    least_a = max(_EXPECTED_V, _EXPECTED_STEPS * given.resolution_v) / given.samples.resistance_ohm
    swing_a = np.zeros(len(first))
    for run in np.flatnonzero(run_sums(np.abs(given.samples.step_a), first, last - 1) > least_a):
        swing_a[run] = _swing(current_a[first[run] : last[run] + 1])
    is_stuck = swing_a > least_a
    if is_stuck.any():
        expected_v = float(np.max(swing_a)) * given.samples.resistance_ohm
        yield _stuck(given, "voltage", first[is_stuck], last[is_stuck], expected_v)


def find_stuck_current(given: CheckInput) -> Iterator[Notice]:
    """A current with a constant reading while the voltage jumps up and down."""
    first, last = equal_runs(given.record.current_a, _FEWEST_SAMPLES + 1)
    if not len(first):
        return
    step_v = given.samples.step_v.copy()
    # A spike of the voltage is a fault of the voltage.
    spiked = _voltage_spikes(given)
    step_v[spiked[1:] | spiked[:-1]] = 0
    least_v = max(_JUMP_V, _JUMP_NOISE * given.samples.noise_v, 3 * given.resolution_v)
    up, down = (run_sums(way * step_v > least_v, first, last - 1) for way in (1, -1))
    is_stuck = np.minimum(up, down) >= _FEWEST_JUMPS
    if is_stuck.any():
        first, last = first[is_stuck], last[is_stuck]
        jump_v = float(np.abs(step_v[first[0] : last[0]]).max())
        yield _stuck(given, "current", first, last, jump_v)


def _stuck(
    given: CheckInput, channel: str, first: Indices, last: Indices, moved_v: float
) -> Notice:
    """The first run, and how many more there are."""
    values = given.samples.values[channel]
    value = values[first]
    is_end = bool(np.all((value == values.max()) | (value == values.min()))) and value[0] != 0
    worst = int(np.argmax(last - first))
    samples = int(np.sum(last - first + 1))
    rows = given.record.row[given.indices(channel)]
    severity: Severity = "error" if samples > 0.01 * given.record.samples else "warning"
    return given.at(
        int(first[0]),
        "stuck.still",
        channel,
        channel=channel,
        range="end" if is_end else None,
        samples=samples,
        places=len(first),
        first_row=rows[first[worst]],
        last_row=rows[last[worst]],
        moved_v=moved_v,
        **{f"value_{_UNITS[channel]}": value[worst]},
    ).rated(severity)


def _swing(current_a: Channel) -> float:
    """The swing of a current, both up and down, except for single samples: where a tester holds the
    voltage, it goes in one direction and is mere noise in the other."""
    middle_a = np.median([current_a[:-2], current_a[1:-1], current_a[2:]], axis=0)
    fall_a = float((np.maximum.accumulate(middle_a) - middle_a).max())
    return min(fall_a, float((middle_a - np.minimum.accumulate(middle_a)).max()))


# This many equal samples, in this many places, at the largest or the smallest value.
_ALIKE, _FEWEST_AT_LIMIT = 4, 3
# Elsewhere under load hardly any are equal: a tester without noise repeats every value.
_ELSEWHERE, _FEWEST_ELSEWHERE = 0.02, 100
_LOADED = 0.05


def find_clipped_current(given: CheckInput) -> Iterator[Notice]:
    """Currents that read exactly the largest value again and again, while others vary."""
    current_a = given.samples.current_a
    first, last = equal_runs(current_a)
    is_alike = last - first + 1 >= _ALIKE
    in_run = np.repeat(is_alike, last - first + 1)
    is_loaded = np.abs(current_a) > _LOADED * given.samples.peak_a
    # Both ends of the range may be clipped, at different values; but a direction with a single
    # value is a pulse set to it.
    limits_a = [
        limit_a
        for limit_a in (current_a.max(), current_a.min())
        if abs(limit_a) > _LOADED * given.samples.peak_a
        and np.sum(is_loaded & (current_a * limit_a > 0) & (current_a != limit_a))
        >= _FEWEST_ELSEWHERE
    ]
    elsewhere = is_loaded & ~np.isin(current_a, limits_a)
    for limit_a in limits_a:
        at_limit = is_alike & (current_a[first] == limit_a)
        if at_limit.sum() < _FEWEST_AT_LIMIT:
            continue
        if elsewhere.sum() < _FEWEST_ELSEWHERE or in_run[elsewhere].mean() > _ELSEWHERE:
            continue
        counts = {"samples": (last - first + 1)[at_limit].sum(), "places": at_limit.sum()}
        at = int(first[at_limit][0])
        yield given.at(at, "clipped-current.limit", limit_a=limit_a, **counts)
