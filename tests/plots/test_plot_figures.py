"""What holds for every figure."""

import io
import re

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure

from barnax import bundled_file, characterize, plots, read_record
from barnax.plots import encode
from barnax.results import Result
from helpers.golden import RESULT
from helpers.results import make_evaluation, make_record


def make_all_figures() -> dict[str, Figure]:
    tests = [read_record(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    cell = characterize(tests)
    scored = np.arange(600) >= 100
    evaluation = make_evaluation(make_record(600), scored)
    return {
        "voltage": plots.plot_voltage(evaluation),
        "error": plots.plot_error(evaluation),
        "ocv": plots.plot_ocv(cell),
        "voltages": plots.plot_voltage({"a": evaluation, "b": evaluation}),
        "errors": plots.plot_error({"a": evaluation, "b": evaluation}),
    }


NAMES = ("voltage", "error", "ocv", "voltages", "errors")


@pytest.fixture(scope="module")
def settings():
    return dict(matplotlib.rcParams)


@pytest.fixture(scope="module")
def figures(settings):
    return make_all_figures()


@pytest.mark.parametrize("name", NAMES)
def test_every_axis_label_ends_in_or_holds_a_unit(figures, name):
    for axes in figures[name].axes:
        labels = [axes.get_xlabel(), axes.get_ylabel()]
        shown = [label for label in labels if label]
        assert shown or axes.get_shared_x_axes().get_siblings(axes)
        assert all(re.search(r"\[(V|mV|A|s|h|%|-|mOhm|1/SOC)\]", label) for label in shown)


@pytest.mark.parametrize("name", NAMES)
def test_figures_can_be_written_without_a_warning(figures, name):
    # Commands write SVG wherever they draw.
    assert len(encode(figures[name], "pdf")) > 1000


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


def test_what_is_stored_is_drawn_from_its_file_too(tmp_path):
    stored = Result.from_json(RESULT)
    path = tmp_path / "stored.json"
    path.write_text(stored.to_json())
    drawn = [
        [
            one.get_xydata().tolist()
            for axes in plots.plot_ocv(source).axes
            for one in axes.get_lines()
        ]
        for source in (stored, path, str(path))
    ]
    assert drawn[0] == drawn[1] == drawn[2]
