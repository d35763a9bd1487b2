"""Where a simulation errs: over time, and over the state of charge."""

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from .error_axes import (
    LABEL,
    broken_line,
    draw_by_soc,
    draw_rmse,
    draw_rmse_by_soc,
    outside_note,
    scored_limits,
)
from .style import (
    BLUE,
    GREY,
    figure_style,
    finish_axes,
    legend_above,
    make_figure,
    title,
)
from .time_axis import NOT_SCORED, choose_time_unit, shade_unscored

if TYPE_CHECKING:
    from ..evaluate import Evaluation


@figure_style()
def plot_error(evaluation: "Evaluation") -> Figure:
    """Measured minus simulated voltage in mV, over time and over SOC.

    Samples that do not count are grey and shaded. Dashed: plus and minus the RMSE of all scored
    samples. The scale leaves out what few scored samples alone would need, and says so. Over SOC
    the steps are plus and minus the RMSE of the scored samples in each twentieth of SOC that holds
    at least five of them.

    >>> from barnax import CircuitParameters, bundled_file, characterize, read_record, validate
    >>> tests = [read_record(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    >>> circuit = CircuitParameters(r0=0.05, r=(0.01, 0.02), c=(1e3, 1e4))
    >>> record = read_record(bundled_file("identification"))
    >>> figure = plot_error(validate(record, characterize(tests), "iso-rc", circuit))
    >>> [axes.get_xlabel() for axes in figure.axes]
    ['Time [h]', 'State of charge [-]']
    """
    course = evaluation.course
    unit = choose_time_unit(course.time_s)
    time, error_mv = course.time_s / unit.seconds, 1e3 * evaluation.error_v
    figure = make_figure()
    over_time, over_soc = figure.subplots(2, 1, sharey=True)

    not_scored = "_none" if course.scored.all() else NOT_SCORED
    for chosen, color, label, layer in (
        (course.scored, BLUE, "scored error", 2.0),
        (~course.scored, GREY, not_scored, 1.9),
    ):
        line = broken_line(time, error_mv, chosen)
        over_time.plot(*line, color=color, linewidth=0.8, label=label, zorder=layer)
        draw_by_soc(over_soc, course.soc[chosen], error_mv[chosen], color, layer)
    rmse_mv = 1e3 * evaluation.metrics.rmse_v
    draw_rmse_by_soc(over_soc, course.soc[course.scored], error_mv[course.scored])
    for axes in (over_time, over_soc):
        draw_rmse(axes, rmse_mv, f"± RMSE, {rmse_mv:.3g} mV")
        axes.set_ylabel(LABEL)
    limits = scored_limits(error_mv[course.scored])
    over_soc.set_ylim(limits)
    over_soc.set_title(outside_note(error_mv[course.scored], *limits), loc="right")
    shade_unscored(over_time, time, course.scored)
    over_time.set_xlabel(unit.label)
    over_soc.set_xlabel("State of charge [-]")
    title(over_time, course.record.name)
    finish_axes(over_time, over_soc)
    legend_above(figure, over_time, over_soc, columns=4)
    return figure
