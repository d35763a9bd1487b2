"""The working condition of one record: its current, and the voltage that was measured."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .decimation import decimate
from .style import (
    BLACK,
    BLUE,
    VERMILLION,
    figure_style,
    finish_axes,
    legend_above,
    make_figure,
    title,
)
from .time_axis import choose_time_unit, shade_unscored

if TYPE_CHECKING:
    from ..course import Course


@figure_style()
def plot_condition(course: "Course") -> Figure:
    """Current, measured voltage and state of charge of the simulated stretch of one record.

    As Fig. 8 and 9 of Li et al. (2023). Time is on the record's own clock, in seconds below two
    hours; discharge current is positive. Samples that do not count are shaded.

    >>> from barnax import Window, bundled_file, characterize, read_record
    >>> from barnax.course import make_course
    >>> cell = characterize([read_record(bundled_file("ocv_discharge"))])
    >>> record = read_record(bundled_file("identification"))
    >>> figure = plot_condition(make_course(record, cell, "so-rc", Window()))
    >>> [axes.get_ylabel() for axes in figure.axes]
    ['Current [A]\\n(discharge > 0)', 'Voltage [V]', 'SOC [-]']
    """
    unit = choose_time_unit(course.time_s)
    time = course.time_s / unit.seconds
    figure = make_figure()
    panels = figure.subplots(3, 1, sharex=True, height_ratios=[1.6, 1.6, 1.0])
    current, voltage, charge = panels
    draw_current(current, time, course.current_a, course.record.hold.value)
    _draw(voltage, time, course.voltage_v, BLUE)
    _draw(charge, time, course.soc, BLACK)
    voltage.set_ylabel("Voltage [V]")
    charge.set_ylabel("SOC [-]")
    charge.set_xlabel(unit.label)
    for axes in panels:
        shade_unscored(axes, time, course.scored)
    title(current, course.record.name)
    finish_axes(*panels)
    if not course.scored.all():
        legend_above(figure, current, columns=1)
    return figure


def draw_current(axes: Axes, time: np.ndarray, current_a: np.ndarray, hold: str) -> None:
    """The current as it flowed between samples, by the record's hold."""
    kept = decimate(time, current_a)
    axes.plot(
        time[kept],
        current_a[kept],
        color=VERMILLION,
        linewidth=0.8,
        drawstyle="steps-post" if hold == "forward" else "steps-pre",
    )
    axes.axhline(0.0, color=BLACK, linewidth=0.6)
    axes.set_ylabel("Current [A]\n(discharge > 0)")


def _draw(axes: Axes, time: np.ndarray, values: np.ndarray, color: str) -> None:
    kept = decimate(time, values)
    axes.plot(time[kept], values[kept], color=color, linewidth=0.8)
