import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from barnax.cell.curves import (
    InterpolatedCurve,
    PolynomialCurve,
    curve_from_dict,
    curve_warnings,
    fit_curve,
)
from barnax.errors import InputError

SOC = np.linspace(0.0, 1.0, 12)
VOLTAGE_V = 3.0 + 0.8 * SOC + 0.3 * np.sin(2 * SOC)


def test_the_polynomial_recovers_a_polynomial_of_its_own_degree():
    coefficients = (3.0, 1.2, -0.7, 0.9, -1.1, 0.4, 0.6, -0.3)
    voltage_v = np.polynomial.polynomial.polyval(SOC, coefficients)
    curve = PolynomialCurve.fit(SOC, voltage_v)
    np.testing.assert_allclose(curve.coefficients, coefficients, atol=1e-8)


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


@pytest.mark.parametrize("fit", ["polynomial", "interpolated"])
def test_a_curve_survives_its_dictionary_bit_for_bit(fit):
    curve = fit_curve(SOC, VOLTAGE_V, fit)
    assert curve_from_dict(curve.to_dict()) == curve


def test_errors_at_the_points_are_curve_minus_measurement():
    curve = PolynomialCurve.fit(SOC, VOLTAGE_V)
    np.testing.assert_allclose(curve.errors_v, curve(SOC) - VOLTAGE_V)


def test_a_polynomial_through_too_few_points_suggests_interpolation():
    with pytest.raises(InputError, match="--ocv-fit interpolated"):
        PolynomialCurve.fit(SOC[:7], VOLTAGE_V[:7])


def test_an_unknown_fit_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match="polynomial, interpolated"):
        fit_curve(SOC, VOLTAGE_V, "spline")  # pyright: ignore[reportArgumentType]


def test_points_out_of_order_are_refused():
    with pytest.raises(InputError, match="increase in SOC"):
        InterpolatedCurve.fit(SOC[::-1], VOLTAGE_V)


def test_a_smooth_rising_curve_gives_no_warning():
    assert curve_warnings(PolynomialCurve.fit(SOC, VOLTAGE_V), "charge") == ()


def test_a_falling_polynomial_is_warned_about_where_it_falls():
    soc = np.linspace(0, 1, 30)
    steep_v = 3.0 + np.tanh(30 * soc) + 0.01 * soc
    (first, *_) = curve_warnings(PolynomialCurve.fit(soc, steep_v), "charge")
    assert "charge OCV curve falls by" in first
    assert "--ocv-fit interpolated" in first


def test_a_polynomial_that_misses_its_points_is_warned_about():
    soc = np.linspace(0, 1, 30)
    found = curve_warnings(PolynomialCurve.fit(soc, 3.0 + np.tanh(30 * soc)), "charge")
    assert any("misses its points" in text for text in found)


def test_a_polynomial_that_leaves_the_range_of_neighboring_points_is_warned_about():
    soc = np.array([0.0, 0.05, 0.1, 0.15, 0.8, 0.85, 0.9, 0.95, 1.0])
    voltage_v = 3.0 + np.where(soc > 0.5, soc - 0.649, soc)
    found = curve_warnings(PolynomialCurve.fit(soc, voltage_v), "discharge")
    assert any("leaves its points" in text and "0.150 and 0.800" in text for text in found)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fit": "spline"}, "unknown fit"),
        ({"soc": [0.0, 1.0]}, "SOC values"),
        ({"voltage [V]": "high"}, "list of numbers"),
        ({"voltage [V]": [float("nan")] * 12}, "finite"),
        ({"coefficients [V]": [1.0]}, "coefficients"),
    ],
)
def test_a_stored_curve_that_was_tampered_with_is_refused(change, message):
    stored = PolynomialCurve.fit(SOC, VOLTAGE_V).to_dict() | change
    with pytest.raises(InputError, match=message):
        curve_from_dict(stored)


@given(
    st.lists(st.floats(2.0, 4.2), min_size=3, max_size=20),
    st.lists(st.floats(0.0, 1.0), min_size=1, max_size=5),
)
def test_the_interpolated_curve_never_leaves_the_range_of_its_points(voltages, soc):
    curve = InterpolatedCurve.fit(np.linspace(0.05, 0.95, len(voltages)), np.array(voltages))
    inside = curve(np.array(soc))
    assert (inside >= min(voltages) - 1e-12).all()
    assert (inside <= max(voltages) + 1e-12).all()
