"""Tables over SOC, and temperature, with their intervals; and errors by SOC and current."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import matplotlib
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from ..cell.elements import names_beside
from .pictures import illustration
from .style import (
    BLUE,
    GREY,
    OPEN,
    SKY_BLUE,
    SOC_LABEL,
    VERMILLION,
    finish,
    finish_bar,
    is_column,
    label_plainly,
    letters_pt,
    make_figure,
    make_panels,
    name_below,
    space_columns,
    title,
)

if TYPE_CHECKING:
    from ..cell import CircuitParameters
    from ..over_soc import TableFit, TableFits
    from ..search.evaluate import Evaluation

PANELS_ACROSS: Final = 2
PANEL_IN: Final = 1.9
# Intervals beyond this many times the largest value do not set the scale.
WIDEST: Final = 1.6

Values = Float[np.ndarray, "nodes"]


@dataclass(frozen=True)
class DrawnTable:
    """One table of a fit as figures have it: in mOhm or mV, NaN where an interval is open."""

    label: str
    is_resistance: bool
    nodes: Values
    is_visited: Bool[np.ndarray, "nodes"]
    values: Values
    low: Values
    high: Values

    @property
    def scale(self) -> tuple[float, float]:
        """A scale for what samples visit, from zero for resistances."""
        shown = self.values[self.is_visited] if self.is_visited.any() else self.values
        most, least = float(shown.max()), float(shown.min())
        span = WIDEST * max(np.abs([most, least]).max(), 1e-3)
        top = max(most, float(np.nanmax(np.clip(self.high, None, span), initial=most)))
        bottom = min(least, float(np.nanmin(np.clip(self.low, -span, None), initial=least)))
        margin = 0.08 * (top - min(bottom, 0.0 if self.is_resistance else bottom) or 1.0)
        return 0.0 if self.is_resistance else bottom - margin, top + margin


def drawn_tables(fit: "TableFit") -> dict[str, DrawnTable]:
    """Every table of a fit by its name, with both ends of every node's interval."""
    nodes, found = np.array(fit.tables.nodes), {}
    for name, values in fit.tables.tables.items():
        symbol, _, unit = name.partition(" [")
        low, high = np.full((2, len(nodes)), np.nan)
        for node in fit.of_table(name):
            at = int(np.argmin(np.abs(nodes - (node.soc or 0.0))))
            low[at] = np.nan if node.low is None else 1e3 * node.low
            high[at] = np.nan if node.high is None else 1e3 * node.high
        is_resistance = unit == "Ohm]"
        found[name] = DrawnTable(
            label=f"{symbol} [{'mOhm' if is_resistance else 'mV'}]",
            is_resistance=is_resistance,
            nodes=nodes,
            is_visited=np.array(fit.tables.visited or np.ones(len(nodes)), bool),
            values=1e3 * np.array(values),
            low=low,
            high=high,
        )
    return found


