"""The style of every figure: sizes, colors, axes, lines, and the rows of a comparison."""

import io
import math
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import matplotlib
import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, fontManager, get_font
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

if TYPE_CHECKING:
    from ..results import Result

HEIGHT_IN: Final = 4.5
LONGEST_TITLE: Final = 80

# M. Okabe and K. Ito, "Color Universal Design" (2008): distinguishable with every color vision.
BLACK: Final = "#000000"
ORANGE: Final = "#E69F00"
SKY_BLUE: Final = "#56B4E9"
GREEN: Final = "#009E73"
BLUE: Final = "#0072B2"
VERMILLION: Final = "#D55E00"
PURPLE: Final = "#CC79A7"
# Neutral greys in addition to the palette.
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

SOC_LABEL: Final = "State of charge [-]"

# matplotlib's own font, and system fonts for letters that it lacks.
FONT: Final = "DejaVu Sans"
FURTHER_FONTS: Final = (
    *("Noto Sans CJK SC", "Noto Sans CJK JP", "Source Han Sans SC", "WenQuanYi Zen Hei"),
    *("Microsoft YaHei", "PingFang SC", "Hiragino Sans", "Yu Gothic", "Malgun Gothic"),
    *("Arial Unicode MS", "Noto Emoji"),
)


@dataclass(frozen=True)
class FigureLayout:
    """The width of figures, and their height and letters relative to those of a page."""

    width_in: float
    height: float = 1.0
    letters: float = 1.0
    max_in_legend: int = 5


PAGE: Final = FigureLayout(7.0)
# A column of most journals; letters of 7 pt.
COLUMN: Final = FigureLayout(3.5, 0.8, 7 / 9, 2)
_layout: ContextVar[FigureLayout] = ContextVar("layout", default=PAGE)


@contextmanager
def column_width() -> Iterator[None]:
    """Context in which figures are as wide as a column of a journal, 3.5 in (89 mm), with 7 pt
    letters.

    >>> with column_width():
    ...     width_in, _ = make_figure().get_size_inches()
    >>> float(width_in)
    3.5
    """
    token = _layout.set(COLUMN)
    try:
        yield
    finally:
        _layout.reset(token)


def is_column() -> bool:
    """True if figures are drawn for a column, where panels stand one below the other."""
    return _layout.get() is COLUMN


def letters_pt(on_a_page: float) -> float:
    """The font size corresponding to this one in a figure as wide as a page."""
    return _layout.get().letters * on_a_page


@contextmanager
def figure_style() -> Iterator[None]:
    """Context in which figures look the same, whatever style the user's session has set."""
    default = matplotlib.rcParamsDefault
    chosen: dict[Any, Any] = {
        name: default[name] for name in default if not name.startswith("backend")
    }
    with matplotlib.rc_context(chosen | scaled(STYLE)):
        yield


def scaled(style: dict[Any, Any]) -> dict[Any, Any]:
    """The style with letters of the layout's size."""
    letters = _layout.get().letters
    return style | {name: letters * style[name] for name in style if name.endswith("size")}


def load_result(source: "Result | str | Path") -> "Result":
    """The given result, or that in a file."""
    # It needs JAX, which figures do not.
    from ..results import Result

    return source if isinstance(source, Result) else Result.from_json(source)


class ShownFigure(Figure):
    """A figure that a notebook shows.

    matplotlib's own figures are shown only if pyplot was imported, which nothing here does.
    """

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        with figure_style():
            self.canvas.print_figure(buffer, format="png", dpi=self.dpi)
        return buffer.getvalue()


def make_figure(height_in: float = HEIGHT_IN) -> Figure:
    """An empty figure unknown to pyplot, with the width of the layout."""
    layout = _layout.get()
    return ShownFigure(figsize=(layout.width_in, layout.height * height_in), layout="constrained")


