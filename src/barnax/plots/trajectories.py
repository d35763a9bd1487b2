"""What online methods took a circuit for, over the state of charge."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from .compared_records import row_looks
from .style import figure_style, finish, label_plainly, make_figure

if TYPE_CHECKING:
    from ..comparison import Row

PANEL_IN, FURNITURE_IN = 1.7, 0.8
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
    figure = make_figure(height_in=FURNITURE_IN + PANEL_IN * (pairs + 1))
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
