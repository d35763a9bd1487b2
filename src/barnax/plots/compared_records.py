"""The rows of a comparison on one record: voltages and errors."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .error import draw_errors, name_axes, outside_note, scored_limits
from .style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    VERMILLION,
    draw_line,
    figure_style,
    finish_axes,
    legend_above,
    letters_pt,
    make_figure,
    show_name,
    title,
)
from .voltage import choose_time_unit, shade_unscored, stretch_clock, worst_stretch

if TYPE_CHECKING:
    from ..search.evaluate import Evaluation


# Cycles of three coprime lengths: 315 rows differ in at least one of them. Neighbors differ in
# lightness too, so that grey print tells them apart.
COLORS: Final = (BLUE, ORANGE, BLACK, VERMILLION, SKY_BLUE, GREEN, PURPLE)
LINES: Final = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (6, 1.5, 1, 1.5)), (0, (3, 1, 1, 1, 1, 1)))
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "<", ">")

# Strips of errors.
MOST_STRIPS: Final = 10
STRIP_IN: Final = 1.1
FURNITURE_IN: Final = 1.1
# Rows farther off than this many times the best do not set the scale: theirs is cut, and said.
FAR_OFF: Final = 3.0

# More lines of voltage than these hide each other even in the magnified stretch.
MOST_VOLTAGES: Final = 8
MARKERS_PER_LINE: Final = 8
HEIGHT_IN: Final = 6.0
MEASURED: Final = "#BEBEBE"
FRAME: Final = "#6A6A6A"
TIE: Final = "#ADADAD"


@dataclass(frozen=True)
class RowLook:
    """The same row looks the same in every figure."""

    color: str
    line: str | tuple[int, tuple[float, ...]]
    marker: str


def row_looks(labels: Iterable[str]) -> dict[str, RowLook]:
    """A look for every label, by its place among the labels.

    >>> [look.marker for look in row_looks(["IBMO-ISO RC", "LS-SO RC"]).values()]
    ['o', 's']
    """
    return {
        label: RowLook(
            COLORS[place % len(COLORS)], LINES[place % len(LINES)], MARKERS[place % len(MARKERS)]
        )
        for place, label in enumerate(labels)
    }


def require_one_record(evaluations: Mapping[str, "Evaluation"]) -> None:
    """Raise `ValueError` where there is nothing to draw, or not the same samples in every row."""
    if not evaluations:
        raise ValueError("there is no row to draw; give at least one evaluation")
    simulated = {
        (each.prepared.record.name, each.prepared.first, len(each.simulated_v))
        for each in evaluations.values()
    }
    if len(simulated) > 1:
        names = ", ".join(sorted({name for name, _, _ in simulated}))
        raise ValueError(
            f"the rows are on different samples ({names}); draw one record and window at a time"
        )


def most_accurate(evaluations: Mapping[str, "Evaluation"], most: int) -> dict[str, "Evaluation"]:
    """At most `most` rows, those of the lowest RMSE, in their own order."""
    ranked = sorted(evaluations, key=lambda label: evaluations[label].metrics.rmse_v)
    kept = set(ranked[:most])
    return {label: each for label, each in evaluations.items() if label in kept}


def heading(record: str, kept: int, of: int) -> str:
    """The record's name, and what a title adds where not every row is drawn.

    >>> heading("cycle.csv", 8, 12)
    'cycle.csv: the 8 of 12 rows with the lowest RMSE'
    """
    return record if kept == of else f"{record}: the {kept} of {of} rows with the lowest RMSE"


@figure_style()
def plot_compared_errors(evaluations: Mapping[str, "Evaluation"]) -> Figure:
    """Measured minus simulated voltage in mV, a strip for each row, on one scale.

    `evaluations` are the rows' evaluations on one record, under their labels (Li et al., 2023,
    Fig. 11 and 13). Left over time, right over SOC, with plus and minus the RMSE in each
    twentieth of SOC. Samples that do not count are grey and shaded. The scale is that of the
    rows within three times the lowest RMSE; samples outside it are counted in the strip. Of more
    than ten rows the ten with the lowest RMSE are drawn. Raises `ValueError` where the rows are
    on different samples.

    >>> from barnax import CircuitParameters, bundled_file, characterize, read_record, validate
    >>> tests = [read_record(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    >>> circuit = CircuitParameters(r0=0.05, r=(0.01, 0.02), c=(1e3, 1e4))
    >>> record, cell = read_record(bundled_file("identification")), characterize(tests)
    >>> rows = {name: validate(record, cell, name, circuit) for name in ("so-rc", "iso-rc")}
    >>> [axes.get_xlabel() for axes in plot_compared_errors(rows).axes[-2:]]
    ['Time [h]', 'State of charge [-]']
    """
    require_one_record(evaluations)
    looks = row_looks(evaluations)
    shown = most_accurate(evaluations, MOST_STRIPS)
    prepared = next(iter(shown.values())).prepared
    figure = make_figure(height_in=FURNITURE_IN + STRIP_IN * len(shown))
    panels = figure.subplots(
        len(shown), 2, squeeze=False, sharey=True, sharex="col", width_ratios=[1.9, 1.0]
    )
    limits = _common_limits(shown)
    for (over_time, over_soc), (label, each) in zip(panels, shown.items(), strict=True):
        colors, labels = (looks[label].color, BLACK), ("_scored", "_not scored", "± RMSE")
        draw_errors(over_time, over_soc, each, colors, 0.7, labels, limits)
        _name_strip(over_time, f"{label}: RMSE {1e3 * each.metrics.rmse_v:.3g} mV")
        outside = outside_note(1e3 * each.error_v[prepared.scored], *limits)
        _name_strip(over_soc, outside.replace(" scored", ""))
    name_axes(panels[-1, 0], panels[-1, 1], prepared)
    figure.supylabel("Error [mV] (measured − simulated)", fontsize=letters_pt(9))
    finish_axes(*panels.flat)
    title(panels[0, 0], heading(prepared.record.name, len(shown), len(evaluations)))
    legend_above(figure, *panels[0], columns=3)
    return figure


def _common_limits(shown: Mapping[str, "Evaluation"]) -> tuple[float, float]:
    """One scale for all strips, from the rows that are not far off."""
    lowest_v = min(each.metrics.rmse_v for each in shown.values())
    near = [each for each in shown.values() if each.metrics.rmse_v <= FAR_OFF * lowest_v]
    limits = np.array([scored_limits(1e3 * each.error_v[each.prepared.scored]) for each in near])
    return float(limits[:, 0].min()), float(limits[:, 1].max())


def _name_strip(axes: Axes, text: str) -> None:
    """A line of text in the upper left corner, readable over data."""
    if text:
        box = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.0}
        place = {"transform": axes.transAxes, "verticalalignment": "top", "zorder": 4}
        show_name(axes.text(0.01, 0.97, text, fontsize=letters_pt(8), bbox=box, **place))


@figure_style()
def plot_compared_voltages(evaluations: Mapping[str, "Evaluation"]) -> Figure:
    """Voltage over time, measured and of every row; below, the framed stretch magnified.

    `evaluations` are the rows' evaluations on one record, under their labels (Li et al., 2023,
    Fig. 10 and 12). The stretch is the one where the row with the lowest RMSE errs most; records
    under 100 scored samples go without. Of more than eight rows the eight
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
    shown = most_accurate(evaluations, MOST_VOLTAGES)
    prepared = next(iter(shown.values())).prepared
    unit = choose_time_unit(prepared.time_s)
    time = prepared.time_s / unit.seconds
    best = min(shown.values(), key=lambda each: each.metrics.rmse_v)
    span = worst_stretch(best.error_v, prepared.scored)
    figure = make_figure(height_in=HEIGHT_IN)
    ratios = [1.0, 1.5] if span is not None else [1.0]
    whole, *close = figure.subplots(len(ratios), 1, squeeze=False, height_ratios=ratios)[:, 0]

    _draw_rows(whole, time, slice(None), shown, looks, is_close=span is None)
    shade_unscored(whole, time, prepared.scored)
    whole.set_xlabel(unit.label)
    title(whole, heading(prepared.record.name, len(shown), len(evaluations)))
    if span is not None:
        seconds, label = stretch_clock(prepared.time_s, span, unit)
        _draw_rows(close[0], seconds, span, shown, looks, is_close=True)
        close[0].set_xlabel(label)
        _frame(whole, close[0], *time[[span.start, span.stop - 1]])
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
    measured_v = next(iter(shown.values())).prepared.voltage_v
    width = 3.2 if is_close else 1.6
    time = time[samples]
    draw_line(axes, time, measured_v[samples], label="measured", color=MEASURED, linewidth=width)
    for place, (label, each) in enumerate(shown.items()):
        look = looks[label]
        name = f"{label} ({1e3 * each.metrics.rmse_v:.3g} mV)"
        drawn = draw_line(
            axes, time, each.simulated_v[samples], label=name, color=look.color, linewidth=0.6
        )
        if is_close:
            drawn.set(linewidth=1.1, linestyle=look.line, marker=look.marker)
            drawn.set(markersize=3.6, markerfacecolor="white")
            # Shifted from row to row, so that markers of equal answers do not hide each other.
            spacing = max(1, np.size(drawn.get_xdata()) // MARKERS_PER_LINE)
            drawn.set_markevery((spacing * place // len(shown), spacing))
    axes.set_ylabel("Voltage [V]")


def _frame(whole: Axes, close: Axes, start: float, stop: float) -> None:
    """A frame around the stretch in the upper panel, tied to the lower one."""
    low_v, high_v = close.get_ylim()
    box = (start, low_v, stop - start, high_v - low_v)
    frame = whole.indicate_inset(box, inset_ax=close, edgecolor=FRAME, alpha=1.0, linewidth=0.9)
    # The ties cross the data: lighter than any line, and behind them.
    for tie in frame.connectors or ():
        tie.set(color=TIE, linewidth=0.7, zorder=1.5)
