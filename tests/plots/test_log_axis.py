"""Tick labels of logarithmic axes: numbers as one writes them, never formulas."""

import pytest
from matplotlib.figure import Figure

from barnax.plots.style import label_plainly


def labels(low: float, high: float) -> list[str]:
    axes = Figure().subplots()
    axes.set_yscale("log")
    axes.set_ylim(low, high)
    label_plainly(axes.yaxis)
    ticks = axes.yaxis.get_majorticklocs()
    assert not len(axes.yaxis.get_minorticklocs())
    shown = [tick for tick in ticks if low <= tick <= high]
    return axes.yaxis.get_major_formatter().format_ticks(shown)


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (2.0, 9.0, ["3", "4.5", "6", "7.5", "9"]),
        (0.5, 60.0, ["1", "3", "10", "30"]),
        (0.5, 2000.0, ["1", "10", "100", "1000"]),
        (1e-7, 2.0, ["10⁻⁷", "10⁻⁶", "10⁻⁵", "10⁻⁴", "10⁻³", "10⁻²", "10⁻¹", "10⁰"]),
        (1e9, 2e13, ["10⁹", "10¹⁰", "10¹¹", "10¹²", "10¹³"]),
    ],
)
def test_labels_are_plain_numbers_or_powers_of_ten(low, high, expected):
    found = labels(low, high)
    assert found == expected
    assert not any("$" in label for label in found)
