"""The figures of pulses, drawn from the bundled test at 25 degC."""

import numpy as np
import pytest

from barnax import CircuitParameters, bundled_file, characterize, read_record
from barnax.model.inputs import prepare_record
from barnax.model.window import Window
from barnax.plots import plot_pulse_resistances, plot_pulses
from barnax.pulses import levels, pulses_of
from barnax.search.evaluate import evaluate


@pytest.fixture(scope="module")
def evaluation():
    record = read_record(bundled_file("hppc_25degC"))
    cell = characterize([record], ocv_fit="interpolated")
    window = Window(start_time_s=10799.0, initial_soc=1.0)
    circuit = CircuitParameters(r0=0.05, r=(0.01, 0.02), c=(1e3, 1e4))
    return evaluate(prepare_record(record, cell, "so-rc", window), circuit)


@pytest.fixture(scope="module")
def pulses(evaluation):
    return pulses_of(evaluation.prepared)


def test_every_direction_and_rate_has_a_panel(evaluation, pulses):
    figure = plot_pulses(evaluation, pulses)
    titles = [axes.get_title(loc="left") for axes in figure.axes[:4]]
    assert [title.split(" (")[0] for title in titles] == [
        "discharge at 1C",
        "discharge at 2C",
        "charge at 0.76C",
        "charge at 1.5C",
    ]


def test_a_pulse_is_drawn_measured_and_simulated_up_to_its_end(evaluation, pulses):
    axes = plot_pulses(evaluation, pulses).axes[0]
    first = levels(pulses)[0]
    lines = [each for each in axes.get_lines() if len(each.get_xdata()) > 1]
    assert len(lines) == 2 * len(first)
    since_s, measured_mohm = lines[0].get_data()
    assert since_s[-1] == pytest.approx(30.0, abs=0.11)
    assert np.interp(10.0, since_s, measured_mohm) == pytest.approx(
        1e3 * first[0].resistance_ohm[2], rel=0.02
    )


def test_a_rate_has_a_line_for_every_time_that_its_pulses_reach(pulses):
    figure = plot_pulse_resistances(pulses, 2.0)
    counts = [len(axes.get_lines()) for axes in figure.axes]
    assert counts == [5, 3, 3, 3]
    (at_once, *_) = figure.axes[0].get_lines()
    np.testing.assert_allclose(
        at_once.get_ydata(), [1e3 * pulse.resistance_ohm[0] for pulse in levels(pulses)[0]]
    )
