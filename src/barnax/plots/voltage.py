"""Measured and simulated voltage of one record, and the current that made it."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .condition import draw_current
from .decimation import decimate
from .style import (
    BLACK,
    SKY_BLUE,
    figure_style,
    finish_axes,
    legend_above,
    make_figure,
    title,
)
from .time_axis import choose_time_unit, lively_stretch, shade_unscored

if TYPE_CHECKING:
    from ..evaluate import Evaluation

FRAME = "#7A7A7A"


@figure_style()
def plot_voltage(evaluation: "Evaluation") -> Figure:
    """Voltage over time, measured and simulated, above the current.

    Time is on the record's own clock, in seconds below two hours. Samples that do not count
    towards the metrics are shaded. At the right the framed stretch, magnified: a scored one with
    much change of current; records under 100 scored samples go without.

    >>> from barnax import CircuitParameters, bundled_file, characterize, read_record, validate
    >>> tests = [read_record(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    >>> circuit = CircuitParameters(r0=0.05, r=(0.01, 0.02), c=(1e3, 1e4))
    >>> record = read_record(bundled_file("identification"))
    >>> figure = plot_voltage(validate(record, characterize(tests), "iso-rc", circuit))
    >>> figure.axes[0].get_ylabel()
    'Voltage [V]'
    """
    course = evaluation.course
    unit = choose_time_unit(course.time_s)
    stretch = lively_stretch(course.current_a, course.scored)
    figure = make_figure()
    columns = 1 if stretch is None else 2
    panels = figure.subplots(
        2,
        columns,
        sharex="col",
        squeeze=False,
        width_ratios=[1.9, 1.0][:columns],
        height_ratios=[2.0, 1.0],
    )
    voltage, current = panels[:, 0]
    time = course.time_s / unit.seconds
    _draw_voltage(voltage, evaluation, time, slice(None))
    _draw_current(current, evaluation, time, slice(None))
    current.set_xlabel(unit.label)
    for axes in (voltage, current):
        shade_unscored(axes, time, course.scored)
    title(voltage, course.record.name)
    if stretch is not None:
        _draw_stretch(panels, evaluation, stretch)
    finish_axes(*panels.flat)
    legend_above(figure, voltage, columns=3)
    return figure


def _draw_voltage(
    axes: Axes, evaluation: "Evaluation", time: np.ndarray, stretch: slice, width: float = 1.0
) -> None:
    course = evaluation.course
    drawn = {
        "measured": (course.voltage_v, SKY_BLUE, 1.8 * width),
        f"simulated (RMSE {1e3 * evaluation.metrics.rmse_v:.3g} mV)": (
            evaluation.simulated_v,
            BLACK,
            0.6 * width,
        ),
    }
    for label, (voltage_v, color, line_width) in drawn.items():
        kept = decimate(time[stretch], voltage_v[stretch])
        axes.plot(
            time[stretch][kept],
            voltage_v[stretch][kept],
            color=color,
            linewidth=line_width,
            label=label,
        )
    axes.set_ylabel("Voltage [V]")


def _draw_current(axes: Axes, evaluation: "Evaluation", time: np.ndarray, stretch: slice) -> None:
    course = evaluation.course
    draw_current(axes, time[stretch], course.current_a[stretch], course.record.hold.value)


def _draw_stretch(panels: np.ndarray, evaluation: "Evaluation", stretch: slice) -> None:
    """The right column: one stretch, on the same clock, and its frame in the left column."""
    course = evaluation.course
    unit = choose_time_unit(course.time_s)
    voltage, current = panels[:, 1]
    # Seconds after a round time: hours would need too many digits on so short an axis.
    origin = np.floor(course.time_s[stretch.start] / unit.seconds * 100) / 100
    time_s = course.time_s - origin * unit.seconds
    _draw_voltage(voltage, evaluation, time_s, stretch, width=1.6)
    _draw_current(current, evaluation, time_s, stretch)
    current.set_xlabel(f"Time after {origin:g} {unit.name} [s]")
    for axes in (voltage, current):
        axes.set_ylabel("")
    title(voltage, "framed stretch")
    edges = course.time_s[[stretch.start, stretch.stop - 1]] / unit.seconds
    for axes in panels[:, 0]:
        axes.axvspan(*edges, facecolor="none", edgecolor=FRAME, linewidth=0.9, zorder=3)
