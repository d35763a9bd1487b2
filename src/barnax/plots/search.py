"""Searches: the fall of every seed's best error, or loss."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import style

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

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


@style.figure_style()
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
    from ..search.seeds import Search

    refined = refinement
    if isinstance(searches, Search):
        seeds, population = searches.seeds, searches.population
    else:
        constant = style.opened(searches).constant
        refined, optimum = constant.refined, constant.global_optimum
        if constant.search is None or refined is None:
            raise ValueError("this result was found without seeds, so no search converged")
        seeds, population = constant.search.seeds, constant.search.population
        optimum_v = None if optimum is None else optimum.rmse_v
    aims_v = {OPTIMUM: optimum_v, "refined": None if refined is None else refined.rmse_v}
    aims_mv = {name: 1e3 * aim for name, aim in aims_v.items() if aim is not None}
    lowest_mv = min(aims_mv.values(), default=0.0)
    history_mv = 1e3 * padded([seed.history_v for seed in seeds])
    spent = population, [seed.evaluations for seed in seeds]
    count = 2 if lowest_mv > 0 else 1
    # No label is nearer to the panel left of it.
    figure.set_layout_engine("constrained", wspace=0.08 if count > 1 else None)
    rmse, *excess = figure.subplots(1, count, squeeze=False)[0]
    _draw_seeds(rmse, *spent, history_mv)
    rmse.set(ylabel="Best RMSE [mV]", yscale="log")
    if lowest_mv > 0:
        for name, aim_mv in aims_mv.items():
            rmse.axhline(aim_mv, **AIMS[name], label=f"{name}, {aim_mv:.4g} mV")
        percent = np.maximum(100 * (history_mv / lowest_mv - 1), LEAST_EXCESS_PERCENT)
        _draw_seeds(excess[0], *spent, percent)
        excess[0].set(ylabel="Above the lowest known RMSE [%]", yscale="log")
    return [rmse, *excess]


def _draw_seeds(axes: Axes, population: Any, evaluations: Any, values: Histories) -> None:
    """A line for every seed, from its first generation to what it spent in all, and the median."""
    first, last = (np.broadcast_to(count, len(values)) for count in (population, evaluations))
    spent = np.linspace(first, last, values.shape[1], axis=1)
    look: dict[str, Any] = {"color": style.SKY_BLUE, "linewidth": 0.8, "drawstyle": "steps-post"}
    label = "one seed" if len(values) == 1 else f"each of {len(values)} seeds"
    axes.plot(spent.T, finite(values).T, **look, label=label)
    if len(values) > 1:
        look |= {"color": style.BLACK, "linewidth": 2.0, "label": "median"}
        axes.plot(np.median(spent, axis=0), finite(np.median(values, axis=0)), **look)
