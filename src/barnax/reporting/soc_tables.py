"""Tables over SOC, and over temperature, as tables of words: every node, and in a few lines."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, compress
from typing import TYPE_CHECKING

import numpy as np

from ..cell.elements import names_beside
from ..cell.parameters import HALF_HYSTERESIS, OCV, OCV_CORRECTION
from ..cell.soc_axis import ABOVE_SOC
from ..over_soc.fits import MIDDLE_SOC
from ..over_soc.node_interval import Fact, parts_of
from .document import Cells, Document, Table, make_table, rows_table
from .wording import document, wording
from .words import (
    NOTHING,
    aligned_millivolt,
    degrees,
    duration,
    errors_words,
    figures,
    gathered,
    interval_beside,
    joined,
    one_sided,
    symbol,
    with_unit,
    without_unit,
)

if TYPE_CHECKING:
    from ..over_soc.cross_validation import CrossValidation
    from ..over_soc.fit import TableFit
    from ..over_soc.fits import LeftOut, TableFits
    from ..over_soc.kept import Kept
    from .view import View

# A value within this share of its interval from an end is marked.
AT_EDGE, EDGE = 0.01, "(*)"
SHORT = {OCV_CORRECTION: "OCV correction", HALF_HYSTERESIS: "half hysteresis"}
Row = tuple[str, ...]


def answer_tables(fits: "TableFits") -> tuple[Table, ...]:
    """The values of tables; of several temperatures, those nearest to 25 degC."""
    degc, fit = fits.reference_degc, fits.reference
    if not fit.is_over_soc:
        return (constants_table(fit),)
    if degc is None:
        return means_table(fit), constants_table(fit), nodes_table(fit)
    alone = degrees(degc)
    both, where = f" and at every temperature; intervals are those of {alone} alone", f" at {alone}"
    return means_table(fit, where), constants_table(fit, both), nodes_table(fit, where)


def other_temperatures(fits: "TableFits") -> tuple[Table, ...]:
    """The errors at each temperature, and the tables of those that are not the reference."""
    over = fits.over_temperature
    if over is None:
        return ()
    cells: Cells[tuple[LeftOut, CrossValidation | None]] = {
        "temperature": lambda row: degrees(row[0].temperature_degc),
        "own tables [mV]": lambda row: errors_words(row[0].own),
        "held-out blocks [mV]": lambda row: errors_words(row[1].tables if row[1] else None),
        "left out [mV]": lambda row: errors_words(row[0].errors),
        "predicted from": lambda row: "both sides" if row[0].is_between else "one side",
    }
    errors = make_table(
        wording("tables.at_each_temperature"),
        zip(over.left_out, (fit.cross_validation for fit in fits), strict=True),
        cells,
        cells,
    )
    others = [(degc, fit) for degc, fit in fits.by_degc if fit is not fits.reference]
    return errors, *(nodes_table(fit, f" at {degrees(degc or 0.0)}") for degc, fit in others)


def nodes_table(fit: "TableFit", where: str = "") -> Table:
    """Every table at every node that samples visit, with its interval."""
    nodes = gathered(
        (fact.soc, fact)
        for fact in fit.facts
        if fact.name in fit.tables.tables and fact.is_visited and not fact.is_mean
    )
    heads = ["SOC [%]"]
    for name in fit.tables.tables:
        short = short_name(name)
        heads += [f"{short} [{'mOhm' if 'Ohm' in name else 'mV'}]", f"{short}, 95 %"]
    rows = []
    for soc, facts in nodes.items():
        cells = ((figures(1e3 * fact.value) + _edge(fact), _thousandfold(fact)) for fact in facts)
        rows.append([f"{100 * (soc or 0.0):g}", *chain.from_iterable(cells)])
    edge = EDGE if any(map(_edge, chain.from_iterable(nodes.values()))) else ""
    caption = wording("tables.nodes", where, fit, edge)
    return rows_table(caption, heads, rows, joined=range(2, len(heads), 2))


def means_table(fit: "TableFit", where: str = "") -> Table:
    """The mean of every table over SOC, with its interval."""
    means = (fact for fact in fit.facts if fact.is_mean)
    return _values_table(wording("tables.means", where, fit, over_soc_words(fit)), "mean", means)


def constants_table(fit: "TableFit", where: str = "") -> Table:
    """The parameters with one value at every SOC: time constants, gamma if there is one, and
    resistances of one node."""
    elsewhere = "" if fit.is_over_soc else "; tables.csv has the OCV"
    caption = f"The parameters with one value at every SOC{where}{elsewhere}."
    shown = (f for f in _constants(fit) if not where or f.name not in _law_numbers(fit))
    return _values_table(caption, "parameter", shown)


def _values_table(caption: str, head: str, facts: "Iterable[Fact]") -> Table:
    cells: Cells[Fact] = {
        head: lambda fact: short_name(fact.name),
        "value": lambda fact: with_unit(fact.name, fact.value),
        "95 % interval": lambda fact: (
            interval_beside(with_unit(fact.name, fact.value), fact) if fact.is_assessed else NOTHING
        ),
    }
    return make_table(caption, facts, cells, cells)


def _constants(fit: "TableFit") -> "Iterator[Fact]":
    """What has one value at every SOC."""
    return (fact for fact in fit.facts if fact.soc is None and not fact.is_mean)


def ocv_tables(fits: "TableFits") -> tuple[Table, ...]:
    """An OCV of the records' own at the nodes near samples, at each temperature."""
    cells: Cells[Fact] = {
        "SOC [%]": lambda node: f"{100 * (node.soc or 0.0):.4g}",
        "OCV [V]": lambda node: f"{node.value:.4f}",
        "95 %": lambda node: NOTHING if node.low is None else f"{node.low:.4f} to {node.high:.4f}",
    }
    by_degc = ((degc, [f for f in fit.facts if f.name == OCV]) for degc, fit in fits.by_degc)
    return tuple(
        make_table(
            f"The OCV{'' if degc is None else f' at {degrees(degc)}'} at the nodes near samples; "
            "linear between nodes, constant beyond them.",
            nodes,
            cells,
        )
        for degc, nodes in by_degc
        if nodes
    )


