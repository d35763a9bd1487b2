"""How every seed's best error, or loss, fell during the search."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .sources import result_of
from .style import (
    BLACK,
    GREEN,
    SKY_BLUE,
    VERMILLION,
    figure_style,
    finish,
    label_plainly,
    make_figure,
    space_columns,
)

if TYPE_CHECKING:
    from ..results import Result
    from ..search.refine import Refinement
    from ..search.seeds import Search, SeedAnswer

Histories = Float[np.ndarray, "seeds generations"]

# Excess below this is rounding, and zero has no place on a logarithmic axis.
LEAST_EXCESS_PERCENT = 1e-6

OPTIMUM = "global optimum"
# Where both are the same, the wide line shows on either side of the narrow one.
AIMS: dict[str, dict[str, Any]] = {
    OPTIMUM: {"color": GREEN, "linewidth": 2.4},
    "refined": {"color": VERMILLION, "linestyle": "--"},
}


def padded(histories: "Sequence[Sequence[float] | np.ndarray]") -> Histories:
    """Histories as rows of one length: a seed that stopped early stays at its last value.

    >>> padded([[3.0, 2.0, 1.0], [4.0]]).tolist()
    [[3.0, 2.0, 1.0], [4.0, 4.0, 4.0]]
    """
    longest = max(len(each) for each in histories)
    return np.array([[*each, *([each[-1]] * (longest - len(each)))] for each in histories])


@figure_style()
def plot_convergence(
    searches: "Search | Result | str | Path | Mapping[str, Any]",
    refinement: "Refinement | None" = None,
    optimum_rmse_v: float | None = None,
) -> Figure:
    """Best RMSE, or loss, of each seed over the evaluations it has spent, and the seeds' median.

    `searches` is an identification, drawn in mV, or the `stats` of population optimizers used
    alone: those of one `optimistix.minimise`, or of many under `jax.vmap`. With `refinement` or the
    RMSE of the global optimum, a second panel shows how far each seed of an identification is
    above the lowest of them, in percent; excesses under 1e-6 % are drawn there. A result, or the
    path of a `result.json`, holds all. Generations count as equally expensive.
    Generations before a seed's first finite value are not drawn, and count as infinite in the
    median. Losses of zero are drawn below all others; the axis is linear if some are negative.

    Raises `ValueError` for stats of another kind of solver.
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
    finite = history[np.isfinite(history)]
    is_logarithmic = bool((finite >= 0).all() and (finite > 0).any())
    if is_logarithmic:
        axes.set_yscale("log")
        history = np.maximum(history, finite[finite > 0].min() / 10)
    _draw_seeds(axes, np.linspace(first, last, history.shape[1], axis=1), history)
    axes.set_ylabel("Best loss")
    return axes


def _runs(
    searches: "Search | Result | str | Path",
    refinement: "Refinement | None",
    optimum_v: float | None,
) -> "tuple[Sequence[SeedAnswer], int, dict[str, float]]":
    """The seeds, how many candidates each began with, and the RMSE in mV that they aim at."""
    from ..search.seeds import Search

    if isinstance(searches, Search):
        seeds, population = searches.seeds, searches.optimizer.population
        refined_v = None if refinement is None else refinement.rmse_v
    else:
        result = result_of(searches)
        if result.search is None or result.refined is None:
            raise ValueError("this result was found without seeds, so no search converged")
        seeds, population = result.search.seeds, result.search.population
        refined_v, found = result.refined.rmse_v, result.global_optimum
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
    for index, (spent, value) in enumerate(zip(evaluations, values, strict=True)):
        label = _count(len(values)) if index == 0 else "_seed"
        _draw_steps(axes, spent, value, SKY_BLUE, 0.8, label)
    if len(values) > 1:
        median = np.median(values, axis=0)
        _draw_steps(axes, np.median(evaluations, axis=0), median, BLACK, 2.0, "median")


def _draw_steps(
    axes: Axes, spent: np.ndarray, values: np.ndarray, color: str, width: float, label: str
) -> None:
    shown = np.where(np.isfinite(values), values, np.nan)
    style = {"color": color, "linewidth": width, "drawstyle": "steps-post"}
    axes.plot(spent, shown, **style, label=label)


def _count(seeds: int) -> str:
    return "one seed" if seeds == 1 else f"each of {seeds} seeds"
