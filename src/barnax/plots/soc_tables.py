"""Tables over SOC, and temperature, with their intervals; and errors by SOC and current."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import matplotlib
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from .style import (
    BLUE,
    GREY,
    OPEN,
    SKY_BLUE,
    figure_style,
    finish,
    finish_axes,
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
# An interval that reaches further than this many times the largest value does not set the scale.
WIDEST: Final = 1.6
BAND: Final[dict[str, Any]] = {"color": SKY_BLUE, "alpha": 0.35, "linewidth": 0.0}

Values = Float[np.ndarray, "nodes"]


@figure_style()
def plot_tables(fit: "TableFit", constant: "CircuitParameters | None" = None) -> Figure:
    """Every table over SOC with the intervals of its nodes, the constant circuit's value behind.

    Nodes that samples visit are filled, with their band; the others are hollow on a dashed line,
    for their values follow from their neighbors. What is not in the scale is said above the panel.

    >>> from barnax.cell import SocTables
    >>> from barnax.over_soc import TableFit
    >>> tables = SocTables((0.0, 0.5, 1.0), (60.0,), (0.06, 0.05, 0.05), ((0.02, 0.01, 0.01),))
    >>> fit = TableFit(tables, 1e-3, (), (), 0.0, "grid-verified", 0, (), 0, (), None, ())
    >>> [axes.get_ylabel() for axes in plot_tables(fit).axes]
    ['R0 [mOhm]', 'R1 [mOhm]']
    """
    named = fit.tables.tables
    across = min(1 if is_column() else PANELS_ACROSS, len(named))
    figure, panels = make_panels(len(named), across, row_in=PANEL_IN, around_in=0.6, sharex=True)
    taus = dict(enumerate(fit.tables.tau_s, start=1))
    for place, (axes, (name, values)) in enumerate(zip(panels, named.items(), strict=True)):
        symbol, _, unit = name.partition(" [")
        is_resistance = unit == "Ohm]"
        axes.set_ylabel(f"{symbol} [{'mOhm' if is_resistance else 'mV'}]")
        _draw_table(axes, fit, name, 1e3 * np.array(values), is_resistance)
        if constant is not None and is_resistance and place <= constant.pairs:
            value = (constant.r0, *constant.r)[place]
            label = "constant circuit"
            axes.axhline(1e3 * value, color=GREY, linewidth=1.4, zorder=1, label=label)
        if is_resistance and place in taus:
            title(axes, f"tau{place} = {taus[place]:.3g} s")
    name_below(panels, across, "State of charge [-]")
    return finish(figure, *panels, columns=4)


def node_intervals(fit: "TableFit", name: str) -> tuple[Values, Values]:
    """Both ends of every node's interval in mOhm or mV, NaN where it is open or unknown."""
    nodes = np.array(fit.tables.nodes)
    low, high = np.full((2, len(nodes)), np.nan)
    for each in fit.of_table(name):
        at = int(np.argmin(np.abs(nodes - (each.soc or 0.0))))
        low[at] = np.nan if each.low is None else 1e3 * each.low
        high[at] = np.nan if each.high is None else 1e3 * each.high
    return low, high


def _draw_table(
    axes: Axes, fit: "TableFit", name: str, values: Values, is_resistance: bool
) -> None:
    nodes = np.array(fit.tables.nodes)
    visited = np.array(fit.tables.visited or np.ones(len(nodes)), bool)
    low, high = node_intervals(fit, name)
    known = visited & np.isfinite(low) & np.isfinite(high)
    line = {"color": BLUE, "zorder": 3}
    axes.plot(nodes, values, linestyle=(0, (3, 2)), linewidth=0.8, **line)
    axes.plot(nodes, np.where(visited, values, np.nan), linewidth=1.2, **line)
    axes.fill_between(nodes, low, high, where=known, zorder=2, label="95 % interval", **BAND)
    # A node between two without an interval has no area to fill.
    axes.vlines(nodes[known], low[known], high[known], color=SKY_BLUE, linewidth=1.0, zorder=2)
    style = {"linestyle": "none", "marker": "o", "markersize": 3.6, "zorder": 4, "clip_on": True}
    axes.plot(nodes[visited], values[visited], color=BLUE, label="node", **style)
    hollow = {**OPEN, "markeredgecolor": BLUE}
    axes.plot(nodes[~visited], values[~visited], label="node without samples", **style, **hollow)
    bottom, top = scale_of(values, visited, low, high, is_resistance)
    axes.set_ylim(bottom, top)
    outside = int(np.count_nonzero((values > top) | (values < bottom)))
    if outside:
        named = "1 node" if outside == 1 else f"{outside} nodes"
        axes.set_title(f"{named} off the scale", loc="right", fontsize=letters_pt(8))


