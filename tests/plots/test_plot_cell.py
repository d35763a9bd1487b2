"""What tests show of a cell: open-circuit and hysteresis voltage, and pulses of 25 degC."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from barnax import CircuitParameters, Window, bundled_file, characterize, evaluate, read_record
from barnax.cell import SegmentedHysteresis
from barnax.model.prepared import prepare_record
from barnax.plots import plot_ocv, plot_pulses
from barnax.plots.cell import plot_fitted_ocv
from barnax.pulses import levels, pulses_of
from helpers.results import labels, make_cell


def test_the_residuals_are_point_minus_curve_in_millivolt(bundled_cell):
    residual = plot_ocv(bundled_cell).axes[1]
    drawn_mv = np.concatenate([line.get_ydata() for line in residual.get_lines()[1:]])
    expected_v = np.concatenate([bundled_cell.charge.errors_v, bundled_cell.discharge.errors_v])
    np.testing.assert_allclose(drawn_mv, -1e3 * expected_v, atol=1e-9)


def test_an_ocv_identified_from_the_record_is_a_line_with_intervals_and_no_points():
    cell = make_cell()
    points = tuple(replace(point, row=0, rest_s=0.0) for point in cell.discharge_points)
    none = {"charge": cell.discharge, "hysteresis": SegmentedHysteresis.zero()}
    own = replace(cell, **none, charge_points=(), discharge_points=points)
    nodes = [SimpleNamespace(soc=each.soc, low=2.9, high=each.voltage_v + 0.1) for each in points]
    for figure, told in (
        (plot_fitted_ocv(own, nodes), ["95 % interval", "identified from the record"]),
        (plot_ocv(own), ["identified from the record"]),
    ):
        (axes,) = figure.axes
        assert labels(axes) == told
        assert all(drawn.get_marker() in ("", "None") for drawn in axes.get_lines())


@pytest.fixture(scope="module")
def evaluation():
    record = read_record(bundled_file("hppc_25degC"))
    cell = characterize([record], ocv_fit="interpolated")
    window = Window(start_time_s=10799.0, initial_soc=1.0)
    circuit = CircuitParameters.constant(r0=0.05, r=(0.01, 0.02), c=(1e3, 1e4))
    return evaluate(prepare_record(record, cell, "so-rc", window), circuit)


def test_every_rate_has_a_panel_of_pulses_measured_and_simulated_up_to_their_ends(evaluation):
    pulses = pulses_of(evaluation.prepared)
    axes, *others = plot_pulses(evaluation, pulses).axes
    titles = [each.get_title(loc="left").split(" (")[0] for each in (axes, *others[:3])]
    rates = "discharge at 1C", "discharge at 2C", "charge at 0.76C", "charge at 1.5C"
    assert titles == [*rates]
    first = levels(pulses)[0]
    lines = [each for each in axes.get_lines() if len(each.get_xdata()) > 1]
    assert len(lines) == 2 * len(first)
    since_s, measured_mohm = lines[0].get_data()
    assert since_s[-1] == pytest.approx(30.0, abs=0.11)
    assert np.interp(10.0, since_s, measured_mohm) == pytest.approx(
        1e3 * first[0].resistance_ohm[2], rel=0.02
    )
