"""Figures of records over time: what one circuit, or every row of a comparison, makes of one."""

import numpy as np
import pytest

from barnax.plots import plot_error, plot_voltage
from barnax.plots.voltage import worst_stretch
from helpers.results import line, make_evaluation, make_record


@pytest.fixture
def scored():
    """Which of 600 samples count, in two stretches."""
    scored = np.ones(600, bool)
    scored[:100] = scored[300:310] = False
    return scored


def test_the_magnified_stretch_is_a_part_of_the_record_on_the_same_clock():
    evaluation = make_evaluation(make_record(9000))
    figure = plot_voltage(evaluation)
    measured = figure.axes[1].get_lines()[0]
    origin_h = float(figure.axes[3].get_xlabel().split()[2])
    time_s = measured.get_xdata() + 3600 * origin_h
    start = round(time_s[0] - 1000.0)
    span = slice(start, start + 200)
    np.testing.assert_allclose(time_s, evaluation.prepared.time_s[span], rtol=1e-12)
    np.testing.assert_array_equal(measured.get_ydata(), evaluation.prepared.voltage_v[span])


def test_unscored_samples_are_shaded_and_named(scored):
    evaluation = make_evaluation(make_record(600), scored)
    figure = plot_voltage(evaluation)
    (shade,) = figure.axes[0].collections
    spans = [path.get_extents().intervalx for path in shade.get_paths()]
    np.testing.assert_allclose(spans, [[1000.0, 1100.0], [1300.0, 1310.0]])
    assert "not scored" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_the_magnified_stretch_is_the_scored_one_with_the_largest_error():
    error_v = np.random.default_rng(3).normal(0.0, 1e-3, 3000)
    error_v[500:900] = 1.0
    error_v[2000:2200] += 0.02
    scored = np.arange(3000) >= 1000
    sums_v2 = np.convolve(np.where(scored, error_v, 0.0) ** 2, np.ones(200), "valid")
    assert worst_stretch(error_v, scored) == slice(np.argmax(sums_v2), np.argmax(sums_v2) + 200)


@pytest.mark.parametrize("plot", [plot_voltage, plot_error])
def test_rows_on_different_samples_are_refused(plot):
    rows = {f"{samples}": make_evaluation(make_record(samples)) for samples in (600, 500)}
    with pytest.raises(ValueError, match="different samples"):
        plot(rows)
    with pytest.raises(ValueError, match="no row"):
        plot({})


def test_scored_and_unscored_samples_together_are_all_samples(scored):
    evaluation = make_evaluation(make_record(600), scored)
    over_time, over_soc = plot_error(evaluation).axes
    emphasized, grey = line(over_time, "scored error"), line(over_time, "not scored")
    assert emphasized.get_color() != grey.get_color()
    assert emphasized.get_zorder() > grey.get_zorder()
    pairs = zip((emphasized, grey), over_soc.get_lines(), (scored, ~scored), strict=False)
    for drawn, points, chosen in pairs:
        error_mv = drawn.get_ydata()[np.isfinite(drawn.get_ydata())]
        np.testing.assert_array_equal(error_mv, 1e3 * evaluation.error_v[chosen])
        np.testing.assert_array_equal(points.get_xdata(), evaluation.prepared.soc[chosen])
    assert np.count_nonzero(np.isnan(emphasized.get_ydata())) == 1


def test_the_steps_are_the_rmse_in_each_twentieth_of_soc():
    error_v = np.where(np.arange(600) < 300, 2e-3, 4e-3)
    upper = plot_error(make_evaluation(make_record(600), error_v=error_v)).axes[1].patches[0]
    heights, edges, _ = upper.get_data()
    assert len(edges) == 21
    np.testing.assert_allclose(heights[:9], 4.0)
    np.testing.assert_allclose(heights[11:], 2.0)
