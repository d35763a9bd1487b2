"""Steps of the current and long rests, and what steps between steady levels show of R0.

A second after a step, the voltage has moved by R0 and by what the pairs have answered since, so
that no R0 is above that. Least squares over a record of long loads and rests do not know it: its
few samples next to steps weigh nothing, and R0 takes up what pairs that are slower leave. A load
that steps all the time tells R0 by its samples.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import stdtrit

from ..cell.soc_axis import is_above
from ..cell.tables import hats
from ..records.record import is_long
from ..records.samples import STEADY_SHARE, STEP_SHARE
from .prepared import PreparedRecord

# On whichever side of its sample a current flows, and however little late the voltage is, all of R0
# is in the answer after so long, and two samples at least. Fewer steps show nothing.
AFTER_S, FEWEST_STEPS = 1.0, 3
# Steps that are rarer among samples than this weigh nothing.
RARE = 1 / 300
# Where a mean ends that steps show with their standard error.
_CONFIDENCE = 0.975
# Nodes between those that steps are near go straight on from them, by such a share of the rest.
_BENDS = 1e-6


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
    later = max(2, math.ceil(AFTER_S / prepared.median_interval_s))
    moves = np.append(0, np.cumsum(moved_a >= STEADY_SHARE * peak_a))
    before = np.flatnonzero(is_step(prepared)) - 1
    before = before[(before > 0) & (before + later < len(moves))]
    before = before[moves[before + later] - moves[before - 1] == 1]
    before = before[prepared.scored[before] & prepared.scored[before + later]]
    return before, before + later


def reach_of(left: Float[np.ndarray, "steps"], freedom: int) -> float:
    """Half the interval of one step's answer, by what a mean leaves of all. It is a robust one:
    steps of an empty cell scatter far more than all others."""
    spread = 1.4826 * float(np.median(np.abs(left))) * math.sqrt(len(left) / freedom)
    return float(stdtrit(freedom, _CONFIDENCE)) * spread


def shown_r0_ohm(
    records: Sequence[PreparedRecord], nodes: Float[np.ndarray, "nodes"]
) -> tuple[Float[np.ndarray, "nodes"], Float[np.ndarray, "nodes"]]:
    """What the steps of all records show of R0 at every node from 10 % SOC on, and half its
    interval by their scatter; this is infinite where they are too few, and wherever some record has
    many."""
    answers, nothing = [], (np.zeros(len(nodes)), np.full(len(nodes), np.inf))
    for prepared in records:
        before, after = steps_of(prepared)
        if np.count_nonzero(is_step(prepared)) > RARE * len(prepared.soc):
            return nothing
        series = prepared.current_a, -prepared.voltage_v
        answers.append([prepared.soc[before], *(own[after] - own[before] for own in series)])
    soc, step_a, fall_v = np.hstack(answers)
    shares = hats(soc, nodes)
    is_shown = is_above(nodes) & (shares.sum(axis=0) >= FEWEST_STEPS)
    freedom = len(soc) - int(np.count_nonzero(is_shown))
    if not np.any(is_shown) or freedom < FEWEST_STEPS:
        return nothing
    bends = math.sqrt(_BENDS) * np.linalg.norm(step_a) * np.diff(np.eye(len(nodes)), 2, axis=0)
    rows = np.vstack([step_a[:, None] * shares, bends])
    shown_ohm = np.linalg.lstsq(rows, np.pad(fall_v, (0, len(bends))))[0]
    reach_v = reach_of(fall_v - rows[: len(soc)] @ shown_ohm, freedom)
    reach_ohm = reach_v * np.sqrt(np.diag(np.linalg.pinv(rows.T @ rows)))
    return shown_ohm, np.where(is_shown, reach_ohm, np.inf)
