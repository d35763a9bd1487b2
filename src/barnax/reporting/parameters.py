"""The parameters of a result with their intervals: as CSV, as a data frame, and side by side."""

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..cell.parameters import OCV, OCV_CORRECTION
from ..errors import InputError
from ..files import csv_text
from ..fit.node_interval import Fact, parts_of
from ..results import Result
from .document import Page
from .render import to_fragment
from .wording import document
from .words import (
    gathered,
    percent,
    soc_extent,
    symbol,
)

if TYPE_CHECKING:
    import polars

    from ..fit.table_fit import TableFit
    from ..fit.temperature_fits import TableFits

# A parameter's name, its SOC or the range of SOC of a mean, and the circuit of a pair that not
# every result has.
Key = tuple[str, str, str]
OF_PAIRS = re.compile(r"(mean )?(R|C|tau)[1-9]")
TABLE_HEADS = ("temperature [degC]", "table", "SOC", "value", "low", "high", "visited")
# States of charge at which tables are compared.
COMPARED_SOC = (0.1, 0.3, 0.5, 0.7, 0.9)
# An interval that spans more than this factor could hide a doubling.
TOO_WIDE = 2.0


def tables_csv(fits: "TableFits") -> bytes:
    """Every node of every table in a row, with its interval if one was computed, then constants and
    means; if there are several temperatures, one after another."""
    rows = [
        (degc, fact.label, fact.soc, fact.value, fact.low, fact.high, int(fact.is_visited))
        for degc, fit in fits.by_degc
        for fact in _facts(fit)
    ]
    first = 1 if fits.over_temperature is None else 0
    return csv_text(TABLE_HEADS[first:], (row[first:] for row in rows)).encode()


def _facts(fit: "TableFit") -> Iterator[Fact]:
    """Every number once: the mean of a constant is its value."""
    return (fact for fact in fit.facts if fit.is_over_soc or not fact.is_mean)


def parameters_frame(result: Result) -> "polars.DataFrame":
    """`Result.to_frame`."""
    import polars as pl

    if result.over is None:
        rows = [(fact.name, fact.value, fact.low, fact.high) for fact in _facts(result.fit)]
        number = dict.fromkeys(("value", "low", "high"), pl.Float64)
        return pl.DataFrame(rows, {"parameter": pl.String, **number}, orient="row")
    nodes = [
        ({} if degc is None else {"temperature [degC]": degc}) | row
        for degc, fit in result.fits.by_degc
        for row in _node_rows(fit)
    ]
    return pl.DataFrame(nodes, infer_schema_length=None)


def _node_rows(fit: "TableFit") -> Iterable[dict[str, Any]]:
    """Every node of the resistances, and of a fitted OCV: its SOC, whether samples visit it, and
    every value with its interval; at nodes of the OCV only, resistances are interpolated."""
    rows: dict[float, dict[str, Any]] = {}
    everywhere: dict[str, Any] = {}
    for fact in _facts(fit):
        what, bracket, unit = fact.label.partition(" [")
        ends = {"": fact.value, " low": fact.low, " high": fact.high}
        columns = {f"{what}{end}{bracket}{unit}": value for end, value in ends.items()}
        if fact.soc is None:
            everywhere |= columns
            continue
        row = {"SOC": fact.soc, "is visited": bool(fact.is_visited)}
        if fact.name == OCV and fit.is_over_soc:
            tables = fit.tables
            row |= {name: float(tables.at(name, np.array(fact.soc))) for name in tables.tables}
        rows.setdefault(fact.soc, row).update(columns)
    return [row | everywhere for _, row in sorted(rows.items())]


def _compared(fit: "TableFit", mean_soc: tuple[float, float] | None) -> Iterator[Fact]:
    """Means over a range of SOC, tables at several states of charge between visited nodes, and
    constants."""
    facts = [*_facts(fit)]
    yield from (_mean_over(fit, fact, mean_soc) for fact in facts if fact.is_mean)
    for name in fit.tables.tables if fit.is_over_soc else ():
        soc, rows = _lines(fit, name)
        if name == OCV_CORRECTION or np.all(np.isnan(rows[1:])):
            # A correction refers to the OCV of its result, and cannot be compared.
            continue
        for at in COMPARED_SOC:
            if soc[0] <= at <= soc[-1]:
                value, low, high = _ends(np.interp(at, soc, row) for row in rows)
                value = np.nan if low is high is None else value
                yield Fact(name, at, value, 0.0, 0.0, low, high)
    yield from (fact for fact in facts if fact.soc is None and not fact.is_mean)


