"""Columns of the reduced factor of some records, and the order in which they stand."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int

from .exponentials import AT_ONCE, Span, span_of
from .prepared import PreparedRecord
from .search_space import Range

if TYPE_CHECKING:
    from .coordinates import Coordinates

# Bound on the error of a pair's answer, relative to the largest current.
TOLERANCE = 1e-12


def spans_between(ends: Iterable[Range]) -> tuple[Span, Span | None]:
    """Nodes for every RC pair of a box, and for a dynamic hysteresis where there is one, by
    `span_ends`. Raises `InputError` where these are too far apart."""
    in_tau, *in_rate = (span_of(*each, TOLERANCE) for each in ends)
    return in_tau, in_rate[0] if in_rate else None


def span_ends(taus_s: Range, gammas: Range | None, interval_s: float) -> list[Range]:
    """What spans go over, as far as an interval can tell a pair from a faster one."""
    in_tau = max(taus_s[0], interval_s / AT_ONCE), taus_s[1]
    return [in_tau] if gammas is None else [in_tau, (1 / gammas[1], 1 / gammas[0])]


def ends_of(records: Sequence[PreparedRecord], box: "Coordinates") -> list[Range]:
    """The same of every circuit in a box."""
    interval_s = min(float(np.min(np.diff(prepared.time_s))) for prepared in records)
    return span_ends(box.tau_span_s, box.gamma_limits, interval_s)


@dataclass(frozen=True, eq=False)
class Layout:
    """The columns of a factor. `amplitude` says what a dynamic hysteresis has of them: none,
    those of the measured gap, or those of a table. The OCV correction stands at `ocv_nodes`, all
    other tables at `nodes`. Several voltages under one current are so many `sides`."""

    nodes: tuple[float, ...]
    ocv_nodes: tuple[float, ...]
    in_tau: Span
    in_rate: Span | None
    has_correction: bool
    has_amplitude: bool
    sides: int = 1

    @cached_property
    def places(self) -> dict[str, Int[np.ndarray, "count width"]]:
        """The places of the columns of each part."""
        ends = np.cumsum([count * width for count, width in self.sizes.values()])
        parts = zip(self.sizes.items(), np.split(np.arange(ends[-1]), ends[:-1]), strict=True)
        return {name: part.reshape(size) for (name, size), part in parts}

    @property
    def width(self) -> int:
        return sum(count * width for count, width in self.sizes.values())

    @property
    def sizes(self) -> dict[str, tuple[int, int]]:
        """Number and width of the columns of each part; those of `pairs` and
        `hysteresis_response` are of the skeletons, `initial_hysteresis` is the hysteresis before it
        has turned."""
        nodes, rate = len(self.nodes), self.in_rate
        responses = 0 if rate is None else len(rate.skeleton), nodes if self.has_amplitude else 1
        return {
            "pairs": (len(self.in_tau.skeleton), nodes),
            "hysteresis_response": responses,
            "initial_hysteresis": (int(self.has_amplitude), nodes),
            "current": (1, nodes),
            "correction": (int(self.has_correction), len(self.ocv_nodes)),
            "base": (self.sides, 1),
        }


def by_first_visit(
    prepared_records: Sequence[PreparedRecord], layout: Layout
) -> Int[np.ndarray, "columns"]:
    """The columns in the order in which samples first come near their nodes, then those of all
    nodes. What is near now is near the end of those seen so far, and moves little of a triangle."""
    if len(layout.nodes) == 1 and not layout.has_correction:
        return np.arange(layout.width)
    first = np.full(layout.width, np.inf)
    for name, places in layout.places.items():
        nodes = np.array(layout.ocv_nodes if name == "correction" else layout.nodes)
        if places.shape[1] != len(nodes) or name == "base":
            continue
        seen, before = np.full(len(nodes), np.inf), 0
        for prepared in prepared_records:
            between = np.clip(np.searchsorted(nodes, prepared.soc, "right") - 1, 0, len(nodes) - 1)
            left, at = np.unique(between, return_index=True)
            for node in (left, np.minimum(left + 1, len(nodes) - 1)):
                np.minimum.at(seen, node, at + before)
            before += len(prepared.soc)
        first[places] = seen
    # What no sample comes near stays empty; what every sample moves is last of all.
    everywhere = [layout.places["base"].ravel()]
    if not layout.has_amplitude:
        everywhere.insert(0, layout.places["hysteresis_response"].ravel())
    order = np.argsort(first, kind="stable")
    return np.concatenate([order[~np.isin(order, np.concatenate(everywhere))], *everywhere])
