"""How every table in a terminal looks."""

from typing import Any

from rich import box

# Seven figures and a file's name in 80 columns.
LAYOUT: dict[str, Any] = {
    "box": box.SIMPLE_HEAD,
    "padding": (0, 1, 0, 0),
    "pad_edge": False,
    "title_style": "bold cyan",
    "header_style": "cyan",
}