def _lines(fit: "TableFit", name: str) -> tuple[np.ndarray, np.ndarray]:
    """The SOC of a table's assessed nodes, and rows of their values, lower and upper ends; NaN if
    not determined, and in between such nodes."""
    facts = (fact for fact in fit.facts if fact.name == name and fact.soc is not None)
    nodes = [(node.soc, node.value, node.low, node.high) for node in facts if node.is_assessed]
    soc, *rows = np.array(nodes, float).reshape(-1, 4).T
    return soc, np.array(rows)


def _ends(numbers: Iterable[Any]) -> list[Any]:
    """Numbers, with None for NaN."""
    return [None if math.isnan(number) else float(number) for number in numbers]


def _mean_over(fit: "TableFit", mean: Fact, within: tuple[float, float] | None) -> Fact:
    """A mean over part of its SOC. Its interval can only be too wide: it is the narrower one of
    nodes with a common error, and of the mean over all minus these of the rest."""
    if within is None or fit.mean_soc is None or within == fit.mean_soc:
        return mean
    length, whole = np.ptp(within), np.ptp(fit.mean_soc)
    part = _integral(fit, mean.name, within)
    rest = _integral(fit, mean.name, fit.mean_soc) - part
    given = np.array([mean.low or 0.0, mean.high], float)
    of_nodes, of_mean = part[1:] / length, (whole * given - rest[:0:-1]) / length
    ends = of_mean if np.ptp(of_mean) <= np.ptp(of_nodes) else of_nodes
    value, low, high = _ends([part[0] / length, *np.where(np.isnan(ends), of_mean, ends)])
    return replace(mean, value=value, low=low or None, high=high)


def _integral(fit: "TableFit", mean: str, within: tuple[float, float]) -> np.ndarray:
    """Integrals over SOC for a mean: of its values, and of both ends of its nodes, none of them
    below zero."""
    total = np.zeros(3)
    for name in parts_of(mean):
        soc, (values, low, high) = _lines(fit, name)
        at = np.array([within[0], *(one for one in soc if within[0] < one < within[1]), within[1]])
        rows = values, np.nan_to_num(low), high
        total += np.trapezoid([np.interp(at, soc, row) for row in rows], at)
    return total


def _key(fact: Fact, result: Result, mean_soc: tuple[float, float] | None, are_apart: bool) -> Key:
    """The properties that two compared numbers have to share: the SOC range of a mean, and the
    circuit of a pair."""
    where = soc_extent(mean_soc) if fact.is_mean else percent(fact.soc)
    of = result.model if are_apart and OF_PAIRS.match(fact.label) else ""
    return fact.label, where, of


def _title(fact: Fact) -> str:
    """The symbol of a number, and its SOC if it has one."""
    return symbol(fact.label) + ("" if fact.soc is None else f" at {percent(fact.soc)} SOC")


def compare(first: Fact, other: Fact) -> str:
    """How two intervals compare: "beyond" where they do not overlap, "too wide to tell" where one
    spans more than a factor of two, else "within"."""
    both = [
        (-math.inf if fact.low is None else fact.low, math.inf if fact.high is None else fact.high)
        for fact in (first, other)
    ]
    if (-math.inf, math.inf) in both:
        return "no interval"
    (low, high), (other_low, other_high) = both
    if low > other_high or high < other_low:
        return "beyond"
    is_wide = any(least <= 0 or most > TOO_WIDE * least for least, most in both)
    return "too wide to tell" if is_wide else "within"


