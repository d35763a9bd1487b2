"""Figures of results: each function takes a result and returns a matplotlib `Figure`.

Nothing is shown or written, and neither pyplot nor the global style is touched: write a figure with
its own `savefig`. Within `column_width()` they fit a journal's column. Importing this package loads
matplotlib, but not JAX.
"""

import io
from typing import Any, Final, Literal

import matplotlib
from matplotlib.figure import Figure
from PIL.Image import Dither, Quantize
from PIL.PngImagePlugin import PngImageFile

from .cell import plot_ocv, plot_pulse_resistances, plot_pulses
from .cells import plot_cell_life, plot_fleet_life, plot_pack
from .error import plot_error, plot_soc_replay
from .soc_tables import plot_over_temperature, plot_summary, plot_tables
from .style import column_width, figure_style
from .voltage import plot_design, plot_voltage

__all__ = [
    "column_width",
    "plot_cell_life",
    "plot_design",
    "plot_error",
    "plot_fleet_life",
    "plot_ocv",
    "plot_over_temperature",
    "plot_pack",
    "plot_pulse_resistances",
    "plot_pulses",
    "plot_soc_replay",
    "plot_summary",
    "plot_tables",
    "plot_voltage",
]

Kind = Literal["png", "svg", "pdf"]
# Dates and versions would make equal runs differ.
UNDATED: Final[dict[Kind, dict[str, Any]]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


def encode(figure: Figure, kind: Kind = "png", dpi: int = 150) -> bytes:
    """The figure as PNG, SVG or PDF, in memory.

    `dpi` is the resolution of PNG and of rasterized parts of SVG and PDF. The first call fixes the
    figure's layout, so that all its files look the same.

    >>> encode(Figure(), "svg")[:5]
    b'<?xml'
    """
    buffer = io.BytesIO()
    with figure_style(), matplotlib.rc_context({"svg.hashsalt": "barnax"}):
        # With a new layout for every file, axes would move by a fraction of a point each time.
        engine = figure.get_layout_engine()
        if engine is not None:
            engine.execute(figure)
            # Not "none": with that placeholder every figure is drawn twice.
            figure.set_layout_engine(None)
        figure.canvas.print_figure(buffer, format=kind, dpi=dpi, metadata=UNDATED[kind])
    return buffer.getvalue()


def with_few_colors(png: bytes) -> bytes:
    """A PNG with 256 colors, a third of the bytes, for pages with many figures."""
    image = PngImageFile(io.BytesIO(png)).convert("RGB")
    buffer = io.BytesIO()
    # The only one of Pillow's methods that keeps rare colors close.
    few = image.quantize(method=Quantize.MAXCOVERAGE, dither=Dither.NONE)
    few.save(buffer, "png", optimize=True)
    return buffer.getvalue()
