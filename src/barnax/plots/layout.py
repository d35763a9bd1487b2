"""Where panels and their labels stand: the room that they need, found before anything is drawn.

matplotlib's constrained layout draws every text twice to find it, which takes as long as drawing
the figure. Here it follows from the sizes of letters and the longest label of an axis' ticks.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.transforms import ScaledTranslation

POINTS_PER_IN: Final = 72.0
# Around a figure, and between what belongs to a panel and the next one.
PAD_IN: Final = 0.05
# A line of letters is so much higher than their size, and a digit so much narrower.
LINE, DIGIT = 1.2, 0.64
# Between a frame and its title, `axes.titlepad`.
TITLE_PT: Final = 6.0
BAR_IN: Final = 0.1


class Room(NamedTuple):
    """Inches from the frame of a panel to the outer side of its labels."""

    left: float
    right: float
    below: float
    above: float


def arrange(
    figure: Figure,
    panels: Sequence[Axes],
    above_in: float = 0.0,
    beside_in: float = 0.0,
    bar: Axes | None = None,
) -> None:
    """Place the panels of one grid, all labels of a column or row at one distance.

    `above_in` is the height of a legend above them, `beside_in` the width of a name at their left,
    and `bar` the scale of colors at their right.
    """
    width_in, height_in = figure.get_size_inches()
    right_in = 0.0 if bar is None else BAR_IN + PAD_IN + _beside_in(bar.yaxis, _ticks_in(bar.yaxis))
    rows = [_span(axes, "rowspan") for axes in panels]
    columns = [_span(axes, "colspan") for axes in panels]
    grid = panels[0].get_gridspec()
    assert grid is not None, "panels are subplots"
    ticks_in = [_ticks_in(axes.yaxis) for axes in panels]
    # Labels of the panels that begin in one column stand in one line.
    ticks_in = [
        max(own for own, other in zip(ticks_in, columns, strict=True) if other[0] == column[0])
        for column in columns
    ]
    rooms = [_room(axes, ticks) for axes, ticks in zip(panels, ticks_in, strict=True)]
    across = _tracks(
        grid.get_width_ratios(),
        [(*span, room.left, room.right) for span, room in zip(columns, rooms, strict=True)],
        (beside_in + PAD_IN, width_in - right_in - PAD_IN),
    )
    # From the top downwards, as rows are counted.
    down = _tracks(
        grid.get_height_ratios(),
        [(*span, room.above, room.below) for span, room in zip(rows, rooms, strict=True)],
        (above_in + PAD_IN, height_in - PAD_IN),
    )
    for axes, ticks, column, row in zip(panels, ticks_in, columns, rows, strict=True):
        left, right = across[column[0]][0] / width_in, across[column[1]][1] / width_in
        top, bottom = 1 - down[row[0]][0] / height_in, 1 - down[row[1]][1] / height_in
        axes.set_position((left, bottom, right - left, top - bottom))
        _place_labels(figure, axes, ticks)
    if bar is not None:
        bottom, top = 1 - down[-1][1] / height_in, 1 - down[0][0] / height_in
        left = 1 - right_in / width_in
        bar.set_position((left, bottom, BAR_IN / width_in, top - bottom))


def add_legend(
    figure: Figure, entries: Mapping[str, Any], columns: int, size_pt: float
) -> tuple[Legend, float]:
    """A legend of handles by their labels at the top of a figure, and its height in inches."""
    top = 1 - PAD_IN / figure.get_figheight()
    how: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, top), "ncols": columns}
    legend = figure.legend(list(entries.values()), list(entries), **how)
    # Half a line is below each.
    return legend, line_in(size_pt, 1.5 * -(-len(entries) // columns))


def line_in(size_pt: Any, lines: float = 1) -> float:
    """The height of lines of letters of a size, in inches."""
    return lines * LINE * size_pt / POINTS_PER_IN


def _span(axes: Axes, name: str) -> tuple[int, int]:
    """The first and the last row or column of the grid that a panel is in."""
    span = getattr(axes.get_subplotspec(), name)
    return span.start, span.stop - 1


def _tracks(
    ratios: Any,
    spans: Sequence[tuple[int, int, float, float]],
    ends_in: tuple[float, float],
) -> Float[np.ndarray, "tracks 2"]:
    """Where the frames in each row or column of a grid begin and end, in inches, with the most room
    before and behind them that a panel needs that begins or ends there."""
    before, behind = np.zeros(len(ratios)), np.zeros(len(ratios))
    for first, last, ahead_in, after_in in spans:
        before[first] = max(before[first], ahead_in)
        behind[last] = max(behind[last], after_in)
    before[1:] += PAD_IN
    start, stop = ends_in
    sizes = (stop - start - before.sum() - behind.sum()) * np.asarray(ratios) / np.sum(ratios)
    stops = start + np.cumsum(before + sizes + behind) - behind
    return np.stack([stops - sizes, stops], axis=1)


def _labels(axis: Axis) -> list[str]:
    """The labels of the ticks in view; none where they are not shown."""
    shown = axis.get_tick_params()
    if not any(shown.get(f"label{side}") for side in ("left", "right", "bottom")):
        return []
    low, high = sorted(axis.get_view_interval())
    # Ticks at the very ends are shown.
    margin = 1e-9 * (high - low)
    at = [tick for tick in axis.get_majorticklocs() if low - margin <= tick <= high + margin]
    return axis.get_major_formatter().format_ticks(at)


def _widest_in(axis: Axis) -> float:
    """The width of the longest label of the ticks."""
    digits = max((len(label) - label.count(".") / 2 for label in _labels(axis)), default=0.0)
    return digits * DIGIT * axis.get_tick_params()["labelsize"] / POINTS_PER_IN


def _mark_in(axis: Axis) -> float:
    """The length of a tick with the blank behind it."""
    shown = axis.get_tick_params()
    return (shown["length"] + shown["pad"]) / POINTS_PER_IN


def _ticks_in(axis: Axis) -> float:
    """How far ticks and their labels reach beside a vertical axis."""
    return _mark_in(axis) + _widest_in(axis)


def _below_in(axis: Axis) -> float:
    """How far they reach below a horizontal axis."""
    shown = axis.get_tick_params()
    if not shown.get("labelbottom"):
        return _mark_in(axis)
    is_upright = shown.get("labelrotation", 0) == 90
    return _mark_in(axis) + (_widest_in(axis) if is_upright else line_in(shown["labelsize"]))


def _beside_in(axis: Axis, ticks_in: float) -> float:
    """How far an axis with its label reaches from the frame."""
    lines = axis.get_label_text().count("\n") + 1 if axis.get_label_text() else 0
    pad_in = axis.labelpad / POINTS_PER_IN if lines else 0.0
    return ticks_in + pad_in + line_in(axis.label.get_fontsize(), lines)


def _room(axes: Axes, ticks_in: float) -> Room:
    # The first and the last label of a horizontal axis may stand over its ends.
    over_in = _widest_in(axes.xaxis) / 2
    titles = [title for loc in ("left", "center", "right") if (title := axes.get_title(loc))]
    lines = max((title.count("\n") + 1 for title in titles), default=0)
    title_in = line_in(axes.title.get_fontsize(), lines)
    return Room(
        left=max(_beside_in(axes.yaxis, ticks_in), over_in),
        right=over_in,
        below=_beside_in(axes.xaxis, _below_in(axes.xaxis)),
        above=title_in + (TITLE_PT / POINTS_PER_IN if lines else PAD_IN),
    )


def _place_labels(figure: Figure, axes: Axes, ticks_in: float) -> None:
    """The names of both axes at fixed distances, for which no tick has to be drawn first."""
    for axis, distance_in in ((axes.yaxis, ticks_in), (axes.xaxis, _below_in(axes.xaxis))):
        away_in = -distance_in - axis.labelpad / POINTS_PER_IN
        is_vertical = axis is axes.yaxis
        away = ScaledTranslation(
            *((away_in, 0) if is_vertical else (0, away_in)), figure.dpi_scale_trans
        )
        axis.set_label_coords(*((0, 0.5) if is_vertical else (0.5, 0)), axes.transAxes + away)
