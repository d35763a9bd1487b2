"""Least squares with bounds: x in [low, high] with the least |b + A x|, by its normal equations.

For many small problems at once (`least_in_boxes`: a few unknowns, thousands of problems, columns
that may be linearly dependent), and for one with up to hundreds of unknowns (`least_in_box`), more
accurately with `with_free_values`.
"""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import LinAlgError, get_lapack_funcs, lstsq

# A column that depends on those before it up to this share of its square moves nothing.
RIDGE = 1e-13
# Guesses of the unknowns at a bound; the few problems that still change are enumerated.
GUESSES = 10
# Active sets, over all problems, that are tried at once.
SETS_AT_ONCE = 4096
# Slopes and distances this small, relative to their terms, are rounding.
ROUNDING = 1e-12
# Exchanges of all wrong unknowns at once that may fail to reduce their number.
PATIENCE = 3
MAX_ROUNDS = 400

Columns = Float[np.ndarray, "points rows"]
Problems = Float[np.ndarray, "unknowns problems"]
Unknowns = Float[np.ndarray, "unknowns"]
Square = Float[np.ndarray, "unknowns unknowns"]
# At the lower bound -1, at the upper one 1, free 0.
ActiveSet = Int[np.ndarray, "unknowns"]


def normal_equations(
    columns: Sequence[Columns], base: Columns
) -> tuple[Float[np.ndarray, "unknowns unknowns points"], Float[np.ndarray, "unknowns points"]]:
    """A'A and A'b of every point's least squares of b + A x."""
    normal = np.empty((len(columns), len(columns), len(base)))
    for i, left in enumerate(columns):
        for j, right in enumerate(columns[: i + 1]):
            normal[i, j] = normal[j, i] = dot(left, right)
    return normal, np.stack([dot(column, base) for column in columns])


def errors_of(
    columns: Sequence[Columns], base: Columns, coefficients: Float[np.ndarray, "unknowns points"]
) -> Columns:
    """b + A x of every point."""
    total = base.copy()
    for column, counts in zip(columns, coefficients, strict=True):
        total += counts[:, None] * column
    return total


def dot(left: Columns, right: Columns) -> Float[np.ndarray, "points"]:
    """The scalar product of every point's vectors."""
    return np.einsum("pr,pr->p", left, right)


def least_in_boxes(
    normal: Float[np.ndarray, "unknowns unknowns problems"],
    gradient: Problems,
    low: Problems,
    high: Problems,
) -> Problems:
    """Each problem's x in [low, high] with the least x.(normal x) / 2 + gradient.x.

    `normal` is A'A and `gradient` A'b for the least squares of b + A x. Where low equals high, x is
    that value. Active sets are guessed for all problems together, each from the signs of the last
    guess's multipliers (Hintermüller, Ito and Kunisch, SIAM J. Optim. 13 (2002) 865); if that
    cycles, all sets are tried. Linearly dependent columns only affect which of the equally good x
    is returned.
    """
    scale = np.sqrt(np.einsum("iin->in", normal))
    scale = np.where(scale > 0, scale, 1.0)
    normal = normal / scale[:, None] / scale
    gradient, box = gradient / scale, (low, high)
    low, high = low * scale, high * scale
    given: list[Any] = [normal, gradient, low, high, low >= high]
    at_low = at_high = np.zeros(low.shape, bool)
    parts, open_problems = low.copy(), np.arange(low.shape[1])
    for _ in range(GUESSES):
        h, g, least, most, pinned = given
        is_free = ~(at_low | at_high | pinned)
        x = _free_minimum(h, g, np.where(at_high, most, least), is_free)
        slope = g + _times(h, x)
        now_low = ((is_free & (x < least)) | (at_low & (slope >= 0))) & ~pinned
        now_high = ((is_free & (x > most)) | (at_high & (slope <= 0))) & ~pinned
        settled = np.all((now_low == at_low) & (now_high == at_high), axis=0)
        parts[:, open_problems[settled]] = np.clip(x, least, most)[:, settled]
        if np.all(settled):
            break
        at_low, at_high = now_low[:, ~settled], now_high[:, ~settled]
        open_problems, *given = (array[..., ~settled] for array in (open_problems, *given))
    else:
        parts[:, open_problems] = _enumerated(*given[:-1])
    return np.clip(parts / scale, *box)


