"""How every figure looks and is written: decimation, ticks, names, bytes."""

import io
import itertools
import re
from xml.etree import ElementTree

import matplotlib.image
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib import pyplot

from barnax.plots import encode, plot_error, plot_ocv, plot_voltage, style
from barnax.plots.style import decimate
from barnax.reporting.document import Picture
from helpers.results import make_cell, make_evaluation, make_record

BEGINNINGS = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}


def make_figure():
    return plot_error(make_evaluation(make_record(300)))


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
    highest = evaluation.error_v if plot is plot_error else evaluation.prepared.voltage_v
    assert max(np.nanmax(line.get_ydata()) for line in lines) >= highest.max()


# Letters of other scripts, a formula, an escape sequence, a byte that is no UTF-8, an emoji.
ODD = "电池 $x^{$ \x1b[0m\x00 \udcff \U0001f50b.csv"


def test_odd_names_of_files_and_rows_are_drawn_without_a_warning():
    figure = plot_voltage({ODD: make_evaluation(make_record(200, name=ODD))})
    ElementTree.fromstring(encode(figure, "svg"))
    for kind in ("png", "pdf"):
        assert encode(figure, kind, dpi=40).startswith(BEGINNINGS[kind])
    assert "$x^{$ \\x1b[0m\\x00 \\udcff" in figure.axes[0].get_title("left")


def test_a_figure_gives_the_same_bytes_every_time_and_after_other_forms():
    figure = make_figure()
    first = {kind: encode(figure, kind, dpi=50) for kind in BEGINNINGS}
    assert all(first[kind].startswith(begins) for kind, begins in BEGINNINGS.items())
    assert first == {kind: encode(figure, kind, dpi=50) for kind in BEGINNINGS}
    other = make_figure()
    assert first == {kind: encode(other, kind, dpi=50) for kind in reversed(BEGINNINGS)}


def test_an_illustration_has_both_forms_and_a_small_picture_that_is_the_large_one():
    drawn = Picture("error", make_figure, "", "")
    for kind in ("png", "svg"):
        assert getattr(drawn, kind).startswith(BEGINNINGS[kind])
    assert drawn.png is drawn.png
    large, small = (
        matplotlib.image.imread(io.BytesIO(each))[..., :3] for each in (drawn.png, drawn.content)
    )
    assert len(drawn.content) < 0.6 * len(drawn.png)
    assert np.abs(large - small).max() < 0.1


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


@pytest.fixture(scope="module")
def settings():
    return dict(matplotlib.rcParams)


@pytest.fixture(scope="module")
def figures(settings, bundled_cell):
    evaluation = make_evaluation(make_record(600), np.arange(600) >= 100)
    several = {"a": evaluation, "b": evaluation}
    drawn = [plot(given) for plot in (plot_voltage, plot_error)
             for given in (evaluation, several)]  # fmt: skip
    return [*drawn, plot_ocv(bundled_cell)]


def test_every_axis_label_ends_in_or_holds_a_unit(figures):
    for axes in (axes for figure in figures for axes in figure.axes):
        shown = [label for label in (axes.get_xlabel(), axes.get_ylabel()) if label]
        assert shown or axes.get_shared_x_axes().get_siblings(axes)
        assert all(re.search(r"\[(V|mV|A|s|h|%|-|mOhm|1/SOC)\]", label) for label in shown)


def test_drawing_leaves_pyplot_and_the_global_style_as_they_were(settings, figures):
    del figures
    assert pyplot.get_fignums() == []
    assert dict(matplotlib.rcParams) == settings


def test_the_style_of_the_session_does_not_show():
    file, plain = io.BytesIO(), io.BytesIO()
    evaluation = make_evaluation(make_record(300))
    plot_voltage(evaluation).savefig(plain, format="raw", dpi=40)
    plain_svg = encode(plot_voltage(evaluation), "svg")
    axes = {"axes.facecolor": "black", "xtick.labelsize": 30.0, "axes.grid": False}
    with matplotlib.rc_context(axes | {"svg.fonttype": "none", "svg.hashsalt": "other"}):
        figure = plot_voltage(evaluation)
        svg = encode(plot_voltage(evaluation), "svg")
    figure.savefig(file, format="raw", dpi=40)
    assert file.getvalue() == plain.getvalue()
    assert svg == plain_svg
