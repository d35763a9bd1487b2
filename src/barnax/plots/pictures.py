"""Figures as files: PNG, SVG or PDF in memory, and a figure with its caption."""

import io
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Final, Literal, ParamSpec

import matplotlib
from matplotlib.figure import Figure
from PIL.Image import Dither, Quantize
from PIL.PngImagePlugin import PngImageFile

from .style import figure_style

Kind = Literal["png", "svg", "pdf"]
DPI: Final = 150
# Dates and versions would make equal runs differ.
UNDATED: Final[dict[Kind, dict[str, Any]]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


def encode(figure: Figure, kind: Kind = "png", dpi: int = DPI) -> bytes:
    """The figure as PNG, SVG or PDF, in memory.

    `dpi` is the resolution of PNG and of what is drawn as a picture inside SVG and PDF. The first
    call settles the figure's layout, so that all its files look the same.

    >>> encode(Figure(), "svg")[:5]
    b'<?xml'
    """
    buffer = io.BytesIO()
    with figure_style(), matplotlib.rc_context({"svg.hashsalt": "barnax"}):
        # Laid out anew for every file, axes would move by a fraction of a point each time.
        engine = figure.get_layout_engine()
        if engine is not None:
            engine.execute(figure)
            # Not "none": with that stand-in every figure is drawn twice.
            figure.set_layout_engine(None)
        figure.canvas.print_figure(buffer, format=kind, dpi=dpi, metadata=UNDATED[kind])
    return buffer.getvalue()


# Sharp on a phone and in print, and small enough to send.
ILLUSTRATION_DPI: Final = 180
Given = ParamSpec("Given")


@dataclass(frozen=True, eq=False)
class Illustration:
    """A figure, drawn when it is first asked for, with what a page and a file need of it.

    Each form is drawn once.

    Attributes:
        name: Its file's name without a suffix.
        draw: What draws it.
        caption: Its caption.
        alt: Words for who cannot see it.
        is_dense: It holds so many points that PNG is the smaller form.
        is_main: It is written beside a result even where no report is; to draw them all takes
            longer than the search.
        live: The numbers of an interactive form, and its caption.
    """

    name: str
    draw: Callable[[], Figure]
    caption: str
    alt: str
    is_dense: bool = True
    is_main: bool = False
    live: Callable[[], tuple[dict[str, Any], str]] | None = None

    @cached_property
    def figure(self) -> Figure:
        return self.draw()

    @cached_property
    def png(self) -> bytes:
        return encode(self.figure, "png", ILLUSTRATION_DPI)

    @cached_property
    def small_png(self) -> bytes:
        """The PNG with 256 colors, a third of the bytes, for a page that holds many."""
        image = PngImageFile(io.BytesIO(self.png)).convert("RGB")
        buffer = io.BytesIO()
        # The one of Pillow's methods that keeps rare colors close.
        few = image.quantize(method=Quantize.MAXCOVERAGE, dither=Dither.NONE)
        few.save(buffer, "png", optimize=True)
        return buffer.getvalue()

    @cached_property
    def svg(self) -> bytes:
        return encode(self.figure, "svg", ILLUSTRATION_DPI)


# The words of each kind of figure, by the function that draws it.
_WORDS: dict[Callable[..., Figure], dict[str, Any]] = {}


def illustration(
    caption: str, alt: str, **more: bool
) -> Callable[[Callable[Given, Figure]], Callable[Given, Figure]]:
    """A decorator: a function draws in our style, and `illustrate` knows its words.

    In both texts {} stands for the record or the circuit; `more` are fields of `Illustration`.
    """

    def register(draw: Callable[Given, Figure]) -> Callable[Given, Figure]:
        styled = figure_style()(draw)
        _WORDS[styled] = {"caption": caption, "alt": alt, **more}
        return styled

    return register


def illustrate(
    name: str, subject: str, draw: Callable[Given, Figure], *given: Given.args, **more: Given.kwargs
) -> Illustration:
    """The figure that a registered function draws of a subject, with its words."""
    words = _WORDS[draw]
    caption = words["caption"].format(subject)
    return Illustration(name, partial(draw, *given, **more), **words | {"caption": caption})


def record_roles(identified: int, validated: int) -> list[str]:
    """Names of each record's files: those identified on, then those for validation.

    >>> record_roles(1, 2)
    ['identification', 'validation-1', 'validation-2']
    """
    first = [f"identification-{number}" for number in range(1, identified + 1)]
    return [
        *(first if identified > 1 else ["identification"]),
        *(f"validation-{number}" for number in range(1, validated + 1)),
    ]
