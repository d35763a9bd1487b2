"""Rests in which the current is not zero."""

from collections.abc import Iterator

import numpy as np

from ..records.stretches import stretches
from .case import Case
from .finding import Finding, counted

# A rest is looked for where the current is below this share of its peak for a minute.
_SMALL_SHARE, _SHORTEST_S, _FEWEST = 0.05, 60.0, 5
# In the second half of a rest the voltage hardly moves, as it does in a slow sweep, and the current
# is steady, as it is not in a taper.
_SETTLED_V = 0.01
# An offset's ampere-hours over the record, as shares of the capacity.
_DRIFT, _NOTED_DRIFT = 0.01, 1e-3
_SPREAD = 0.3


def find_rests(case: Case) -> Iterator[Finding]:
    """A current that is not zero while the cell rests, or so noisy that it hides the rests."""
    current_a = case.record.current_a
    rests = _rests(case)
    if rests:
        yield from _offset(case, rests)
    if case.rest_current_a > 1.01 * case.scale_ah / 100:
        first = int(np.argmax(case.is_rested))
        yield case.at(
            first,
            "note",
            f"the current is noisy at rest: below {1e3 * case.rest_current_a:.3g} mA counts as "
            "rest, C/100 does not",
            f"--rest-current {case.rest_current_a:.2g} says so, or another value",
        )
    is_zero = current_a == 0
    is_minus = is_zero & np.signbit(case.samples.current_a)
    # Rounded noise gives some; a tester that turns the sign of its readings gives nearly all.
    if is_minus.sum() > max(_FEWEST, 0.9 * is_zero.sum()):
        what = (
            f"the resting current is written -0 ({counted(int(is_minus.sum()), 'time')}), read as 0"
        )
        yield case.at(int(np.argmax(is_minus)), "note", what)


def _rests(case: Case) -> list[tuple[int, float, float]]:
    """First sample, median current in A and length in s of each stretch that looks like a rest."""
    record = case.record
    first, last = stretches(np.abs(record.current_a) < _SMALL_SHARE * case.peak_a)
    length_s = record.time_s[last] - record.time_s[first]
    is_long = (length_s >= _SHORTEST_S) & (last - first >= _FEWEST)
    found = []
    for a, b, length in zip(first[is_long], last[is_long], length_s[is_long], strict=True):
        half = slice((a + b) // 2, b + 1)
        current_a, voltage_v = record.current_a[half], record.voltage_v[half]
        middle_a = float(np.median(current_a))
        low_a, high_a = np.quantile(current_a, [0.1, 0.9])
        is_steady = high_a - low_a <= _SPREAD * abs(middle_a) + 4 * case.resolution_a
        if is_steady and np.ptp(voltage_v) <= _SETTLED_V + 4 * case.noise_v:
            found.append((int(a), middle_a, float(length)))
    return found


def _offset(case: Case, rests: list[tuple[int, float, float]]) -> Iterator[Finding]:
    """An offset, if no rest is without: what reads zero somewhere has none."""
    values_a = np.array([value for _, value, _ in rests])
    lengths_s = np.array([length for *_, length in rests])
    offset_a = float(values_a[np.argmin(np.abs(values_a))])
    if abs(offset_a) <= 2 * case.resolution_a and abs(offset_a) < case.scale_ah / 100:
        return
    is_alike = np.abs(values_a - offset_a) <= _SPREAD * abs(offset_a) + 2 * case.resolution_a
    if lengths_s[is_alike].sum() < 0.5 * lengths_s.sum():
        return
    record = case.record
    drift_ah = abs(offset_a) * float(record.time_s[-1] - record.time_s[0]) / 3600
    first = rests[int(np.argmax(is_alike))][0]
    value = -1e3 * offset_a if record.sign.value == "charge-positive" else 1e3 * offset_a
    what = (
        f"the current is {value:.3g} mA while the cell rests, "
        f"{drift_ah:.3g} Ah over the record ({counted(len(rests), 'rest')})"
    )
    if abs(offset_a) >= case.scale_ah / 100:
        limit_a = 1.5 * abs(offset_a)
        remedy = f"subtract it from the current, or --rest-current {limit_a:.2g} to see the rests"
        yield case.at(first, "warning", what, remedy)
    elif drift_ah > _DRIFT * case.scale_ah:
        yield case.at(first, "warning", what, "subtract it from the current")
    elif drift_ah > _NOTED_DRIFT * case.scale_ah:
        yield case.at(first, "note", what, "subtract it from the current if it is none")
