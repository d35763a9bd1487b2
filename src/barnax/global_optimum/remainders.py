"""Columns between the places that a proof looks at: along one scale each is the parabola through
the ends and the middle of a box, up to a remainder that its third derivative bounds."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from ..cell.tables import hats
from ..model.axes import Axis
from ..model.prepared import BLOCK, PreparedRecord

# In x = log(s / tau) a pair's kernel is exp(x - exp(x)); this is the integral of the absolute
# value of its third derivative, rounded up. The RMS of a response's third derivative in log(tau) is
# at most this times the current's at some time earlier.
THIRD_DERIVATIVE = 1.78302
# Error of the parabola through the ends and the middle of an interval, in (half width)^3 times the
# largest third derivative; and how it can add up errors of the three values.
PARABOLA = 1 / (9 * 3**0.5)
LEBESGUE = 1.25


def beyond_parabola(
    derivatives: Float[np.ndarray, "2 width"], half_width: Float[np.ndarray, "*boxes"] | float
) -> Float[np.ndarray, "_"]:
    """A bound on any unit y times a column minus the parabola, given its `remainders`."""
    third, error = derivatives
    return PARABOLA * third * half_width**3 + LEBESGUE * error


def lowest_of_parabola(
    below: Float[np.ndarray, "_"], middle: Float[np.ndarray, "_"], above: Float[np.ndarray, "_"]
) -> Float[np.ndarray, "_"]:
    """The least value of the parabolas through the lower end, the middle and the upper end."""
    slope, bend = (above - below) / 2, (above + below) / 2 - middle
    # Lowest where the slope vanishes, or at an end.
    is_between = bend > np.abs(slope) / 2
    lowest = middle - slope**2 / np.where(is_between, 4 * bend, 1.0)
    return np.where(is_between, lowest, np.minimum(below, above))


def remainders(
    prepared_records: Sequence[PreparedRecord], axes: Sequence[Axis], nodes: Sequence[float]
) -> list[Float[np.ndarray, "2 _"]]:
    """Of each axis's columns: bounds on the RMS of their third derivative by the scale, and on
    that of their own error."""

    def shares_of_current(part: PreparedRecord) -> Float[np.ndarray, "samples nodes"]:
        return hats(part.soc, nodes) * part.held_a[:, None]

    largest_a, _ = _largest_and_rms(prepared_records, shares_of_current)
    rms_a = np.minimum(largest_a, earlier_rms(prepared_records, shares_of_current))
    found = []
    for axis in axes:
        largest, rms = largest_a, rms_a
        if axis.sign < 0:

            def amplitude(part: PreparedRecord, table: int | None = axis.table):
                measured_v = part.hysteresis_amplitude_v
                if table is None and measured_v is not None:
                    return part.scored[:, None] * measured_v[:, None]
                return part.scored[:, None] * hats(part.soc, nodes)

            # What moves the hysteresis is at most 2, from one direction to the other.
            largest, rms = (2 * bound for bound in _largest_and_rms(prepared_records, amplitude))
        found.append(np.array([THIRD_DERIVATIVE * rms, axis.span.error * largest]))
    return found


def _largest_and_rms(
    prepared_records: Sequence[PreparedRecord],
    signals: Callable[[PreparedRecord], Float[np.ndarray, "samples signals"]],
) -> tuple[Float[np.ndarray, "signals"], Float[np.ndarray, "signals"]]:
    """The largest magnitudes of signals, and the roots of their squares for each scored sample."""
    largest, squares, scored = np.zeros(1), np.zeros(1), 0
    for prepared in prepared_records:
        for part in prepared.parts(BLOCK):
            values = signals(part)[:BLOCK]
            largest = np.maximum(largest, np.max(np.abs(values), axis=0))
            squares = squares + np.sum(values**2, axis=0)
        scored += int(np.count_nonzero(prepared.scored))
    return largest, np.sqrt(squares / scored)


def earlier_rms(
    prepared_records: Sequence[PreparedRecord],
    signals: Callable[[PreparedRecord], Float[np.ndarray, "samples signals"]],
) -> Float[np.ndarray, "signals"]:
    """Bounds on the RMS of signals, such as the current, some time before the scored samples.

    A signal is held from a sample to the next. An interval counts as often as samples can be that
    time after it: as many as any run of its length holds.
    """
    squares, scored = np.zeros(1), 0
    for prepared in prepared_records:
        scored_s = prepared.time_s if np.all(prepared.scored) else prepared.time_s[prepared.scored]
        most: dict[float, int] = {}
        for part in prepared.parts(BLOCK):
            # Few distinct lengths, none of them shortened.
            length_s = np.exp2(np.ceil(8 * np.log2(np.diff(part.time_s))) / 8)
            lengths_s, kind = np.unique(length_s, return_inverse=True)
            for run_s in lengths_s.tolist():
                if run_s not in most:
                    most[run_s] = _most_within(scored_s, run_s)
            counts = np.array([most[run_s] for run_s in lengths_s.tolist()])[kind]
            squares = squares + counts @ signals(part)[:-1] ** 2
        scored += len(scored_s)
    return np.sqrt(squares / scored)


def _most_within(time_s: Float[np.ndarray, "samples"], length_s: float) -> int:
    """The most samples that a half-open run of that length holds."""
    return max(
        int(np.max(np.searchsorted(time_s, here + length_s) - first - np.arange(len(here))))
        for first in range(0, len(time_s), BLOCK)
        for here in [time_s[first : first + BLOCK]]
    )
