"""Measured voltage of one record, and every row's simulation of it."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .decimation import decimate
from .rows import RowLook, most_accurate, require_one_record, row_looks, selection_note
from .style import figure_style, finish_axes, legend_above, make_figure, title
from .time_axis import choose_time_unit, lively_stretch, shade_unscored

if TYPE_CHECKING:
    from ..evaluate import Evaluation

# More lines than these hide each other even in the magnified stretch.
MOST_ROWS = 8
MARKERS_PER_LINE = 8
HEIGHT_IN = 6.0
MEASURED = "#BEBEBE"
FRAME = "#6A6A6A"
TIE = "#ADADAD"


@figure_style()
def plot_compared_voltages(evaluations: Mapping[str, "Evaluation"]) -> Figure:
    """Voltage over time, measured and of every row; below, the framed stretch magnified.

    `evaluations` are the rows' evaluations on one record, under their labels (Li et al., 2023,
    Fig. 10 and 12). The stretch is a scored one with much change of current, chosen by the
    current alone; records under 100 scored samples go without. Of more than eight rows the eight
    with the lowest RMSE are drawn, and the title says so. Raises `ValueError` where the rows are
    on different samples.

    >>> from barnax import CircuitParameters, bundled_file, characterize, read_record, validate
    >>> tests = [read_record(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    >>> circuit = CircuitParameters(r0=0.05, r=(0.01, 0.02), c=(1e3, 1e4))
    >>> record, cell = read_record(bundled_file("identification")), characterize(tests)
    >>> rows = {name: validate(record, cell, name, circuit) for name in ("so-rc", "iso-rc")}
    >>> [axes.get_ylabel() for axes in plot_compared_voltages(rows).axes]
    ['Voltage [V]', 'Voltage [V]']
    """
    require_one_record(evaluations)
    looks = row_looks(evaluations)
    shown = most_accurate(evaluations, MOST_ROWS)
    course = next(iter(shown.values())).course
    unit = choose_time_unit(course.time_s)
    time = course.time_s / unit.seconds
    stretch = lively_stretch(course.current_a, course.scored)
    figure = make_figure(height_in=HEIGHT_IN)
    ratios = [1.0, 1.5] if stretch is not None else [1.0]
    whole, *close = figure.subplots(len(ratios), 1, squeeze=False, height_ratios=ratios)[:, 0]

    _draw_rows(whole, time, slice(None), shown, looks, is_close=stretch is None)
    shade_unscored(whole, time, course.scored)
    whole.set_xlabel(unit.label)
    note = selection_note(len(shown), len(evaluations))
    title(whole, f"{course.record.name}: {note}" if note else course.record.name)
    if stretch is not None:
        origin = np.floor(course.time_s[stretch.start] / unit.seconds * 100) / 100
        seconds = course.time_s - origin * unit.seconds
        _draw_rows(close[0], seconds, stretch, shown, looks, is_close=True)
        close[0].set_xlabel(f"Time after {origin:g} {unit.name} [s]")
        _frame(whole, close[0], *time[[stretch.start, stretch.stop - 1]])
    finish_axes(whole, *close)
    legend_above(figure, *close, whole, columns=3)
    return figure


def _draw_rows(
    axes: Axes,
    time: np.ndarray,
    samples: slice,
    shown: Mapping[str, "Evaluation"],
    looks: Mapping[str, RowLook],
    *,
    is_close: bool,
) -> None:
    """The measured line and every row's; markers only where single samples can be seen."""
    measured_v = next(iter(shown.values())).course.voltage_v
    _draw_line(
        axes, time, measured_v, samples, "measured", MEASURED, linewidth=3.2 if is_close else 1.6
    )
    for place, (label, each) in enumerate(shown.items()):
        look = looks[label]
        name = f"{label} ({1e3 * each.metrics.rmse_v:.3g} mV)"
        drawn = _draw_line(axes, time, each.simulated_v, samples, name, look.color, linewidth=0.6)
        if is_close:
            drawn.set(linewidth=1.1, linestyle=look.line, marker=look.marker)
            drawn.set(markersize=3.6, markerfacecolor="white")
            # Shifted from row to row, so that markers of equal answers do not hide each other.
            spacing = max(1, np.size(drawn.get_xdata()) // MARKERS_PER_LINE)
            drawn.set_markevery((spacing * place // len(shown), spacing))
    axes.set_ylabel("Voltage [V]")


def _draw_line(
    axes: Axes,
    time: np.ndarray,
    voltage_v: np.ndarray,
    samples: slice,
    label: str,
    color: str,
    linewidth: float,
) -> Line2D:
    x, y = time[samples], voltage_v[samples]
    kept = decimate(x, y)
    (drawn,) = axes.plot(x[kept], y[kept], color=color, linewidth=linewidth, label=label)
    return drawn


def _frame(whole: Axes, close: Axes, start: float, stop: float) -> None:
    """A frame around the stretch in the upper panel, tied to the lower one."""
    low_v, high_v = close.get_ylim()
    frame = whole.indicate_inset(
        (start, low_v, stop - start, high_v - low_v),
        inset_ax=close,
        edgecolor=FRAME,
        alpha=1.0,
        linewidth=0.9,
    )
    # The ties cross the data: lighter than any line, and behind them.
    for tie in frame.connectors or ():
        tie.set(color=TIE, linewidth=0.7, zorder=1.5)