def scale_of(
    values: Values,
    visited: Bool[np.ndarray, "nodes"],
    low: Values,
    high: Values,
    is_resistance: bool,
) -> tuple[float, float]:
    """A scale for what samples visit, from zero for resistances."""
    shown = values[visited] if visited.any() else values
    most, least = float(shown.max()), float(shown.min())
    span = WIDEST * max(np.abs([most, least]).max(), 1e-3)
    top = max(most, float(np.nanmax(np.clip(high, None, span), initial=most)))
    bottom = min(least, float(np.nanmin(np.clip(low, -span, None), initial=least)))
    margin = 0.08 * (top - min(bottom, 0.0 if is_resistance else bottom) or 1.0)
    return 0.0 if is_resistance else bottom - margin, top + margin


SOC_EDGES: Final = np.linspace(0.0, 1.0, 21)
CURRENT_BINS: Final = 16
FEWEST_IN_CELL: Final = 5
# A few cells near empty can be ten times as far off as all others.
SHOWN_PERCENT: Final = 97.0


@figure_style()
def plot_error_map(circuits: "Mapping[str, Sequence[Evaluation]]") -> Figure:
    """RMSE in cells of SOC and current over all scored samples, a panel a circuit, on one scale.

    Cells with fewer than five samples are empty. `circuits` are evaluations by the circuit's name.

    >>> from barnax import CircuitParameters, bundled_file, characterize, read_record, validate
    >>> tests = [read_record(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    >>> circuit = CircuitParameters(r0=0.05, r=(0.01, 0.02), c=(1e3, 1e4))
    >>> record = read_record(bundled_file("identification"))
    >>> figure = plot_error_map({"a": [validate(record, characterize(tests), "iso-rc", circuit)]})
    >>> figure.axes[0].get_xlabel()
    'State of charge [-]'
    """
    flat = [each for evaluations in circuits.values() for each in evaluations]
    currents = np.concatenate([each.prepared.current_a[each.prepared.scored] for each in flat])
    edges_a = np.linspace(*_rounded(float(currents.min()), float(currents.max())), CURRENT_BINS + 1)
    maps = {name: _rmse_mv(evaluations, edges_a) for name, evaluations in circuits.items()}
    known = np.concatenate([each.compressed() for each in maps.values()])
    top = float(np.percentile(known, SHOWN_PERCENT)) if len(known) else 1.0
    figure = make_figure(height_in=3.2)
    space_columns(figure)
    panels = np.atleast_1d(figure.subplots(1, len(maps), sharex=True, sharey=True))
    scale = ScalarMappable(Normalize(0.0, top), matplotlib.colormaps["viridis"])
    for axes, (name, rmse_mv) in zip(panels, maps.items(), strict=True):
        axes.pcolormesh(SOC_EDGES, edges_a, rmse_mv.T, cmap=scale.cmap, norm=scale.norm)
        axes.set_xlabel("State of charge [-]")
        title(axes, name)
    panels[0].set_ylabel("Current [A]\n(discharge > 0)")
    extend = "max" if len(known) and known.max() > top else "neither"
    bar = figure.colorbar(scale, ax=list(panels), pad=0.02, aspect=30, extend=extend)
    beyond = f", up to {known.max():.3g}" if extend == "max" else ""
    bar.set_label(f"RMSE [mV]{beyond}")
    finish_bar(bar)
    finish_axes(*panels)
    for axes in panels:
        axes.set_xlim(0.0, 1.0)
    return figure


def _rounded(low: float, high: float) -> tuple[float, float]:
    """The range, with a little room where it is a point."""
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _rmse_mv(evaluations: "Sequence[Evaluation]", edges_a: np.ndarray) -> np.ma.MaskedArray:
    """RMSE of every cell, masked where there are too few samples."""
    scored = [each.prepared.scored for each in evaluations]
    pairs = list(zip(evaluations, scored, strict=True))
    soc = np.concatenate([each.prepared.soc[chosen] for each, chosen in pairs])
    current_a = np.concatenate([each.prepared.current_a[chosen] for each, chosen in pairs])
    error_mv = 1e3 * np.concatenate([each.error_v[chosen] for each, chosen in pairs])
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
# What is interpolated is drawn at so many temperatures.
POINTS: Final = 101


