"""What all figures share: size, colors, line widths, and axes made alike."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

WIDTH_IN: Final = 7.0
HEIGHT_IN: Final = 4.5
LONGEST_TITLE: Final = 80

# M. Okabe and K. Ito, "Color Universal Design" (2008): told apart with every color vision.
BLACK: Final = "#000000"
ORANGE: Final = "#E69F00"
SKY_BLUE: Final = "#56B4E9"
GREEN: Final = "#009E73"
BLUE: Final = "#0072B2"
VERMILLION: Final = "#D55E00"
PURPLE: Final = "#CC79A7"
# Neutral greys beside the palette.
GREY: Final = "#9A9A9A"
SHADE: Final = "#E4E4E4"

STYLE: Final[dict[Any, Any]] = {
    "figure.dpi": 150,
    "font.size": 9,
    "axes.labelsize": 9,
    "axes.linewidth": 0.7,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 9,
    "axes.xmargin": 0.01,
    "legend.borderaxespad": 0.2,
    "legend.columnspacing": 1.6,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "legend.handlelength": 2.4,
    "lines.linewidth": 1.0,
    "lines.solid_joinstyle": "round",
    "patch.linewidth": 0.7,
}
# Ticks are made while a figure is drawn, after its style has ended, so the axes must hold these.
TICKS: Final[dict[str, Any]] = {
    "color": BLACK,
    "direction": "out",
    "labelcolor": BLACK,
    "labelsize": 8.5,
    "length": 3.0,
    "pad": 2.5,
    "width": 0.7,
}
MINOR_TICKS: Final[dict[str, Any]] = TICKS | {"length": 1.5, "width": 0.5}
GRID: Final[dict[str, Any]] = {"color": "#D9D9D9", "linestyle": "-", "linewidth": 0.5}


@contextmanager
def figure_style() -> Iterator[None]:
    """Within it figures look the same, whatever style the user's session has set."""
    default = matplotlib.rcParamsDefault
    chosen: dict[Any, Any] = {
        name: default[name] for name in default if not name.startswith("backend")
    }
    with matplotlib.rc_context(chosen | STYLE):
        yield


def make_figure(width_in: float = WIDTH_IN, height_in: float = HEIGHT_IN) -> Figure:
    """An empty figure that no pyplot knows of."""
    return Figure(figsize=(width_in, height_in), layout="constrained")


def finish_axes(*many: Axes) -> None:
    """Ticks, a grid behind the data, and labels of one column or row at one height."""
    for axes in many:
        axes.tick_params(which="major", **TICKS)
        axes.tick_params(which="minor", **MINOR_TICKS)
        axes.grid(visible=True, which="major", **GRID)
        axes.set_axisbelow(True)
    figure = many[0].figure.get_figure(root=True)
    figure.align_ylabels(many)


def title(axes: Axes, text: str) -> None:
    """A small title at the left, its end kept where it is too long.

    Names of files come here, so dollar signs are no formulas.
    """
    shown = text if len(text) <= LONGEST_TITLE else "…" + text[1 - LONGEST_TITLE :]
    axes.set_title(shown, parse_math=False)


def legend_above(figure: Figure, *panels: Axes, columns: int) -> None:
    """One legend of all labels in `panels` above them, where it hides no data."""
    entries = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    figure.legend(list(entries.values()), list(entries), loc="outside upper center", ncols=columns)
