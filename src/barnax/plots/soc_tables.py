"""Tables over SOC, and temperature, with their intervals."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import matplotlib
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..cell.elements import names_beside
from ..cell.parameters import HALF_HYSTERESIS, OCV
from ..errors import counted
from .pictures import illustration
from .style import (
    BLUE,
    GREY,
    OPEN,
    SKY_BLUE,
    SOC_LABEL,
    VERMILLION,
    finish,
    is_column,
    label_plainly,
    letters_pt,
    make_panels,
    name_below,
    title,
)

if TYPE_CHECKING:
    from ..cell import CircuitParameters
    from ..over_soc import TableFit, TableFits

PANELS_ACROSS: Final = 2
PANEL_IN: Final = 1.9
# What sets no scale may extend it to this many times the largest value that does.
WIDEST: Final = 1.6
# Resistances over this many times the median set no scale.
FAR: Final = 8.0
# What is off a scale stands beside a time constant, in lines of so many letters.
LETTERS: Final = 34
# What a hysteresis is called on its axis.
HALF: Final = HALF_HYSTERESIS.partition(" [")[0]

Values = Float[np.ndarray, "nodes"]


@dataclass(frozen=True)
class DrawnTable:
    """One table of a fit as figures have it: in the unit of its label, NaN where an interval is
    open."""

    label: str
    is_resistance: bool
    nodes: Values
    is_visited: Bool[np.ndarray, "nodes"]
    values: Values
    low: Values
    high: Values
    has_nodes: bool = True

    @property
    def at_every_soc(self) -> "DrawnTable":
        """The one value of a table at both ends of the SOC."""
        rows = ("is_visited", "values", "low", "high")
        both = {row: np.repeat(getattr(self, row), 2) for row in rows}
        return replace(self, nodes=np.array([0.0, 1.0]), has_nodes=False, **both)

    @property
    def seen(self) -> "DrawnTable":
        """The table at the nodes that samples visit."""
        rows = ("nodes", "is_visited", "values", "low", "high")
        return replace(self, **{row: getattr(self, row)[self.is_visited] for row in rows})


def scale_of(tables: Sequence[DrawnTable]) -> tuple[float, float]:
    """One scale for tables at the nodes that samples visit, from zero but for OCVs: of those
    that the data determine, with an interval narrower than the value, and that are not far above
    the others."""
    seen = [table.seen if table.is_visited.any() else table for table in tables]
    values, low, high = (_rows(seen, name) for name in ("values", "low", "high"))
    is_resistance = tables[0].is_resistance
    # Of constants, all are shown.
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
    value; empty where none is."""
    bottom, top = limits
    values, is_visited = _rows(tables, "values"), _rows(tables, "is_visited")
    is_outside = (values < bottom) | (values > top)
    seen, others = values[is_outside & is_visited], values[is_outside & ~is_visited]
    unit, told = tables[0].label.partition("[")[2].rstrip("]"), []
    if len(seen):
        at = "at" if len(seen) == 1 else "up to"
        told.append(f"{counted(len(seen), 'node')} {at} {max(seen, key=abs):.3g} {unit}")
    if len(others):
        told.append(counted(len(others), "extrapolated node"))
    if constant is not None and not bottom <= constant <= top:
        told.append(f"constant circuit at {constant:.3g} {unit}")
    return f"off scale: {', '.join(told)}" if told else ""


def _rows(tables: Sequence[DrawnTable], name: str) -> np.ndarray:
    return np.concatenate([getattr(table, name) for table in tables])


def drawn_tables(fit: "TableFit") -> dict[str, DrawnTable]:
    """Every table of a fit by its name, with both ends of every node's interval; and the OCV of the
    records' own, which has nodes of its own."""
    nodes = np.array(fit.tables.nodes)
    visited = np.array(fit.tables.visited or np.ones(len(nodes)), bool)
    found = {
        name: _drawn(fit, name, nodes, visited, np.array(values))
        for name, values in fit.tables.tables.items()
    }
    if own := fit.of_table(OCV):
        nodes, values_v = np.array([(node.soc, node.value) for node in own], float).T
        found[OCV] = _drawn(fit, OCV, nodes, np.full(len(nodes), True), values_v)
    return found


def _drawn(
    fit: "TableFit", name: str, nodes: Values, visited: Bool[np.ndarray, "nodes"], values: Values
) -> DrawnTable:
    symbol, _, unit = name.partition(" [")
    scale, shown = (1.0, "V") if name == OCV else (1e3, f"m{unit.rstrip(']')}")
    low, high = np.full((2, len(nodes)), np.nan)
    for node in fit.of_table(name):
        at = int(np.argmin(np.abs(nodes - (node.soc or 0.0))))
        low[at] = np.nan if node.low is None else scale * node.low
        high[at] = np.nan if node.high is None else scale * node.high
    label = f"{symbol} [{shown}]"
    table = DrawnTable(label, unit == "Ohm]", nodes, visited, scale * values, low, high)
    return table if len(nodes) > 1 else table.at_every_soc


