"""Least squares in a box, of one problem and of many at once, against SciPy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from barnax.model.box_least_squares import least_in_box, least_in_boxes, with_free_values


def made(seed, rows=60, unknowns=24):
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(rows, unknowns)) * np.geomspace(1, 1e-3, unknowns)
    # Neighbors that hardly differ, as those of two time constants.
    matrix[:, 1::2] = matrix[:, ::2] + 1e-3 * matrix[:, 1::2]
    low = np.where(rng.random(unknowns) < 0.3, -np.inf, 0.0)
    high = np.where(rng.random(unknowns) < 0.3, 0.5, np.inf)
    return matrix, rng.normal(size=rows), low, high


def least_squares_in_box(matrix, base, low, high):
    x, active_set = least_in_box(matrix.T @ matrix, matrix.T @ base, low, high)
    return np.clip(with_free_values(matrix, base, x, active_set == 0), low, high), active_set


@pytest.mark.parametrize("seed", range(3))
def test_scipy_finds_the_same_minimum(seed):
    matrix, base, low, high = made(seed)
    x, active_set = least_squares_in_box(matrix, base, low, high)
    other = lsq_linear(matrix, -base, (low, high), method="bvls", tol=1e-14)
    assert np.sum((base + matrix @ x) ** 2) == pytest.approx(2 * other.cost, rel=1e-10)
    assert np.all((x >= low) & (x <= high))
    assert np.all(x[active_set < 0] == low[active_set < 0])


def test_any_guess_of_the_sides_ends_at_the_same_answer():
    matrix, base, low, high = made(1)
    normal, gradient = matrix.T @ matrix, matrix.T @ base
    expected, active_set = least_in_box(normal, gradient, low, high)
    for guess in (active_set, -np.ones_like(active_set) * np.isfinite(low)):
        actual, _ = least_in_box(normal, gradient, low, high, guess.astype(int))
        assert actual == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_held_unknowns_keep_their_values():
    matrix, base, low, high = made(2)
    low[3] = high[3] = 0.25
    assert least_squares_in_box(matrix, base, low, high)[0][3] == 0.25


ROWS = 12


def solved(columns, base, low, high):
    """The solution of every problem; `columns` has axes problem, row and unknown."""
    normal = np.einsum("nri,nrj->ijn", columns, columns)
    return least_in_boxes(normal, np.einsum("nri,nr->in", columns, base), low.T, high.T).T


def error(columns, base, x):
    return np.linalg.norm(base + np.einsum("nri,ni->nr", columns, x), axis=1)


def expected_error(columns, base, low, high):
    """What SciPy reaches, problem after problem; it wants low below high."""
    errors = []
    for a, b, least, most in zip(columns, base, low, high, strict=True):
        free = most > least
        x = least.copy()
        if free.any():
            given = lsq_linear(
                a[:, free],
                -(b + a[:, ~free] @ least[~free]),
                (least[free], most[free]),
                method="bvls",
                tol=1e-15,
            )
            x[free] = given.x
        errors.append(np.linalg.norm(b + a @ x))
    return np.array(errors)


@given(
    unknowns=st.integers(1, 5),
    seed=st.integers(0, 10_000),
    likeness=st.sampled_from([0.0, 0.9, 0.9999, 1.0]),
    pinned=st.booleans(),
)
def test_no_problem_ends_above_the_error_of_scipys_exact_solver(unknowns, seed, likeness, pinned):
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((30, ROWS, unknowns)) * 10 ** rng.uniform(-2, 2, unknowns)
    columns = likeness * columns[:, :, :1] + (1 - likeness) * columns
    base = rng.standard_normal((30, ROWS))
    low = rng.uniform(-1, 0.2, (30, unknowns))
    high = low + rng.uniform(0, 1, (30, unknowns))
    if pinned:
        high[:, 0] = low[:, 0]
    actual = solved(columns, base, low, high)
    assert np.all((low <= actual) & (actual <= high))
    # Inside the box nothing is below the optimum; where columns are nearly alike SciPy's solver
    # itself can stop above it.
    excess = error(columns, base, actual) / expected_error(columns, base, low, high) - 1
    assert excess.max() < 1e-9


def test_a_column_of_zeros_costs_nothing():
    columns = np.stack([np.zeros(ROWS), np.ones(ROWS)], axis=1)[None]
    low, high = np.array([[0.0, 0.0]]), np.array([[1.0, 1.0]])
    (actual,) = solved(columns, -0.25 * np.ones((1, ROWS)), low, high)
    assert actual[1] == pytest.approx(0.25)
