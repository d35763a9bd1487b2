import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from scipy.interpolate import PchipInterpolator

from barnax.cell.curves import (
    InterpolatedCurve,
    PolynomialCurve,
    curve_warnings,
    fit_curve,
)
from barnax.errors import InputError

SOC = np.linspace(0.0, 1.0, 12)
VOLTAGE_V = 3.0 + 0.8 * SOC + 0.3 * np.sin(2 * SOC)


def test_the_polynomial_is_the_least_squares_solution_of_numpy():
    expected = np.linalg.lstsq(np.vander(SOC, 8, increasing=True), VOLTAGE_V)[0]
    curve = PolynomialCurve.fit(SOC, VOLTAGE_V)
    np.testing.assert_allclose(curve.coefficients, expected, atol=1e-7)


def test_the_interpolated_curve_is_scipys_pchip():
    grid = np.linspace(0, 1, 101)
    expected = PchipInterpolator(SOC, VOLTAGE_V)(grid)
    np.testing.assert_array_equal(InterpolatedCurve.fit(SOC, VOLTAGE_V)(grid), expected)


@pytest.mark.parametrize("fit", ["polynomial", "interpolated"])
def test_a_curve_is_constant_beyond_its_end_points(fit):
    curve = fit_curve(SOC[1:-1], VOLTAGE_V[1:-1], fit)
    outside = curve(np.array([-0.2, 0.0, 1.0, 1.3]))
    ends = curve(SOC[[1, 1, -2, -2]])
    np.testing.assert_array_equal(outside, ends)


@pytest.mark.parametrize("at", [[2, 1, 0], [0, 2, 1], [0, 1, 1, 2]])
def test_points_out_of_order_are_refused(at):
    with pytest.raises(InputError, match="increase in SOC"):
        InterpolatedCurve.fit(SOC[at], VOLTAGE_V[at])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_points_that_are_not_finite_are_refused(value):
    with pytest.raises(InputError, match="finite"):
        InterpolatedCurve(((0.0, 3.0), (0.5, value), (1.0, 4.0)))


@pytest.mark.parametrize("points", [(), ((0.5, 3.0),), (0.0, 1.0), ((0.0, 3.0, 1), (1.0, 4.0, 2))])
def test_what_is_no_two_pairs_of_soc_and_voltage_is_refused(points):
    with pytest.raises(InputError, match="at least two points"):
        InterpolatedCurve(points)


@pytest.mark.parametrize("slope_v", [0.0, 1e-4, 1.0])
def test_a_curve_through_points_that_do_not_fall_gives_no_warning(slope_v):
    assert curve_warnings(InterpolatedCurve.fit(SOC, 3.2 + slope_v * SOC), "charge") == ()


def test_a_fall_between_points_is_warned_about_with_where_it_begins_and_ends():
    curve = InterpolatedCurve(((0.0, 3.0), (0.3, 3.3), (0.4, 3.35), (0.6, 3.31), (1.0, 3.6)))
    (text,) = curve_warnings(curve, "charge")
    assert "falls by 40.0 mV from SOC 0.400 to 0.600" in text
    assert "check the points there" in text


@pytest.mark.parametrize("side", [-1, 1])
def test_a_curve_that_misses_its_points_is_warned_about(side):
    points = ((0.0, 3.0), (0.5, 3.5 + side * 0.02), (1.0, 4.0))
    (text,) = curve_warnings(PolynomialCurve(points, (3.0, 1.0)), "charge")
    assert "misses its points by up to 20.0 mV, at SOC 0.500" in text


@pytest.mark.parametrize("side", [-1, 1])
def test_a_curve_that_leaves_the_range_of_neighboring_points_is_warned_about(side):
    # A parabola through all points: its bow in the middle gap ends at 3 and 3.008 V and, by its
    # vertex, goes 36.1 mV beyond the nearer one. The other gaps are far steeper.
    rise_v, bow_v = 0.008, side * 0.04
    in_gap = Polynomial([3.0, rise_v + 4 * bow_v, -4 * bow_v])
    whole = in_gap(Polynomial([-1.0, 4.0]))
    points = tuple((soc, float(whole(soc))) for soc in (0.0, 0.25, 0.5, 0.75))
    found = curve_warnings(PolynomialCurve(points, tuple(whole.coef)), "discharge")
    assert any("overshoots by 36.1 mV between SOC 0.250 and 0.500" in text for text in found)


@given(
    st.lists(st.floats(2.0, 4.2), min_size=3, max_size=20),
    st.lists(st.floats(0.0, 1.0), min_size=1, max_size=5),
)
def test_the_interpolated_curve_never_leaves_the_range_of_its_points(voltages, soc):
    curve = InterpolatedCurve.fit(np.linspace(0.05, 0.95, len(voltages)), np.array(voltages))
    inside = curve(np.array(soc))
    assert (inside >= min(voltages) - 1e-12).all()
    assert (inside <= max(voltages) + 1e-12).all()
