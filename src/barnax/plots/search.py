"""Searches: the fall of every seed's best error, or loss, and the answers of seeds side by side."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..cell import CircuitParameters
from ..cell.elements import names_of
from . import style
from .pictures import illustration

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ..comparison import ComparisonResult
    from ..comparison.result import RowPart
    from ..results import Result
    from ..search.refine import Refinement
    from ..search.seeds import Search

Histories = Float[np.ndarray, "seeds generations"]

SPENT: Final = "Evaluations of one seed [-]"
# Excess below this is rounding, and zero has no place on a logarithmic axis.
LEAST_EXCESS_PERCENT: Final = 1e-6
OPTIMUM: Final = "global optimum"
# Where both are equal, the wide line shows on either side of the narrow one.
AIMS: Final[dict[str, dict[str, Any]]] = {
    OPTIMUM: {"color": style.GREEN, "linewidth": 2.4},
    "refined": {"color": style.VERMILLION, "linestyle": "--"},
}


def padded(histories: "Sequence[Sequence[float] | np.ndarray]") -> Histories:
    """Histories as rows of one length: a seed that stopped early stays at its last value.

    >>> padded([[3.0, 2.0, 1.0], [4.0]]).tolist()
    [[3.0, 2.0, 1.0], [4.0, 4.0, 4.0]]
    """
    longest = max(len(history) for history in histories)
    return np.array(
        [[*history, *([history[-1]] * (longest - len(history)))] for history in histories]
    )


def finite(values: np.ndarray) -> np.ndarray:
    """The values, NaN in place of infinite ones, which are not drawn."""
    return np.where(np.isfinite(values), values, np.nan)


def excess_percent(errors: np.ndarray, lowest: float) -> np.ndarray:
    """Errors above the lowest in percent, at least what shows on a logarithmic axis."""
    return np.maximum(100 * (errors / lowest - 1), LEAST_EXCESS_PERCENT)


def _beside(figure: Figure, count: int) -> list[Axes]:
    """Panels beside each other, no label nearer to the panel left of it."""
    figure.set_layout_engine("constrained", wspace=0.08 if count > 1 else None)
    return list(figure.subplots(1, count, squeeze=False)[0])


@illustration(
    "How the best RMSE of every seed fell during the search, and how far each stayed above "
    "the lowest RMSE known.",
    "Best RMSE of every seed over evaluations",
)
def plot_convergence(
    searches: "Search | Result | str | Path | Mapping[str, ArrayLike]",
    refinement: "Refinement | None" = None,
    optimum_rmse_v: float | None = None,
) -> Figure:
    """Best RMSE, or loss, of each seed over the evaluations it has spent, and the seeds' median.

    With `refinement` or the RMSE of the global optimum, which a result holds, a second panel shows
    how far each seed of an identification is above the lowest of them, in percent; excesses under
    1e-6 % are drawn there. Generations count as equally expensive.
    Generations before a seed's first finite value are not drawn, and count as infinite in the
    median. Losses of zero are drawn below all others; the axis is linear if some are negative.

    Raises `ValueError` for stats of another kind of solver.

    Args:
        searches: A search, a result or the path of a `result.json`, drawn in mV; or the `stats` of
            population optimizers used alone: those of one `optimistix.minimise`, or of many under
            `jax.vmap`.
        refinement: Its refinement.
        optimum_rmse_v: RMSE of the global optimum.
    """
    figure = style.make_figure()
    if isinstance(searches, Mapping):
        panels = [_plot_losses(figure, searches)]
    else:
        panels = _plot_errors(figure, searches, refinement, optimum_rmse_v)
    for axes in panels:
        axes.set(xscale="log", xlabel=SPENT)
        style.label_plainly(axes.xaxis)
        if axes.get_yscale() == "log":
            style.label_plainly(axes.yaxis)
    return style.finish(figure, *panels, columns=4)


def _plot_losses(figure: Figure, stats: Mapping[str, Any]) -> Axes:
    """One panel from the stats of one or many searches."""
    missing = [name for name in ("history", "population", "evaluations") if name not in stats]
    if missing:
        raise ValueError(
            f"the stats lack {', '.join(missing)}; pass the `stats` that optimistix.minimise "
            "returns for an optimizer of barnax, whole"
        )
    history = np.atleast_2d(np.asarray(stats["history"]))
    axes = figure.subplots()
    known = history[np.isfinite(history)]
    if (known >= 0).all() and (known > 0).any():
        axes.set_yscale("log")
        history = np.maximum(history, known[known > 0].min() / 10)
    _draw_seeds(axes, stats["population"], stats["evaluations"], history)
    axes.set_ylabel("Best loss")
    return axes


def _plot_errors(
    figure: Figure,
    searches: "Search | Result | str | Path",
    refinement: "Refinement | None",
    optimum_v: float | None,
) -> list[Axes]:
    """A panel of RMSE and, where there is one to aim at, one of the excess over the lowest.

    A lowest RMSE of zero, as of data without noise, has neither excess nor a logarithm.
    """
    from ..results import Result
    from ..search.seeds import Search

    refined = refinement
    if isinstance(searches, Search):
        seeds, population = searches.seeds, searches.population
    else:
        constant = style.opened(searches, Result).constant
        refined, optimum = constant.refined, constant.global_optimum
        if constant.search is None or refined is None:
            raise ValueError("this result was found without seeds, so no search converged")
        seeds, population = constant.search.seeds, constant.search.population
        optimum_v = None if optimum is None else optimum.rmse_v
    aims_v = {OPTIMUM: optimum_v, "refined": refined and refined.rmse_v}
    aims_mv = {name: 1e3 * aim for name, aim in aims_v.items() if aim is not None}
    lowest_mv = min(aims_mv.values(), default=0.0)
    history_mv = 1e3 * padded([seed.history_v for seed in seeds])
    spent = population, [seed.evaluations for seed in seeds]
    rmse, *excess = _beside(figure, 2 if lowest_mv > 0 else 1)
    _draw_seeds(rmse, *spent, history_mv)
    rmse.set(ylabel="Best RMSE [mV]", yscale="log")
    if lowest_mv > 0:
        for name, aim_mv in aims_mv.items():
            rmse.axhline(aim_mv, **AIMS[name], label=f"{name}, {aim_mv:.4g} mV")
        _draw_seeds(excess[0], *spent, excess_percent(history_mv, lowest_mv))
        excess[0].set(ylabel="Above the lowest known RMSE [%]", yscale="log")
    return [rmse, *excess]


def _draw_seeds(axes: Axes, population: Any, evaluations: Any, values: Histories) -> None:
    """A line for every seed, from its first generation to what it spent in all, and the median."""
    first, last = (np.broadcast_to(count, len(values)) for count in (population, evaluations))
    spent = np.linspace(first, last, values.shape[1], axis=1)
    look = {"color": style.SKY_BLUE, "linewidth": 0.8, "drawstyle": "steps-post"}
    label = "one seed" if len(values) == 1 else f"each of {len(values)} seeds"
    axes.plot(spent.T, finite(values).T, **look, label=label)
    if len(values) > 1:
        look |= {"color": style.BLACK, "linewidth": 2.0, "label": "median"}
        axes.plot(np.median(spent, axis=0), finite(np.median(values, axis=0)), **look)


BAND: Final = (10, 90)
MARKERS_PER_LINE: Final = 6
COMPARED_IN: Final = 4.8


@illustration(
    "How the best RMSE of each row fell: the median of its seeds, and a band from the tenth "
    "to the ninetieth percentile. A row without a history is a single marker.",
    "Best RMSE of the rows over evaluations, with the spread of the seeds",
)
def plot_compared_convergence(comparison: "ComparisonResult | str | Path") -> Figure:
    """Best RMSE of each row over the evaluations of one seed: its median, and a band of seeds.

    The band holds the seeds from the tenth to the ninetieth percentile. Rows without a history,
    such as least squares, are a mark at what they spent. Where the global optimum of a model is
    known, a second panel shows the excess over it, in percent; excesses under 1e-6 % are drawn
    there. Generations count as equally expensive, and those before a seed's first finite error
    as infinite.

    Args:
        comparison: A comparison, or the path of a `comparison.json`.
    """
    result, rows, looks = _seeded_rows(comparison)
    optima_v = {name: model.optimum_rmse_v for name, model in result.models.items()}
    figure = style.make_figure(height_in=COMPARED_IN)
    rmse, *excess = _beside(figure, 1 + any(optima_v.get(row.model) for row in rows))
    for row in rows:
        spent, errors_v = _convergence(row, result.budget.population)
        _draw_convergence(rmse, row.name, looks[row.name], spent, 1e3 * errors_v)
        optimum_v = optima_v.get(row.model)
        if optimum_v:
            percent = excess_percent(errors_v, optimum_v)
            _draw_convergence(excess[0], row.name, looks[row.name], spent, percent)
    for axes, label in zip(figure.axes, ("Best RMSE [mV]", "Optimality gap [%]"), strict=False):
        axes.set(xscale="log", yscale="log", xlabel=SPENT, ylabel=label)
        style.label_plainly(axes.yaxis)
    return style.finish(figure, *figure.axes)


def _seeded_rows(
    comparison: "ComparisonResult | str | Path",
) -> "tuple[ComparisonResult, list[RowPart], dict[str, style.RowLook]]":
    """A comparison, its rows that have seeds, and their looks."""
    from ..comparison import ComparisonResult

    result = style.opened(comparison, ComparisonResult)
    rows = [row for row in result.rows if row.seeds]
    return result, rows, style.row_looks([row.name for row in rows])


def _convergence(row: "RowPart", population: int) -> tuple[np.ndarray, np.ndarray]:
    """The evaluations that a seed had spent, and the best RMSE of every seed by then.

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
    axes: Axes, name: str, look: style.RowLook, spent: np.ndarray, values: np.ndarray
) -> None:
    mark = {"label": name, "color": look.color, "marker": look.marker, "markersize": 4.0}
    if len(spent) == 1:
        axes.plot(spent, values[0], linestyle="none", **mark)
        return
    # Interpolating between infinite errors gives NaN, which is not drawn.
    with np.errstate(invalid="ignore"):
        low, median, high = np.percentile(values, [BAND[0], 50, BAND[1]], axis=0)
    if len(values) > 1:
        band = {"color": look.color, "alpha": 0.16, "linewidth": 0.0}
        axes.fill_between(spent, finite(low), finite(high), **band)
    # Markers are spaced evenly along a logarithmic axis.
    marked = np.searchsorted(spent, np.geomspace(spent[0], spent[-1], MARKERS_PER_LINE))
    every = np.unique(np.minimum(marked, len(spent) - 1)).tolist()
    line = {"linestyle": look.line, "linewidth": 1.3, "markerfacecolor": "white"}
    axes.plot(spent, finite(median), **mark, **line, markevery=every)