def _enumerated(normal, gradient: Problems, low: Problems, high: Problems) -> Problems:
    """The best of all active sets, each moved into the box."""
    active_set = np.array([*itertools.product((-1, 0, 1), repeat=len(low))]).T[..., None]
    step, best = max(1, SETS_AT_ONCE // active_set.shape[1]), low.copy()
    for first in range(0, low.shape[1], step):
        here = slice(first, first + step)
        h, g, least, most = (array[..., None, here] for array in (normal, gradient, low, high))
        bound = np.where((active_set > 0) & np.isfinite(most), most, least)
        x = _free_minimum(h, g, bound, (active_set == 0) & (least < most))
        x = np.clip(x, least, most)
        value = np.sum(x * (2 * g + _times(h, x)), axis=0)
        lowest = np.argmin(np.where(np.isnan(value), np.inf, value), axis=0)
        best[:, here] = np.take_along_axis(x, lowest[None, None], axis=1)[:, 0]
    return best


def _free_minimum(
    normal,
    gradient: Float[np.ndarray, "unknowns *problems"],
    x: Float[np.ndarray, "unknowns *sets"],
    is_free: Bool[np.ndarray, "unknowns *sets"],
) -> Float[np.ndarray, "unknowns *sets"]:
    """x with its free entries where the slope vanishes, by an L D L' factorization.

    The diagonal of `normal` is one.
    """
    count = len(x)
    target = -(gradient + _times(normal, np.where(is_free, 0.0, x)))
    coupled = np.where(is_free[:, None] & is_free, normal, 0.0)
    factor = {}
    pivots, forward = [], []
    for i in range(count):
        for j in range(i):
            value = coupled[i, j]
            for k in range(j):
                value = value - factor[i, k] * factor[j, k] * pivots[k]
            factor[i, j] = value / pivots[j]
        # An unknown that is not free does not affect the others.
        pivot = 1.0 + RIDGE - sum(factor[i, k] ** 2 * pivots[k] for k in range(i))
        pivots.append(np.maximum(pivot, RIDGE))
        forward.append(target[i] - sum(factor[i, k] * forward[k] for k in range(i)))
    solved = [np.empty(0)] * count
    for i in reversed(range(count)):
        below = sum(factor[k, i] * solved[k] for k in range(i + 1, count))
        solved[i] = forward[i] / pivots[i] - below
    return np.where(is_free, np.stack(solved), x)


def _times(normal, x: Float[np.ndarray, "unknowns *sets"]) -> Float[np.ndarray, "unknowns *sets"]:
    # In a fixed order of summation, however many problems there are.
    total: Any = sum(normal[:, j] * x[j] for j in range(len(x)))
    return total


def least_in_box(
    normal: Square,
    gradient: Unknowns,
    low: Unknowns,
    high: Unknowns,
    active_set: ActiveSet | None = None,
) -> tuple[Unknowns, ActiveSet]:
    """The x in [low, high] with the least x.(normal x) / 2 + gradient.x, and which are at a bound.

    `normal` is positive definite. `active_set` is a guess of the bounds, such as a neighbor's.
    Block principal pivoting (Portugal, Judice and Vicente, Math. Comp. 63 (1994) 625): all unknowns
    on the wrong side change it at once; if that does not help, only the last of them does, which
    always terminates.

    >>> x, active_set = least_in_box(np.eye(2), np.array([1.0, -1.0]), np.zeros(2), np.full(2, 9.0))
    >>> x.tolist(), active_set.tolist()
    ([0.0, 1.0], [-1, 0])
    """
    is_held = low >= high
    active_set = np.zeros(len(low), int) if active_set is None else active_set.copy()
    active_set[is_held] = -1
    unit = np.sqrt(np.diag(normal))
    fewest, patience = len(low) + 1, PATIENCE
    x = low
    for _ in range(MAX_ROUNDS):
        free = np.flatnonzero(active_set == 0)
        x = np.where(active_set < 0, low, np.where(active_set > 0, high, 0.0))
        x[free] = _solved(normal[np.ix_(free, free)], -(gradient + normal @ x)[free])
        pull = normal @ x
        slope = gradient + pull
        slack = ROUNDING * (np.abs(gradient) + unit * np.sqrt(max(x @ pull, 0.0)))
        span = ROUNDING * np.abs(x)
        is_low, is_high = active_set < 0, active_set > 0
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
        active_set[wrong] = np.where(active_set[wrong] == 0, now, 0)
    return np.clip(x, low, high), active_set


def with_free_values(
    matrix: Float[np.ndarray, "rows unknowns"],
    base: Float[np.ndarray, "rows"],
    x: Unknowns,
    is_free: Bool[np.ndarray, "unknowns"],
) -> Unknowns:
    """x with the free entries that minimize |base + matrix x|, whether in the box or not.

    By an orthogonal factorization: the normal equations, from which the free entries are
    determined, would lose digits.
    """
    x = np.where(is_free, 0.0, x)
    free = lstsq(matrix[:, is_free], -(base + matrix @ x), lapack_driver="gelsy")
    x[is_free] = np.asarray(free[0] if free is not None else 0.0)
    return x


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
