"""Which OCV sweeps one record holds: those between rests, or slow ones."""

import numpy as np

from ..errors import InputError
from ..records import rests
from ..records.record import Record
from .rest_points import MINIMUM_REST_S, find_rest_sweeps
from .slow_sweep import find_slow_sweeps
from .sweep import WORD, Sweep

# A kind that passes less than this share of what the other passes is conditioning beside a test.
CONDITIONING = 0.5


def find_sweeps(
    record: Record, capacity_ah: float | None, rest_current_a: float | None = None
) -> tuple[list[Sweep], list[str]]:
    """The OCV sweeps of one record, on its own axis of charge, and warnings.

    Current below `rest_current_a` is rest; without it `capacity_ah` says what is, and without
    that the charge that the record spans. A record may hold a pulse-rest test and slow sweeps:
    one kind counts, and a warning names the other. Raises `InputError` where the record is no OCV
    test.
    """
    span_ah = float(np.ptp(record.discharged_ah))
    if span_ah == 0:
        raise InputError(
            f"{record.name} is not an OCV test: no charge passed; give the test that moves the "
            "cell between full and empty"
        )
    threshold_a = rest_current_a
    if threshold_a is None:
        # A capacity given in mAh would turn the whole record into one rest.
        provisional_ah = span_ah if capacity_ah is None else min(capacity_ah, span_ah)
        threshold_a = rests.rest_current_a(record, provisional_ah)
    elif threshold_a > np.abs(record.current_a).max():
        raise InputError(
            f"{record.name}: no current reaches {threshold_a:.4g} A, so all of it is rest: give a "
            "lower --rest-current"
        )
    slow = find_slow_sweeps(record, threshold_a, MINIMUM_REST_S)
    if not slow:
        return find_rest_sweeps(record, threshold_a), []
    try:
        rested = find_rest_sweeps(record, threshold_a)
    except InputError:
        return slow, []
    used, ignored = (rested, slow) if _is_test(rested, slow) else (slow, rested)
    return used, [_ignored_warning(used[0], sweep) for sweep in ignored]


def _is_test(rested: list[Sweep], slow: list[Sweep]) -> bool:
    """Whether the sweeps between rests are the test, and the slow ones something beside it.

    The kind that measures both directions is; where both kinds do, rests, which hold no
    overpotential.
    """
    rested_ah, slow_ah = (max(sweep.passed_ah for sweep in kind) for kind in (rested, slow))
    if min(rested_ah, slow_ah) < CONDITIONING * max(rested_ah, slow_ah):
        return rested_ah > slow_ah
    return len(rested) >= len({sweep.direction for sweep in slow})


def _ignored_warning(used: Sweep, ignored: Sweep) -> str:
    words = {"rests": "rests between pulses", "slow": "a slow sweep"}
    first, last = ignored.points[0].row, ignored.points[-1].row
    return (
        f"{ignored.source} holds two OCV tests: the {WORD[ignored.direction]} by "
        f"{words[ignored.kind]} in rows {first} to {last}, {ignored.passed_ah:.4g} Ah, is ignored "
        f"beside {words[used.kind]}; cut the record to use it instead"
    )