RMSE: Final = "RMSE [mV]"
PANELS_ACROSS: Final = 3
LINE_IN: Final = 0.26
FURNITURE_IN: Final = 0.65
LEGEND_IN: Final = 0.3
# Seeds are spread evenly about their row's line, so that equal answers show.
SPREAD: Final = 0.56
MARGIN: Final = 0.06
GOLDEN_RATIO: Final = 0.6180339887498949


def readable(parameters: Mapping[str, float]) -> dict[str, float]:
    """Resistances in mOhm, capacitances in F and time constants in s, by a name with its unit.

    `parameters` are PyBaMM's names, as `result.json` holds them.

    >>> readable({"R0 [Ohm]": 0.05, "R1 [Ohm]": 0.02, "C1 [F]": 500.0})
    {'R0 [mOhm]': 50.0, 'R1 [mOhm]': 20.0, 'C1 [F]': 500.0, 'tau1 [s]': 10.0}
    """
    circuit = CircuitParameters.from_dict(parameters)
    values = {"R0 [mOhm]": 1e3 * circuit.r0}
    pairs = zip(names_of(circuit.elements), circuit.r, circuit.c, circuit.tau_s, strict=True)
    for names, r, c, tau_s in pairs:
        values[names.resistance.replace("[Ohm]", "[mOhm]")] = 1e3 * r
        if names.capacitance is not None:
            values[names.capacitance] = c
        values[names.tau] = tau_s
    if circuit.gamma is not None:
        values["gamma [1/SOC]"] = circuit.gamma
    return values


