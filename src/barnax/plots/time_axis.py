"""Time on the horizontal axis: its unit, the samples that do not count, a stretch to look into."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes

from .decimation import COLUMNS
from .style import SHADE

NOT_SCORED = "not scored"
HOURS_FROM_S = 7200.0
STRETCH_SAMPLES = 200
STRETCHES_PER_RECORD = 5
SHORTEST_STRETCH = 20
AS_LIVELY = 0.98

Samples = Float[np.ndarray, "samples"]


@dataclass(frozen=True)
class TimeUnit:
    """A unit of time and how many seconds it has."""

    name: str
    seconds: float

    @property
    def label(self) -> str:
        return f"Time [{self.name}]"


def choose_time_unit(time_s: Samples) -> TimeUnit:
    """Hours for records of two hours and more, else seconds.

    >>> choose_time_unit(np.array([0.0, 7200.0])).label
    'Time [h]'
    """
    if time_s[-1] - time_s[0] >= HOURS_FROM_S:
        return TimeUnit("h", 3600.0)
    return TimeUnit("s", 1.0)


def shade_unscored(axes: Axes, time: Samples, scored: Bool[np.ndarray, "samples"]) -> None:
    """Shade the time between scored samples, over the whole height; one entry for the legend.

    Gaps too narrow to be seen are left out: a record may hold tens of thousands of them.
    """
    changes = np.diff(~scored, prepend=False, append=False)
    starts, stops = np.flatnonzero(changes).reshape(-1, 2).T
    left, right = time[starts], time[np.minimum(stops, len(time) - 1)]
    is_visible = right - left >= (time[-1] - time[0]) / COLUMNS
    if not is_visible.any():
        return
    spans = list(zip(left[is_visible], (right - left)[is_visible], strict=True))
    bottom, top = axes.get_ylim()
    axes.broken_barh(
        spans,
        (0.0, 1.0),
        transform=axes.get_xaxis_transform(),
        facecolor=SHADE,
        edgecolor="none",
        zorder=0,
        label=NOT_SCORED,
    )
    axes.set_ylim(bottom, top)


def lively_stretch(current_a: Samples, scored: Bool[np.ndarray, "samples"]) -> slice | None:
    """A short scored stretch with much change of current, or `None` where the record is short.

    Chosen by the current alone, so that it neither flatters nor blames the simulation. Where a
    profile repeats itself, the repetition nearest to the middle of the scored samples is taken.
    """
    length = min(STRETCH_SAMPLES, int(np.count_nonzero(scored)) // STRETCHES_PER_RECORD)
    if length < SHORTEST_STRETCH:
        return None
    both_scored = scored[1:] & scored[:-1]
    change_a = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(current_a)) * both_scored)])
    within_a = change_a[length - 1 :] - change_a[: len(change_a) - length + 1]
    lively = np.flatnonzero(within_a >= AS_LIVELY * within_a.max())
    middle = np.median(np.flatnonzero(scored)) - length / 2
    start = int(lively[np.argmin(np.abs(lively - middle))])
    return slice(start, start + length)
