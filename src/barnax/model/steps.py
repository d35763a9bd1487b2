"""Steps of the current and long rests, and the answers of steps between steady levels.

A second after a step, the voltage has moved by R0 and by what the pairs have answered since, so
that no R0 is above that. Least squares over a record of long loads and rests do not know it: its
few samples next to steps weigh nothing, and R0 takes up what pairs that are slower leave.
"""

import numpy as np
from jaxtyping import Bool, Int

from ..records.record import STEP_SHARE, is_long
from ..records.samples import STEADY_SHARE
from .prepared import PreparedRecord

# On whichever side of its sample a current flows, and however little late the voltage is, all of R0
# is in the answer after so long (a second, but for a clock's jitter), and two samples at least.
# Fewer steps show nothing.
AFTER_S, FEWEST_STEPS = 0.99, 3


def is_step(prepared: PreparedRecord) -> Bool[np.ndarray, "simulated"]:
    """True at the samples that the current steps to, whatever is before and after."""
    moved_a = np.abs(np.diff(prepared.current_a, prepend=prepared.current_a[:1]))
    return moved_a > STEP_SHARE * np.abs(prepared.current_a).max()


def is_at_ocv(prepared: PreparedRecord) -> Bool[np.ndarray, "simulated"]:
    """True at the ends of rests so long that the voltage is the OCV."""
    rests = prepared.record.segments(prepared.rest_current_a).rests
    ends = [rest.last for rest in rests if is_long(rest.duration_s)]
    return np.isin(np.arange(prepared.span.start, prepared.span.stop), ends)


def steps_of(
    prepared: PreparedRecord,
) -> tuple[Int[np.ndarray, "steps"], Int[np.ndarray, "steps"]]:
    """The scored samples before the steps of a record, and those at which their answers are read,
    with one move of the current within each."""
    moved_a, peak_a = np.abs(np.diff(prepared.current_a)), np.abs(prepared.current_a).max()
    time_s, moves = prepared.time_s, np.append(0, np.cumsum(moved_a >= STEADY_SHARE * peak_a))
    before = np.flatnonzero(is_step(prepared)) - 1
    before = before[before > 0]
    after = np.maximum(before + 2, np.searchsorted(time_s, time_s[before + 1] + AFTER_S))
    is_inside = after < len(moves)
    before, after = before[is_inside], after[is_inside]
    is_single = moves[after] - moves[before - 1] == 1
    is_single &= prepared.scored[before] & prepared.scored[after]
    return before[is_single], after[is_single]
