"""What tests of designs share: short searches."""

import pytest

import barnax

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
