import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax.cell import SegmentedHysteresis
from barnax.cell.curves import KNOTS
from barnax.errors import InputError

SOC = np.linspace(0.0, 1.0, 41)
# Where the five nodal values of the continuous fit stand.
NODE_SOC = np.array([0.0, 0.1, 0.35, 0.95, 1.0])
AT_KNOTS_V = np.array([0.03, 0.02, 0.012, 0.012, 0.009, 0.001])
nodes = st.lists(st.floats(-0.3, 0.3), min_size=5, max_size=5)
kinds = st.sampled_from(["continuous", "independent"])


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
    w = np.interp(SOC, KNOTS, AT_KNOTS_V) + 1e-3 * rng.standard_normal(len(SOC))
    hats = np.stack(
        [np.interp(SOC, KNOTS, np.array([*unit[:3], *unit[2:]])) for unit in np.eye(5)],
        axis=1,
    )
    expected = np.linalg.lstsq(hats, w)[0]
    np.testing.assert_allclose(SegmentedHysteresis.fit(SOC, w)(NODE_SOC), expected, atol=1e-7)


def test_the_independent_fit_is_a_line_of_numpy_in_each_segment():
    w = 0.01 + 0.02 * np.sin(9 * SOC)
    fitted = SegmentedHysteresis.fit(SOC, w, "independent").parameters
    inside = (SOC >= 0.1) & (SOC < 0.35)
    slope, intercept = np.polyfit(SOC[inside], w[inside], 1)
    assert fitted["C"] == pytest.approx(slope, abs=1e-6)
    assert fitted["D"] == pytest.approx(intercept, abs=1e-6)
    assert fitted["P"] == pytest.approx(w[(SOC >= 0.35) & (SOC < 0.75)].mean(), abs=1e-12)


@pytest.mark.parametrize("kind", ["continuous", "independent"])
def test_the_nine_parameters_are_those_of_equation_4(kind):
    fitted = SegmentedHysteresis.fit(SOC, 0.01 + 0.02 * np.sin(9 * SOC), kind)
    grid = np.linspace(0, 1, 777)
    np.testing.assert_allclose(fitted(grid), eq4(fitted.parameters, grid), atol=1e-14)


@given(
    st.lists(st.floats(0, 1), min_size=1, max_size=6, unique=True),
    st.floats(-0.2, 0.2),
    kinds,
)
def test_a_constant_is_fitted_everywhere_however_few_the_points(soc, w, kind):
    fitted = SegmentedHysteresis.fit(np.array(soc), np.full(len(soc), w), kind)
    np.testing.assert_allclose(fitted(np.linspace(0, 1, 50)), w, atol=1e-6)


@given(st.lists(st.floats(0.4, 0.7), min_size=1, max_size=6, unique=True), kinds)
def test_segments_without_points_follow_their_neighbors(soc, kind):
    w = 0.01 + 0.01 * np.array(soc)
    fitted = SegmentedHysteresis.fit(np.array(soc), w, kind)
    np.testing.assert_allclose(fitted(np.linspace(0, 1, 50)), w.mean(), atol=1e-6)


def test_soc_beyond_full_and_empty_takes_the_end_values():
    fitted = SegmentedHysteresis.fit(SOC, np.interp(SOC, KNOTS, AT_KNOTS_V))
    np.testing.assert_array_equal(fitted(np.array([-0.5, 1.5])), fitted(np.array([0.0, 1.0])))


def test_an_unknown_fit_is_refused():
    with pytest.raises(ValueError, match="continuous, independent"):
        SegmentedHysteresis.fit(SOC, SOC, "cubic")  # pyright: ignore[reportArgumentType]


def test_no_point_at_all_is_refused():
    with pytest.raises(InputError, match="at least one SOC on both branches"):
        SegmentedHysteresis.fit(np.zeros(0), np.zeros(0))
