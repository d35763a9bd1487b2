"""Triangular factors of many rows: they give the squared norm of any combination of columns."""

from collections.abc import Iterable
from functools import reduce
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import get_lapack_funcs, qr

# Rows added to a factor at a time, as many as fit in a core's cache, and columns of one block
# reflector: measured, adding whole blocks with LAPACK's plain QR takes three times as long.
PANEL = 1024
FEW_COLUMNS, REFLECTORS = 128, (8, 32)
# Rows of the factor that add less than this to any column's RMS, in V, are left out. They are
# orthogonal to the others: an RMSE grows by their square over twice itself.
NEGLIGIBLE_V = 1e-13
# The remaining rows are padded to a multiple of this, so that most records share one program, and
# to match a processor's widest registers.
ROW_STEP = 16

Rows = Float[np.ndarray, "rows columns"]
Triangle = Float[np.ndarray, "columns columns"]


def reflectors(columns: int) -> int:
    """Number of columns that LAPACK reflects at once."""
    few, many = REFLECTORS
    return min(few if columns <= FEW_COLUMNS else many, columns)


def update_triangular(factor: Triangle, rows: Rows) -> Triangle:
    """The triangular factor of a triangular factor, which it may overwrite, and more rows."""
    tpqrt: Any = get_lapack_funcs("tpqrt", (factor,))
    for first in range(0, len(rows), PANEL):
        panel = np.array(rows[first : first + PANEL], order="F")
        factor = tpqrt(0, reflectors(len(factor)), factor, panel, True, True)[0]
    return factor


def join_triangles(triangles: Iterable[Triangle]) -> Triangle:
    """The triangular factor of several triangular ones."""
    tpqrt: Any = get_lapack_funcs("tpqrt")

    def joined(used: Triangle, other: Triangle) -> Triangle:
        return tpqrt(len(used), reflectors(len(used)), used, other)[0]

    return reduce(joined, triangles)


def append_rows(factor: Triangle, rows: Rows) -> Triangle:
    """The triangular factor with more rows; its empty columns stay empty."""
    used = np.flatnonzero(np.any(factor, axis=0) | np.any(rows, axis=0))
    joined, block = np.zeros_like(factor), np.ix_(used, used)
    joined[block] = update_triangular(factor[block], rows[np.any(rows, axis=1)][:, used])
    return joined


def shorten(
    factor: Float[np.ndarray, "rows columns"], negligible: float
) -> Float[np.ndarray, "fewer columns"]:
    """A factor with fewer rows that preserves the norm of every combination of columns, up to
    `negligible`.
    """
    if not np.any(factor):
        return np.zeros((ROW_STEP, factor.shape[1]))
    columns, rows = np.any(factor, axis=0), np.any(factor, axis=1)
    decomposed: Any = qr(factor[np.ix_(rows, columns)], mode="r", pivoting=True)
    order = np.flatnonzero(columns)[decomposed[1]]
    triangle = decomposed[0][: len(order)]
    lengths = np.sqrt(np.cumsum(triangle[::-1] ** 2, axis=0)[::-1].max(axis=1))
    wanted = int(np.count_nonzero(lengths > negligible))
    shorter = np.zeros((-(-max(wanted, 1) // ROW_STEP) * ROW_STEP, factor.shape[1]))
    kept = triangle[: len(shorter)]
    shorter[: len(kept), order] = kept
    return shorter