@illustration(
    "The tables over the state of charge{} with the intervals of their nodes, and the constant "
    "circuit behind. Hollow: nodes without samples near them, whose values follow from those "
    "of their neighbors. Crossed: nodes with samples that do not determine the value.",
    "Resistances and OCV correction over the state of charge, with intervals",
    is_dense=False,
    is_main=True,
)
def plot_tables(fit: "TableFit", constant: "CircuitParameters | None" = None) -> Figure:
    """Every table over SOC with the intervals of its nodes, the constant circuit's value behind.

    Nodes that samples visit are filled, with their band, and crossed where the value is not
    determined; the others are hollow on a dashed line, for their values follow from their
    neighbors. What is not in the scale is said above the panel.

    Args:
        fit: Tables over SOC.
        constant: The constant circuit.

    >>> from barnax.cell import CircuitParameters
    >>> from barnax.over_soc import TableFit
    >>> tables = CircuitParameters.over_soc(
    ...     (0.0, 0.5, 1.0), (60.0,), (0.06, 0.05, 0.05), ((0.02, 0.01, 0.01),)
    ... )
    >>> fit = TableFit(tables, 1e-3, (), (), 0.0, "grid-verified", 0, (), 0, (), None, ())
    >>> [axes.get_ylabel() for axes in plot_tables(fit).axes]
    ['R0 [mOhm]', 'R1 [mOhm]']
    """
    tables = drawn_tables(fit).values()
    across = min(1 if is_column() else PANELS_ACROSS, len(tables))
    figure, panels = make_panels(len(tables), across, row_in=PANEL_IN, around_in=0.6, sharex=True)
    for axes, table in zip(panels, tables, strict=True):
        axes.set_ylabel(table.label)
        _draw_table(axes, table)
        resistance = table.label.replace("[mOhm]", "[Ohm]")
        tau = names_beside(resistance).tau
        value = None if constant is None else constant.named_ohm.get(resistance)
        if value is not None:
            label = "constant circuit"
            axes.axhline(1e3 * value, color=GREY, linewidth=1.4, zorder=1, label=label)
        if tau in fit.tables.constants:
            title(axes, f"{tau.partition(' ')[0]} = {fit.tables.constants[tau]:.3g} s")
    name_below(panels, across, SOC_LABEL)
    return finish(figure, *panels, columns=4)


def _draw_table(axes: Axes, table: DrawnTable) -> None:
    nodes, values, visited = table.nodes, table.values, table.is_visited
    known = visited & np.isfinite(table.low) & np.isfinite(table.high)
    line = {"color": BLUE, "zorder": 3}
    axes.plot(nodes, values, linestyle=(0, (3, 2)), linewidth=0.8, **line)
    axes.plot(nodes, np.where(visited, values, np.nan), linewidth=1.2, **line)
    band = {"color": SKY_BLUE, "alpha": 0.35, "linewidth": 0.0, "label": "95 % interval"}
    axes.fill_between(nodes, table.low, table.high, where=known, zorder=2, **band)
    # A node whose neighbors have no interval has no area to fill.
    ends = {"color": SKY_BLUE, "linewidth": 1.0, "zorder": 2}
    axes.vlines(nodes[known], table.low[known], table.high[known], **ends)
    style = {"linestyle": "none", "marker": "o", "markersize": 3.6, "zorder": 4, "clip_on": True}
    axes.plot(nodes[visited], values[visited], color=BLUE, label="node", **style)
    open_ended = visited & ~known
    crossed = {**style, "marker": "x", "markersize": 5.5, "color": VERMILLION}
    axes.plot(nodes[open_ended], values[open_ended], **crossed, label="not determined")
    hollow = {**OPEN, "markeredgecolor": BLUE}
    axes.plot(nodes[~visited], values[~visited], label="node without samples", **style, **hollow)
    bottom, top = table.scale
    axes.set_ylim(bottom, top)
    outside = int(np.count_nonzero((values > top) | (values < bottom)))
    if outside:
        named = "1 node" if outside == 1 else f"{outside} nodes"
        axes.set_title(f"{named} off the scale", loc="right", fontsize=letters_pt(8))


SOC_EDGES: Final = np.linspace(0.0, 1.0, 21)
CURRENT_BINS: Final = 16
FEWEST_IN_CELL: Final = 5
# A few cells near empty can be ten times as far off as all others.
SHOWN_PERCENT: Final = 97.0


