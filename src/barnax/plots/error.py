"""Where a simulation errs: over time, and over the state of charge."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .decimation import COLUMNS, decimate
from .style import (
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    figure_style,
    finish_axes,
    legend_above,
    make_figure,
    title,
)
from .time_axis import NOT_SCORED, choose_time_unit, shade_unscored

if TYPE_CHECKING:
    from ..evaluate import Evaluation

Samples = Float[np.ndarray, "samples"]

LABEL = "Error [mV]\n(measured − simulated)"
SOC_BINS = 20
FEWEST_IN_BIN = 5
# A few samples at the very end of a discharge can be ten times as far off as all the others.
FEW_PERCENT = 0.5
MARGIN = 0.3
NEARLY_INSIDE = 1.5


@figure_style()
def plot_error(evaluation: "Evaluation") -> Figure:
    """Measured minus simulated voltage in mV, over time and over SOC.

    Samples that do not count are grey and shaded. Dashed: plus and minus the RMSE of all scored
    samples. The scale leaves out what few scored samples alone would need, and says so. Over SOC
    the steps are plus and minus the RMSE of the scored samples in each twentieth of SOC that holds
    at least five of them.

    >>> from barnax import CircuitParameters, bundled_file, characterize, read_record, validate
    >>> tests = [read_record(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    >>> circuit = CircuitParameters(r0=0.05, r1=0.01, c1=1e3, r2=0.02, c2=1e4)
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
        line = _runs(time, error_mv, chosen)
        over_time.plot(*line, color=color, linewidth=0.8, label=label, zorder=layer)
        # A picture of the points: as vectors, a long record would make a file of many megabytes.
        over_soc.plot(
            course.soc[chosen],
            error_mv[chosen],
            color=color,
            linestyle="none",
            marker=".",
            markersize=2.0,
            markeredgewidth=0.0,
            alpha=0.6,
            rasterized=True,
            zorder=layer,
        )
    _draw_rmse_by_soc(over_soc, course.soc[course.scored], error_mv[course.scored])
    for axes in (over_time, over_soc):
        _draw_rmse(axes, 1e3 * evaluation.metrics.rmse_v)
        axes.set_ylabel(LABEL)
    _frame(over_soc, error_mv[course.scored])
    shade_unscored(over_time, time, course.scored)
    over_time.set_xlabel(unit.label)
    over_soc.set_xlabel("State of charge [-]")
    title(over_time, course.record.name)
    finish_axes(over_time, over_soc)
    legend_above(figure, over_time, over_soc, columns=4)
    return figure


def _runs(
    time: Samples, error_mv: Samples, chosen: Bool[np.ndarray, "samples"]
) -> tuple[Samples, Samples]:
    """The chosen samples as a line, broken where others lie between, as wide as can be seen."""
    indices = np.flatnonzero(chosen)
    kept = indices[decimate(time[indices], error_mv[indices])]
    others = np.cumsum(~chosen)
    is_wide = np.diff(time[kept]) > (time[-1] - time[0]) / COLUMNS
    breaks = np.flatnonzero((np.diff(others[kept]) > 0) & is_wide) + 1
    return np.insert(time[kept], breaks, np.nan), np.insert(error_mv[kept], breaks, np.nan)


def _draw_rmse(axes: Axes, rmse_mv: float) -> None:
    axes.axhline(0.0, color=BLACK, linewidth=0.6)
    for side, label in ((1, f"± RMSE, {rmse_mv:.3g} mV"), (-1, "_lower")):
        axes.axhline(side * rmse_mv, color=BLACK, linestyle="--", label=label)


def _draw_rmse_by_soc(axes: Axes, soc: Samples, error_mv: Samples) -> None:
    edges = np.linspace(0.0, 1.0, SOC_BINS + 1)
    samples = np.histogram(soc, edges)[0]
    squares = np.histogram(soc, edges, weights=error_mv**2)[0]
    is_enough = samples >= FEWEST_IN_BIN
    rmse_mv = np.full(SOC_BINS, np.nan)
    rmse_mv[is_enough] = np.sqrt(squares[is_enough] / samples[is_enough])
    for side, label in ((1, f"± RMSE in each {1 / SOC_BINS:g} of SOC"), (-1, "_lower")):
        axes.stairs(
            side * rmse_mv,
            edges,
            baseline=None,
            color=ORANGE,
            linewidth=1.6,
            label=label,
            zorder=2.5,
        )


def _frame(axes: Axes, scored_mv: Samples) -> None:
    """Limits that all but a few scored samples need, and a note on those that lie outside."""
    rmse_mv = np.sqrt(np.mean(scored_mv**2))
    few = [FEW_PERCENT, 100 - FEW_PERCENT]
    low, high = np.percentile(np.concatenate([scored_mv, [-rmse_mv, rmse_mv]]), few)
    margin = MARGIN * (high - low) or 1.0
    low, high = min(low - margin, -1.1 * rmse_mv), max(high + margin, 1.1 * rmse_mv)
    if NEARLY_INSIDE * low < scored_mv.min() and scored_mv.max() < NEARLY_INSIDE * high:
        low = min(low, scored_mv.min() - margin / 4)
        high = max(high, scored_mv.max() + margin / 4)
    outside = (scored_mv < low) | (scored_mv > high)
    axes.set_ylim(low, high)
    if outside.any():
        farthest = scored_mv[np.argmax(np.abs(scored_mv))]
        axes.set_title(
            f"outside: {np.count_nonzero(outside)} of {len(scored_mv)} scored samples, "
            f"up to {farthest:.0f} mV".replace("-", "−"),
            loc="right",
        )