@dataclass(frozen=True, repr=False)
class SideBySide:
    """Results side by side; a console and a notebook show it as tables.

    Attributes:
        document: The tables with their summary.
        differing: For each result after the first, the parameters whose intervals do not overlap
            those of the first.
        too_wide: Likewise, the parameters of which one interval spans more than a factor of two, so
            that no difference can be seen.
    """

    document: Page
    differing: Mapping[str, tuple[str, ...]]
    too_wide: Mapping[str, tuple[str, ...]]

    def __repr__(self) -> str:
        from .terminal import to_text

        return to_text(self.document)

    def _repr_html_(self) -> str:
        return to_fragment(self.document)


def show(*results: Result | str | Path, names: tuple[str, ...] = ()) -> SideBySide:
    """Two or more results side by side, and what differs beyond their intervals.

    Two cells, two ages or two temperatures of one cell: every parameter with its 95 % interval, and
    the change from the first result. Only intervals that do not overlap count as a difference, and
    an interval that spans more than a factor of two decides nothing. Tables are compared at several
    states of charge, and by their means over the SOC that all results visit. If one result has a
    constant circuit only, the constants of all are compared.

    Args:
        results: Results, their folders or their files.
        names: What each is called; by default its records, numbered where these are alike.

    Raises `InputError` for fewer than two results, and for names that do not fit.

    >>> import barnax
    >>> result = barnax.identify(setup="li2023", seeds=0)
    >>> barnax.show(result, result, names=("fresh", "aged")).differing
    {'aged': ()}
    """
    loaded = [result if isinstance(result, Result) else Result.load(result) for result in results]
    if len(loaded) < 2:
        raise InputError(f"{len(loaded)} result given; give two or more to show side by side")
    names = names or _names(loaded)
    if len({*names}) != len(loaded):
        raise InputError(f"the names {', '.join(names)} are not {len(loaded)} different ones")
    constant = [name for name, result in zip(names, loaded, strict=True) if not result.over]
    are_apart = len({result.fit.tables.elements for result in loaded}) > 1
    shown = [result.without_tables() for result in loaded] if constant else loaded
    fits = [result.fit for result in shown]
    ranges = [fit.mean_soc if fit.is_over_soc else None for fit in fits]
    means_soc = _common(ranges)
    quantities = {
        name: {_key(fact, result, soc, are_apart): fact for fact in _compared(result.fit, soc)}
        for name, result, soc in zip(names, shown, means_soc, strict=True)
    }
    (_, first), *others = quantities.items()
    changes = {
        name: gathered(
            (compare(facts[key], fact), fact) for key, fact in first.items() if key in facts
        )
        for name, facts in others
    }
    differing, too_wide = (
        {name: tuple(map(_title, alike.get(change, ()))) for name, alike in changes.items()}
        for change in ("beyond", "too wide to tell")
    )
    report = document(
        "beside",
        results=dict(zip(names, shown, strict=True)),
        keys=dict.fromkeys(key for facts in quantities.values() for key in facts),
        quantities=quantities,
        compare=compare,
        names=names,
        beyond=differing,
        wide={name: _by_symbol(alike) for name, alike in changes.items()},
        are_apart=are_apart,
        extents=dict.fromkeys(map(soc_extent, filter(None, means_soc))),
        is_common=means_soc != ranges,
        constant=constant,
    )
    return SideBySide(report, differing, too_wide)


def _common(
    ranges: list[tuple[float, float] | None],
) -> list[tuple[float, float] | None]:
    """The SOC range of each result's means: the range that all of them visit, if there is one."""
    given = [soc for soc in ranges if soc is not None]
    if len(given) < len(ranges):
        return ranges
    low, high = max(soc[0] for soc in given), min(soc[1] for soc in given)
    return [(low, high)] * len(ranges) if low < high else ranges


def _by_symbol(changes: Mapping[str, Iterable[Fact]]) -> Mapping[str, list[str]]:
    """All states of charge of each parameter whose intervals are too wide to tell, in percent;
    empty for one without any."""
    return gathered(
        (symbol(fact.label), "" if fact.soc is None else f"{100 * fact.soc:g}")
        for fact in changes.get("too wide to tell", ())
    )


def _names(results: list[Result]) -> tuple[str, ...]:
    names = [result.name for result in results]
    if len({*names}) == len(names):
        return tuple(names)
    return tuple(f"{number}: {name}" for number, name in enumerate(names, 1))