@illustration(
    "RMSE by state of charge and current, over all scored samples of the {} records.",
    "RMSE in cells of state of charge and current",
)
def plot_error_map(circuits: "Mapping[str, Sequence[Evaluation]]") -> Figure:
    """RMSE in cells of SOC and current over all scored samples, a panel a circuit, on one scale.

    Cells with fewer than five samples are empty.

    Args:
        circuits: Evaluations by the circuit's name.

    >>> from barnax import CircuitParameters, bundled_file, characterize, read_record, validate
    >>> tests = [read_record(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    >>> circuit = CircuitParameters.constant(r0=0.05, r=(0.01, 0.02), c=(1e3, 1e4))
    >>> record = read_record(bundled_file("identification"))
    >>> figure = plot_error_map({"a": [validate(record, characterize(tests), "iso-rc", circuit)]})
    >>> figure.axes[0].get_xlabel()
    'State of charge [-]'
    """
    flat = [evaluation for evaluations in circuits.values() for evaluation in evaluations]
    currents = np.concatenate(
        [evaluation.prepared.current_a[evaluation.prepared.scored] for evaluation in flat]
    )
    edges_a = np.linspace(*_rounded(float(currents.min()), float(currents.max())), CURRENT_BINS + 1)
    maps = {name: _rmse_mv(evaluations, edges_a) for name, evaluations in circuits.items()}
    known = np.concatenate([rmse_mv.compressed() for rmse_mv in maps.values()])
    top = float(np.percentile(known, SHOWN_PERCENT)) if len(known) else 1.0
    figure = make_figure(height_in=3.2)
    space_columns(figure)
    panels = np.atleast_1d(figure.subplots(1, len(maps), sharex=True, sharey=True))
    scale = ScalarMappable(Normalize(0.0, top), matplotlib.colormaps["viridis"])
    for axes, (name, rmse_mv) in zip(panels, maps.items(), strict=True):
        axes.pcolormesh(SOC_EDGES, edges_a, rmse_mv.T, cmap=scale.cmap, norm=scale.norm)
        axes.set_xlabel(SOC_LABEL)
        title(axes, name)
    panels[0].set_ylabel("Current [A]\n(discharge > 0)")
    extend = "max" if len(known) and known.max() > top else "neither"
    bar = figure.colorbar(scale, ax=list(panels), pad=0.02, aspect=30, extend=extend)
    beyond = f", up to {known.max():.3g}" if extend == "max" else ""
    bar.set_label(f"RMSE [mV]{beyond}")
    finish_bar(bar)
    for axes in panels:
        axes.set_xlim(0.0, 1.0)
    return finish(figure, *panels)


def _rounded(low: float, high: float) -> tuple[float, float]:
    """The range, with a little room where it is a point."""
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _rmse_mv(evaluations: "Sequence[Evaluation]", edges_a: np.ndarray) -> np.ma.MaskedArray:
    """RMSE of every cell, masked where there are too few samples."""
    scored = [evaluation.prepared.scored for evaluation in evaluations]
    pairs = list(zip(evaluations, scored, strict=True))
    soc = np.concatenate([evaluation.prepared.soc[chosen] for evaluation, chosen in pairs])
    current_a = np.concatenate(
        [evaluation.prepared.current_a[chosen] for evaluation, chosen in pairs]
    )
    error_mv = 1e3 * np.concatenate([evaluation.error_v[chosen] for evaluation, chosen in pairs])
    bins = (SOC_EDGES, edges_a)
    samples = np.histogram2d(soc, current_a, bins)[0]
    squares = np.histogram2d(soc, current_a, bins, weights=error_mv**2)[0]
    enough = samples >= FEWEST_IN_CELL
    return np.ma.masked_array(np.sqrt(squares / np.maximum(samples, 1)), mask=~enough)


TEMPERATURE_PANEL_IN: Final = 2.1
# States of charge that are drawn over temperature: the nodes nearest to these.
SOC: Final = (0.1, 0.3, 0.5, 0.7, 0.9)
COLORS: Final = "plasma"
# The end of the colors is too light for a line.
LIGHTEST: Final = 0.85
# Temperatures at which the interpolation is drawn.
POINTS: Final = 101


