"""Circuits as rows of a table: resistances, capacitances and time constants, pair by pair."""

from collections.abc import Callable, Mapping

from ..plots.quantities import readable
from .document import Column, Table
from .words import significant

ROW = Column("row", role="text")


def circuits_table(
    caption: str,
    circuits: Mapping[str, Mapping[str, float]],
    further: tuple[Column, ...],
    cells: Callable[[str], tuple[str, ...]],
    first: Column = ROW,
) -> Table:
    """Circuits by their names under `first`, a dash where one has not got a parameter.

    `further` columns follow, filled by what `cells` gives for a name.
    """
    values = {name: readable(parameters) for name, parameters in circuits.items()}
    heads = sorted({head for each in values.values() for head in each}, key=_order)
    return Table(
        caption=caption,
        columns=(first, *(_column(head) for head in heads), *further),
        rows=tuple(
            (name, *(significant(each.get(head)) for head in heads), *cells(name))
            for name, each in values.items()
        ),
    )


def _order(head: str) -> tuple[str, int]:
    """R0, R1, C1, tau1, R2, ...: pair by pair, what has no pair last."""
    symbol = head.split()[0]
    kinds = ("R", "C", "tau")
    kind = symbol.rstrip("0123456789")
    number = symbol[len(kind) :]
    return (number or "9", kinds.index(kind) if kind in kinds else len(kinds))


def _column(head: str) -> Column:
    name, _, unit = head.partition(" ")
    return Column(name, unit.strip("[]"))
