"""Curves of OCV and hysteresis voltage against NumPy, SciPy and Eq. 4."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.interpolate import PchipInterpolator

from barnax.cell import SegmentedHysteresis
from barnax.cell.curves import KNOTS, InterpolatedCurve, PolynomialCurve, curve_warnings, fit_curve
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


def test_a_fall_between_points_is_warned_about_with_where_it_begins_and_ends():
    curve = InterpolatedCurve(((0.0, 3.0), (0.3, 3.3), (0.4, 3.35), (0.6, 3.3468), (1.0, 3.6)))
    (notice,) = curve_warnings(curve, "charge")
    assert "falls by 3.2 mV from SOC 0.400 to 0.600" in notice.what
    assert notice.remedy == "check the points there"


@pytest.mark.parametrize("side", [-1, 1])
def test_a_curve_that_misses_its_points_is_warned_about(side):
    points = ((0.0, 3.0), (0.5, 3.5 + side * 0.02), (1.0, 4.0))
    (notice,) = curve_warnings(PolynomialCurve(points, (3.0, 1.0)), "charge")
    assert "misses its points by up to 20.0 mV, at SOC 0.500" in notice.what


@pytest.mark.parametrize("side", [-1, 1])
def test_a_curve_that_leaves_the_range_of_neighboring_points_is_warned_about(side):
    # A parabola through all points: its bow in the middle gap ends at 3 and 3.008 V and, by its
    # vertex, goes 36.1 mV beyond the nearer one. The other gaps are far steeper.
    rise_v, bow_v = 0.008, side * 0.04
    in_gap = Polynomial([3.0, rise_v + 4 * bow_v, -4 * bow_v])
    whole = in_gap(Polynomial([-1.0, 4.0]))
    points = tuple((soc, float(whole(soc))) for soc in (0.0, 0.25, 0.5, 0.75))
    actual = curve_warnings(PolynomialCurve(points, tuple(whole.coef)), "discharge")
    assert any("overshoots by 36.1 mV between SOC 0.250 and 0.500" in each.what for each in actual)


# The hysteresis voltage


W_SOC = np.linspace(0.0, 1.0, 41)
# Where the five nodal values of the continuous fit stand.
NODE_SOC = np.array([0.0, 0.1, 0.35, 0.95, 1.0])
AT_KNOTS_V = np.array([0.03, 0.02, 0.012, 0.012, 0.009, 0.001])


def eq4(parameters: dict[str, float], soc: np.ndarray) -> np.ndarray:
    """Li et al. (2023), Eq. 4, term by term."""
    p = parameters
    return np.select(
        [soc < 0.1, soc < 0.35, soc < 0.75, soc < 0.95],
        [p["A"] * soc + p["B"], p["C"] * soc + p["D"], p["P"] + 0 * soc, p["E"] * soc + p["F"]],
        p["G"] * soc + p["H"],
    )


def test_the_continuous_fit_is_the_least_squares_solution_of_numpy():
    rng = np.random.default_rng(0)
    w = np.interp(W_SOC, KNOTS, AT_KNOTS_V) + 1e-3 * rng.standard_normal(len(W_SOC))
    hats = np.stack(
        [np.interp(W_SOC, KNOTS, np.array([*unit[:3], *unit[2:]])) for unit in np.eye(5)], axis=1
    )
    expected = np.linalg.lstsq(hats, w)[0]
    np.testing.assert_allclose(SegmentedHysteresis.fit(W_SOC, w)(NODE_SOC), expected, atol=1e-7)


def test_the_independent_fit_is_a_line_of_numpy_in_each_segment():
    w = 0.01 + 0.02 * np.sin(9 * W_SOC)
    fitted = SegmentedHysteresis.fit(W_SOC, w, "independent").parameters
    inside = (W_SOC >= 0.1) & (W_SOC < 0.35)
    slope, intercept = np.polyfit(W_SOC[inside], w[inside], 1)
    assert fitted["C"] == pytest.approx(slope, abs=1e-6)
    assert fitted["D"] == pytest.approx(intercept, abs=1e-6)
    assert fitted["P"] == pytest.approx(w[(W_SOC >= 0.35) & (W_SOC < 0.75)].mean(), abs=1e-6)


@pytest.mark.parametrize("kind", ["continuous", "independent"])
def test_the_nine_parameters_are_those_of_equation_4(kind):
    fitted = SegmentedHysteresis.fit(W_SOC, 0.01 + 0.02 * np.sin(9 * W_SOC), kind)
    grid = np.linspace(0, 1, 777)
    np.testing.assert_allclose(fitted(grid), eq4(fitted.parameters, grid), atol=1e-14)
