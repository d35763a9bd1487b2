"""The convergence figure draws every seed's history."""

import io

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


def test_the_median_is_bolder_than_the_seeds():
    *seeds, median = plot_convergence(make_search(HISTORIES_V)).axes[0].get_lines()
    np.testing.assert_allclose(median.get_ydata(), [40.0, 20.0, 12.0])
    assert median.get_linewidth() >= 2 * max(line.get_linewidth() for line in seeds)


def test_the_excess_over_the_refined_answer_is_in_percent():
    found = make_search(HISTORIES_V)
    figure = plot_convergence(found, make_refinement(found, 0.01))
    assert len(figure.axes) == 2
    np.testing.assert_allclose(figure.axes[1].get_lines()[0].get_ydata(), [200.0, 100.0, 10.0])


def test_the_known_optimum_is_drawn_and_the_excess_is_over_the_lowest():
    found = make_search(HISTORIES_V)
    rmse, excess = plot_convergence(found, make_refinement(found, 0.0105), 0.01).axes
    assert {"global optimum, 10 mV", "refined, 10.5 mV"} <= set(rmse.get_legend_handles_labels()[1])
    np.testing.assert_allclose(excess.get_lines()[0].get_ydata(), [200.0, 100.0, 10.0])


def test_the_right_panel_s_label_keeps_clear_of_the_left_panel():
    found = make_search(HISTORIES_V)
    figure = plot_convergence(found, make_refinement(found, 0.01))
    figure.draw_without_rendering()
    left, right = figure.axes
    gap = right.yaxis.label.get_window_extent().x0 - left.get_window_extent().x1
    assert gap > right.yaxis.label.get_fontsize() / 72 * figure.dpi


def test_an_excess_of_nothing_is_drawn_at_the_floor():
    found = make_search([[0.02, 0.01]])
    figure = plot_convergence(found, make_refinement(found, 0.01))
    figure.savefig(io.BytesIO())
    np.testing.assert_allclose(figure.axes[1].get_lines()[0].get_ydata(), [100.0, 1e-6])


def test_one_seed_needs_no_median():
    figure = plot_convergence(make_search(HISTORIES_V[:1]))
    figure.savefig(io.BytesIO())
    assert figure.axes[0].get_legend_handles_labels()[1] == ["one seed"]


def test_generations_before_the_first_finite_error_are_left_out():
    found = make_search([[np.inf, 0.02, 0.01], [0.03, 0.02, 0.01]])
    figure = plot_convergence(found, make_refinement(found, 0.01))
    figure.savefig(io.BytesIO())
    np.testing.assert_array_equal(figure.axes[0].get_lines()[0].get_ydata(), [np.nan, 20.0, 10.0])


def test_a_refined_error_of_zero_has_no_excess_to_draw():
    found = make_search(HISTORIES_V)
    figure = plot_convergence(found, make_refinement(found, 0.0))
    figure.savefig(io.BytesIO())
    assert len(figure.axes) == 1


@pytest.mark.parametrize("lowest_v", [0.029, 0.002, 1e-8])
def test_any_span_of_errors_has_labeled_ticks(lowest_v):
    figure = plot_convergence(make_search([[0.03, lowest_v]]))
    figure.savefig(io.BytesIO())
    low, high = figure.axes[0].get_ylim()
    ticks = [
        tick
        for tick in figure.axes[0].yaxis.get_major_ticks()
        if low <= tick.get_loc() <= high and tick.label1.get_text()
    ]
    assert len(ticks) >= 3


LOSSES = np.array([[8.0, 2.0, 0.0], [np.inf, 4.0, 1.0]])
STATS = {"history": LOSSES, "population": np.array([10, 10]), "evaluations": np.array([30, 30])}


def test_the_stats_of_searches_used_alone_are_drawn_as_losses():
    (axes,) = plot_convergence(STATS).axes
    *seeds, median = axes.get_lines()
    assert axes.get_ylabel() == "Best loss"
    for line, drawn in zip(seeds, [[8.0, 2.0, 0.1], [np.nan, 4.0, 1.0]], strict=True):
        np.testing.assert_allclose(line.get_xdata(), [10, 20, 30])
        np.testing.assert_allclose(line.get_ydata(), drawn)
    np.testing.assert_allclose(median.get_ydata(), [np.nan, 3.0, 0.55])


def test_one_search_used_alone_is_one_seed():
    stats = {"history": LOSSES[0], "population": 10, "evaluations": 30}
    (axes,) = plot_convergence(stats).axes
    assert axes.get_legend_handles_labels()[1] == ["one seed"]
    np.testing.assert_allclose(axes.get_lines()[0].get_ydata(), [8.0, 2.0, 0.2])


@pytest.mark.parametrize("lowest", [-3.0, 0.0])
def test_losses_without_a_logarithm_are_drawn_on_a_linear_axis(lowest):
    history = np.array([0.0, lowest, lowest])
    figure = plot_convergence({"history": history, "population": 10, "evaluations": 30})
    figure.savefig(io.BytesIO())
    assert figure.axes[0].get_yscale() == "linear"
    np.testing.assert_array_equal(figure.axes[0].get_lines()[0].get_ydata(), history)


def test_searches_that_failed_altogether_make_an_empty_figure():
    figure = plot_convergence(STATS | {"history": np.full((2, 3), np.inf)})
    figure.savefig(io.BytesIO())


def test_stats_of_another_solver_are_refused():
    with pytest.raises(ValueError, match="lack history, population"):
        plot_convergence({"num_steps": 3, "evaluations": 30})


def test_a_stored_result_is_drawn_as_the_search_it_holds(refinement, tmp_path):
    result = result_of(refinement)
    (tmp_path / "result.json").write_text(result.to_json())
    expected = plot_convergence(refinement.search, refinement)
    for stored in (result, tmp_path / "result.json"):
        figure = plot_convergence(stored)
        for ours, drawn in zip(expected.axes, figure.axes, strict=True):
            for line, same in zip(ours.get_lines(), drawn.get_lines(), strict=True):
                np.testing.assert_array_equal(line.get_xydata(), same.get_xydata())
