"""The fall of every seed's best error, or loss."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .pictures import illustration
from .style import (
    BLACK,
    GREEN,
    SKY_BLUE,
    VERMILLION,
    RowLook,
    finish,
    label_plainly,
    make_figure,
    opened,
    row_looks,
    space_columns,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ..comparison import ComparisonResult
    from ..comparison.result import RowPart
    from ..results import Result
    from ..search.refine import Refinement
    from ..search.seeds import Search, SeedAnswer

Histories = Float[np.ndarray, "seeds generations"]

# Excess below this is rounding, and zero has no place on a logarithmic axis.
LEAST_EXCESS_PERCENT = 1e-6

OPTIMUM = "global optimum"
# Where both are equal, the wide line shows on either side of the narrow one.
AIMS: dict[str, dict[str, Any]] = {
    OPTIMUM: {"color": GREEN, "linewidth": 2.4},
    "refined": {"color": VERMILLION, "linestyle": "--"},
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
    figure = make_figure()
    if isinstance(searches, Mapping):
        panels = [_plot_losses(figure, searches)]
    else:
        panels = _plot_errors(figure, *_runs(searches, refinement, optimum_rmse_v))
    for axes in panels:
        axes.set_xlabel("Evaluations of one seed [-]")
        axes.set_xscale("log")
        label_plainly(axes.xaxis)
        if axes.get_yscale() == "log":
            label_plainly(axes.yaxis)
    return finish(figure, *panels, columns=4)


def _plot_losses(figure: Figure, stats: Mapping[str, Any]) -> Axes:
    """One panel from the stats of one or many searches."""
    missing = [name for name in ("history", "population", "evaluations") if name not in stats]
    if missing:
        raise ValueError(
            f"the stats lack {', '.join(missing)}; pass the `stats` that optimistix.minimise "
            "returns for an optimizer of barnax, whole"
        )
    history = np.atleast_2d(np.asarray(stats["history"]))
    first, last = (
        np.broadcast_to(stats[name], len(history)) for name in ("population", "evaluations")
    )
    axes = figure.subplots()
    known = history[np.isfinite(history)]
    is_logarithmic = bool((known >= 0).all() and (known > 0).any())
    if is_logarithmic:
        axes.set_yscale("log")
        history = np.maximum(history, known[known > 0].min() / 10)
    _draw_seeds(axes, np.linspace(first, last, history.shape[1], axis=1), history)
    axes.set_ylabel("Best loss")
    return axes


def _runs(
    searches: "Search | Result | str | Path",
    refinement: "Refinement | None",
    optimum_v: float | None,
) -> "tuple[Sequence[SeedAnswer], int, dict[str, float]]":
    """The seeds, how many candidates each began with, and the RMSE in mV that they aim at."""
    from ..results import Result
    from ..search.seeds import Search

    if isinstance(searches, Search):
        seeds, population = searches.seeds, searches.optimizer.population
        refined_v = None if refinement is None else refinement.rmse_v
    else:
        result = opened(searches, Result)
        if result.constant.search is None or result.constant.refined is None:
            raise ValueError("this result was found without seeds, so no search converged")
        seeds, population = result.constant.search.seeds, result.constant.search.population
        refined_v, found = result.constant.refined.rmse_v, result.constant.global_optimum
        optimum_v = None if found is None else found.rmse_v
    aims_v = {OPTIMUM: optimum_v, "refined": refined_v}
    return seeds, population, {name: 1e3 * aim for name, aim in aims_v.items() if aim is not None}


def _plot_errors(
    figure: Figure, seeds: "Sequence[SeedAnswer]", population: int, aims_mv: Mapping[str, float]
) -> list[Axes]:
    """A panel of RMSE and, where there is one to aim at, one of the excess over the lowest.

    A lowest RMSE of zero, as of data without noise, has neither excess nor a logarithm.
    """
    lowest_mv = min(aims_mv.values(), default=0.0)
    history_mv = 1e3 * padded([seed.history_v for seed in seeds])
    spent = np.array([seed.evaluations for seed in seeds])
    evaluations = np.linspace(population, spent, history_mv.shape[1], axis=1)
    rmse, *excess = figure.subplots(1, 2 if lowest_mv > 0 else 1, squeeze=False)[0]
    _draw_seeds(rmse, evaluations, history_mv)
    rmse.set(ylabel="Best RMSE [mV]", yscale="log")
    if lowest_mv > 0:
        for name, aim_mv in aims_mv.items():
            rmse.axhline(aim_mv, **AIMS[name], label=f"{name}, {aim_mv:.4g} mV")
        excess_percent = 100 * (history_mv / lowest_mv - 1)
        _draw_seeds(excess[0], evaluations, np.maximum(excess_percent, LEAST_EXCESS_PERCENT))
        excess[0].set(ylabel="Above the lowest known RMSE [%]", yscale="log")
        space_columns(figure)
    return [rmse, *excess]


def _draw_seeds(axes: Axes, evaluations: Histories, values: Histories) -> None:
    style = {"color": SKY_BLUE, "linewidth": 0.8, "drawstyle": "steps-post"}
    label = "one seed" if len(values) == 1 else f"each of {len(values)} seeds"
    axes.plot(evaluations.T, finite(values).T, **style, label=label)
    if len(values) > 1:
        median = np.median(values, axis=0)
        style |= {"color": BLACK, "linewidth": 2.0, "label": "median"}
        axes.plot(np.median(evaluations, axis=0), finite(median), **style)


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
    from ..comparison import ComparisonResult

    result = opened(comparison, ComparisonResult)
    optima_v = {name: model.optimum_rmse_v for name, model in result.models.items()}
    rows = [row for row in result.rows if row.seeds]
    looks = row_looks([row.name for row in rows])
    has_excess = any(optima_v.get(row.model) for row in rows)
    figure = make_figure(height_in=COMPARED_IN)
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
    axes: Axes, name: str, look: RowLook, spent: np.ndarray, values: np.ndarray
) -> None:
    style: dict[str, Any] = {"label": name, "color": look.color}
    style |= {"marker": look.marker, "markersize": 4.0}
    if len(spent) == 1:
        axes.plot(spent, values[0], linestyle="none", **style)
        return
    # Interpolating between infinite errors gives NaN, which is not drawn.
    with np.errstate(invalid="ignore"):
        low, median, high = np.percentile(values, [BAND[0], 50, BAND[1]], axis=0)
    if len(values) > 1:
        band = {"color": look.color, "alpha": 0.16, "linewidth": 0.0}
        axes.fill_between(spent, finite(low), finite(high), **band)
    # Markers are spaced evenly along a logarithmic axis.
    places = np.searchsorted(spent, np.geomspace(spent[0], spent[-1], MARKERS_PER_LINE))
    style["markevery"] = np.unique(np.minimum(places, len(spent) - 1)).tolist()
    style |= {"linestyle": look.line, "linewidth": 1.3, "markerfacecolor": "white"}
    axes.plot(spent, finite(median), **style)
