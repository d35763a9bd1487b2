"""The circuits that were weighed against each other, in a table and in words."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .document import Bullets, Cells, Section, Table, make_table
from .soc_tables import errors_words
from .words import fixed, percent

if TYPE_CHECKING:
    from ..candidates import Candidate


def ranked(candidates: "Sequence[Candidate]") -> "list[Candidate]":
    """The answer first, then by the errors on what was fitted."""
    return sorted(candidates, key=lambda each: (not each.is_answer, each.identification.rmse_v))


def candidates_section(
    candidates: "Sequence[Candidate]", validation: Sequence[str], title: str = "Circuits"
) -> list[Section]:
    """Every circuit that was weighed with its errors, the answer marked; none for a single one."""
    if len(candidates) < 2:
        return []
    told = (
        "Each is the best circuit of its kind, refined and proved as far as the last column says. "
        "Blocks left out of the fit decide: the simplest circuit is preferred unless another "
        "lowers their error, and that above 10 % SOC, by more than 10 %; but a `model` or `over` "
        "that was given is the answer."
    )
    return [Section(title, (Bullets((told,)), candidates_table(candidates, validation)))]


def candidates_table(candidates: "Sequence[Candidate]", validation: Sequence[str]) -> Table:
    """The errors of every circuit on all records."""
    cells: Cells[Candidate] = {
        "circuit": lambda each: each.name,
        "identification [mV]": lambda each: errors_words(each.identification),
    }
    for place, name in enumerate(validation):
        cells[f"{name} [mV]"] = lambda each, place=place: fixed(1e3 * each.validation_v[place], 1)
    cells["left out [mV]"] = lambda each: errors_words(each.held_out)
    cells["better ones are at most"] = lambda each: (
        "not proved"
        if each.proved_gap is None or each.proved_gap >= 1
        else f"{percent(each.proved_gap)} better"
    )
    cells[""] = lambda each: "the answer" if each.is_answer else ""
    return make_table(
        "RMSE in mV, in brackets that above 10 % SOC, of the circuits that were weighed.",
        ranked(candidates),
        cells,
        ["circuit", "left out [mV]", "identification [mV]", "better ones are at most", ""],
    )
