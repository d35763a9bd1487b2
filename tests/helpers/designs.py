"""What tests of designs share: short searches, and the text of a screen."""

import pytest
from rich.console import Console

import barnax
from barnax.cli.session import as_flags
from barnax.reporting.terminal import to_terminal

BLOCKS = [
    barnax.Block("pulse", (10.0, 40.0), (1.0, 0.0)),
    barnax.Block("steps", (30.0, 30.0, 60.0, 60.0), (1.0, -1.0, 0.5, 0.0)),
]


def quick_design(*known, **asked):
    """A design, for which a fifth of the usual number of patterns are tried. Limits, forms and what
    a screen says hold for the best of any number."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("barnax.experiment.search.PREDICTIONS", 24)
        patch.setattr("barnax.experiment.search.FURTHER", 12)
        return barnax.design(*known, **asked)


def screen_of(document):
    console = Console(width=1000)
    with console.capture() as shown:
        for block in to_terminal(document.with_option_names(as_flags)):
            console.print(block)
    return shown.get()
