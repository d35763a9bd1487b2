"""Many small least-squares problems with bounds, solved exactly and at once."""

import itertools

import numpy as np
from jaxtyping import Bool, Float

# A column this dependent on those before it, relative to its own square, moves nothing.
RIDGE = 1e-13
# Guesses of which unknowns are at a bound; those few problems that still change are enumerated.
GUESSES = 10

Unknowns = Float[np.ndarray, "unknowns problems"]


def least_in_box(
    normal: Float[np.ndarray, "unknowns unknowns problems"],
    gradient: Unknowns,
    low: Unknowns,
    high: Unknowns,
) -> Unknowns:
    """Each problem's x in [low, high] with the least x.(normal x) / 2 + gradient.x.

    `normal` is A'A and `gradient` A'b for the least squares of b + A x. Where low and high are
    one value, that is it. Active sets are guessed for all problems together, each from the signs
    of the last guess's multipliers (Hintermüller, Ito and Kunisch, SIAM J. Optim. 13 (2002)
    865); where that runs in circles all sets are tried. Columns that depend on others cost
    nothing but which of the equally good x is found.
    """
    scale = np.sqrt(np.einsum("iin->in", normal))
    scale = np.where(scale > 0, scale, 1.0)
    normal = normal / scale[:, None] / scale
    gradient, box = gradient / scale, (low, high)
    low, high = low * scale, high * scale
    held = low >= high
    at_low = at_high = np.zeros_like(held)
    found, open_problems = low.copy(), np.arange(low.shape[1])
    for _ in range(GUESSES):
        here = np.ix_(np.arange(len(low)), open_problems)
        h, g, least, most, pinned = (
            normal[:, :, open_problems],
            gradient[here],
            low[here],
            high[here],
            held[here],
        )
        is_free = ~(at_low | at_high | pinned)
        x = _free_minimum(h, g, np.where(at_high, most, least), is_free)
        slope = g + _times(h, x)
        now_low = ((is_free & (x < least)) | (at_low & (slope >= 0))) & ~pinned
        now_high = ((is_free & (x > most)) | (at_high & (slope <= 0))) & ~pinned
        settled = np.all((now_low == at_low) & (now_high == at_high), axis=0)
        found[:, open_problems[settled]] = np.clip(x, least, most)[:, settled]
        open_problems = open_problems[~settled]
        at_low, at_high = now_low[:, ~settled], now_high[:, ~settled]
        if not len(open_problems):
            break
    if len(open_problems):
        here = np.ix_(np.arange(len(low)), open_problems)
        found[here] = _enumerated(
            normal[:, :, open_problems], gradient[here], low[here], high[here]
        )
    return np.clip(found / scale, *box)


def _enumerated(normal, gradient: Unknowns, low: Unknowns, high: Unknowns) -> Unknowns:
    """The best of all active sets, each moved into the box."""
    least, best = np.full(low.shape[1], np.inf), low.copy()
    for sides in itertools.product((-1, 0, 1), repeat=len(low)):
        side = np.array(sides)[:, None]
        is_free = (side == 0) & (low < high)
        x = _free_minimum(normal, gradient, np.where(side > 0, high, low), is_free)
        x = np.clip(x, low, high)
        value = np.sum(x * (2 * gradient + _times(normal, x)), axis=0)
        best = np.where(value < least, x, best)
        least = np.minimum(value, least)
    return best


def _free_minimum(normal, gradient: Unknowns, x: Unknowns, is_free: Bool[np.ndarray, "..."]):
    """x with its free entries where the slope vanishes, by an L D L' factorization.

    The diagonal of `normal` is one.
    """
    count = len(x)
    target = -(gradient + _times(normal, np.where(is_free, 0.0, x)))
    factor = {}
    pivots, forward = [], []
    for i in range(count):
        for j in range(i):
            value = np.where(is_free[i] & is_free[j], normal[i, j], 0.0)
            for k in range(j):
                value = value - factor[i, k] * factor[j, k] * pivots[k]
            factor[i, j] = value / pivots[j]
        pivot = 1.0 + RIDGE - sum(factor[i, k] ** 2 * pivots[k] for k in range(i))
        pivots.append(np.where(is_free[i], np.maximum(pivot, RIDGE), 1.0))
        forward.append(target[i] - sum(factor[i, k] * forward[k] for k in range(i)))
    solved = [np.empty(0)] * count
    for i in reversed(range(count)):
        below = sum(factor[k, i] * solved[k] for k in range(i + 1, count))
        solved[i] = forward[i] / pivots[i] - below
    return np.where(is_free, np.stack(solved), x)


def _times(normal, x: Unknowns) -> Unknowns:
    return np.einsum("ijn,jn->in", normal, x)
