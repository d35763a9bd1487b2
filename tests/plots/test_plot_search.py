"""Convergence draws every seed's and row's history, of seeds, of rows and of losses alone."""

import io

import numpy as np
import pytest

from barnax.comparison.result import SeedAnswerPart
from barnax.plots import (
    plot_compared_convergence,
    plot_compared_parameters,
    plot_convergence,
)
from helpers.comparisons import PARAMETERS, make_comparison, make_failure, make_row
from helpers.results import labels, line, make_refinement, make_search, result_of

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
    assert {"global optimum, 10 mV", "refined, 10.5 mV"} <= set(labels(rmse))
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
    assert labels(figure.axes[0]) == ["one seed"]


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
    for each, drawn in zip(seeds, [[8.0, 2.0, 0.1], [np.nan, 4.0, 1.0]], strict=True):
        np.testing.assert_allclose(each.get_xdata(), [10, 20, 30])
        np.testing.assert_allclose(each.get_ydata(), drawn)
    np.testing.assert_allclose(median.get_ydata(), [np.nan, 3.0, 0.55])


def test_one_search_used_alone_is_one_seed():
    stats = {"history": LOSSES[0], "population": 10, "evaluations": 30}
    (axes,) = plot_convergence(stats).axes
    assert labels(axes) == ["one seed"]
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


@pytest.mark.parametrize("plot", [plot_compared_convergence, plot_compared_parameters])
def test_a_row_without_an_answer_does_not_change_the_looks_of_the_others(plot):
    rows = [make_failure("rls so-rc", "No."), make_row("lm so-rc", 20.0)]
    colors = [
        {line.get_color() for line in plot(make_comparison(given)).axes[0].get_lines()}
        for given in (rows, rows[1:])
    ]
    assert colors[0] == colors[1]


def test_convergence_is_each_row_s_median_with_a_band_of_its_seeds():
    row = make_row("ibmo so-rc", 20.0)
    axes = plot_compared_convergence(make_comparison([row])).axes[0]
    median = line(axes, "ibmo so-rc")
    np.testing.assert_allclose(median.get_xdata(), [30, 165, 300])
    np.testing.assert_allclose(median.get_ydata(), [40.0, 30.0, 20.2])
    (band,) = axes.collections
    heights = band.get_paths()[0].vertices[:, 1]
    np.testing.assert_allclose([heights.min(), heights.max()], [20.04, 40.0])


def test_a_row_without_a_history_is_a_mark_at_what_it_spent():
    seed = SeedAnswerPart(rmse_v=0.03, parameters=PARAMETERS, evaluations=0, history_v=None)
    row = make_row("ls so-rc", 30.0, seeds=1).model_copy(update={"seeds": (seed,)})
    drawn = line(plot_compared_convergence(make_comparison([row])).axes[0], "ls so-rc")
    assert (drawn.get_xdata(), drawn.get_ydata()) == ([1.0], [30.0])


def test_the_excess_over_a_known_optimum_has_a_panel():
    rows = [make_row("ibmo so-rc", 20.0), make_row("ibmo esc", 20.0)]
    figure = plot_compared_convergence(make_comparison(rows, optima_mv={"so-rc": 20.0}))
    figure.savefig(io.BytesIO())
    assert labels(figure.axes[1]) == ["ibmo so-rc"]
    np.testing.assert_allclose(
        line(figure.axes[1], "ibmo so-rc").get_ydata(), [100.0, 50.0, 1.0], rtol=1e-6
    )
    assert len(plot_compared_convergence(make_comparison(rows)).axes) == 1


def test_generations_without_a_finite_error_are_not_drawn():
    seed = SeedAnswerPart(
        rmse_v=0.03, parameters=PARAMETERS, evaluations=20, history_v=(0.04, 0.03)
    )
    lost = seed.model_construct(**dict(seed) | {"history_v": (np.inf, 0.03)})
    row = make_row("bmo so-rc", 30.0).model_copy(update={"seeds": (lost,)})
    figure = plot_compared_convergence(make_comparison([]).model_copy(update={"rows": (row,)}))
    figure.savefig(io.BytesIO())
    np.testing.assert_array_equal(line(figure.axes[0], "bmo so-rc").get_ydata(), [np.nan, 30.0])


@pytest.mark.slow
def test_a_result_is_drawn_as_the_search_it_holds(refinement):
    figures = (
        plot_convergence(refinement.search, refinement),
        plot_convergence(result_of(refinement)),
    )
    for ours, drawn in zip(*(figure.axes for figure in figures), strict=True):
        for each, same in zip(ours.get_lines(), drawn.get_lines(), strict=True):
            np.testing.assert_array_equal(each.get_xydata(), same.get_xydata())
