"""What tests show of a cell: open-circuit and hysteresis voltage, and pulses of 25 degC."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from barnax import CircuitParameters, bundled_file, characterize, read_record
from barnax.cell import CellModel, InterpolatedCurve, OcvPoint, SegmentedHysteresis
from barnax.model.prepared import prepare_record
from barnax.model.window import Window
from barnax.plots import plot_ocv, plot_pulses
from barnax.plots.cell import plot_fitted_ocv
from barnax.pulses import levels, pulses_of
from barnax.search.evaluate import evaluate
from helpers.results import labels, line

SOC = np.linspace(0.0, 1.0, 11)


def make_cell(has_charge: bool = True) -> CellModel:
    """Branches 20 mV apart; without the charge branch both are the discharge."""
    voltage_v = 3.0 + SOC
    discharge = InterpolatedCurve.fit(SOC, voltage_v)
    charge = InterpolatedCurve.fit(SOC, voltage_v + 0.02) if has_charge else discharge
    points = [
        tuple(OcvPoint(soc, float(v), "made", 2, 7200.0) for soc, v in curve.points)
        for curve in (charge, discharge)
    ]
    return CellModel(
        capacity_ah=2.0,
        capacity_origin="given",
        charge=charge,
        discharge=discharge,
        hysteresis=SegmentedHysteresis.fit(SOC, np.full(11, 0.02))
        if has_charge
        else SegmentedHysteresis.zero(),
        charge_points=points[0] if has_charge else (),
        discharge_points=points[1],
        errors={},
    )


def test_the_symbols_are_the_measured_points():
    axes = plot_ocv(make_cell()).axes[0]
    np.testing.assert_allclose(line(axes, "discharge points").get_xdata(), SOC)
    np.testing.assert_allclose(line(axes, "discharge points").get_ydata(), 3.0 + SOC)
    np.testing.assert_allclose(line(axes, "charge points").get_ydata(), 3.02 + SOC)


def test_the_residuals_are_point_minus_curve_in_millivolt(bundled_cell):
    residual = plot_ocv(bundled_cell).axes[1]
    drawn_mv = np.concatenate([line.get_ydata() for line in residual.get_lines()[1:]])
    expected_v = np.concatenate([bundled_cell.charge.errors_v, bundled_cell.discharge.errors_v])
    np.testing.assert_allclose(drawn_mv, -1e3 * expected_v, atol=1e-9)


def test_an_ocv_of_the_records_own_is_a_line_with_intervals_and_no_points():
    made = make_cell(has_charge=False)
    points = tuple(replace(point, row=0, rest_s=0.0) for point in made.discharge_points)
    own = replace(made, discharge_points=points)
    nodes = [SimpleNamespace(soc=soc, low=2.9 + soc, high=3.1 + soc) for soc in SOC]
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
