"""The error figure draws measured minus simulated voltage, scored and unscored."""

import io

import numpy as np
import pytest

from barnax.plots import plot_error
from helpers.results import line, make_evaluation, make_record


def test_the_line_is_the_error_in_millivolt():
    evaluation = make_evaluation(make_record(600))
    drawn = line(plot_error(evaluation).axes[0], "scored error")
    np.testing.assert_array_equal(drawn.get_xdata(), evaluation.prepared.time_s)
    np.testing.assert_array_equal(drawn.get_ydata(), 1e3 * evaluation.error_v)


def test_scored_and_unscored_samples_together_are_all_samples():
    scored = np.ones(600, bool)
    scored[:100] = scored[300:310] = False
    evaluation = make_evaluation(make_record(600), scored)
    over_time, over_soc = plot_error(evaluation).axes
    emphasized, grey = line(over_time, "scored error"), line(over_time, "not scored")
    assert emphasized.get_color() != grey.get_color()
    assert emphasized.get_zorder() > grey.get_zorder()
    for drawn, chosen in ((emphasized, scored), (grey, ~scored)):
        error_mv = drawn.get_ydata()
        np.testing.assert_array_equal(
            error_mv[np.isfinite(error_mv)], 1e3 * evaluation.error_v[chosen]
        )
    assert np.count_nonzero(np.isnan(emphasized.get_ydata())) == 1
    points, grey_points = over_soc.get_lines()[:2]
    np.testing.assert_array_equal(points.get_xdata(), evaluation.prepared.soc[scored])
    np.testing.assert_array_equal(grey_points.get_xdata(), evaluation.prepared.soc[~scored])


def test_the_dashed_lines_are_the_rmse_of_the_scored_samples():
    error_v = np.where(np.arange(600) < 100, 0.5, 3e-3)
    evaluation = make_evaluation(make_record(600), np.arange(600) >= 100, error_v)
    upper = line(plot_error(evaluation).axes[0], "± RMSE, 3 mV")
    np.testing.assert_allclose(upper.get_ydata(), [3.0, 3.0])


def test_the_steps_are_the_rmse_in_each_twentieth_of_soc():
    error_v = np.where(np.arange(600) < 300, 2e-3, 4e-3)
    upper = plot_error(make_evaluation(make_record(600), error_v=error_v)).axes[1].patches[0]
    heights, edges, _ = upper.get_data()
    assert len(edges) == 21
    np.testing.assert_allclose(heights[:9], 4.0)
    np.testing.assert_allclose(heights[11:], 2.0)


def test_few_samples_far_off_do_not_flatten_the_rest_and_are_counted():
    error_v = 5e-3 * np.sin(np.arange(1000) / 50)
    error_v[-3:] = -0.6
    over_time, over_soc = plot_error(make_evaluation(make_record(1000), error_v=error_v)).axes
    assert over_time.get_ylim()[0] > -100
    assert over_soc.get_title("right") == "outside: 3 of 1000 scored samples, up to −600 mV"


def test_samples_inside_the_limits_need_no_note():
    assert plot_error(make_evaluation(make_record(1000))).axes[1].get_title("right") == ""


@pytest.mark.parametrize("error_v", [np.zeros(10), np.linspace(-0.01, 0.02, 10)])
def test_ten_samples_and_no_error_at_all_are_drawn(error_v):
    figure = plot_error(make_evaluation(make_record(10), error_v=error_v))
    figure.savefig(io.BytesIO())
    low, high = figure.axes[0].get_ylim()
    assert low < 1e3 * error_v.min()
    assert high > 1e3 * error_v.max()
