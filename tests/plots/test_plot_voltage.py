"""The voltage figure draws what it was given."""

import io

import numpy as np
import pytest

from barnax.plots import plot_voltage
from barnax.plots.voltage import worst_stretch
from helpers.results import make_evaluation, make_record


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


@pytest.mark.parametrize(("samples", "label"), [(7200, "Time [s]"), (7201, "Time [h]")])
def test_two_hours_and_more_are_told_in_hours(samples, label):
    figure = plot_voltage(make_evaluation(make_record(samples)))
    assert figure.axes[2].get_xlabel() == label


def test_the_current_panel_says_which_sign_is_discharge():
    evaluation = make_evaluation(make_record(600))
    axes = plot_voltage(evaluation).axes[2]
    assert axes.get_ylabel() == "Current [A]\n(discharge > 0)"
    np.testing.assert_array_equal(axes.get_lines()[0].get_ydata(), evaluation.prepared.current_a)


def test_ten_samples_are_drawn_without_a_magnified_stretch():
    figure = plot_voltage(make_evaluation(make_record(10)))
    figure.savefig(io.BytesIO())
    assert len(figure.axes) == 2


def test_unscored_samples_are_shaded_and_named():
    scored = np.ones(600, bool)
    scored[:100] = scored[300:310] = False
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
