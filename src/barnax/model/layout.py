"""Triangular factors of many rows: sufficient for the squared norm of any combination of columns;
and the order of the columns in the reduced factor of records."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import get_lapack_funcs, qr

from .exponentials import AT_ONCE, Span, span_of
from .prepared import PreparedRecord
from .search_space import Range

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
    """The triangular factor of a triangular factor and more rows."""
    tpqrt: Any = get_lapack_funcs("tpqrt", (factor,))
    for first in range(0, len(rows), PANEL):
        panel = np.array(rows[first : first + PANEL], order="F")
        factor = tpqrt(0, reflectors(len(factor)), factor, panel, overwrite_b=True)[0]
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


# Bound on the error of a pair's response, relative to the largest current.
TOLERANCE = 1e-12


def spans_between(ends: Iterable[Range]) -> tuple[Span, Span | None]:
    """Nodes for every RC pair in a box, and for a dynamic hysteresis if there is one, from
    `span_ends`. Raises `InputError` if the ends are too far apart."""
    in_tau, *in_rate = (span_of(*each, TOLERANCE) for each in ends)
    return in_tau, in_rate[0] if in_rate else None


def span_ends(taus_s: Range, gammas: Range | None, interval_s: float) -> list[Range]:
    """The ranges of spans, from the fastest pair that an interval can resolve on."""
    in_tau = max(taus_s[0], interval_s / AT_ONCE), taus_s[1]
    return [in_tau] if gammas is None else [in_tau, (1 / gammas[1], 1 / gammas[0])]


def ends_of(records: Sequence[PreparedRecord], taus_s: Range, gammas: Range | None) -> list[Range]:
    """The ranges of spans that the densest samples of the records can resolve."""
    interval_s = min(float(np.min(np.diff(prepared.time_s))) for prepared in records)
    return span_ends(taus_s, gammas, interval_s)


@dataclass(frozen=True, eq=False)
class Layout:
    """The columns of a factor. `amplitude` gives the columns of a dynamic hysteresis: none, those
    of the measured gap, or those of a table. The OCV correction is at `ocv_nodes`, all other tables
    at `nodes`. Several voltages under one current are as many `voltages`."""

    nodes: tuple[float, ...]
    ocv_nodes: tuple[float, ...]
    in_tau: Span
    in_rate: Span | None
    has_correction: bool
    has_amplitude: bool
    voltages: int = 1

    @cached_property
    def columns(self) -> dict[str, Int[np.ndarray, "count width"]]:
        """The indices of the columns of each part."""
        ends = np.cumsum([count * width for count, width in self.sizes.values()])
        parts = zip(self.sizes.items(), np.split(np.arange(ends[-1]), ends[:-1]), strict=True)
        return {name: part.reshape(size) for (name, size), part in parts}

    @property
    def width(self) -> int:
        return sum(count * width for count, width in self.sizes.values())

    @property
    def sizes(self) -> dict[str, tuple[int, int]]:
        """Number and width of the columns of each part; those of `pairs` and `hysteresis_response`
        are for the skeletons, `initial_hysteresis` is the hysteresis before it has turned."""
        nodes, rate = len(self.nodes), self.in_rate
        responses = 0 if rate is None else len(rate.skeleton), nodes if self.has_amplitude else 1
        return {
            "pairs": (len(self.in_tau.skeleton), nodes),
            "hysteresis_response": responses,
            "initial_hysteresis": (int(self.has_amplitude), nodes),
            "current": (1, nodes),
            "correction": (int(self.has_correction), len(self.ocv_nodes)),
            "base": (self.voltages, 1),
        }


def by_first_visit(
    prepared_records: Sequence[PreparedRecord], layout: Layout
) -> Int[np.ndarray, "columns"]:
    """The columns in the order in which samples first come near their nodes, then those of all
    nodes. The nodes near a sample are at the end of those seen so far, so that it changes little of
    a triangle."""
    if len(layout.nodes) == 1 and not layout.has_correction:
        return np.arange(layout.width)
    first = np.full(layout.width, np.inf)
    for name, indices in layout.columns.items():
        nodes = np.array(layout.ocv_nodes if name == "correction" else layout.nodes)
        if indices.shape[1] != len(nodes) or name == "base":
            continue
        seen, before = np.full(len(nodes), np.inf), 0
        for prepared in prepared_records:
            between = np.clip(np.searchsorted(nodes, prepared.soc, "right") - 1, 0, len(nodes) - 1)
            left, at = np.unique(between, return_index=True)
            for node in (left, np.minimum(left + 1, len(nodes) - 1)):
                np.minimum.at(seen, node, at + before)
            before += len(prepared.soc)
        first[indices] = seen
    # Columns that no sample comes near stay empty; those that every sample changes come last.
    everywhere = [layout.columns["base"].ravel()]
    if not layout.has_amplitude:
        everywhere.insert(0, layout.columns["hysteresis_response"].ravel())
    order = np.argsort(first, kind="stable")
    return np.concatenate([order[~np.isin(order, np.concatenate(everywhere))], *everywhere])