def make_panels(
    count: int, across: int, heights_in: tuple[float, float], below: str = "", **shared: Any
) -> tuple[Figure, list[Axes]]:
    """A figure with `count` panels in rows of `across`; `heights_in` are those of a row and of the
    space around all of them, and `below` names the x axis of the lowest panel of each column."""
    rows = -(-count // across)
    row_in, around_in = heights_in
    figure = make_figure(height_in=around_in + row_in * rows)
    panels = figure.subplots(rows, across, squeeze=False, **shared).ravel()
    for axes in panels[count:]:
        axes.remove()
    for axes in panels[:count][-across:] if below else ():
        axes.set_xlabel(below)
        axes.tick_params(labelbottom=True)
    return figure, list(panels[:count])


def finish(
    figure: Figure, *panels: Axes, columns: int = 3, legend_of: Sequence[Axes] | None = None
) -> Figure:
    """The figure with ticks, a grid behind the data, labels of one column or row at one height, and
    above it, where it hides no data, one legend of all labels in `legend_of`, by default the
    panels; none if there is no label."""
    for axes in panels:
        axes.tick_params(which="major", **scaled(TICKS))
        axes.tick_params(which="minor", **scaled(MINOR_TICKS))
        axes.grid(visible=True, which="major", **GRID)
        axes.set_axisbelow(True)
    figure.align_ylabels(panels)
    entries = {}
    for axes in panels if legend_of is None else legend_of:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    if entries:
        columns = min(columns, _layout.get().max_in_legend)
        legend = figure.legend(
            list(entries.values()), list(entries), loc="outside upper center", ncols=columns
        )
        for text in legend.get_texts():
            show_name(text)
    return figure


def title(axes: Axes, text: str) -> None:
    """A small title at the left; one that is too long keeps its end."""
    text = legible(text)
    shown = text if len(text) <= LONGEST_TITLE else "…" + text[1 - LONGEST_TITLE :]
    show_name(axes.set_title(shown))


def show_name(text: Text) -> None:
    """Show names of files and rows literally: no formulas, and no letter without a glyph."""
    text.set_parse_math(False)
    shown = legible(text.get_text())
    text.set_text(shown)
    if not shown.isascii():
        text.set_fontfamily(_fonts())


def legible(name: str) -> str:
    r"""The name, with escapes for controls and for letters that no font here can draw.

    Controls would break an SVG file, and letters without a glyph are drawn as empty boxes.

    >>> legible("cell \x1b µ.csv")
    'cell \\x1b µ.csv'
    """
    return "".join(
        letter
        if letter.isprintable() and ord(letter) in _letters()
        else letter.encode("unicode_escape").decode()
        for letter in name
    )


@cache
def _fonts() -> list[str]:
    installed = {font.name for font in fontManager.ttflist}
    return [FONT, *(name for name in FURTHER_FONTS if name in installed)]


@cache
def _letters() -> frozenset[int]:
    """The code points that some font here can draw."""
    return frozenset().union(*(get_font(findfont(name)).get_charmap() for name in _fonts()))


SHORT = 10.0
FEW_DECADES = 100.0
MIDDLE = 300.0
LONG = 1e4
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def label_plainly(axis: Axis) -> None:
    """Ticks with plain numbers on a logarithmic axis, even if it spans less than a decade.

    Call it after the limits are set. An axis of more than four decades shows powers of ten, in
    plain characters: setting them as formulas takes as long as the rest of a figure's text.
    """
    low, high = sorted(axis.get_view_interval())
    within = (1, 2, 5) if high / low < FEW_DECADES else (1, 3) if high / low < MIDDLE else (1,)
    is_short = high / low < SHORT
    label = _power_of_ten if high / low > LONG else _plain
    axis.set_major_locator(
        MaxNLocator(5, steps=[1, 2, 5, 10]) if is_short else LogLocator(subs=within)
    )
    axis.set_major_formatter(FuncFormatter(label))
    axis.set_minor_locator(NullLocator())


def _plain(value: float, _: object) -> str:
    return f"{value:g}"


def _power_of_ten(value: float, _: object) -> str:
    return "10" + str(round(math.log10(value))).translate(RAISED)


# About twice the pixel columns of a 7 inch figure at 150 dpi.
COLUMNS = 2000


def decimate(
    x: Float[np.ndarray, "samples"], y: Float[np.ndarray, "samples"], columns: int = COLUMNS
) -> Int[np.ndarray, "kept"]:
    """Indices of the samples that suffice to draw y over x, which must not decrease.

    The first, last, lowest and highest sample of each of `columns` equal parts of the range of x:
    the drawn line is the same as long as a part is no wider than a pixel (U. Jugel et al., "M4: A
    Visualization-Oriented Time Series Data Aggregation", VLDB 7 (2014) 797). All samples if there
    are fewer.

    >>> decimate(np.arange(6.0), np.array([0.0, 5.0, 2.0, -3.0, 1.0, 1.0]), columns=1)
    array([0, 1, 3, 5])
    """
    if len(x) <= 4 * columns:
        return np.arange(len(x))
    column = np.minimum((x - x[0]) * (columns / (x[-1] - x[0])), columns - 1).astype(int)
    first = np.flatnonzero(np.diff(column, prepend=-1))
    last = np.append(first[1:], len(x)) - 1
    by_height = np.lexsort((y, column))
    return np.unique(np.concatenate([first, last, by_height[first], by_height[last]]))


def draw_line(
    axes: Axes, x: Float[np.ndarray, "samples"], y: Float[np.ndarray, "samples"], **style: Any
) -> Line2D:
    """y over x, with as many samples as can be seen."""
    kept = decimate(x, y)
    (line,) = axes.plot(x[kept], y[kept], **style)
    return line


# The band between the ends of intervals.
BAND: Final[dict[str, Any]] = {"color": SKY_BLUE, "alpha": 0.35, "linewidth": 0.0}
# A marker that is visible over any color.
OPEN: Final[dict[str, Any]] = {
    "markerfacecolor": "white",
    "markeredgecolor": BLACK,
    "markeredgewidth": 0.9,
}


def draw_points(axes: Axes, x: Any, y: Any, marker: str, size: float, **style: Any) -> None:
    """Markers without a line between them."""
    axes.plot(x, y, linestyle="none", marker=marker, markersize=size, **style)


def mark_outside(axes: Axes, x: Any, y: Any, limits: tuple[float, float]) -> None:
    """Set the limits of the y axis, and draw an arrow at the edge wherever a value lies beyond
    them."""
    axes.set_ylim(limits)
    for marker, end, beyond in (("v", limits[0], y < limits[0]), ("^", limits[1], y > limits[1])):
        style = {"color": VERMILLION, "markeredgewidth": 0.0, "clip_on": False, "zorder": 4}
        if beyond.any():
            draw_points(axes, x[beyond], np.full(beyond.sum(), end), marker, 3.6, **style)


# Cycles of three coprime lengths: 315 rows differ in at least one of them. Neighbors also differ in
# lightness, so that they are distinct in grey print.
ROW_COLORS: Final = (BLUE, ORANGE, BLACK, VERMILLION, SKY_BLUE, GREEN, PURPLE)
LINES: Final = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (6, 1.5, 1, 1.5)), (0, (3, 1, 1, 1, 1, 1)))
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "<", ">")


@dataclass(frozen=True)
class RowLook:
    """The look of one row, the same in every figure."""

    color: str
    line: str | tuple[int, tuple[float, ...]]
    marker: str


# Label of a single circuit.
ALONE: Final = "simulated"


def row_looks(labels: Collection[str]) -> dict[str, RowLook]:
    """A look for every label, by its index; plain black for a single circuit.

    >>> [look.marker for look in row_looks(["IBMO-ISO RC", "LS-SO RC"]).values()]
    ['o', 's']
    """
    if [*labels] == [ALONE]:
        return {ALONE: RowLook(BLACK, "-", "")}
    return {
        label: RowLook(
            ROW_COLORS[index % len(ROW_COLORS)],
            LINES[index % len(LINES)],
            MARKERS[index % len(MARKERS)],
        )
        for index, label in enumerate(labels)
    }
