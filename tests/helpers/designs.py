"""What tests of designs share: blocks with which a search is short, and the text of a screen."""

from rich.console import Console

import barnax

BLOCKS = [
    barnax.Block("pulse", (10.0, 40.0), (1.0, 0.0)),
    barnax.Block("steps", (30.0, 30.0, 60.0, 60.0), (1.0, -1.0, 0.5, 0.0)),
]


def screen_of(lines):
    console = Console(width=1000)
    with console.capture() as shown:
        for line in lines:
            console.print(line)
    return shown.get()
