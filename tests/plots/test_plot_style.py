"""How every figure looks and is written: decimation, ticks, names, bytes."""

import io
import itertools
from xml.etree import ElementTree

import matplotlib.image
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from barnax.plots import (
    plot_error,
    plot_ocv,
    plot_voltage,
    style,
)
from barnax.plots.pictures import Illustration, encode
from barnax.plots.style import LONGEST_TITLE, decimate, label_plainly, legible
from helpers.results import make_cell, make_evaluation, make_record

BEGINNINGS = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}


def make_figure():
    return plot_error(make_evaluation(make_record(300)))


def test_a_short_record_keeps_every_sample():
    x = np.arange(40.0)
    np.testing.assert_array_equal(decimate(x, np.sin(x), columns=10), np.arange(40))


@given(st.integers(0, 2**32 - 1), st.integers(1, 30), st.integers(121, 600))
def test_every_column_keeps_its_extremes_and_ends(seed, columns, samples):
    random = np.random.default_rng(seed)
    x = np.cumsum(random.exponential(size=samples))
    y = random.normal(size=samples)
    kept = decimate(x, y, columns)
    edges = np.linspace(x[0], x[-1], columns + 1)
    for left, right in itertools.pairwise(edges):
        # Samples within rounding of an edge may belong to either side.
        inside = np.flatnonzero((x > left + 1e-9) & (x < right - 1e-9))
        if len(inside) == 0:
            continue
        among = kept[(x[kept] > left - 1e-9) & (x[kept] < right + 1e-9)]
        assert y[among].min() <= y[inside].min()
        assert y[among].max() >= y[inside].max()
    assert (kept[0], kept[-1]) == (0, samples - 1)
    assert len(kept) <= 4 * columns


@pytest.mark.parametrize("plot", [plot_voltage, plot_error])
def test_a_long_record_is_drawn_with_few_points(plot):
    random = np.random.default_rng(0)
    evaluation = make_evaluation(make_record(200_000), error_v=random.normal(size=200_000))
    lines = [line for line in plot(evaluation).axes[0].get_lines() if len(line.get_xdata()) > 2]
    assert lines
    assert all(len(line.get_xdata()) <= 8000 for line in lines)
    highest = (
        evaluation.error_v.max() if plot is plot_error else evaluation.prepared.voltage_v.max()
    )
    drawn = max(np.nanmax(line.get_ydata()) for line in lines)
    assert drawn >= highest


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
        (2.0, 9.0, ["2", "4", "6", "8"]),
        (3.0, 40.0, ["5", "10", "20"]),
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


# Letters of other scripts, a formula, an escape sequence, a byte that is no UTF-8, an emoji.
ODD = "电池 $x^{$ \x1b[0m\x00 \udcff \U0001f50b.csv"
DRAWN = {
    "voltage": lambda each: plot_voltage(each),
    "error": lambda each: plot_error(each),
    "voltages": lambda each: plot_voltage({ODD: each}),
    "errors": lambda each: plot_error({ODD: each}),
}


@pytest.mark.parametrize(
    "plot",
    [
        pytest.param(plot, id=name, marks=[] if name == "voltages" else [pytest.mark.slow])
        for name, plot in DRAWN.items()
    ],
)
def test_odd_names_of_files_and_rows_are_drawn_without_a_warning(plot):
    figure = plot(make_evaluation(make_record(200, name=ODD)))
    ElementTree.fromstring(encode(figure, "svg"))
    for kind in ("png", "pdf"):
        assert encode(figure, kind, dpi=40).startswith(BEGINNINGS[kind])
    assert "$x^{$ \\x1b[0m\\x00 \\udcff" in figure.axes[0].get_title("left")


def test_a_letter_without_a_glyph_keeps_its_code_and_all_others_stay(monkeypatch):
    monkeypatch.setattr("barnax.plots.style.FURTHER_FONTS", ())
    for cached in (style._fonts, style._letters):
        cached.cache_clear()
    try:
        assert legible("Zelle µ−1 電.csv") == "Zelle µ−1 \\u96fb.csv"
    finally:
        for cached in (style._fonts, style._letters):
            cached.cache_clear()


def test_the_end_of_a_long_name_is_kept():
    figure = plot_voltage(make_evaluation(make_record(200, name=100 * "long_" + ".csv")))
    shown = figure.axes[0].get_title("left")
    assert shown.startswith("…")
    assert shown.endswith("long_.csv")
    assert len(shown) == LONGEST_TITLE


def test_a_figure_shows_itself_in_a_notebook():
    figure = make_figure()
    shown = matplotlib.image.imread(io.BytesIO(figure._repr_png_()))
    assert shown.shape[:2] == tuple(figure.bbox.size[::-1])
    assert 0 < np.mean(shown[..., :3] < 1) < 0.5


@pytest.mark.parametrize("kind", BEGINNINGS)
def test_a_figure_gives_the_same_bytes_every_time_and_after_other_forms(kind):
    figure = make_figure()
    first = encode(figure, kind)
    assert first.startswith(BEGINNINGS[kind])
    encode(figure, "png", dpi=40)
    assert first == encode(figure, kind) == encode(make_figure(), kind)


def test_an_illustration_has_both_forms_and_a_small_picture_that_is_the_large_one():
    drawn = Illustration("error", make_figure, "", "")
    for kind in ("png", "svg"):
        assert getattr(drawn, kind).startswith(BEGINNINGS[kind])
    assert drawn.png is drawn.png
    large, small = (
        matplotlib.image.imread(io.BytesIO(each))[..., :3] for each in (drawn.png, drawn.small_png)
    )
    assert len(drawn.small_png) < 0.6 * len(drawn.png)
    assert np.abs(large - small).max() < 0.1


def test_a_figure_for_a_column_is_half_as_wide_with_letters_of_seven_points():
    with style.column_width():
        figure = plot_ocv(make_cell())
    figure.draw_without_rendering()
    (axes,) = figure.axes
    letters = [axes.xaxis.label, *axes.get_xticklabels(), *figure.legends[0].get_texts()]
    assert figure.get_size_inches()[0] == 3.5
    assert max(text.get_fontsize() for text in letters) == pytest.approx(7.0)
    assert plot_ocv(make_cell()).get_size_inches()[0] == 7.0


def test_in_a_column_every_letter_stands_inside_the_figure():
    evaluation = make_evaluation(make_record(9000))
    with style.column_width():
        figures = [plot_ocv(make_cell()), plot_voltage(evaluation), plot_error(evaluation)]
    for figure in figures:
        figure.draw_without_rendering()
        legend = figure.legends[0].get_window_extent()
        box = figure.get_tightbbox().transformed(figure.dpi_scale_trans)
        for each in (legend, box):
            assert each.x0 >= -1
            assert each.x1 <= figure.bbox.x1 + 1
