"""The columns of the reduced factor of records, and their order."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Int

from .exponentials import AT_ONCE, Span, span_of
from .prepared import PreparedRecord
from .search_space import Range

# Bound on the error of a pair's response, relative to the largest current.
TOLERANCE = 1e-12
# A pair has settled when its response is below this share of the largest current's.
SETTLED = 1e-16


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
    at `nodes`. A base error for each of several voltages is a column; `voltages` are their
    numbers."""

    nodes: tuple[float, ...]
    ocv_nodes: tuple[float, ...]
    in_tau: Span
    in_rate: Span | None
    has_correction: bool
    has_amplitude: bool
    voltages: tuple[int, ...] = (0,)

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
            "base": (len(self.voltages), 1),
        }


def by_last_change(
    prepared_records: Sequence[PreparedRecord], layout: Layout
) -> Int[np.ndarray, "columns"]:
    """The columns in the order in which samples last change them, then those that every sample
    changes. A sample changes the columns of the nodes next to it, and those of the pairs that have
    not settled since the record was near their node; in this order it changes little of a triangle.
    """
    if len(layout.nodes) == 1 and not layout.has_correction:
        return np.arange(layout.width)
    last_s, begin_s = np.full(layout.width, -np.inf), 0.0
    for prepared in prepared_records:
        time_s = begin_s + prepared.time_s - prepared.time_s[0]
        begin_s = float(time_s[-1])
        for name, indices in layout.columns.items():
            nodes = np.array(layout.ocv_nodes if name == "correction" else layout.nodes)
            if indices.shape[1] != len(nodes) or name == "base":
                continue
            near_s = np.full(len(nodes), -np.inf)
            for side in ("left", "right"):
                node = np.searchsorted(nodes, prepared.soc, side) - (side == "right")
                np.maximum.at(near_s, np.clip(node, 0, len(nodes) - 1), time_s)
            settling_s = -math.log(SETTLED) * layout.in_tau.skeleton_tau if name == "pairs" else [0]
            until_s = np.minimum(np.add.outer(settling_s, near_s), begin_s)
            last_s[indices] = np.maximum(last_s[indices], until_s)
    everywhere = [layout.columns["base"].ravel()]
    if not layout.has_amplitude:
        everywhere.insert(0, layout.columns["hysteresis_response"].ravel())
    order = np.argsort(last_s, kind="stable")
    return np.concatenate([order[~np.isin(order, np.concatenate(everywhere))], *everywhere])
