"""Tables that several reports have: metrics, circuits, and names with what is said of them."""

from collections.abc import Callable, Mapping
from itertools import chain
from typing import TYPE_CHECKING

from ..plots.parameters import readable
from .document import Item, Table, make_table
from .words import figures, fixed

if TYPE_CHECKING:
    from ..results import MetricsPart

Cells = dict[str, Callable[[Item], str]]

METRICS: "Cells[MetricsPart]" = {
    "RMSE [mV]": lambda each: millivolts_cell(each.rmse_v),
    "R2": lambda each: fixed(each.r2, 4),
    "R2 (paper)": lambda each: fixed(each.r2_paper, 4),
    "MAPE [%]": lambda each: fixed(each.mape_percent, 3),
    "CE [V]": lambda each: fixed(each.ce_v, 2),
    "max [mV]": lambda each: fixed(1e3 * each.max_v, 1),
    "samples": lambda each: str(each.samples),
}


def circuits_table(
    caption: str,
    circuits: Mapping[str, Mapping[str, float]],
    further: Cells[str],
    first: str = "row",
) -> Table:
    """Circuits by their names under `first`, a dash where one has not got a parameter.

    `further` columns follow, filled by what they give for a name.
    """
    values = {name: readable(parameters) for name, parameters in circuits.items()}

    def of_circuit(head: str) -> Callable[[str], str]:
        return lambda name: figures(values[name].get(head), 4)

    heads = sorted(dict.fromkeys(chain.from_iterable(values.values())), key=_order)
    cells = {first: str, **{head: of_circuit(head) for head in heads}, **further}
    return make_table(caption, circuits, cells, [first])


def _order(head: str) -> tuple[str, int]:
    """R0, R1, C1, tau1, R2, ...: pair by pair, what has no pair last."""
    symbol = head.split()[0]
    kinds = ("R", "C", "tau")
    kind = symbol.rstrip("0123456789")
    number = symbol[len(kind) :]
    return (number or "9", kinds.index(kind) if kind in kinds else len(kinds))


def pairs_table(caption: str, name: str, value: str, pairs: Mapping[str, str]) -> Table:
    """Names and what is said of each, both in words."""
    return make_table(caption, pairs, {name: str, value: lambda each: pairs[each]}, [name, value])


def millivolts_cell(value_v: float | None) -> str:
    """A voltage under a head in mV, a dash where there is none."""
    return fixed(None if value_v is None else 1e3 * value_v, 3)