def kept_document(kept: "Sequence[Kept]", fit: "TableFit") -> Document:
    """The fit of some kept records together."""
    return document("kept", {"nodes": (nodes_table(fit),)}, kept=kept, fit=fit)


def headline(view: "View") -> tuple[list[str], list[Row]]:
    """Heads and rows: each resistance's mean with its interval and its value at 50 % SOC, beside it
    its time constant; pairs of nearly one time constant as their sum.

    The head of the intervals says what they are of: the records identified on, or of three and
    more what another one would show.
    """
    if view.over_temperature is not None:
        return _by_temperature(view)
    fit, records = view.result.fit, len(view.identified)
    kind = (
        "another record"
        if fit.are_of_another_record
        else "this record"
        if records == 1
        else "these records"
    )
    mean = over_soc_words(fit).replace("over", "mean") if fit.is_over_soc else over_soc_words(fit)
    at_soc = MIDDLE_SOC
    if fit.is_over_soc:
        at_soc = min(visited_soc(fit), key=lambda soc: abs(soc - MIDDLE_SOC))
    heads = ["", mean, f"95 %, {kind}", f"at {100 * at_soc:g} %" if fit.is_over_soc else ""]
    rows = []
    for shown in shown_means(fit):
        parts = parts_of(shown.name)
        value = with_unit(shown.name, shown.value)
        middle = ""
        if fit.is_over_soc:
            here = sum(float(fit.tables.at(part, np.array(at_soc))) for part in parts)
            middle = without_unit(with_unit(shown.name, here), value)
        row = [short_name(shown.name), value, _interval_of(shown, value, view), middle]
        rows.append((*row, *_taus(parts, view)))
    for fact in _constants(fit):
        name, is_shown = fact.name, fact.name not in (*fit.tables.tables, *_law_numbers(fit))
        if is_shown and not name.startswith("tau"):
            value = with_unit(name, fact.value)
            interval = _interval_of(fact, value, view) if fact.is_assessed else ""
            rows.append((symbol(name), value, interval, "", "", "", ""))
    return ([*heads, "", "", ""] if view.result.tables is not None else [""] * 7), rows


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