@figure_style()
def plot_tables_by_temperature(found: "TableFits") -> Figure:
    """Every table over SOC at the nodes that samples visit, a line with its band a temperature."""
    degc, fits = _degc(found), found.fits
    named = fits[0].tables.tables
    figure, panels = _panels(len(named))
    colors = _colors(len(degc))
    for axes, name in zip(panels, named, strict=True):
        for temperature, fit, color in zip(degc, fits, colors, strict=True):
            soc, value, low, high = _visited(fit, name)
            label = f"{temperature:.3g} degC"
            axes.plot(soc, value, color=color, marker="o", markersize=3, linewidth=1.2, label=label)
            axes.fill_between(soc, low, high, color=color, alpha=0.18, linewidth=0.0)
        is_resistance = name.endswith("[Ohm]")
        axes.set_ylabel(f"{name.partition(' [')[0]} [{'mOhm' if is_resistance else 'mV'}]")
        _limit(axes, [_visited(fit, name)[1] for fit in fits], is_resistance)
    name_below(panels, PANELS_ACROSS, "State of charge [-]")
    return finish(figure, *panels, columns=5)


@figure_style()
def plot_over_temperature(found: "TableFits") -> Figure:
    """Every resistance over temperature, a line a state of charge.

    Marks with intervals are the measured temperatures, lines what is interpolated between them.
    """
    degc, fits, tables = _degc(found), found.fits, found.tables
    assert tables is not None, "asked by _degc"
    names = [name for name in fits[0].tables.tables if name.endswith("[Ohm]")]
    nodes, places = fits[0].tables.nodes, _places(fits)
    fine = np.linspace(degc[0], degc[-1], POINTS)
    between = [tables.at(float(each)).tables for each in fine]
    figure, panels = _panels(len(names))
    colors = _colors(len(places))
    for axes, name in zip(panels, names, strict=True):
        for place, color in zip(places, colors, strict=True):
            course = [1e3 * each[name][place] for each in between]
            label = f"SOC {100 * nodes[place]:g} %"
            axes.plot(fine, course, color=color, linewidth=1.2, label=label)
            for temperature, fit in zip(degc, fits, strict=True):
                soc, value, low, high = _visited(fit, name)
                at = int(np.argmin(np.abs(soc - nodes[place])))
                if np.isfinite(low[at]) and np.isfinite(high[at]):
                    axes.plot([temperature] * 2, [max(low[at], 0.0), high[at]], color=color)
                axes.plot(temperature, value[at], color=color, marker="o", markersize=3.6)
        axes.set_ylabel(f"{name.partition(' [')[0]} [mOhm]")
        axes.margins(x=0.05)
        values = np.array([[each[name][place] for place in places] for each in between])
        if values.min() > 0:
            axes.set_yscale("log")
            axes.set_ylim(1e3 * values.min() / 1.5, 1e3 * values.max() * 1.5)
            label_plainly(axes.yaxis)
    name_below(panels, PANELS_ACROSS, "Temperature [degC]")
    return finish(figure, *panels, columns=5)


def _degc(found: "TableFits") -> tuple[float, ...]:
    if found.over_temperature is None:
        raise ValueError("these tables are of one temperature")
    return found.over_temperature.temperatures_degc


def _visited(fit: "TableFit", name: str) -> tuple[np.ndarray, ...]:
    """SOC, value, and interval of a table at the visited nodes, in mOhm or mV; NaN where open."""
    known = {each.soc: each for each in fit.of_table(name)}
    rows = []
    for soc, value, seen in zip(
        fit.tables.nodes, fit.tables.tables[name], fit.tables.visited, strict=True
    ):
        each = known.get(soc)
        ends = (None, None) if each is None else (each.low, each.high)
        rows += [(soc, value, *ends)] if seen else []
    soc, *values = np.array(rows, float).T
    return soc, *(1e3 * each for each in values)


def _places(fits: "tuple[TableFit, ...]") -> list[int]:
    """The nodes nearest to `SOC` of those that samples of every temperature visit."""
    seen = np.all([fit.tables.visited for fit in fits], axis=0)
    nodes = np.array(fits[0].tables.nodes)
    known = np.flatnonzero(seen) if seen.any() else np.arange(len(nodes))
    return sorted({int(known[np.argmin(np.abs(nodes[known] - soc))]) for soc in SOC})


def _limit(axes: Axes, values: list[np.ndarray], is_resistance: bool) -> None:
    """A scale of the values: a band may reach beyond it."""
    flat = np.concatenate(values)
    low, high = float(flat.min()), float(flat.max())
    margin = 0.12 * ((high - low) or 1.0)
    axes.set_ylim(0.0 if is_resistance else low - margin, high + margin)


def _colors(count: int) -> np.ndarray:
    return matplotlib.colormaps[COLORS](np.linspace(0.0, LIGHTEST, count))


def _panels(count: int) -> tuple[Figure, list[Axes]]:
    size = {"row_in": TEMPERATURE_PANEL_IN, "around_in": 0.7}
    return make_panels(count, min(PANELS_ACROSS, count), **size, sharex=True)
