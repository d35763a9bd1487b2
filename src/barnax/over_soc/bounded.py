"""Least squares in a box, exactly, for the hundred unknowns of some tables."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import LinAlgError, get_lapack_funcs, lstsq

# Slopes and distances this small, relative to what makes them up, are rounding.
ROUNDING = 1e-12
# Exchanges of all wrong unknowns at once that may leave as many wrong ones as there were.
PATIENCE = 3
MOST_ROUNDS = 400

Unknowns = Float[np.ndarray, "unknowns"]
Square = Float[np.ndarray, "unknowns unknowns"]
# At the lower bound -1, at the upper one 1, free 0.
Sides = Int[np.ndarray, "unknowns"]


def least_in_box(
    normal: Square, gradient: Unknowns, low: Unknowns, high: Unknowns, sides: Sides | None = None
) -> tuple[Unknowns, Sides]:
    """The x in [low, high] with the least x.(normal x) / 2 + gradient.x, and which are at a bound.

    `normal` is positive definite. `sides` are a guess of which are, such as a neighbor's answer.
    Block principal pivoting (Portugal, Judice and Vicente, Math. Comp. 63 (1994) 625): all
    unknowns on the wrong side change it at once; where that does not help, only the last of them
    does, which always ends.

    >>> x, sides = least_in_box(np.eye(2), np.array([1.0, -1.0]), np.zeros(2), np.full(2, 9.0))
    >>> x.tolist(), sides.tolist()
    ([0.0, 1.0], [-1, 0])
    """
    is_held = low >= high
    sides = np.zeros(len(low), int) if sides is None else sides.copy()
    sides[is_held] = -1
    unit = np.sqrt(np.diag(normal))
    fewest, patience = len(low) + 1, PATIENCE
    x = low
    for _ in range(MOST_ROUNDS):
        free = np.flatnonzero(sides == 0)
        x = np.where(sides < 0, low, np.where(sides > 0, high, 0.0))
        x[free] = _solved(normal[np.ix_(free, free)], -(gradient[free] + normal[free] @ x))
        slope = gradient + normal @ x
        slack = ROUNDING * (np.abs(gradient) + unit * np.sqrt(max(x @ normal @ x, 0.0)))
        span = ROUNDING * np.abs(x)
        is_low, is_high = sides < 0, sides > 0
        wrong = np.flatnonzero(
            ~is_held
            & ~np.where(
                is_low,
                slope >= -slack,
                np.where(is_high, slope <= slack, (x >= low - span) & (x <= high + span)),
            )
        )
        if not len(wrong):
            break
        if len(wrong) < fewest:
            fewest, patience = len(wrong), PATIENCE
        elif patience:
            patience -= 1
        else:
            wrong = wrong[-1:]
        now = np.where(x[wrong] < low[wrong], -1, 1)
        sides[wrong] = np.where(sides[wrong] == 0, now, 0)
    return np.clip(x, low, high), sides


def least_squares_in_box(
    matrix: Float[np.ndarray, "rows unknowns"],
    base: Float[np.ndarray, "rows"],
    low: Unknowns,
    high: Unknowns,
    sides: Sides | None = None,
) -> tuple[Unknowns, Sides]:
    """The x in [low, high] with the least |base + matrix x|, and which are at a bound.

    Which are is found with the normal equations; their values, which those would give to fewer
    digits, by an orthogonal factorization.
    """
    x, sides = least_in_box(matrix.T @ matrix, matrix.T @ base, low, high, sides)
    free = sides == 0
    at_bound = np.where(free, 0.0, x)
    found = lstsq(matrix[:, free], -(base + matrix @ at_bound), lapack_driver="gelsy")
    x = at_bound.copy()
    x[free] = np.asarray(found[0] if found is not None else 0.0)
    return np.clip(x, low, high), sides


def _solved(normal: Square, target: Unknowns) -> Unknowns:
    """The solution of positive definite equations, by Cholesky."""
    if not len(target):
        return target
    # Without SciPy's checks, which take longer than the solution.
    posv: Any = get_lapack_funcs("posv", (normal,))
    _, solution, failed = posv(normal, target)
    if failed:
        raise LinAlgError("the equations of some tables have no definite solution")
    return solution
