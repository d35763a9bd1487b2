"""Pulse tests (HPPC): the pulses of a record, each out of a rest, and their resistances."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from .records import Record
from .records.record import equal_runs
from .records.samples import STEADY_SHARE, voltage_noise_v

if TYPE_CHECKING:
    from .model.prepared import PreparedRecord

# Times in s at which a pulse's resistance is usually reported: at once, and as in USABC (1996), the
# FreedomCAR manuals and ISO 12405-4 (2018).
STANDARD_S = (0.0, 2.0, 10.0, 18.0, 30.0)
# In a record with pulses of up to this length, a longer load moves the cell to another SOC. Without
# them it is itself a pulse, as in a GITT, up to this share of the charge of the record. A rest of
# at least the last length settles the cell before pulses.
LONGEST_S, MOST_SHARE, SETTLED_S = 120.0, 0.25, 300.0
# In a pulse test, pulses follow at least this many long rests.
FEWEST_LEVELS = 3
# Pulses below this share of the largest discharge do not belong to a test.
SMALL_SHARE = 0.05
FEWEST_SAMPLES = 3
# Neighbors that differ by more than this share belong to two loads, unless the first is a ramp.
STEP_SHARE, RAMP_S = 0.2, 1.0
# A tester that has reached a limit reduces the current by more than this share.
HELD_SHARE = 0.05
LEVEL_QUANTILE = 0.9
# Largest distance of a sample from a time for the voltage there to be known, in s and as a share,
# and the latest first sample.
NEAR_S, NEAR_SHARE, AT_ONCE_S = 0.5, 0.2, 1.0
# The second sample of a pulse adds at most this multiple of what the third adds, apart from this
# share of the total, this voltage and this multiple of the noise: if it adds more, the first was
# taken during the step.
LASTING, CAUGHT_SHARE, CAUGHT_V, CAUGHT_NOISE = 2.0, 0.03, 1e-3, 8.0
# A first sample that comes sooner after the rest, as a share of the next interval, shows R0 alone,
# and the addition of the second is due to fast pairs.
SOON = 0.5
# Currents within this share of each other are one rate.
SAME_RATE = 0.1
Samples = Float[np.ndarray, "samples"]


@dataclass(frozen=True)
class Pulse:
    """One pulse out of a rest.

    `soc` is the state of charge where it begins, `row` the source row of its first sample,
    `current_a` its level (discharge positive), `rest_s` the rest before it. `is_limited` is True if
    the tester reached a limit and reduced the current. `resistance_ohm` is the change of voltage
    over the change of current after each of `STANDARD_S`, None if the pulse was over or not
    sampled; the first is that of the first sample under load, `delay_s` after the step, None if the
    voltage there contains only part of the step, and a pulse's last sample is used for up to 0.5 s
    after it. As in the standards, it includes the change of the OCV due to the charge of the pulse.
    """

    record: str
    row: int
    soc: float
    current_a: float
    duration_s: float
    rest_s: float
    is_limited: bool
    temperature_degc: float | None
    delay_s: float
    resistance_ohm: tuple[float | None, ...]


class _Load(NamedTuple):
    """Samples `first` to `last` under one current, or at rest (`way` 0)."""

    way: int
    first: int
    last: int
    begin_s: float
    end_s: float

    @property
    def duration_s(self) -> float:
        return self.end_s - self.begin_s


def find_pulses(record: Record, soc: Samples, threshold_a: float) -> tuple[Pulse, ...]:
    """Every pulse of a record, in order of time, whatever its direction and rate.

    A pulse is a load out of a rest, with only pulses and rests since a rest of at least 5 min; the
    cell rests below `threshold_a`. It takes up to 2 min (HPPC), or in a record with fewer than
    three such pulses moves up to a quarter of its charge (GITT). `soc` is that of every sample.

    >>> from barnax import bundled_file, read_record
    >>> record = read_record(bundled_file("hppc_25degC"))
    >>> pulses = find_pulses(record, 1 - record.discharged_ah / 2.0, threshold_a=0.02)
    >>> [round(pulse.current_a, 1) for pulse in pulses[-4:]]
    [2.0, -1.5, 4.0, -3.0]
    """
    step_a = np.abs(np.diff(record.current_a))
    is_quiet = step_a < STEADY_SHARE * np.abs(record.current_a).max()
    noise_v = voltage_noise_v(np.diff(record.voltage_v)[is_quiet])
    loads, discharged_ah = tuple(_loads(record, threshold_a)), record.discharged_ah
    may_count = [load.duration_s <= LONGEST_S for load in loads]
    pairs = list(_out_of_rest(loads, may_count))
    if len(pairs) < FEWEST_LEVELS:
        for number, (_, first, last, *_) in enumerate(loads):
            passed_ah = abs(discharged_ah[last] - discharged_ah[first])
            may_count[number] |= bool(passed_ah <= MOST_SHARE * record.span_ah)
        pairs = list(_out_of_rest(loads, may_count))
    return tuple(_pulse(record, soc, load, rest, noise_v) for rest, load in pairs)


def _out_of_rest(
    loads: Sequence[_Load], may_count: Sequence[bool]
) -> Iterator[tuple[_Load, _Load]]:
    """Each pulse among the loads that may count as one, with the rest before it."""
    rest: _Load | None = None
    is_settled = False
    for load, is_pulse in zip(loads, may_count, strict=True):
        if load.way == 0:
            rest, is_settled = load, is_settled or load.duration_s >= SETTLED_S
            continue
        is_settled &= rest is not None and is_pulse and load.last - load.first + 1 >= FEWEST_SAMPLES
        if rest is not None and is_settled:
            yield rest, load
        rest = None


def _loads(record: Record, threshold_a: float) -> Iterator[_Load]:
    """The record as loads and rests; a short ramp of the current belongs to the load after it."""
    level_a = np.where(record.segments(threshold_a).is_rested, 0.0, record.current_a)
    way = np.sign(level_a).astype(int)
    largest_a = np.maximum(np.abs(level_a[1:]), np.abs(level_a[:-1]))
    is_cut = (np.diff(way) != 0) | (np.abs(np.diff(level_a)) > STEP_SHARE * largest_a)
    firsts, lasts = equal_runs(np.append(0, np.cumsum(is_cut)))
    begins, ends = (record.time_s[at] for at in record.flowing_between(firsts, lasts))
    columns = (way[firsts], firsts, lasts, begins, ends)
    ramp: _Load | None = None
    for load in map(_Load, *(column.tolist() for column in columns)):
        if ramp is not None and ramp.way == load.way:
            load = load._replace(first=ramp.first, begin_s=ramp.begin_s)
        elif ramp is not None:
            yield ramp
        ramp = load if load.way and load.duration_s < RAMP_S else None
        if ramp is None:
            yield load
    if ramp is not None:
        yield ramp


def _pulse(record: Record, soc: Samples, load: _Load, rest: _Load, noise_v: float) -> Pulse:
    span = slice(load.first, load.last + 1)
    since_s = record.time_s[span] - load.begin_s
    if record.hold.value == "centered":
        # The load of a mean begins in the middle of the interval before it.
        since_s = since_s + record.interval_s[load.first - 1] / 2
    change_a = record.current_a[span] - record.current_a[rest.last]
    drop_v = record.voltage_v[rest.last] - record.voltage_v[span]
    # A level near the highest, because a limit may reduce most of a pulse.
    reached_a = load.way * np.quantile(np.abs(change_a), LEVEL_QUANTILE, method="nearest")
    is_held = np.abs(change_a / reached_a - 1) <= HELD_SHARE
    start = int(np.argmax(is_held))
    lost = np.flatnonzero(~is_held[start:])
    stop = start + int(lost[0]) if len(lost) else len(is_held)
    held = slice(start, stop)
    before_s = record.time_s[load.first + start - 1] - load.begin_s
    times_s = np.append(before_s, since_s[held][:3])
    is_whole = since_s[start] <= AT_ONCE_S and not _is_in_edge(
        np.diff(times_s), np.abs(drop_v[held][:3]), noise_v
    )
    ratio_ohm = drop_v[held] / change_a[held]
    at_once_ohm = float(ratio_ohm[0]) if is_whole else None
    degc = record.temperature_degc
    return Pulse(
        record=record.name,
        row=int(record.row[load.first]),
        soc=float(soc[rest.last]),
        current_a=float(np.median(change_a[held])),
        duration_s=load.duration_s,
        rest_s=rest.duration_s,
        is_limited=stop < len(is_held),
        temperature_degc=None if degc is None else float(degc[rest.last]),
        delay_s=float(since_s[start]),
        resistance_ohm=(at_once_ohm, *_lasting(since_s[held], ratio_ohm)),
    )


def _lasting(since_s: Samples, ratio_ohm: Samples) -> Iterator[float | None]:
    """The ratio at `STANDARD_S` except the first, linear between samples that are close enough."""
    for time_s in STANDARD_S[1:]:
        is_over = since_s[-1] < time_s - NEAR_S
        nearest_s = float(np.abs(since_s - time_s).min())
        is_sampled = not is_over and nearest_s <= max(NEAR_S, NEAR_SHARE * time_s)
        yield float(np.interp(time_s, since_s, ratio_ohm)) if is_sampled else None


def _is_in_edge(
    interval_s: Float[np.ndarray, "intervals"], drop_v: Samples, noise_v: float
) -> bool:
    """True if the first voltage of a pulse contains only part of its step.

    The intervals are those before each of its first three samples.
    """
    is_even = len(interval_s) == 3 and abs(interval_s[2] / interval_s[1] - 1) <= NEAR_SHARE
    if not is_even or interval_s[0] < SOON * interval_s[1]:
        return False
    second_v, third_v = np.diff(drop_v)
    least_v = max(CAUGHT_SHARE * drop_v[1], CAUGHT_V, CAUGHT_NOISE * noise_v)
    return bool(second_v - LASTING * max(third_v, 0.0) > least_v)


def first_pulse(record: Record) -> Pulse | None:
    """The first pulse of a record, None if there is none; its SOC is not yet set."""
    if record.span_ah == 0:
        return None
    rest_a = record.rest_current_a(record.span_ah)
    return next(iter(find_pulses(record, np.ones(record.samples), rest_a)), None)


def pulses_of(prepared: "PreparedRecord") -> tuple[Pulse, ...]:
    """The pulses of a prepared record; none unless it is a pulse test.

    A pulse test has pulses after at least three of its long rests, and not small ones, which a
    drive cycle has by chance.
    """
    # The preparation of records loads JAX, which pulses do not need.
    from .model.prepared import soc_along

    record, start = prepared.record, prepared.start.soc
    soc = soc_along(record, prepared.capacity_ah, prepared.first, start)
    pulses = find_pulses(record, soc, prepared.rest_current_a)
    given_degc = prepared.window.temperature_degc
    if given_degc is not None:
        pulses = tuple(replace(pulse, temperature_degc=given_degc) for pulse in pulses)
    least_a = SMALL_SHARE * float(record.current_a[prepared.first :].max())
    settled = [p for p in pulses if p.rest_s >= SETTLED_S and abs(p.current_a) >= least_a]
    return pulses if len(settled) >= FEWEST_LEVELS else ()


def pulse_samples(record: Record, pulse: Pulse) -> slice:
    """The samples of a pulse in its record, from the last at rest on."""
    first = int(np.searchsorted(record.row, pulse.row))
    since_s = record.time_s[first:] - record.time_s[first - 1]
    return slice(first - 1, first + int(np.searchsorted(since_s, pulse.duration_s, "right")))


def levels(pulses: Sequence[Pulse]) -> list[tuple[Pulse, ...]]:
    """The pulses by direction and rate, discharges first and lower rates before higher ones.

    >>> levels([])
    []
    """
    rates: list[list[Pulse]] = []
    for pulse in sorted(pulses, key=lambda pulse: (pulse.current_a < 0, abs(pulse.current_a))):
        reached_a = rates[-1][-1].current_a if rates else 0.0
        if abs(pulse.current_a - reached_a) > SAME_RATE * abs(pulse.current_a):
            rates.append([])
        rates[-1].append(pulse)
    return [tuple(sorted(level, key=lambda pulse: -pulse.soc)) for level in rates]


def rate_label(level: Sequence[Pulse], capacity_ah: float) -> str:
    """The direction and rate of pulses, such as "discharge at 1C (2 A)"."""
    current_a = float(np.median([pulse.current_a for pulse in level]))
    way = "discharge" if current_a > 0 else "charge"
    return f"{way} at {abs(current_a) / capacity_ah:.2g}C ({abs(current_a):.3g} A)"