@illustration(
    "The answer of every seed, before refinement. Bar: the median seed; diamond: the "
    "same after refinement; dotted: a bound.",
    "Parameters of every seed of every row",
    is_dense=False,
)
def plot_compared_parameters(comparison: "ComparisonResult | str | Path") -> Figure:
    """Every seed's own parameters and RMSE: a panel for each, a line for each row.

    Marks are the seeds before refinement, the tall stroke their median seed, the white diamond
    what Levenberg-Marquardt made of that. Dotted lines are bounds that all models share, where
    they lie in view.

    Args:
        comparison: A comparison, or the path of a `comparison.json`.
    """
    result, rows, looks = _seeded_rows(comparison)
    names = _quantities(rows)
    heights_in = FURNITURE_IN + LINE_IN * len(rows), LEGEND_IN
    figure, panels = style.make_panels(len(names), PANELS_ACROSS, heights_in, sharey=True)
    bounds = _shared_bounds(result)
    for axes, name in zip(panels, names, strict=True):
        for line, row in enumerate(rows):
            _draw_row(axes, line, row, looks[row.name], name)
        axes.set(xscale="log", xlabel=name)
        axes.margins(x=MARGIN)
        low, high = axes.get_xlim()
        for limit in bounds.get(name, ()):
            # A bound just outside the data still shows that they end at it.
            if low / 1.3 <= limit <= high * 1.3:
                axes.axvline(limit, color=style.GREY, linestyle=":", linewidth=1.1, zorder=1)
        style.label_plainly(axes.xaxis)
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.set_yticks(range(len(rows)), [row.name for row in rows], parse_math=False)
    return style.finish(figure, *panels, legend_of=panels[:1])


