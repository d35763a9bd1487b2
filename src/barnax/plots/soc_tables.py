"""Tables over SOC, and temperature, with their intervals; and the answer at a glance."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..cell.elements import names_beside
from ..cell.parameters import HALF_HYSTERESIS, OCV
from ..errors import counted
from . import style
from .error import outside_note, scored_limits
from .voltage import Clock, Rows, Samples, draw_rows, shade_unscored

if TYPE_CHECKING:
    from ..cell import CircuitParameters
    from ..fit.node_interval import Fact
    from ..fit.table_fit import TableFit
    from ..fit.temperature_fits import TableFits
    from ..search.evaluate import Evaluation

PANELS_ACROSS: Final = 2
# Height of a row of panels, and of the space around all of them.
HEIGHTS_IN: Final = (1.9, 0.6)
# Values that set no scale may extend it to this many times the largest value that does.
WIDEST: Final = 1.6
# Resistances above this many times the median set no scale.
FAR: Final = 8.0
# Values off a scale are listed beside a time constant, in lines of this many characters.
LETTERS: Final = 34
# The axis label of a hysteresis.
HALF: Final = HALF_HYSTERESIS.partition(" [")[0]


# For a node: the SOC, whether samples visit it without determining it, and its value with the ends
# of its interval.
NODE: Final = np.dtype(
    [("soc", float), ("is_visited", bool), ("is_open", bool)]
    + [(name, float) for name in ("value", "low", "high")]
)


@dataclass(frozen=True)
class DrawnTable:
    """One table of a fit as drawn in figures.

    Attributes:
        label: Its name, with the unit of its values.
        is_resistance: True if it is in mOhm.
        nodes: One `NODE` each, NaN at an open end of the interval; for one value at every SOC, both
            ends of the SOC range.
        has_nodes: True unless it has one value at every SOC.
    """

    label: str
    is_resistance: bool
    nodes: np.ndarray
    has_nodes: bool

    @property
    def seen(self) -> "DrawnTable":
        """The table at the nodes that samples visit."""
        return replace(self, nodes=self.nodes[self.nodes["is_visited"]])


def drawn_tables(fit: "TableFit") -> dict[str, DrawnTable]:
    """Every table of a fit by its name, with both ends of every node's interval; and a fitted OCV,
    which has its own nodes."""
    rows: dict[str, list[Fact]] = {}
    for fact in fit.facts:
        if not fact.is_mean and fact.name in (*fit.tables.tables, OCV):
            rows.setdefault(fact.name, []).append(fact)
    return {name: _drawn(name, facts) for name, facts in rows.items()}


def _drawn(name: str, facts: "Sequence[Fact]") -> DrawnTable:
    symbol, _, unit = name.partition(" [")
    scale, shown = (1.0, "V") if name == OCV else (1e3, f"m{unit.rstrip(']')}")
    rows = [(fact.soc, fact.value, fact.low, fact.high) for fact in facts]
    soc, *values = np.array(rows, float).T
    is_open = [fact.is_assessed and fact.low is None and fact.high is None for fact in facts]
    if unit == "Ohm]":
        # A resistance with only an upper end is between zero and that.
        values[1] = np.where(np.isnan(values[1]) & np.isfinite(values[2]), 0.0, values[1])
    visited = [fact.is_visited for fact in facts]
    columns = [soc, visited, is_open, *(scale * column for column in values)]
    nodes = np.rec.fromarrays(columns, NODE)
    if len(facts) == 1:
        nodes = np.repeat(nodes, 2)
        nodes["soc"] = 0.0, 1.0
    return DrawnTable(f"{symbol} [{shown}]", unit == "Ohm]", nodes, len(facts) > 1)


def scale_of(tables: Sequence[DrawnTable]) -> tuple[float, float]:
    """One scale for tables at the nodes that samples visit, from zero except for OCVs: from the
    nodes that the data determine, with an interval narrower than the value, and that are not far
    above the others."""
    seen = [table.seen if table.nodes["is_visited"].any() else table for table in tables]
    nodes = np.concatenate([table.nodes for table in seen])
    values, low, high = nodes["value"], nodes["low"], nodes["high"]
    is_resistance = tables[0].is_resistance
    # All constants are shown.
    are_some = is_resistance and tables[0].has_nodes
    sets = high - low <= values if are_some else np.full(len(values), True)
    sets = sets if sets.any() else ~sets
    if are_some:
        sets &= values <= FAR * np.median(values[sets])
    span = WIDEST * max(np.abs(values[sets]).max(), 1e-3)
    ends = np.clip(np.concatenate([low[sets], high[sets]]), -span, span)
    reached = np.concatenate([ends, values[np.abs(values) <= span]])
    bottom, top = float(np.nanmin(reached)), float(np.nanmax(reached))
    if is_resistance or tables[0].label.startswith(HALF):
        return 0.0, 1.08 * top or 1.0
    margin = 0.08 * (top - bottom or 1.0)
    return bottom - margin, top + margin


def off_the_scale(
    tables: Sequence[DrawnTable], limits: tuple[float, float], constant: float | None = None
) -> str:
    """The nodes outside the limits, how many of them are extrapolated, and the constant circuit's
    value; empty if there are none."""
    bottom, top = limits
    nodes = np.concatenate([table.nodes for table in tables])
    is_outside = (nodes["value"] < bottom) | (nodes["value"] > top)
    values, is_visited = nodes["value"][is_outside], nodes["is_visited"][is_outside]
    unit = tables[0].label.partition("[")[2].rstrip("]")
    reasons = []
    if is_visited.any():
        at = "at" if is_visited.sum() == 1 else "up to"
        farthest = max(values[is_visited], key=abs)
        reasons.append(f"{counted(is_visited.sum(), 'node')} {at} {farthest:.3g} {unit}")
    if not is_visited.all():
        reasons.append(counted(np.sum(~is_visited), "extrapolated node"))
    if constant is not None and not bottom <= constant <= top:
        reasons.append(f"constant circuit at {constant:.3g} {unit}")
    return f"off scale: {', '.join(reasons)}" if reasons else ""


@style.figure_style()
def plot_tables(fit: "TableFit", constant: "CircuitParameters | None" = None) -> Figure:
    """Every table over SOC with the intervals of its nodes, the constant circuit's value behind.

    Nodes that samples visit are filled, with their band, and crossed if the value is not
    determined; the others are hollow on a dashed line, because their values depend on their
    neighbors. Values outside the scale are given above the panel.

    Args:
        fit: Tables over SOC.
        constant: The constant circuit.

    >>> from barnax import TableFit
    >>> from barnax.cell import CircuitParameters
    >>> tables = CircuitParameters.over_soc(
    ...     (0.0, 0.5, 1.0), (60.0,), (0.06, 0.05, 0.05), ((0.02, 0.01, 0.01),)
    ... )
    >>> fit = TableFit(tables, 1e-3, (), (), 0.0, "grid-verified", 0, (), 0, (), None, ())
    >>> [axes.get_ylabel() for axes in plot_tables(fit).axes]
    ['R0 [mOhm]', 'R1 [mOhm]']
    """
    tables, ohm = drawn_tables(fit), {} if constant is None else constant.named_ohm
    across = min(1 if style.is_column() else PANELS_ACROSS, len(tables))
    figure, panels = style.make_panels(
        len(tables), across, HEIGHTS_IN, style.SOC_LABEL, sharex=True
    )
    for axes, (name, table) in zip(panels, tables.items(), strict=True):
        axes.set_ylabel(table.label)
        _draw_table(axes, table)
        value = 1e3 * ohm[name] if name in ohm else None
        if value is not None:
            # Drawn over the range of the visited nodes, if there are any.
            shown = table.seen if table.nodes["is_visited"].any() else table
            look = {"color": style.GREY, "linewidth": 1.4, "zorder": 1}
            axes.plot(shown.nodes["soc"][[0, -1]], [value] * 2, **look, label="constant circuit")
        limits = scale_of([table])
        axes.set_ylim(limits)
        outside = textwrap.fill(off_the_scale([table], limits, value), LETTERS)
        axes.set_title(outside, loc="right", fontsize=style.letters_pt(8))
        tau = names_beside(name).tau
        if tau in fit.tables.constants:
            style.title(axes, f"{tau.partition(' ')[0]} = {fit.tables.constants[tau]:.3g} s")
    return style.finish(figure, *panels, columns=4)


def _draw_table(axes: Axes, table: DrawnTable) -> None:
    nodes, is_visited = table.nodes, table.nodes["is_visited"]
    is_bounded = is_visited & np.isfinite(nodes["low"]) & np.isfinite(nodes["high"])
    bounded = nodes[is_bounded]
    line: dict[str, Any] = {"color": style.BLUE, "zorder": 3}
    axes.plot(nodes["soc"], nodes["value"], linestyle=(0, (3, 2)), linewidth=0.8, **line)
    axes.plot(nodes["soc"], np.where(is_visited, nodes["value"], np.nan), linewidth=1.2, **line)
    band: dict[str, Any] = {**style.BAND, "label": "95 % interval"}
    axes.fill_between(nodes["soc"], nodes["low"], nodes["high"], where=is_bounded, zorder=2, **band)
    # A node whose neighbors have no interval has no area to fill.
    ends: dict[str, Any] = {"color": style.SKY_BLUE, "linewidth": 1.0, "zorder": 2}
    axes.vlines(bounded["soc"], bounded["low"], bounded["high"], **ends)
    dot: dict[str, Any] = {"marker": "o", "markersize": 3.6, "color": style.BLUE}
    cross: dict[str, Any] = {"marker": "x", "markersize": 5.5, "color": style.VERMILLION}
    hollow: dict[str, Any] = {**dot, **style.OPEN, "markeredgecolor": style.BLUE}
    for label, is_drawn, mark in (
        ("node", is_visited & table.has_nodes, dot),
        ("not determined", is_visited & nodes["is_open"], cross),
        ("node without samples", ~is_visited, hollow),
    ):
        if is_drawn.any():
            drawn = nodes[is_drawn]
            axes.plot(drawn["soc"], drawn["value"], label=label, linestyle="none", zorder=4, **mark)


TALL_IN: Final = (2.1, 0.7)
# States of charge for plots over temperature: the nodes nearest to these.
SOC: Final = (0.1, 0.3, 0.5, 0.7, 0.9)
COLORS: Final = "plasma"
# The end of the colors is too light for a line.
LIGHTEST: Final = 0.85
# Markers at one temperature are separated by this share of the range.
APART: Final = 0.012
BETWEEN: Final[dict[str, Any]] = {"linewidth": 0.8, "linestyle": (0, (5, 3))}
# Intervals extend a logarithmic scale up to this factor.
WIDEST_LOG: Final = 3.0
# Temperatures at which the interpolation is drawn.
POINTS: Final = 101


@style.figure_style()
def plot_over_temperature(table_fits: "TableFits") -> Figure:
    """Every resistance over temperature, one line per state of charge.

    Markers with intervals are the measured temperatures, drawn slightly apart so that none hides
    another; dashed lines are interpolated. Raises `ValueError` for tables at one temperature.

    Args:
        table_fits: Tables at several temperatures.
    """
    over, between = table_fits.over_temperature, table_fits.tables
    if over is None or between is None:
        raise ValueError("these tables are of one temperature")
    degc, fits = np.array(over.temperatures_degc), [drawn_tables(fit) for fit in table_fits.fits]
    names = [name for name, table in fits[0].items() if table.is_resistance]
    chosen = _chosen_nodes(table_fits.fits)
    colors = matplotlib.colormaps[COLORS](np.linspace(0.0, LIGHTEST, len(chosen)))
    fine = np.linspace(degc[0], degc[-1], POINTS)
    courses = [between.at(float(at_degc)).tables for at_degc in fine]
    figure, panels = style.make_panels(
        len(names), min(PANELS_ACROSS, len(names)), TALL_IN, "Temperature [degC]", sharex=True
    )
    for axes, name in zip(panels, names, strict=True):
        ohm = np.array([tables[name] for tables in courses])[:, chosen]
        for number, (node, color) in enumerate(zip(chosen, colors, strict=True)):
            axes.plot(fine, 1e3 * ohm[:, number], color=color, **BETWEEN)
            at = np.stack([fit[name].nodes[node] for fit in fits])
            reach = np.maximum([at["value"] - at["low"], at["high"] - at["value"]], 0.0)
            apart = APART * (fine[-1] - fine[0]) * (number - (len(chosen) - 1) / 2)
            look = {"fmt": "o", "color": color, "markersize": 3.6}
            label = f"SOC {100 * table_fits.fits[0].tables.nodes[node]:g} %"
            axes.errorbar(degc + apart, at["value"], reach, **look, label=label)
        axes.plot([], [], color=style.GREY, **BETWEEN, label="interpolated")
        axes.margins(x=0.05)
        axes.set_ylabel(fits[0][name].label)
        if ohm.min() > 0:
            axes.set(yscale="log", ylabel=f"{fits[0][name].label}\n(log scale)")
            low, high = axes.get_ylim()
            least, most = 1e3 * ohm.min() / WIDEST_LOG, 1e3 * ohm.max() * WIDEST_LOG
            axes.set_ylim(max(low, least), min(high, most))
            style.label_plainly(axes.yaxis)
    return style.finish(figure, *panels, columns=3)


def _chosen_nodes(fits: "Sequence[TableFit]") -> list[int]:
    """The nodes nearest to `SOC` among those that samples visit at every temperature."""
    is_seen = np.all([fit.tables.visited for fit in fits], axis=0)
    nodes = np.array(fits[0].tables.nodes)
    candidates = np.flatnonzero(is_seen) if is_seen.any() else np.arange(len(nodes))
    return sorted({int(candidates[np.argmin(np.abs(nodes[candidates] - soc))]) for soc in SOC})


SUMMARY_COLORS: Final = (style.BLUE, style.ORANGE, style.GREEN, style.PURPLE, style.VERMILLION)
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
    >>> result = barnax.identify(setup="li2023", seeds=0, trust="none")
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
    for table, color in zip(tables, SUMMARY_COLORS, strict=False):
        nodes = table.nodes
        is_bounded = np.isfinite(nodes["low"]) & np.isfinite(nodes["high"])
        band = {"where": is_bounded, "color": color, "alpha": 0.2, "linewidth": 0.0}
        at_soc = nodes["soc"] if table.has_nodes else np.array([soc.min(), soc.max()])
        axes.fill_between(at_soc, nodes["low"], nodes["high"], **band)
        marker = "o" if table.has_nodes else ""
        lines += axes.plot(at_soc, nodes["value"], color=color, marker=marker, markersize=3.0)
    longest_s = (1 - 1e-3) * float(np.ptp(evaluation.prepared.time_s[scored]))
    at_bound = {bound.name for bound in fit.at_bound}
    labels = ["R0"]
    for tau, tau_s in fit.tables.named_tau_s.items():
        name = names_beside(tau).resistance.partition(" ")[0]
        # The first of several records may be shorter than another.
        is_long = tau_s > longest_s and (fit.tables.is_constant or tau in at_bound)
        shown = f"{tau_s:.3g} s" if tau_s < 1000 else f"{tau_s / 60:.3g} min"
        labels.append(f"{name}, tau {'longer than the record' if is_long else shown}")
    axes.legend(lines, labels, loc="upper center", title="shaded: 95 % intervals")
    # Room for the markers at the ends.
    axes.margins(x=0.03)
    axes.set_ylim(-0.02 * top, top)
    axes.set(xlabel=style.SOC_LABEL, ylabel="Resistance [mOhm]")
    style.title(axes, off_the_scale(tables, (0.0, top)))
