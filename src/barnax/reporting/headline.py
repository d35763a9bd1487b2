"""The parameters in a few lines: means over SOC with their intervals, and time constants."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..cell.elements import names_beside
from ..cell.parameters import RATE
from ..over_soc.node_interval import parts_of
from ..table_run import MIDDLE_SOC
from .soc_tables import over_soc_words, short_name, visited_soc
from .temperatures import numbers_of
from .words import (
    aligned_millivolt,
    degrees,
    duration,
    figures,
    interval_beside,
    joined,
    symbol,
    with_unit,
    without_unit,
)

if TYPE_CHECKING:
    from ..over_soc import NodeInterval, TableFit
    from ..results import Result

Row = tuple[str, ...]


def headline(result: "Result") -> tuple[list[str], list[Row]]:
    """Heads and rows: each resistance's mean with its interval and its value at 50 % SOC, beside it
    its time constant; pairs of nearly one time constant as their sum.

    The head of the intervals says what they are of: the records identified on, or of three and
    more what another one would show.
    """
    if result.fits.over_temperature is not None:
        return _by_temperature(result)
    fit, records = result.fit, len(result.of_role("identification"))
    are_several = any(mean.record_low is not None for mean in fit.means)
    kind = "another record" if are_several else "this record" if records == 1 else "these records"
    at_soc = MIDDLE_SOC
    if fit.is_over_soc:
        at_soc = min(visited_soc(fit), key=lambda soc: abs(soc - MIDDLE_SOC))
    heads = ["", over_soc_words(fit), kind, f"at {100 * at_soc:g} %" if fit.is_over_soc else ""]
    rows = []
    for mean in shown_means(fit):
        parts = parts_of(mean.name)
        value = with_unit(mean.name, mean.value)
        middle = ""
        if fit.is_over_soc:
            here = sum(float(fit.tables.at(part, np.array(at_soc))) for part in parts)
            middle = without_unit(with_unit(mean.name, here), value)
        own = mean.on_another_record if are_several else mean
        row = [short_name(mean.name), value, _interval_of(own, value, result), middle]
        rows.append((*row, *_taus(parts, result)))
    for name, number in fit.tables.constants.items():
        if not name.startswith("tau") and name not in numbers_of(fit):
            value = with_unit(name, number) + (" /SOC" if name == RATE else "")
            known = [own for own in fit.intervals if own.name == name]
            told = _interval_of(known[0], value, result) if known else ""
            rows.append((symbol(name), value, told, "", "", "", ""))
    return ([*heads, "", "", ""] if result.tables is not None else []), rows


def shown_means(fit: "TableFit") -> Iterator["NodeInterval"]:
    """The means, each sum in place of its parts."""
    sums = [mean for mean in fit.means if len(parts_of(mean.name)) > 1]
    taken: set[str] = set()
    for mean in fit.means[: len(fit.means) - len(sums)]:
        own = next((total for total in sums if mean.name in parts_of(total.name)), mean)
        if mean.name not in taken and not taken.intersection(parts_of(own.name)):
            yield own
            taken.update(parts_of(own.name))
        elif mean.name not in taken:
            yield mean


def _interval_of(own: "NodeInterval", value: str, result: "Result") -> str:
    held = set(result.constant.fixed)
    if result.tables is not None:
        held = {name for name, ends in result.tables.settings.ranges.items() if ends[0] == ends[1]}
    if own.name in held:
        return "held"
    for bound in result.fit.at_bound:
        if bound.name == own.name and own.low is None and own.high is None:
            return f"at its {bound.side} bound"
    if not result.fit.intervals:
        return ""
    return interval_beside(value, own.name, own.low, own.high, own.value)


def _taus(parts: list[str], result: "Result") -> Row:
    """The symbols, values and intervals of the time constants of some resistances."""
    fit = result.fit
    names = [tau for part in parts if (tau := names_beside(part).tau) in fit.tables.constants]
    if not names:
        return ("", "", "")
    values_s = [fit.tables.constants[name] for name in names]
    called = ", ".join(map(symbol, names))
    longest_s = max(part.duration_s or 0.0 for part in result.of_role("identification"))
    upper = {bound.name for bound in fit.at_bound if bound.side == "upper"}
    if len(names) == 1 and upper.issuperset(names) and values_s[0] >= longest_s * (1 - 1e-3):
        return called, f"> {duration(longest_s)}", "longer than the record"
    known = [own for own in fit.intervals if own.name in names]
    if len(names) > 1:
        return called, f"{joined([figures(value_s) for value_s in values_s])} s", ""
    value = with_unit(names[0], values_s[0])
    return called, value, _interval_of(known[0], value, result) if known else ""


def _by_temperature(result: "Result") -> tuple[list[str], list[Row]]:
    """Means and errors of each temperature, then what is the same at all of them."""
    fits, over = result.fits.fits, result.fits.over_temperature
    assert over is not None, "asked for above"
    names = [mean.name for mean in fits[0].means if len(parts_of(mean.name)) == 1]
    heads = [over_soc_words(result.fit), *map(symbol, names), "RMSE", "unseen", "left out"]
    rows = []
    for fit, left in zip(fits, over.left_out, strict=True):
        held = fit.cross_validation
        means = {mean.name: with_unit(mean.name, mean.value) for mean in fit.means}
        errors = (left.own, held and held.tables, left.errors)
        told = [aligned_millivolt(error and error.rmse_v) for error in errors]
        rows.append((degrees(left.temperature_degc), *(means[name] for name in names), *told))
    for name, value in fits[0].tables.constants.items():
        if name not in numbers_of(fits[0]):
            rows.append((symbol(name), with_unit(name, value), *[""] * (len(names) + 2)))
    return heads, rows
