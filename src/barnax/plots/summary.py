"""The answer at a glance: measured and simulated voltage, the error, and the resistances."""

from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..cell.elements import names_beside
from .error import outside_note, scored_limits
from .pictures import illustration
from .soc_tables import drawn_tables, off_the_scale, scale_of
from .style import (
    ALONE,
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SOC_LABEL,
    VERMILLION,
    draw_line,
    finish,
    is_column,
    make_figure,
    mark_outside,
    row_looks,
    title,
)
from .voltage import choose_time_unit, draw_rows, shade_unscored

if TYPE_CHECKING:
    from ..over_soc import TableFit
    from ..search.evaluate import Evaluation

COLORS: Final = (BLUE, ORANGE, GREEN, PURPLE, VERMILLION)
# Room for the legend above the resistances.
ROOM: Final = 1.3


@illustration(
    "The answer on {}: measured and simulated voltage, the error, and the resistances over the "
    "state of charge with their 95 % intervals.",
    "Voltage and error over time, and resistances over the state of charge",
    is_main=True,
)
def plot_summary(
    evaluation: "Evaluation",
    fit: "TableFit",
) -> Figure:
    """Voltage and error over time, and the resistances with their 95 % intervals over SOC.

    Only nodes that samples visit are drawn. A constant is a line, its interval a band.

    Args:
        evaluation: The answer on a record.
        fit: The answer, `Result.fit`.

    >>> import barnax
    >>> result = barnax.identify(setup="li2023", seeds=0, trust="none", advise=False)
    >>> figure = plot_summary(result.run.identification[0], result.fit)
    >>> [axes.get_ylabel() for axes in figure.axes]
    ['Voltage [V]', 'Error [mV]', 'Resistance [mOhm]']
    """
    prepared = evaluation.prepared
    unit = choose_time_unit(prepared.time_s)
    time = prepared.time_s / unit.seconds
    figure = make_figure(height_in=6.0 if is_column() else 3.6)
    if is_column():
        grid = figure.add_gridspec(3, 1, height_ratios=[2, 1, 2])
        places = grid[0], grid[1], grid[2]
    else:
        grid = figure.add_gridspec(2, 2, height_ratios=[2, 1], width_ratios=[1.35, 1])
        places = grid[0, 0], grid[1, 0], grid[:, 1]
    voltage = figure.add_subplot(places[0])
    error = figure.add_subplot(places[1], sharex=voltage)
    over_soc = figure.add_subplot(places[2])
    rows = {ALONE: evaluation}
    draw_rows(voltage, time, slice(None), rows, row_looks(rows), is_close=False)
    title(voltage, prepared.record.name)
    _draw_error(error, evaluation, time)
    error.set_xlabel(unit.label)
    for axes in (voltage, error):
        shade_unscored(axes, time, prepared.scored)
    voltage.tick_params(labelbottom=False)
    _draw_resistances(over_soc, evaluation, fit)
    return finish(figure, voltage, error, over_soc, columns=2)


def _draw_error(axes: Axes, evaluation: "Evaluation", time: np.ndarray) -> None:
    error_mv = 1e3 * evaluation.error_v
    is_scored = evaluation.prepared.scored
    scored = error_mv[is_scored]
    draw_line(axes, time, error_mv, color=BLACK, linewidth=0.5)
    axes.axhline(0.0, color=BLACK, linewidth=0.5)
    limits = scored_limits(scored)
    mark_outside(axes, time[is_scored], scored, limits)
    title(axes, outside_note(scored, *limits))
    axes.set_ylabel("Error [mV]")


def _draw_resistances(axes: Axes, evaluation: "Evaluation", fit: "TableFit") -> None:
    prepared = evaluation.prepared
    longest_s = (1 - 1e-3) * float(np.ptp(prepared.time_s[prepared.scored]))
    soc = prepared.soc[prepared.scored]
    at_bound = {bound.name for bound in fit.at_bound}
    resistances = [table.seen for table in drawn_tables(fit).values() if table.is_resistance]
    tau_s, top = fit.tables.named_tau_s, ROOM * scale_of(resistances)[1]
    lines: list[Line2D] = []
    for table, color in zip(resistances, COLORS, strict=False):
        known = np.isfinite(table.low) & np.isfinite(table.high)
        band = {"where": known, "color": color, "alpha": 0.2, "linewidth": 0.0}
        nodes = table.nodes if table.has_nodes else np.array([soc.min(), soc.max()])
        axes.fill_between(nodes, table.low, table.high, **band)
        marker = "o" if table.has_nodes else ""
        lines += axes.plot(nodes, table.values, color=color, marker=marker, markersize=3.0)
    names = [names_beside(name).resistance.partition(" ")[0] for name in tau_s]
    # Of several records, the first may be the shorter.
    is_long = [
        seconds > longest_s and (fit.tables.is_constant or name in at_bound)
        for name, seconds in tau_s.items()
    ]
    labels = [
        f"{name}, tau {'longer than the record' if is_longer else _time(seconds)}"
        for name, seconds, is_longer in zip(names, tau_s.values(), is_long, strict=True)
    ]
    axes.legend(lines, ["R0", *labels], loc="upper center", title="shaded: 95 % intervals")
    # Room for the markers at the ends.
    axes.margins(x=0.03)
    axes.set_ylim(-0.02 * top, top)
    axes.set_xlabel(SOC_LABEL)
    axes.set_ylabel("Resistance [mOhm]")
    title(axes, off_the_scale(resistances, (0.0, top)))


def _time(seconds: float) -> str:
    return f"{seconds:.3g} s" if seconds < 1000 else f"{seconds / 60:.3g} min"