def _quantities(rows: "Sequence[RowPart]") -> list[str]:
    """The quantities with a panel: RMSE, resistances, time constants, the rate of a hysteresis."""
    names = dict.fromkeys(name for row in rows for name in readable(row.seeds[0].parameters))
    kinds = ("R", "tau", "gamma")
    return [RMSE, *(name for kind in kinds for name in names if name.startswith(kind))]


def _value(name: str, rmse_v: float, parameters: Mapping[str, float]) -> float:
    return 1e3 * rmse_v if name == RMSE else readable(parameters).get(name, np.nan)


def _draw_row(axes: Axes, line: int, row: "RowPart", look: style.RowLook, name: str) -> None:
    values = np.array([_value(name, seed.rmse_v, seed.parameters) for seed in row.seeds])
    offset = SPREAD * ((np.arange(len(values)) * GOLDEN_RATIO + 0.5) % 1 - 0.5)
    dot = {"color": look.color, "markeredgewidth": 0.0, "alpha": 0.75, "label": "one seed"}
    style.draw_points(axes, values, line + offset, look.marker, 3.2, **dot)
    if row.identification is not None and row.parameters is not None:
        median = _value(name, row.identification.metrics.rmse_v, row.parameters)
        stroke = {"color": style.BLACK, "linewidth": 1.4, "label": "median seed"}
        axes.plot([median] * 2, [line - 0.42, line + 0.42], **stroke)
    if row.refined_rmse_v is not None and row.refined_parameters is not None:
        refined = _value(name, row.refined_rmse_v, row.refined_parameters)
        label = "median seed, refined"
        style.draw_points(axes, refined, line, "D", 4.6, **style.OPEN, label=label, zorder=3)


def _shared_bounds(result: "ComparisonResult") -> dict[str, tuple[float, float]]:
    """Bounds in readable units of what every model bounds alike."""
    of_models = [model.bounds for model in result.models.values()]
    shared = {}
    for name, (low, high) in of_models[0].items() if of_models else ():
        if all(bounds.get(name) == (low, high) for bounds in of_models):
            scale = 1e3 if name.endswith("[Ohm]") else 1.0
            shared[name.replace("[Ohm]", "[mOhm]")] = (scale * low, scale * high)
    return shared
