"""What holds for every figure."""

import io
import re

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot

from barnax import plots
from barnax.plots import encode
from helpers.results import make_evaluation, make_record


@pytest.fixture(scope="module")
def settings():
    return dict(matplotlib.rcParams)


@pytest.fixture(scope="module")
def figures(settings, bundled_cell):
    evaluation = make_evaluation(make_record(600), np.arange(600) >= 100)
    several = {"a": evaluation, "b": evaluation}
    drawn = [plot(given) for plot in (plots.plot_voltage, plots.plot_error)
             for given in (evaluation, several)]  # fmt: skip
    return [*drawn, plots.plot_ocv(bundled_cell)]


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
    plots.plot_voltage(evaluation).savefig(plain, format="raw", dpi=40)
    plain_svg = encode(plots.plot_voltage(evaluation), "svg")
    axes = {"axes.facecolor": "black", "xtick.labelsize": 30.0, "axes.grid": False}
    with matplotlib.rc_context(axes | {"svg.fonttype": "none", "svg.hashsalt": "other"}):
        figure = plots.plot_voltage(evaluation)
        svg = encode(plots.plot_voltage(evaluation), "svg")
    figure.savefig(file, format="raw", dpi=40)
    assert file.getvalue() == plain.getvalue()
    assert svg == plain_svg
