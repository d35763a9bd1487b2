"""Figures of records over time: what one circuit, or every row of a comparison, makes of one."""

import io

import numpy as np
import pytest

from barnax.plots import (
    plot_error,
    plot_voltage,
)
from barnax.plots.style import row_looks
from barnax.plots.voltage import worst_stretch
from helpers.results import labels, line, make_evaluation, make_record


@pytest.fixture
def scored():
    """Which of 600 samples count, in two stretches."""
    scored = np.ones(600, bool)
    scored[:100] = scored[300:310] = False
    return scored


def make_rows(*sizes_v, samples=600, scored=None):
    record = make_record(samples)
    wave = np.sin(np.arange(samples) / 50)
    return {
        f"row {place}": make_evaluation(record, scored, size_v * wave)
        for place, size_v in enumerate(sizes_v)
    }


def test_the_lines_are_the_measured_and_the_simulated_voltage():
    evaluation = make_evaluation(make_record(600))
    measured, simulated = plot_voltage(evaluation).axes[0].get_lines()
    np.testing.assert_array_equal(measured.get_xdata(), evaluation.prepared.time_s)
    np.testing.assert_array_equal(measured.get_ydata(), evaluation.prepared.voltage_v)
    np.testing.assert_array_equal(simulated.get_ydata(), evaluation.simulated_v)


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


@pytest.mark.parametrize("plot", [plot_voltage, lambda each: plot_voltage({"a": each})])
def test_a_short_record_has_no_stretch_to_magnify(plot):
    figure = plot(make_evaluation(make_record(10)))
    figure.savefig(io.BytesIO())
    assert not any("Time after" in axes.get_xlabel() for axes in figure.axes)


@pytest.mark.parametrize(("samples", "label"), [(7200, "Time [s]"), (7201, "Time [h]")])
def test_two_hours_and_more_are_told_in_hours(samples, label):
    figure = plot_voltage(make_evaluation(make_record(samples)))
    assert figure.axes[2].get_xlabel() == label


def test_the_current_panel_says_which_sign_is_discharge():
    evaluation = make_evaluation(make_record(600))
    axes = plot_voltage(evaluation).axes[2]
    assert axes.get_ylabel() == "Current [A]\n(discharge > 0)"
    np.testing.assert_array_equal(axes.get_lines()[0].get_ydata(), evaluation.prepared.current_a)


def test_unscored_samples_are_shaded_and_named(scored):
    evaluation = make_evaluation(make_record(600), scored)
    figure = plot_voltage(evaluation)
    (shade,) = figure.axes[0].collections
    spans = [path.get_extents().intervalx for path in shade.get_paths()]
    np.testing.assert_allclose(spans, [[1000.0, 1100.0], [1300.0, 1310.0]])
    assert "not scored" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_shading_leaves_the_limits_to_the_data():
    record = make_record(600)
    plain = plot_voltage(make_evaluation(record)).axes[0].get_ylim()
    assert plot_voltage(make_evaluation(record, np.arange(600) > 99)).axes[0].get_ylim() == plain


def test_the_magnified_stretch_is_the_scored_one_with_the_largest_error():
    error_v = np.random.default_rng(3).normal(0.0, 1e-3, 3000)
    error_v[500:900] = 1.0
    error_v[2000:2200] += 0.02
    scored = np.arange(3000) >= 1000
    squares = np.where(scored, error_v, 0.0) ** 2
    expected = max(range(3000 - 200 + 1), key=lambda start: squares[start : start + 200].sum())
    assert worst_stretch(error_v, scored) == slice(expected, expected + 200)


def test_every_row_s_voltage_is_drawn_over_the_measured_one():
    rows = make_rows(2e-3, 5e-3)
    whole = plot_voltage(rows).axes[0]
    first = rows["row 0"]
    np.testing.assert_array_equal(line(whole, "measured").get_ydata(), first.prepared.voltage_v)
    for label, each in rows.items():
        name = f"{label} (RMSE {1e3 * each.metrics.rmse_v:.3g} mV)"
        np.testing.assert_array_equal(line(whole, name).get_ydata(), each.simulated_v)


