"""Whether time is in the unit that its name says, or in minutes, hours or milliseconds.

Three things tell: the tester's own ampere-hours against the integrated current, the sampling
interval, for a second is 1/60 of a minute, and the bulk time.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..records.checks import throughput_ratio
from ..records.columns import Column
from ..records.samples import Samples
from .bulk_time import bulk_time_s
from .finding import Finding, Severity, found_at

# A unit, its seconds, and the bulk time that would be too short for any cell if they were seconds.
# Too long is what no whole record comes near; on a plateau, where the voltage stands, it may.
_LONGER = (("hours", "h", 3600.0, 0.5), ("minutes", "min", 60.0, 40.0))
_SLOW_S = 1e4
# The voltage must have moved for that to mean anything, and through more than the steep end.
_TRAVEL_V, _STEEP_BELOW_V = 0.3, 3.0
# Whole seconds in longer units, and how close the median interval comes to them. Past a fifth of a
# second the numbers are as good in seconds.
_SECONDS, _PATTERN, _SHORT_S = (1.0, 2.0, 5.0, 10.0, 30.0), 0.03, 0.2
_LONG_S = 500.0
_RATIO = 0.15


def examine_time_unit(
    samples: Samples, columns: Mapping[str, Column]
) -> tuple[Samples, list[Finding]]:
    """The samples with time in s, and whether its column's name was wrong."""
    suspicion = _too_fast(samples) or _too_slow(samples, columns["time"].unit.factor)
    if suspicion is None:
        return samples, []
    words, symbol, factor, severity, reason = suspicion
    what = f"'{columns['time'].header}' looks like {words}: {reason}"
    remedy = f"rename the column to 'Test Time / {symbol}'"
    mended = replace(samples, time_s=samples.time_s * factor)
    return mended, [found_at(samples, 0, severity, what, remedy)]


_Suspicion = tuple[str, str, float, Severity, str]


def _too_fast(samples: Samples) -> _Suspicion | None:
    interval_s = float(np.median(np.diff(samples.time_s)))
    bulk_s, travel_v = bulk_time_s(samples)
    ratio = throughput_ratio(samples)
    is_steep = float(np.median(samples.voltage_v)) < _STEEP_BELOW_V or travel_v < 2 * _TRAVEL_V
    for words, symbol, factor, shortest_s in _LONGER:
        if ratio is not None:
            if abs(ratio * factor - 1) < _RATIO:
                reason = f"the current integrates to 1/{1 / ratio:.4g} of the tester's Ah"
                return words, symbol, factor, "error", reason
            continue
        is_pattern = interval_s < _SHORT_S and any(
            abs(interval_s * factor / second - 1) < _PATTERN for second in _SECONDS
        )
        is_fast = 0 < bulk_s < shortest_s and travel_v >= _TRAVEL_V
        pattern = f"samples lie {interval_s:.5g} apart, {interval_s * factor:.3g} s if in {words}"
        if is_fast and (is_pattern or symbol == "h"):
            return words, symbol, factor, "error", f"{pattern}; {_bulk(bulk_s)}"
        if is_pattern and bulk_s == 0:
            return words, symbol, factor, "warning", pattern
        if is_fast and not is_steep:
            return words, symbol, factor, "warning", _bulk(bulk_s)
    return None


def _too_slow(samples: Samples, stated_s: float) -> _Suspicion | None:
    """`stated_s` is how long a unit of time is by the column's name."""
    words, symbol, factor = ("milliseconds", "ms", 1e-3)
    if stated_s != 1:
        words, symbol, factor = ("seconds", "s", 1 / stated_s)
    interval_s = float(np.median(np.diff(samples.time_s)))
    bulk_s, travel_v = bulk_time_s(samples)
    ratio = throughput_ratio(samples)
    if ratio is not None and abs(ratio * factor - 1) >= _RATIO:
        return None
    reason = f"samples lie {interval_s:.5g} s apart"
    # A thousandfold charge alone may be milliamperes, which leave the bulk time as it is.
    if bulk_s > _SLOW_S and travel_v >= _TRAVEL_V and interval_s >= _LONG_S / 10:
        return words, symbol, factor, "error", f"{reason}; {_bulk(bulk_s)}"
    if bulk_s == 0 and interval_s >= _LONG_S:
        return words, symbol, factor, "warning", reason
    return None


def _bulk(bulk_s: float) -> str:
    return f"in seconds the cell's resistance could move its charge in {bulk_s:.3g} s"
