"""Convergence draws the history of every seed, of a search or of losses alone."""

import numpy as np
import pytest

from barnax.plots import plot_convergence
from helpers.results import make_refinement, make_search, result_of

HISTORIES_V = [[0.03, 0.02, 0.011], [0.04, 0.012, 0.012], [0.05, 0.05, 0.02]]


def test_every_seed_is_a_line_in_millivolt_over_its_evaluations():
    lines = plot_convergence(make_search(HISTORIES_V)).axes[0].get_lines()
    for drawn, history_v in zip(lines, HISTORIES_V, strict=False):
        np.testing.assert_allclose(drawn.get_xdata(), [10, 20, 30])
        np.testing.assert_allclose(drawn.get_ydata(), 1e3 * np.array(history_v))


def test_the_excess_over_the_refined_answer_is_in_percent():
    found = make_search(HISTORIES_V)
    figure = plot_convergence(found, make_refinement(found, 0.01))
    assert len(figure.axes) == 2
    np.testing.assert_allclose(figure.axes[1].get_lines()[0].get_ydata(), [200.0, 100.0, 10.0])


@pytest.mark.slow
def test_a_result_is_drawn_as_the_search_it_holds(refinement):
    figures = (
        plot_convergence(refinement.search, refinement),
        plot_convergence(result_of(refinement)),
    )
    for ours, drawn in zip(*(figure.axes for figure in figures), strict=True):
        for each, same in zip(ours.get_lines(), drawn.get_lines(), strict=True):
            np.testing.assert_array_equal(each.get_xydata(), same.get_xydata())
