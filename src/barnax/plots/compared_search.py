"""The rows of a comparison: how they converged, and what seeds and online methods found."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .compared_records import RowLook, row_looks
from .search import LEAST_EXCESS_PERCENT, padded
from .sources import comparison_of
from .style import (
    BLACK,
    GREY,
    OPEN,
    draw_points,
    figure_style,
    finish,
    finish_axes,
    label_plainly,
    legend_above,
    make_figure,
    readable,
    space_columns,
)

if TYPE_CHECKING:
    from ..comparison import ComparisonResult, Row
    from ..comparison.result import RowPart


BAND = (10, 90)
MARKERS_PER_LINE = 6
HEIGHT_IN = 4.8

RMSE = "RMSE [mV]"
COLUMNS = 3
LINE_IN = 0.26
FURNITURE_IN = 0.65
LEGEND_IN = 0.3
# Seeds are spread about their row's line, evenly and without a draw, so equal answers show.
SPREAD = 0.56
MARGIN = 0.06
GOLDEN_RATIO = 0.6180339887498949


@figure_style()
def plot_compared_convergence(comparison: "ComparisonResult | str | Path") -> Figure:
    """Best RMSE of each row over the evaluations of one seed: its median, and a band of seeds.

    The band holds the seeds from the tenth to the ninetieth percentile. Rows without a history,
    such as least squares, are a mark at what they spent. Where the global optimum of a model is
    known, a second panel shows the excess over it, in percent; excesses under 1e-6 % are drawn
    there. Generations count as equally expensive, and those before a seed's first finite error
    as infinite. `comparison` may be the path of a `comparison.json`.
    """
    result = comparison_of(comparison)
    optima_v = {name: model.optimum_rmse_v for name, model in result.models.items()}
    rows = [row for row in result.rows if row.seeds]
    looks = row_looks(row.name for row in rows)
    has_excess = any(optima_v.get(row.model) for row in rows)
    figure = make_figure(height_in=HEIGHT_IN)
    panels = figure.subplots(1, 2 if has_excess else 1, squeeze=False)[0]
    for row in rows:
        spent, errors_v = _convergence(row, result.budget.population)
        _draw_convergence(panels[0], row.name, looks[row.name], spent, 1e3 * errors_v)
        optimum_v = optima_v.get(row.model)
        if optimum_v:
            excess_percent = np.maximum(100 * (errors_v / optimum_v - 1), LEAST_EXCESS_PERCENT)
            _draw_convergence(panels[1], row.name, looks[row.name], spent, excess_percent)
    panels[0].set_ylabel("Best RMSE [mV]")
    if has_excess:
        panels[1].set_ylabel("Optimality gap [%]")
        space_columns(figure)
    for axes in panels:
        axes.set(xscale="log", yscale="log", xlabel="Evaluations of one seed [-]")
        label_plainly(axes.yaxis)
    return finish(figure, *panels)


def _convergence(row: "RowPart", population: int) -> tuple[np.ndarray, np.ndarray]:
    """What a seed had spent, and the best RMSE of every seed by then.

    One column, of the median RMSE at the median cost, for a row without a history.
    """
    histories = [seed.history_v for seed in row.seeds if seed.history_v]
    spent = [seed.evaluations for seed in row.seeds]
    if len(histories) < len(row.seeds):
        rmse_v = np.median([seed.rmse_v for seed in row.seeds])
        return np.array([max(float(np.median(spent)), 1.0)]), np.array([[rmse_v]])
    errors_v = padded(histories)
    return np.linspace(population, max(spent), errors_v.shape[1]), errors_v


def _draw_convergence(
    axes: Axes, name: str, look: RowLook, spent: np.ndarray, values: np.ndarray
) -> None:
    style = {"color": look.color, "marker": look.marker, "markersize": 4.0, "label": name}
    if len(spent) == 1:
        axes.plot(spent, values[0], linestyle="none", **style)
        return
    # Between infinite errors nothing can be interpolated; what comes of it is not drawn.
    with np.errstate(invalid="ignore"):
        low, median, high = np.percentile(values, [BAND[0], 50, BAND[1]], axis=0)
    if len(values) > 1:
        axes.fill_between(
            spent, _finite(low), _finite(high), color=look.color, alpha=0.16, linewidth=0.0
        )
    # Evenly along a logarithmic axis.
    places = np.searchsorted(spent, np.geomspace(spent[0], spent[-1], MARKERS_PER_LINE))
    axes.plot(
        spent,
        _finite(median),
        linestyle=look.line,
        linewidth=1.3,
        markerfacecolor="white",
        markevery=np.unique(np.minimum(places, len(spent) - 1)).tolist(),
        **style,
    )


def _finite(values: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(values), values, np.nan)


@figure_style()
def plot_compared_parameters(comparison: "ComparisonResult | str | Path") -> Figure:
    """Every seed's own parameters and RMSE: a panel for each, a line for each row.

    Marks are the seeds before refinement, the tall stroke their median seed, the white diamond
    what Levenberg-Marquardt made of that. Dotted lines are bounds that all models share, where
    they lie in view. `comparison` may be the path of a `comparison.json`.
    """
    result = comparison_of(comparison)
    rows = [row for row in result.rows if row.seeds]
    looks = row_looks(row.name for row in rows)
    names = _quantities(rows)
    lines = -(-len(names) // COLUMNS)
    figure = make_figure(height_in=LEGEND_IN + lines * (FURNITURE_IN + LINE_IN * len(rows)))
    grid = figure.subplots(lines, COLUMNS, squeeze=False, sharey=True)
    bounds = _shared_bounds(result)
    for axes, name in zip(grid.flat, names, strict=False):
        for place, row in enumerate(rows):
            _draw_row(axes, place, row, looks[row.name], name)
        axes.set(xscale="log", xlabel=name)
        axes.margins(x=MARGIN)
        _draw_bounds(axes, bounds.get(name, ()))
        label_plainly(axes.xaxis)
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.set_yticks(range(len(rows)), [row.name for row in rows], parse_math=False)
    for axes in grid.flat[len(names) :]:
        axes.set_visible(False)
    finish_axes(*grid.flat[: len(names)])
    legend_above(figure, grid[0, 0], columns=3)
    return figure


def _quantities(rows: "Sequence[RowPart]") -> list[str]:
    """What has a panel: the RMSE, resistances, time constants, the rate of a hysteresis."""
    found = dict.fromkeys(name for row in rows for name in readable(row.seeds[0].parameters))
    kinds = ("R", "tau", "gamma")
    return [RMSE, *(name for kind in kinds for name in found if name.startswith(kind))]


def _value(name: str, rmse_v: float, parameters: Mapping[str, float]) -> float:
    return 1e3 * rmse_v if name == RMSE else readable(parameters).get(name, np.nan)


def _draw_row(axes: Axes, place: int, row: "RowPart", look: RowLook, name: str) -> None:
    values = np.array([_value(name, seed.rmse_v, seed.parameters) for seed in row.seeds])
    offset = SPREAD * ((np.arange(len(values)) * GOLDEN_RATIO + 0.5) % 1 - 0.5)
    is_first = place == 0
    style = {"color": look.color, "markeredgewidth": 0.0, "alpha": 0.75}
    label = "one seed" if is_first else "_seed"
    draw_points(axes, values, place + offset, look.marker, 3.2, **style, label=label)
    if row.identification is not None and row.parameters is not None:
        median = _value(name, row.identification.metrics.rmse_v, row.parameters)
        label = "median seed" if is_first else "_median"
        stroke = [place - 0.42, place + 0.42]
        axes.plot([median, median], stroke, color=BLACK, linewidth=1.4, label=label)
    if row.refined_rmse_v is not None and row.refined_parameters is not None:
        refined = _value(name, row.refined_rmse_v, row.refined_parameters)
        label = "median seed, refined" if is_first else "_refined"
        draw_points(axes, refined, place, "D", 4.6, **OPEN, label=label, zorder=3)


def _shared_bounds(result: "ComparisonResult") -> dict[str, tuple[float, float]]:
    """Bounds in readable units of what every model bounds alike."""
    each = [model.bounds for model in result.models.values()]
    shared = {}
    for name, limits in each[0].items() if each else ():
        if all(bounds.get(name) == limits for bounds in each):
            scale = 1e3 if name.endswith("[Ohm]") else 1.0
            low, high = limits
            shared[name.replace("[Ohm]", "[mOhm]")] = (scale * low, scale * high)
    return shared


def _draw_bounds(axes: Axes, limits: Sequence[float]) -> None:
    low, high = axes.get_xlim()
    for limit in limits:
        # Just outside the data a bound still says that the data end at it.
        if low / 1.3 <= limit <= high * 1.3:
            axes.axvline(limit, color=GREY, linestyle=":", linewidth=1.1, zorder=1)


TRAJECTORY_IN, AROUND_IN = 1.7, 0.8
# A median for every percent of SOC: from sample to sample a trajectory is mostly noise.
STEPS = np.linspace(0, 1, 101)


@figure_style()
def plot_trajectories(rows: "Mapping[str, Row]") -> Figure:
    """R0, every R and every tau over the state of charge, as each online row saw them.

    Lines are medians in each percent of the state of charge, and break where the row's equation
    belonged to no circuit. Short dashes at the right are what the row answers. Rows without a
    trajectory are left out; raises `ValueError` where none has one.
    """
    tracked = {name: row for name, row in rows.items() if row.median.trajectory is not None}
    if not tracked:
        raise ValueError("no row is of an online method; there is no trajectory to draw")
    looks, pairs = row_looks(rows), max(row.problem.bounds.pairs for row in tracked.values())
    figure = make_figure(height_in=AROUND_IN + TRAJECTORY_IN * (pairs + 1))
    grid = figure.subplots(pairs + 1, 2, squeeze=False, sharex=True)
    for name, row in tracked.items():
        path, answer = row.median.trajectory, row.median.parameters
        assert path is not None, "chosen above"
        prepared = row.problem.prepared
        soc = np.interp(path.time_s, prepared.time_s, prepared.soc)
        panels = [(grid[0, 0], 1e3 * path.r0, 1e3 * answer.r0, "R0 [mOhm]")]
        for pair in range(path.r.shape[1]):
            number = pair + 1
            values, final = 1e3 * path.r[:, pair], 1e3 * answer.r[pair]
            panels.append((grid[number, 0], values, final, f"R{number} [mOhm]"))
            values, final = path.tau_s[:, pair], answer.tau_s[pair]
            panels.append((grid[number, 1], values, final, f"tau{number} [s]"))
        look = {"color": looks[name].color, "linestyle": looks[name].line}
        for axes, values, final, label in panels:
            axes.plot(*medians(soc, values), linewidth=1.2, **look, label=name)
            axes.plot([-3, 0], [final, final], linewidth=1.6, color=look["color"])
            axes.set(ylabel=label, yscale="log")
    grid[0, 1].set_visible(False)
    shown = [axes for axes in grid.flat if axes.get_visible()]
    for axes in grid[-1]:
        axes.set_xlabel("State of charge [%]")
        # As a discharge runs.
        axes.set_xlim(101, -4)
    for axes in shown:
        label_plainly(axes.yaxis)
    return finish(figure, *shown)


def medians(soc: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The middle of every percent of SOC in %, and the median of what is a number there."""
    place = np.clip(np.digitize(soc, STEPS), 1, len(STEPS) - 1)
    inside = [values[(place == step) & np.isfinite(values)] for step in range(1, len(STEPS))]
    middle = [np.median(each) if len(each) else np.nan for each in inside]
    return 100 * (STEPS[:-1] + STEPS[1:]) / 2, np.array(middle)
