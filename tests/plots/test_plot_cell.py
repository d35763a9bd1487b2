"""The figures of a cell: its open-circuit voltage and its hysteresis voltage."""

import io
import itertools

import numpy as np
import pytest

from barnax import bundled_file, characterize, read_record
from barnax.cell import CellModel, InterpolatedCurve, OcvPoint, SegmentedHysteresis
from barnax.cell.curves import KNOTS
from barnax.plots import plot_hysteresis, plot_ocv
from helpers.results import line

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


@pytest.fixture(scope="module")
def polynomial_cell():
    return characterize(
        [read_record(bundled_file(f"ocv_{way}")) for way in ("charge", "discharge")]
    )


def test_the_symbols_are_the_measured_points():
    axes = plot_ocv(make_cell()).axes[0]
    np.testing.assert_allclose(line(axes, "discharge points").get_xdata(), SOC)
    np.testing.assert_allclose(line(axes, "discharge points").get_ydata(), 3.0 + SOC)
    np.testing.assert_allclose(line(axes, "charge points").get_ydata(), 3.02 + SOC)


def test_the_average_lies_in_the_middle_of_the_branches():
    average = line(plot_ocv(make_cell()).axes[0], "average")
    np.testing.assert_allclose(average.get_ydata(), 3.01 + average.get_xdata())


def test_the_residuals_are_point_minus_curve_in_millivolt(polynomial_cell):
    residual = plot_ocv(polynomial_cell).axes[1]
    drawn_mv = np.concatenate([line.get_ydata() for line in residual.get_lines()[1:]])
    expected_v = np.concatenate(
        [polynomial_cell.charge.errors_v, polynomial_cell.discharge.errors_v]
    )
    np.testing.assert_allclose(drawn_mv, -1e3 * expected_v, atol=1e-9)


def test_rounding_errors_of_a_curve_through_its_points_do_not_fill_the_panel():
    low, high = plot_ocv(make_cell()).axes[1].get_ylim()
    assert low <= -1.0
    assert high >= 1.0


def test_a_branch_that_was_not_measured_is_not_drawn():
    labels = plot_ocv(make_cell(has_charge=False)).axes[0].get_legend_handles_labels()[1]
    assert labels == ["discharge curve", "discharge points"]


def test_the_hysteresis_points_are_those_of_the_fit(polynomial_cell):
    points = line(plot_hysteresis(polynomial_cell).axes[0], "the same at the OCV points")
    expected = np.array(polynomial_cell.hysteresis.points)
    np.testing.assert_allclose(points.get_xdata(), expected[:, 0])
    np.testing.assert_allclose(points.get_ydata(), 1e3 * expected[:, 1])


def test_the_five_segments_end_at_the_knots(polynomial_cell):
    lines = plot_hysteresis(polynomial_cell).axes[0].get_lines()
    segments = [
        line for line in lines if line.get_label() in ("five segments (continuous)", "_segment")
    ]
    np.testing.assert_allclose(
        [line.get_xdata() for line in segments], list(itertools.pairwise(KNOTS))
    )
    middle = [np.mean(line.get_xdata()) for line in segments]
    np.testing.assert_allclose(
        [np.mean(line.get_ydata()) for line in segments],
        1e3 * polynomial_cell.hysteresis_v(np.array(middle)),
    )


def test_the_scale_of_the_hysteresis_includes_zero():
    low, high = plot_hysteresis(make_cell()).axes[0].get_ylim()
    assert low <= 0 <= high


def test_measured_differences_are_added_where_the_curves_miss_them(polynomial_cell):
    label = "difference of the measured points (PCHIP)"
    drawn = line(plot_hysteresis(polynomial_cell).axes[0], label)
    assert (
        np.max(np.abs(drawn.get_ydata() - 1e3 * np.array(polynomial_cell.hysteresis.points)[:, 1]))
        > 1
    )
    assert label not in plot_hysteresis(make_cell()).axes[0].get_legend_handles_labels()[1]


def test_of_a_cell_with_one_branch_no_hysteresis_is_drawn_but_said_to_be_missing():
    figure = plot_hysteresis(make_cell(has_charge=False))
    figure.savefig(io.BytesIO())
    (axes,) = figure.axes
    assert not axes.get_lines()
    assert [text.get_text() for text in axes.texts] == [
        "not measured: the OCV is of one branch only"
    ]