def test_the_magnified_stretch_shows_the_same_rows_where_the_frame_is():
    whole, close, _, below = plot_voltage(make_rows(2e-3, 5e-3, samples=2000)).axes
    assert labels(close) == labels(whole)
    origin = float(below.get_xlabel().split()[2])
    shown = line(close, "measured")
    time_s = shown.get_xdata() + origin
    measured = line(whole, "measured")
    at = np.searchsorted(measured.get_xdata(), time_s)
    np.testing.assert_array_equal(measured.get_ydata()[at], shown.get_ydata())


def test_of_many_rows_the_most_accurate_are_drawn_and_it_is_said():
    rows = make_rows(*np.arange(12, 0, -1) * 1e-3)
    whole = plot_voltage(rows).axes[0]
    assert len(labels(whole)) == 1 + 8
    assert not any(label.startswith("row 3 ") for label in labels(whole))
    assert "the 8 of 12 rows with the lowest RMSE" in whole.get_title("left")


@pytest.mark.parametrize("plot", [plot_voltage, plot_error])
def test_rows_on_different_samples_are_refused(plot):
    rows = make_rows(1e-3) | {"other": make_evaluation(make_record(500))}
    with pytest.raises(ValueError, match="different samples"):
        plot(rows)
    with pytest.raises(ValueError, match="no row"):
        plot({})


def test_the_line_is_the_error_in_millivolt():
    evaluation = make_evaluation(make_record(600))
    drawn = line(plot_error(evaluation).axes[0], "scored error")
    np.testing.assert_array_equal(drawn.get_xdata(), evaluation.prepared.time_s)
    np.testing.assert_array_equal(drawn.get_ydata(), 1e3 * evaluation.error_v)


def test_scored_and_unscored_samples_together_are_all_samples(scored):
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
    assert over_soc.get_title("right") == "off scale: 3 of 1000 samples, up to −600 mV"
    # An arrow at the edge is where each of them is.
    for axes in (over_time, over_soc):
        (arrows,) = [own for own in axes.get_lines() if own.get_marker() == "v"]
        assert [*arrows.get_ydata()] == [axes.get_ylim()[0]] * 3
    inside = plot_error(make_evaluation(make_record(1000))).axes[1]
    assert inside.get_title("right") == ""


@pytest.mark.parametrize("error_v", [np.zeros(10), np.linspace(-0.01, 0.02, 10)])
def test_ten_samples_and_no_error_at_all_are_drawn(error_v):
    figure = plot_error(make_evaluation(make_record(10), error_v=error_v))
    figure.savefig(io.BytesIO())
    low, high = figure.axes[0].get_ylim()
    assert low < 1e3 * error_v.min()
    assert high > 1e3 * error_v.max()


def test_every_row_s_errors_have_a_strip_on_one_scale():
    rows = make_rows(2e-3, 5e-3)
    axes = plot_error(rows).axes
    assert len(axes) == 4
    for (over_time, over_soc), each in zip(np.reshape(axes, (-1, 2)), rows.values(), strict=True):
        np.testing.assert_array_equal(over_time.get_lines()[0].get_ydata(), 1e3 * each.error_v)
        np.testing.assert_array_equal(over_soc.get_lines()[0].get_xdata(), each.prepared.soc)
        np.testing.assert_allclose(
            line(over_time, "± RMSE").get_ydata()[0], 1e3 * each.metrics.rmse_v
        )
    assert len({panel.get_ylim() for panel in axes}) == 1


def test_a_row_that_is_far_off_does_not_set_the_scale_and_is_said_to_be_cut():
    axes = plot_error(make_rows(2e-3, 500e-3)).axes
    assert axes[0].get_ylim()[1] < 20
    assert "off scale:" in axes[3].texts[0].get_text()
    assert not axes[1].texts


def test_the_same_row_looks_the_same_in_every_figure():
    names = [f"row {place}" for place in range(40)]
    looks = row_looks(names)
    assert len({(look.color, look.line, look.marker) for look in looks.values()}) == 40
    rows = make_rows(2e-3, 5e-3)
    voltages, errors = plot_voltage(rows).axes[0], plot_error(rows).axes
    for place, label in enumerate(rows):
        color = row_looks(rows)[label].color
        assert voltages.get_lines()[1 + place].get_color() == color
        assert errors[2 * place].get_lines()[0].get_color() == color
