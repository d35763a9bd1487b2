"""Circuits with tables over SOC: the tables with their intervals, and errors by SOC and current."""

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
    letters_pt,
    make_figure,
    space_columns,
    title,
)

if TYPE_CHECKING:
    from ..cell import CircuitParameters
    from ..over_soc import TableFit
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
    rows = -(-len(named) // across)
    figure = make_figure(height_in=0.6 + PANEL_IN * rows)
    panels = figure.subplots(rows, across, sharex=True, squeeze=False).ravel()
    taus = dict(enumerate(fit.tables.tau_s, start=1))
    for place, (axes, (name, values)) in enumerate(zip(panels, named.items(), strict=False)):
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
    for axes in panels[len(named) :]:
        axes.remove()
    for axes in panels[max(len(named) - across, 0) : len(named)]:
        axes.set_xlabel("State of charge [-]")
        axes.tick_params(labelbottom=True)
    return finish(figure, *panels[: len(named)], columns=4)


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
