"""The answer at a glance: measured and simulated voltage, the error, and the resistances."""

from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..cell.elements import names_beside
from . import style
from .error import outside_note, scored_limits
from .soc_tables import drawn_tables, off_the_scale, scale_of
from .voltage import Clock, Rows, Samples, draw_rows, shade_unscored

if TYPE_CHECKING:
    from ..over_soc import TableFit
    from ..search.evaluate import Evaluation

COLORS: Final = (style.BLUE, style.ORANGE, style.GREEN, style.PURPLE, style.VERMILLION)
# Room for the legend above the resistances.
ROOM: Final = 1.3


@style.figure_style()
def plot_summary(evaluation: "Evaluation", fit: "TableFit") -> Figure:
    """Voltage and error over time, and the resistances with their 95 % intervals over SOC.

    Only nodes that samples visit are drawn. A constant is a line, its interval a band.

    Args:
        evaluation: The answer on a record.
        fit: The answer, `Result.fit`.

    >>> import barnax
    >>> result = barnax.identify(setup="li2023", seeds=0, trust="none", advise=False)
    >>> figure = plot_summary(result.evaluations.identification[0], result.fit)
    >>> [axes.get_ylabel() for axes in figure.axes]
    ['Voltage [V]', 'Error [mV]', 'Resistance [mOhm]']
    """
    rows = Rows(evaluation, 1)
    clock = Clock(rows.prepared.time_s)
    figure = style.make_figure(height_in=6.0 if style.is_column() else 3.6)
    if style.is_column():
        grid = figure.add_gridspec(3, 1, height_ratios=[2, 1, 2])
        cells = grid[0], grid[1], grid[2]
    else:
        grid = figure.add_gridspec(2, 2, height_ratios=[2, 1], width_ratios=[1.35, 1])
        cells = grid[0, 0], grid[1, 0], grid[:, 1]
    voltage = figure.add_subplot(cells[0])
    error = figure.add_subplot(cells[1], sharex=voltage)
    over_soc = figure.add_subplot(cells[2])
    draw_rows(voltage, rows, clock.time, slice(None), is_close=False)
    style.title(voltage, rows.title)
    _draw_error(error, evaluation, clock.time)
    error.set_xlabel(clock.label)
    for axes in (voltage, error):
        shade_unscored(axes, clock.time, rows.prepared.scored)
    voltage.tick_params(labelbottom=False)
    _draw_resistances(over_soc, evaluation, fit)
    return style.finish(figure, voltage, error, over_soc, columns=2)


def _draw_error(axes: Axes, evaluation: "Evaluation", time: Samples) -> None:
    error_mv, is_scored = 1e3 * evaluation.error_v, evaluation.prepared.scored
    scored = error_mv[is_scored]
    style.draw_line(axes, time, error_mv, color=style.BLACK, linewidth=0.5)
    axes.axhline(0.0, color=style.BLACK, linewidth=0.5)
    limits = scored_limits(scored)
    style.mark_outside(axes, time[is_scored], scored, limits)
    style.title(axes, outside_note(scored, *limits))
    axes.set_ylabel("Error [mV]")


def _draw_resistances(axes: Axes, evaluation: "Evaluation", fit: "TableFit") -> None:
    scored = evaluation.prepared.scored
    soc = evaluation.prepared.soc[scored]
    tables = [table.seen for table in drawn_tables(fit).values() if table.is_resistance]
    top = ROOM * scale_of(tables)[1]
    lines: list[Line2D] = []
    for table, color in zip(tables, COLORS, strict=False):
        nodes = table.nodes
        is_known = np.isfinite(nodes["low"]) & np.isfinite(nodes["high"])
        band = {"where": is_known, "color": color, "alpha": 0.2, "linewidth": 0.0}
        at_soc = nodes["soc"] if table.has_nodes else np.array([soc.min(), soc.max()])
        axes.fill_between(at_soc, nodes["low"], nodes["high"], **band)
        marker = "o" if table.has_nodes else ""
        lines += axes.plot(at_soc, nodes["value"], color=color, marker=marker, markersize=3.0)
    longest_s = (1 - 1e-3) * float(np.ptp(evaluation.prepared.time_s[scored]))
    at_bound = {bound.name for bound in fit.at_bound}
    labels = ["R0"]
    for tau, tau_s in fit.tables.named_tau_s.items():
        name = names_beside(tau).resistance.partition(" ")[0]
        # Of several records, the first may be the shorter.
        is_long = tau_s > longest_s and (fit.tables.is_constant or tau in at_bound)
        shown = f"{tau_s:.3g} s" if tau_s < 1000 else f"{tau_s / 60:.3g} min"
        labels.append(f"{name}, tau {'longer than the record' if is_long else shown}")
    axes.legend(lines, labels, loc="upper center", title="shaded: 95 % intervals")
    # Room for the markers at the ends.
    axes.margins(x=0.03)
    axes.set_ylim(-0.02 * top, top)
    axes.set(xlabel=style.SOC_LABEL, ylabel="Resistance [mOhm]")
    style.title(axes, off_the_scale(tables, (0.0, top)))
