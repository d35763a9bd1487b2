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
    SKY_BLUE,
    VERMILLION,
    figure_style,
    finish,
    label_plainly,
    make_figure,
)

if TYPE_CHECKING:
    from ..results import Result
    from ..search.refine import Refinement
    from ..search.seeds import Search, SeedAnswer

Histories = Float[np.ndarray, "seeds generations"]

# Excess below this is rounding, and zero has no place on a logarithmic axis.
LEAST_EXCESS_PERCENT = 1e-6


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
) -> Figure:
    """Best RMSE, or loss, of each seed over the evaluations it has spent, and the seeds' median.

    `searches` is an identification, drawn in mV, or the `stats` of population optimizers used
    alone: those of one `optimistix.minimise`, or of many under `jax.vmap`. With `refinement`, a
    second panel shows how far each seed of an identification is above the refined RMSE, in
    percent; excesses under 1e-6 % are drawn there. A result, or the path of a `result.json`,
    holds both. Generations count as equally expensive.
    Generations before a seed's first finite value are not drawn, and count as infinite in the
    median. Losses of zero are drawn below all others; the axis is linear if some are negative.

    Raises `ValueError` for stats of another kind of solver.
    """
    figure = make_figure()
    if isinstance(searches, Mapping):
        panels = [_plot_losses(figure, searches)]
    else:
        panels = _plot_errors(figure, *_runs(searches, refinement))
    for axes in panels:
        axes.set_xlabel("Evaluations of one seed [-]")
        axes.set_xscale("log")
        label_plainly(axes.xaxis)
        if axes.get_yscale() == "log":
            label_plainly(axes.yaxis)
    return finish(figure, *panels)


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
    searches: "Search | Result | str | Path", refinement: "Refinement | None"
) -> "tuple[Sequence[SeedAnswer], int, float]":
    """The seeds, how many candidates each began with, and the refined RMSE in mV or zero."""
    from ..search.seeds import Search

    if isinstance(searches, Search):
        refined_mv = 0.0 if refinement is None else 1e3 * refinement.rmse_v
        return searches.seeds, searches.optimizer.population, refined_mv
    result = result_of(searches)
    if result.search is None or result.refined is None:
        raise ValueError("this result was found without seeds, so no search converged")
    return result.search.seeds, result.search.population, 1e3 * result.refined.rmse_v


def _plot_errors(
    figure: Figure, seeds: "Sequence[SeedAnswer]", population: int, refined_mv: float
) -> list[Axes]:
    """A panel of RMSE and, where a refined RMSE is given, one of the excess over it.

    A refined RMSE of zero, as of data without noise, has neither excess nor a logarithm.
    """
    history_mv = 1e3 * padded([seed.history_v for seed in seeds])
    spent = np.array([seed.evaluations for seed in seeds])
    evaluations = np.linspace(population, spent, history_mv.shape[1], axis=1)
    rmse, *excess = figure.subplots(1, 2 if refined_mv > 0 else 1, squeeze=False)[0]
    _draw_seeds(rmse, evaluations, history_mv)
    rmse.set(ylabel="Best RMSE [mV]", yscale="log")
    if refined_mv > 0:
        rmse.axhline(
            refined_mv, color=VERMILLION, linestyle="--", label=f"refined, {refined_mv:.4g} mV"
        )
        excess_percent = 100 * (history_mv / refined_mv - 1)
        _draw_seeds(excess[0], evaluations, np.maximum(excess_percent, LEAST_EXCESS_PERCENT))
        excess[0].set(ylabel="Best RMSE above the refined [%]", yscale="log")
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