@illustration(
    "The tables of each temperature over the state of charge, with their 95 % intervals.",
    "Resistances and OCV correction over the state of charge, one line per temperature",
    is_dense=False,
    is_main=True,
)
def plot_tables_by_temperature(found: "TableFits") -> Figure:
    """Every table over SOC at the nodes that samples visit, a line with its band a temperature.

    Args:
        found: Tables of several temperatures.
    """
    degc, fits = _degc(found), [drawn_tables(fit) for fit in found.fits]
    figure, panels = _panels(len(fits[0]))
    for axes, name in zip(panels, fits[0], strict=True):
        tables = [fit[name] for fit in fits]
        for temperature, table, color in zip(degc, tables, _colors(len(degc)), strict=True):
            seen, label = table.is_visited, f"{temperature:.3g} degC"
            line = {"color": color, "marker": "o", "markersize": 3, "linewidth": 1.2}
            axes.plot(table.nodes[seen], table.values[seen], **line, label=label)
            band = table.nodes[seen], table.low[seen], table.high[seen]
            axes.fill_between(*band, color=color, alpha=0.18, linewidth=0.0)
        axes.set_ylabel(tables[0].label)
        # The scale is that of the values; a band may reach beyond it.
        values = np.concatenate([table.values[table.is_visited] for table in tables])
        margin = 0.12 * (np.ptp(values) or 1.0)
        low = 0.0 if tables[0].is_resistance else values.min() - margin
        axes.set_ylim(low, values.max() + margin)
    name_below(panels, PANELS_ACROSS, SOC_LABEL)
    return finish(figure, *panels, columns=5)


@illustration(
    "Resistances over temperature at several states of charge. Markers with 95 % intervals: "
    "measured temperatures; lines: the interpolation between them.",
    "Resistances over temperature, one line per state of charge",
    is_dense=False,
    is_main=True,
)
def plot_over_temperature(found: "TableFits") -> Figure:
    """Every resistance over temperature, a line a state of charge.

    Marks with intervals are the measured temperatures, lines what is interpolated between them.

    Args:
        found: Tables of several temperatures.
    """
    degc, fits, between = _degc(found), [drawn_tables(fit) for fit in found.fits], found.tables
    assert between is not None, "asked by _degc"
    names = [name for name, table in fits[0].items() if table.is_resistance]
    nodes, places = found.fits[0].tables.nodes, _places(found.fits)
    fine = np.linspace(degc[0], degc[-1], POINTS)
    courses = [between.at(float(at_degc)).tables for at_degc in fine]
    figure, panels = _panels(len(names))
    for axes, name in zip(panels, names, strict=True):
        values = 1e3 * np.array([[tables[name][place] for place in places] for tables in courses])
        for place, course, color in zip(places, values.T, _colors(len(places)), strict=True):
            label = f"SOC {100 * nodes[place]:g} %"
            axes.plot(fine, course, color=color, linewidth=1.2, label=label)
            for temperature, fit in zip(degc, fits, strict=True):
                table = fit[name]
                low, high = max(table.low[place], 0.0), table.high[place]
                axes.plot([temperature] * 2, [low, high], color=color)
                value = table.values[place]
                axes.plot(temperature, value, color=color, marker="o", markersize=3.6)
        axes.set_ylabel(fits[0][name].label)
        axes.margins(x=0.05)
        if values.min() > 0:
            axes.set_yscale("log")
            axes.set_ylim(values.min() / 1.5, values.max() * 1.5)
            label_plainly(axes.yaxis)
    name_below(panels, PANELS_ACROSS, "Temperature [degC]")
    return finish(figure, *panels, columns=5)


def _degc(found: "TableFits") -> tuple[float, ...]:
    if found.over_temperature is None:
        raise ValueError("these tables are of one temperature")
    return found.over_temperature.temperatures_degc


def _places(fits: "tuple[TableFit, ...]") -> list[int]:
    """The nodes nearest to `SOC` of those that samples of every temperature visit."""
    seen = np.all([fit.tables.visited for fit in fits], axis=0)
    nodes = np.array(fits[0].tables.nodes)
    known = np.flatnonzero(seen) if seen.any() else np.arange(len(nodes))
    return sorted({int(known[np.argmin(np.abs(nodes[known] - soc))]) for soc in SOC})


def _colors(count: int) -> np.ndarray:
    return matplotlib.colormaps[COLORS](np.linspace(0.0, LIGHTEST, count))


def _panels(count: int) -> tuple[Figure, list[Axes]]:
    size = {"row_in": TEMPERATURE_PANEL_IN, "around_in": 0.7}
    return make_panels(count, min(PANELS_ACROSS, count), **size, sharex=True)
