"""Circuits weighed against each other, and which of them the data support."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from .cell import CellModel
from .over_soc import SocErrors, TableFit, table_name
from .search.evaluate import Evaluation

# Constant circuits, the simplest first: no hysteresis, switched at once, and following the charge.
WEIGHED = ("so-rc", "iso-rc", "esc")
# Tables of a pair more are weighed where they leave less.
TWO_PAIRS, THREE_PAIRS = "so-rc", "3rc"
# Its hysteresis follows the charge: where that is the best constant circuit, its tables are weighed
# too.
FOLLOWING = "esc"
# Where records show their OCV themselves, what is tried beside each circuit that is the answer so
# far: a pair more, and a hysteresis, which can each imitate the other, and both.
FURTHER = {
    TWO_PAIRS: (THREE_PAIRS, FOLLOWING),
    THREE_PAIRS: (f"{FOLLOWING}+rc",),
    FOLLOWING: (f"{FOLLOWING}+rc",),
}
# A constant circuit that leaves so many times the error of another is contradicted by the data:
# its intervals, which take its structure for granted, do not hold.
CONTRADICTED = 1.5
# A circuit whose held-out error differs from the answer's by less is no less possible.
ALIKE = 0.1
# Tables of which samples visit less SOC than this are no answer for the cell: beyond, they follow
# from their neighbors.
LEAST_SPAN_SOC = 0.3


@dataclass(frozen=True)
class Candidate:
    """A circuit that was weighed: its errors on what it was fitted to, and on what it was not.

    Attributes:
        model: Name of the circuit.
        over: "soc" or "soc,temperature" for tables, "ocv" for one value of each resistance at every
            SOC beside a table of the OCV, None for a constant circuit.
        identification: Errors on all records identified on together.
        validation_v: RMSE on each record validated on.
        held_out: Errors on blocks held out of the fit; None where nothing was.
        proved_gap: The largest share of its error that a better circuit of its kind could save;
            None without a proof.
        is_answer: True for the one that the result is of.
    """

    model: str
    over: str | None
    identification: SocErrors
    validation_v: tuple[float, ...]
    held_out: SocErrors | None
    proved_gap: float | None = None
    is_answer: bool = False

    @property
    def name(self) -> str:
        """The circuit as tables and screens call it."""
        return table_name(self.model, self.over)

    @classmethod
    def of(
        cls,
        model: str,
        over: str | None,
        identified: Iterable[Evaluation],
        validated: Iterable[Evaluation],
        held_out: SocErrors | None,
        proved_gap: float | None,
    ) -> "Candidate":
        """The candidate with the errors of its evaluations."""
        validation_v = tuple(evaluation.metrics.rmse_v for evaluation in validated)
        scored = [(found, found.prepared.scored) for found in identified]
        together = SocErrors.of((found.error_v[at], found.prepared.soc[at]) for found, at in scored)
        return cls(model, over, together, validation_v, held_out, proved_gap)


def tabulated_circuit(cell: CellModel) -> str:
    """The circuit that tables are of: their OCV correction stands in for a switched hysteresis;
    on an OCV as flat as LFP's the hysteresis matters, and follows the charge."""
    return FOLLOWING if cell.has_flat_ocv else TWO_PAIRS


def spans_enough(fit: TableFit) -> bool:
    """True if samples visit so much of the SOC that tables say something of the cell."""
    tables = fit.tables
    visited = [
        soc for soc, is_visited in zip(tables.nodes, tables.visited, strict=True) if is_visited
    ]
    return bool(visited) and max(visited) - min(visited) >= LEAST_SPAN_SOC


def is_better(one: SocErrors | None, simpler: SocErrors | None) -> bool:
    """True if a circuit is worth what it has more than a simpler one, by held-out errors."""
    return one is not None and simpler is not None and one.is_worth(simpler)


def is_alike(one: SocErrors | None, other: SocErrors | None) -> bool:
    """True if held-out errors tell two circuits apart by less than `ALIKE`."""
    if one is None or other is None:
        return False
    low, high = sorted((one.rmse_v, other.rmse_v))
    return (1 - ALIKE) * high <= low


def best_of(held_out: Sequence[SocErrors | None]) -> int:
    """The place of the constant circuit to prefer, the simplest of them being first."""
    worth = [
        (errors.rmse_v, place)
        for place, errors in enumerate(held_out)
        if errors is not None and is_better(errors, held_out[0])
    ]
    return min(worth, default=(0.0, 0))[1]
