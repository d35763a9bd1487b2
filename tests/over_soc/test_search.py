"""Least squares in a box against SciPy."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from barnax.over_soc.search import least_in_box, least_squares_in_box


def made(seed, rows=60, unknowns=24):
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(rows, unknowns)) * np.geomspace(1, 1e-3, unknowns)
    # Neighbors that hardly differ, as those of two time constants.
    matrix[:, 1::2] = matrix[:, ::2] + 1e-3 * matrix[:, 1::2]
    low = np.where(rng.random(unknowns) < 0.3, -np.inf, 0.0)
    high = np.where(rng.random(unknowns) < 0.3, 0.5, np.inf)
    return matrix, rng.normal(size=rows), low, high


@pytest.mark.parametrize("seed", range(8))
def test_scipy_finds_the_same_minimum(seed):
    matrix, base, low, high = made(seed)
    x, sides = least_squares_in_box(matrix, base, low, high)
    other = lsq_linear(matrix, -base, (low, high), method="bvls", tol=1e-14)
    assert np.sum((base + matrix @ x) ** 2) == pytest.approx(2 * other.cost, rel=1e-10)
    assert np.all((x >= low) & (x <= high))
    assert np.all(x[sides < 0] == low[sides < 0])


def test_any_guess_of_the_sides_ends_at_the_same_answer():
    matrix, base, low, high = made(1)
    normal, gradient = matrix.T @ matrix, matrix.T @ base
    expected, sides = least_in_box(normal, gradient, low, high)
    for guess in (sides, -np.ones_like(sides) * np.isfinite(low)):
        found, _ = least_in_box(normal, gradient, low, high, guess.astype(int))
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_held_unknowns_keep_their_values():
    matrix, base, low, high = made(2)
    low[3] = high[3] = 0.25
    assert least_squares_in_box(matrix, base, low, high)[0][3] == 0.25
