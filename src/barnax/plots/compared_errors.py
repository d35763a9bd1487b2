"""Where every row of a comparison errs: over time and over the state of charge."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .error_axes import (
    broken_line,
    draw_by_soc,
    draw_rmse,
    draw_rmse_by_soc,
    outside_note,
    scored_limits,
)
from .rows import most_accurate, require_one_record, row_looks, selection_note
from .style import BLACK, GREY, figure_style, finish_axes, legend_above, make_figure, title
from .time_axis import choose_time_unit, shade_unscored

if TYPE_CHECKING:
    from ..evaluate import Evaluation

MOST_ROWS = 10
STRIP_IN = 1.1
FURNITURE_IN = 1.1
# Rows farther off than this many times the best do not set the scale: theirs is cut, and said.
FAR_OFF = 3.0


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
    shown = most_accurate(evaluations, MOST_ROWS)
    course = next(iter(shown.values())).course
    unit = choose_time_unit(course.time_s)
    time, scored = course.time_s / unit.seconds, course.scored
    figure = make_figure(height_in=FURNITURE_IN + STRIP_IN * len(shown))
    panels = figure.subplots(
        len(shown), 2, squeeze=False, sharey=True, sharex="col", width_ratios=[1.9, 1.0]
    )
    limits = _common_limits(shown)
    for (over_time, over_soc), (label, each) in zip(panels, shown.items(), strict=True):
        error_mv, color = 1e3 * each.error_v, looks[label].color
        for chosen, shade, layer in ((scored, color, 2.0), (~scored, GREY, 1.9)):
            line = broken_line(time, error_mv, chosen)
            over_time.plot(*line, color=shade, linewidth=0.7, zorder=layer)
            draw_by_soc(over_soc, course.soc[chosen], error_mv[chosen], shade, layer)
        draw_rmse_by_soc(over_soc, course.soc[scored], error_mv[scored], BLACK)
        for axes in (over_time, over_soc):
            draw_rmse(axes, 1e3 * each.metrics.rmse_v, "± RMSE")
        over_time.set_ylim(limits)
        shade_unscored(over_time, time, scored)
        _name_strip(over_time, f"{label}: RMSE {1e3 * each.metrics.rmse_v:.3g} mV")
        _name_strip(over_soc, outside_note(error_mv[scored], *limits).replace(" scored", ""))
    panels[-1, 0].set_xlabel(unit.label)
    panels[-1, 1].set_xlabel("State of charge [-]")
    figure.supylabel("Error [mV] (measured − simulated)", fontsize=9)
    note = selection_note(len(shown), len(evaluations))
    heading = f"{course.record.name}: {note}" if note else course.record.name
    finish_axes(*panels.flat)
    title(panels[0, 0], heading)
    legend_above(figure, *panels[0], columns=3)
    return figure


def _common_limits(shown: Mapping[str, "Evaluation"]) -> tuple[float, float]:
    """One scale for all strips, from the rows that are not far off."""
    lowest_v = min(each.metrics.rmse_v for each in shown.values())
    near = [each for each in shown.values() if each.metrics.rmse_v <= FAR_OFF * lowest_v]
    limits = np.array([scored_limits(1e3 * each.error_v[each.course.scored]) for each in near])
    return float(limits[:, 0].min()), float(limits[:, 1].max())


def _name_strip(axes: Axes, text: str) -> None:
    """A line of text in the upper left corner, readable over data."""
    if text:
        axes.text(
            0.01,
            0.97,
            text,
            transform=axes.transAxes,
            verticalalignment="top",
            fontsize=8,
            parse_math=False,
            bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.0},
            zorder=4,
        )