@illustration(
    "Resistances{}, and the OCV where it was fitted, over the state of charge with 95 % intervals; "
    "the constant circuit in grey. Hollow: nodes without samples near them, whose values follow "
    "from those of their neighbors. Crossed: values that the samples there do not determine.",
    "Resistances, and OCV where it was fitted, over the state of charge, with intervals",
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
    tables, ohm = drawn_tables(fit).values(), {} if constant is None else constant.named_ohm
    across = min(1 if is_column() else PANELS_ACROSS, len(tables))
    figure, panels = make_panels(len(tables), across, row_in=PANEL_IN, around_in=0.6, sharex=True)
    for axes, table in zip(panels, tables, strict=True):
        axes.set_ylabel(table.label)
        resistance = table.label.replace("[mOhm]", "[Ohm]")
        tau = names_beside(resistance).tau
        value = 1e3 * ohm[resistance] if resistance in ohm else None
        _draw_table(axes, table)
        if value is not None:
            label = "constant circuit"
            # It says something where the records do.
            soc = table.seen.nodes if table.is_visited.any() else table.nodes
            ends = soc[[0, -1]]
            axes.plot(ends, [value] * 2, color=GREY, linewidth=1.4, zorder=1, label=label)
        limits = scale_of([table])
        axes.set_ylim(limits)
        outside = off_the_scale([table], limits, value)
        axes.set_title(textwrap.fill(outside, LETTERS), loc="right", fontsize=letters_pt(8))
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
    crossed = {"marker": "x", "markersize": 5.5, "color": VERMILLION}
    hollow = {**OPEN, "markeredgecolor": BLUE}
    for label, where, own in (
        ("node", visited & table.has_nodes, {"color": BLUE}),
        ("not determined", visited & ~known, crossed),
        ("node without samples", ~visited, hollow),
    ):
        if where.any():
            axes.plot(nodes[where], values[where], label=label, **{**style, **own})


TEMPERATURE_PANEL_IN: Final = 2.1
# States of charge that are drawn over temperature: the nodes nearest to these.
SOC: Final = (0.1, 0.3, 0.5, 0.7, 0.9)
COLORS: Final = "plasma"
# The end of the colors is too light for a line.
LIGHTEST: Final = 0.85
# Marks of one temperature stand apart by this share of the range.
APART: Final = 0.012
BETWEEN: Final[dict[str, Any]] = {"linewidth": 0.8, "linestyle": (0, (5, 3))}
# Intervals extend a logarithmic scale up to this factor.
WIDEST_LOG: Final = 3.0
# Temperatures at which the interpolation is drawn.
POINTS: Final = 101


@illustration(
    "Resistances over temperature at several states of charge, on a logarithmic scale. Markers "
    "with 95 % intervals: measured temperatures, drawn a little apart; dashed: the interpolation "
    "between them.",
    "Resistances over temperature, one line per state of charge",
    is_dense=False,
    is_main=True,
)
def plot_over_temperature(found: "TableFits") -> Figure:
    """Every resistance over temperature, a line a state of charge.

    Marks with intervals are the measured temperatures, drawn a little apart so that none hides
    another; dashed lines are what is interpolated between them.

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
        is_log, label = values.min() > 0, fits[0][name].label
        for number, (place, color) in enumerate(zip(places, _colors(len(places)), strict=True)):
            axes.plot(fine, values[:, number], color=color, **BETWEEN)
            value, low, high = np.array(
                [[rows[place] for rows in (fit[name].values, fit[name].low, fit[name].high)]
                 for fit in fits]
            ).T  # fmt: skip
            apart = APART * (fine[-1] - fine[0]) * (number - (len(places) - 1) / 2)
            axes.errorbar(
                np.array(degc) + apart, value, np.maximum([value - low, high - value], 0.0),
                fmt="o", color=color, markersize=3.6, label=f"SOC {100 * nodes[place]:g} %",
            )  # fmt: skip
        axes.plot([], [], color=GREY, **BETWEEN, label="interpolated")
        axes.margins(x=0.05)
        axes.set_ylabel(f"{label}\n(log scale)" if is_log else label)
        if is_log:
            axes.set_yscale("log")
            low, high = axes.get_ylim()
            axes.set_ylim(max(low, values.min() / WIDEST_LOG), min(high, values.max() * WIDEST_LOG))
            label_plainly(axes.yaxis)
    name_below(panels, PANELS_ACROSS, "Temperature [degC]")
    return finish(figure, *panels, columns=3)


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
