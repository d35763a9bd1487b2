"""Where a record starts: at full, or where another file of the same cell ends."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..model.inputs import prepare_record
from ..model.window import Window
from .looking import Seen
from .ocv import OcvChoice

# A rested cell so near full is full: the last digits of a voltage there tell of the rest before.
_FULL = 0.005
# To so many digits a capacity and a state of charge are known.
DIGITS = 4
# A file goes on from another where its counters agree to this share of the capacity, so soon after.
_SAME_COUNT, _PAUSE_S = 1e-3, 3600.0


def started(
    files: Sequence[Seen], seen: Seen, window: Window, choice: OcvChoice
) -> tuple[Window, str | None]:
    """The window with its start at full where it rests there, or where another of the files ends
    that it goes on from, with that file's name. Raises `InputError` if neither fits."""
    capacity_ah = record_capacity_ah(seen, window, choice)
    own = replace(window, capacity_ah=capacity_ah)
    try:
        prepared = prepare_record(seen.record, choice.cell, "so-rc", own)
    except InputError:
        before = next((each for each in files if _goes_on(each, seen, choice)), None)
        soc = None if before is None else _final_soc(before, choice)
        if before is None or soc is None or window != Window():
            raise
        prepare_record(seen.record, choice.cell, "so-rc", replace(own, initial_soc=soc))
        return replace(window, initial_soc=soc), before.name
    if window.initial_soc is None and prepared.start.soc >= 1 - _FULL:
        return replace(window, initial_soc=1.0), None
    return window, None


def _goes_on(before: Seen, seen: Seen, choice: OcvChoice) -> bool:
    """Whether a file's clock and counters go on where those of another end."""
    if before.traits is None or seen.traits is None or before is seen:
        return False
    first, second = before.record, seen.record
    if first.charge_ah is None or second.charge_ah is None or not second.charge_ah[0]:
        return False
    apart_ah = abs(float(second.charge_ah[0] - first.charge_ah[-1]))
    apart_s = float(second.time_s[0] - first.time_s[-1])
    return apart_ah <= _SAME_COUNT * choice.cell.capacity_ah and 0 <= apart_s <= _PAUSE_S


def _final_soc(seen: Seen, choice: OcvChoice) -> float | None:
    """The state of charge at the end of a file, where it shows that anywhere."""
    try:
        prepared = prepare_record(seen.record, choice.cell, "so-rc")
    except InputError:
        return None
    return float(f"{prepared.soc[-1]:.{DIGITS}g}")


def record_capacity_ah(seen: Seen, window: Window, choice: OcvChoice) -> float | None:
    """What the record takes out of the full cell, where that is more than the OCV test tells."""
    if window.initial_soc != 1.0:
        return None
    discharged_ah = seen.record.discharged_ah
    first = 0
    if window.start_after_step is not None and seen.record.step is not None:
        first = int(np.flatnonzero(seen.record.step == window.start_after_step)[-1])
    elif window.start_time_s is not None:
        first = int(np.searchsorted(seen.record.time_s, window.start_time_s))
    taken_ah = float(discharged_ah[first:].max() - discharged_ah[first])
    return float(f"{taken_ah:.{DIGITS}g}") if taken_ah > choice.cell.capacity_ah else None
