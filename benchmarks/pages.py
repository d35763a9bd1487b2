"""Committed results: pages, tables and figures written whole, and where their numbers come from."""

import csv
import datetime
import importlib.metadata
import io
import os
import platform
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from barnax.cli.output import write_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PACKAGES = ("barnax", "jax", "jaxlib", "optimistix", "equinox", "numpy", "scipy")


def save_page(path: Path, text: str) -> None:
    """Put a page or a table in the place of the former one."""
    save_file(path, text.encode())


def publish(path: Path, text: str) -> None:
    """Put a page in the place of the former one, and print it."""
    save_page(path, text)
    print(text)


def save_figure(path: Path, figure: "Figure", dpi: float) -> None:
    """Put a PNG in the place of the former one."""
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=dpi)
    save_file(path, content.getvalue())


def save_file(path: Path, content: bytes) -> None:
    """Put any file in the place of the former one."""
    write_file(path, content)


def write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    """The rows under a header of their keys."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(
        {key: f"{value:.6g}" if isinstance(value, float) else value for key, value in row.items()}
        for row in rows
    )
    save_page(path, text.getvalue())


def provenance(command: str, key: int, *more_packages: str) -> dict[str, str]:
    """What a reader needs to make the same numbers again."""
    versions = [f"{name} {importlib.metadata.version(name)}" for name in PACKAGES + more_packages]
    return {
        "command": f"`{command}`",
        "key": str(key),
        "versions": ", ".join([f"Python {platform.python_version()}", *versions]),
        "machine": f"{os.cpu_count()} shared CPU cores, {platform.machine()}, float64",
        "date": datetime.date.today().isoformat(),
    }


def as_markdown(facts: dict[str, str]) -> str:
    """The facts as a list."""
    return "\n".join(f"- {name}: {fact}" for name, fact in facts.items())


def data_folder(given: str | None) -> Path | None:
    """The folder of measured cells, or None where there is none."""
    folder = given or os.environ.get("BARNAX_SHARED_DATA")
    path = Path(folder) if folder else Path(__file__).parents[2] / "shared" / "data"
    return path if path.is_dir() else None


def given_folder(arguments: Sequence[str]) -> Path:
    """The folder of measured cells that a command was given, or where it is; ends without one."""
    folder = data_folder(arguments[0] if arguments else None)
    if folder is None:
        sys.exit("the measured cells are not here; give their folder")
    return folder