def _by_temperature(view: "View") -> tuple[list[str], list[Row]]:
    """Means and errors of each temperature, then what is the same at all of them."""
    fits, over = view.result.fits.fits, view.over_temperature
    assert over is not None, "asked of several temperatures"
    names = [mean.name for mean in fits[0].means if len(parts_of(mean.name)) == 1]
    mean = over_soc_words(view.result.fit).replace("over", "mean")
    heads = [mean, *map(symbol, names), "RMSE", "held out", "left out"]
    rows: list[tuple[str, ...]] = []
    for fit, left in zip(fits, over.left_out, strict=True):
        held = fit.cross_validation
        means = {mean.name: with_unit(mean.name, mean.value) for mean in fit.means}
        errors = (left.own, held.tables if held else None, left.errors)
        shown = [aligned_millivolt(error.rmse_v if error else None) for error in errors]
        rows.append((degrees(left.temperature_degc), *(means[name] for name in names), *shown))
    for name, value in fits[0].tables.constants.items():
        if name not in _law_numbers(fits[0]):
            rows.append((symbol(name), with_unit(name, value), *[""] * (len(names) + 2)))
    return heads, rows


def _taus(parts: list[str], view: "View") -> Row:
    """The symbols, values and intervals of the time constants of some resistances."""
    named = [names_beside(part).tau for part in parts]
    taus = [fact for name in named for fact in _constants(view.result.fit) if fact.name == name]
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
    return symbols, value, _interval_of(fact, value, view) if fact.is_assessed else ""


def _interval_of(own: Fact, value: str, view: "View") -> str:
    held = set(view.result.constant.fixed)
    if view.result.tables is not None:
        ranges = view.result.tables.settings.ranges
        held = {name for name, ends in ranges.items() if ends[0] == ends[1]}
    if own.name in held:
        return "held"
    for bound in view.result.fit.at_bound:
        if bound.name == own.name and own.low is None and own.high is None:
            return f"at its {bound.side} bound"
    return interval_beside(value, own) if view.result.fit.intervals else ""


def over_soc_words(fit: "TableFit") -> str:
    """The range of SOC that means are over, as a sentence has it; empty of a constant circuit."""
    extent = mean_extent(fit)
    return f"over {extent} SOC" if extent else ""


def mean_extent(fit: "TableFit") -> str:
    """The range of SOC that means are over, in percent; empty of a constant circuit."""
    soc = visited_soc(fit) if fit.is_over_soc else [own.soc or 0.0 for own in fit.of_table(OCV)]
    if not soc:
        return ""
    low = max(soc[0], min(ABOVE_SOC, soc[-1]))
    return f"{100 * low:.0f}-{100 * soc[-1]:.0f} %"


def visited_soc(fit: "TableFit") -> list[float]:
    """The nodes of tables that samples visit."""
    return [*compress(fit.tables.nodes, fit.tables.visited)]


def _law_numbers(fit: "TableFit") -> set[str]:
    """The names of the numbers of what resistances follow."""
    law = fit.tables.dependence
    return set() if law is None else set(law.numbers)


def short_name(name: str) -> str:
    """The head of a table's column."""
    return SHORT.get(name, symbol(name))


def _thousandfold(node: Fact) -> str:
    """An interval in mOhm or mV."""
    if not node.is_assessed:
        return NOTHING
    open_end = one_sided(node.low, node.high, lambda end: figures(1e3 * end))
    if open_end or node.low is None or node.high is None:
        return open_end
    return f"{figures(1e3 * node.low)} to {figures(1e3 * node.high)}"


def _edge(node: Fact) -> str:
    """A mark where a value is at an end of its own interval."""
    if node.low is None or node.high is None or node.record_low is not None:
        return ""
    near = AT_EDGE * (node.high - node.low)
    return f" {EDGE}" if min(node.value - node.low, node.high - node.value) <= near else ""
