"""A figure as the content of an image file, the same bytes for the same figure."""

import io
from typing import Any, Final, Literal

import matplotlib
from matplotlib.figure import Figure

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
