"""Committed results: pages, tables and figures, each written whole or not at all."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

from barnax.cli.output import write_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def save_page(path: Path, text: str) -> None:
    """Put a page or a table in the place of the former one."""
    save_file(path, text.encode())


def save_figure(path: Path, figure: "Figure", dpi: float) -> None:
    """Put a PNG in the place of the former one."""
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=dpi)
    save_file(path, content.getvalue())


def save_file(path: Path, content: bytes) -> None:
    """Put any file in the place of the former one."""
    write_file(path, content)
