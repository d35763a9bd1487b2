"""Figures as bytes: the same for the same figure, in every form."""

import matplotlib
import pytest
from sample_results import make_evaluation, make_record

from barnax.plots import plot_error, plot_hysteresis, plot_ocv
from barnax.plots.sources import Illustration, cell_of
from barnax.plots.style import encode
from barnax.results import Result, make_result
from barnax.search.evaluate import evaluate

BEGINNINGS = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}


def make_figure():
    return plot_error(make_evaluation(make_record(300)))


@pytest.mark.parametrize("kind", BEGINNINGS)
def test_a_figure_gives_the_same_bytes_every_time_and_after_other_forms(kind):
    figure = make_figure()
    first = encode(figure, kind)
    assert first.startswith(BEGINNINGS[kind])
    encode(figure, "png", dpi=40)
    assert first == encode(figure, kind) == encode(make_figure(), kind)


def test_the_style_of_the_session_does_not_show_in_the_bytes():
    plain = encode(make_figure(), "svg")
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "other"}):
        assert encode(make_figure(), "svg") == plain


def test_an_illustration_has_every_form_of_its_figure():
    illustration = Illustration("error", make_figure(), "", "")
    for kind, beginning in BEGINNINGS.items():
        assert getattr(illustration, kind).startswith(beginning)
    assert illustration.png is illustration.png


def test_the_cell_of_a_result_or_of_its_file_is_drawn_as_the_cell_itself(
    checked, short_problem, tmp_path
):
    evaluation = evaluate(short_problem.prepared, checked.parameters)
    result = make_result(checked, [evaluation])
    path = tmp_path / "result.json"
    path.write_text(result.to_json())
    assert isinstance(result, Result)
    for plot in (plot_ocv, plot_hysteresis):
        drawn = [
            [each.get_xydata().tolist() for axes in plot(source).axes for each in axes.get_lines()]
            for source in (short_problem.cell, result, path, str(path))
        ]
        assert all(each == drawn[0] for each in drawn)
    assert cell_of(short_problem.cell) is short_problem.cell
