"""Tables over SOC, and over temperature, as tables of words: every node, and in a few lines."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..cell.elements import names_beside
from ..over_soc.fits import MIDDLE_SOC
from ..over_soc.node_interval import Fact, parts_of
from .document import Document, Table, rows_table
from .wording import document, table
from .words import duration, figures, joined, symbol, with_unit, without_unit

if TYPE_CHECKING:
    from ..over_soc.fit import TableFit
    from ..over_soc.kept import Kept
    from .view import View


def kept_document(kept: "Sequence[Kept]", fit: "TableFit") -> Document:
    """The fit of some kept records together."""
    return document("kept", kept=kept, fit=fit)


def headline(view: "View") -> Table:
    """Each resistance's mean with its interval and its value at 50 % SOC, beside it
    its time constant; pairs of nearly one time constant as their sum.

    The head of the intervals says what they are of: the records identified on, or of three and
    more what another one would show.
    """
    if view.over_temperature is not None:
        return table("tables.by_temperature", view)
    fit = view.result.fit
    kind = "this record" if len(view.identified) == 1 else "these records"
    kind = "another record" if fit.are_of_another_record else kind
    heads, rows, at_soc = [""] * 7, list[tuple[str, ...]](), MIDDLE_SOC
    if view.result.tables is not None or fit.intervals:
        heads[1:3] = f"mean {view.extent}" if fit.is_over_soc else "", f"95 %, {kind}"
    if fit.is_over_soc:
        at_soc = min(fit.visited_nodes, key=lambda soc: abs(soc - MIDDLE_SOC))
        heads[3] = f"at {100 * at_soc:g} %"
    for shown in shown_means(fit):
        parts = parts_of(shown.name)
        value = with_unit(shown.name, shown.value)
        middle = ""
        if fit.is_over_soc:
            here = sum(float(fit.tables.at(part, np.array(at_soc))) for part in parts)
            middle = without_unit(with_unit(shown.name, here), value)
        row = [symbol(shown.name), value, view.interval(shown, value), middle]
        rows.append((*row, *_taus(parts, view)))
    for fact in fit.constant_facts:
        name, is_shown = fact.name, fact.name not in fit.tables.tables
        if is_shown and not name.startswith("tau"):
            value = with_unit(name, fact.value)
            rows.append((symbol(name), value, view.interval(fact, value), "", "", "", ""))
    # Names and intervals take turns with numbers.
    return rows_table("", heads, rows, {0, 2, 4, 6}, joined={5, 6}, is_bare=True)


def shown_means(fit: "TableFit") -> list[Fact]:
    """The means, each sum in place of its parts; of two sums that share a part, the first."""
    means = {fact.name: fact for fact in fit.facts if fact.is_mean}
    for total in [name for name in means if len(parts_of(name)) > 1]:
        first, *others = parts_of(total)
        shown = means.pop(total)
        if means.keys() >= {first, *others}:
            means = {name: shown if name == first else fact for name, fact in means.items()}
            for part in others:
                del means[part]
    return [*means.values()]


def _taus(parts: list[str], view: "View") -> tuple[str, str, str]:
    """The symbols, values and intervals of the time constants of some resistances."""
    named = [names_beside(part).tau for part in parts]
    facts = view.result.fit.constant_facts
    taus = [fact for name in named for fact in facts if fact.name == name]
    if not taus:
        return ("", "", "")
    symbols, fact = ", ".join(symbol(tau.name) for tau in taus), taus[0]
    if len(taus) > 1:
        return symbols, f"{joined([figures(tau.value) for tau in taus])} s", ""
    longest_s = max(part.duration_s or 0.0 for part in view.identified)
    upper = {bound.name for bound in view.result.fit.at_bound if bound.side == "upper"}
    if fact.name in upper and fact.value >= longest_s * (1 - 1e-3):
        return symbols, f"> {duration(longest_s)}", "longer than the record"
    value = with_unit(fact.name, fact.value)
    return symbols, value, view.interval(fact, value)
