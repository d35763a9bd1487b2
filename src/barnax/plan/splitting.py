"""A file that holds a whole schedule, cut into its tests: by full charges and by OCV sweeps."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..records import Record, rest_current_a
from .looking import SERVING, Seen, look_at_source

# A charge without a rest of so long that passes this share of what the record spans ends a test.
_PAUSE_S, _BULK = 300.0, 0.3
# A slow one is a test itself.
_SLOW_S = 9 * 3600.0
# A charge ends full where its voltage is so near the record's highest and its current has tapered.
_FULL_V, _TAPERED = 0.02, 0.5
# What is shorter is no test.
_FEWEST, _SHORTEST_S = 50, 600.0


def split(seen: Seen) -> list[Seen]:
    """The tests of a file, each as a part of it; the file itself where it holds one at most."""
    if seen.traits is None or seen.source is None:
        return [seen]
    try:
        record = seen.record
    except InputError:
        return [seen]
    parts = [_part(seen, record, *span) for span in _spans(seen, record)]
    if sum(part.kind(None) in SERVING for part in parts) < 2:
        return [seen]
    return [_numbered(part, f"{seen.name}#{number}") for number, part in enumerate(parts, 1)]


def _numbered(part: Seen, name: str) -> Seen:
    assert part.source is not None, "a part was read"
    return replace(part, name=name, source=replace(part.source, name=name))


def _part(seen: Seen, record: Record, first: int, last: int, is_full: bool) -> Seen:
    span_s = float(record.time_s[first]), float(record.time_s[last])
    assert seen.source is not None
    source = replace(seen.source, span_s=span_s)
    return replace(look_at_source(seen.path, source), starts_full=is_full)


def _spans(seen: Seen, record: Record) -> Iterator[tuple[int, int, bool]]:
    """First and last sample of each test, and whether it begins with the cell charged to full."""
    for first, last, is_full in _between_charges(record):
        if not _is_long(record, first, last):
            continue
        part = _part(seen, record, first, last, is_full)
        sweeps = (
            [each for each in part.traits.sweeps if each.kind == "rests"] if part.traits else []
        )
        if not sweeps:
            yield first, last, is_full
            continue
        rows = [point.row for sweep in sweeps for point in sweep.points]
        begin, end = np.searchsorted(record.row, [min(rows), max(rows)]).tolist()
        # A sweep begins where its first rest ends, and may end at a cut-off without a rest.
        if _is_long(record, end, last) and _serves(seen, record, end, last):
            yield first, end, is_full
            yield end, last, False
        elif _is_long(record, first, begin) and _serves(seen, record, first, begin):
            yield first, begin, is_full
            yield begin, last, False
        else:
            yield first, last, is_full


def _serves(seen: Seen, record: Record, first: int, last: int) -> bool:
    return _part(seen, record, first, last, False).kind(None) in SERVING


def _between_charges(record: Record) -> Iterator[tuple[int, int, bool]]:
    """What lies between the ends of the record's long charges, and whether full comes before."""
    discharged_ah = record.discharged_ah
    span_ah = float(np.ptp(discharged_ah))
    rest_a = rest_current_a(record, span_ah)
    charging = np.flatnonzero(record.current_a < -rest_a)
    discharging = np.flatnonzero(record.current_a > rest_a)
    begin, is_full = 0, False
    is_cut = np.diff(record.time_s[charging]) > _PAUSE_S
    is_cut |= np.diff(np.searchsorted(discharging, charging)) != 0
    for run in np.split(charging, np.flatnonzero(is_cut) + 1):
        if not len(run):
            continue
        first, last = int(run[0]), int(run[-1])
        if discharged_ah[first] - discharged_ah[last] < _BULK * span_ah:
            continue
        is_slow = record.time_s[last] - record.time_s[first] > _SLOW_S
        yield begin, (last if is_slow else max(first - 1, begin)), is_full
        current_a = record.current_a[run]
        is_near = record.voltage_v[last] > record.voltage_v.max() - _FULL_V
        is_full = bool(is_near and current_a[-1] > _TAPERED * current_a.min())
        begin = min(last + 1, record.samples - 1)
    yield begin, record.samples - 1, is_full


def _is_long(record: Record, first: int, last: int) -> bool:
    is_loaded = np.any(record.current_a[first : last + 1])
    length_s = record.time_s[last] - record.time_s[first]
    return bool(is_loaded and last - first >= _FEWEST and length_s >= _SHORTEST_S)
