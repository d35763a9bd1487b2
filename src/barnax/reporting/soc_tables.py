"""Tables over SOC in words and tables: how good they are, whether they pay, and every node."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ..cell.tables import HALF_HYSTERESIS, OCV_CORRECTION
from ..uncertainty.covariance import WIDEST_FACTOR
from .document import Block, Bullets, Section, Table, make_table
from .words import (
    NOTHING,
    between,
    duration,
    figures,
    fixed,
    joined,
    millivolt,
    percent,
    symbol,
    with_unit,
)

if TYPE_CHECKING:
    from ..comparison.tabulated import Tabulated
    from ..over_soc import NodeInterval, SocErrors, TableFit
    from ..results import MetricsPart, Result, TablesPart

# What stands for a table where there is room for one value.
MIDDLE_SOC = 0.5
# Errors on all of a record that differ by less than this share are alike.
ALIKE = 0.02
NOT_DETERMINED = "not determined"
SHORT = {OCV_CORRECTION: "OCV correction", HALF_HYSTERESIS: "hysteresis"}


def best_tables(fit: "TableFit") -> str:
    """How close the tables are to the best possible ones."""
    ranges = [duration(end) for end in (fit.tau_ranges_s[0][0], fit.tau_ranges_s[-1][1])]
    where = f"no tables with time constants from {joined(ranges, 'to')} are more than"
    gap = f"{where} {percent(fit.proved_gap)} better"
    if fit.status == "certified":
        return f"proved, {gap}."
    grid = "verified on a grid of time constants"
    if fit.lower_bound_v <= 0:
        return f"{grid}, not proved."
    return f"{grid}; the proof stopped after {fit.cells:,} cells: {gap}."


def pay_sentence(fit: "TableFit", unseen: "Sequence[tuple[SocErrors, SocErrors]]" = ()) -> str:
    """Whether tables pay; empty where nothing was held out and no other record is there.

    `unseen` are the constant circuit's errors and the tables' on each validation record, which
    decide where there are any; else blocks held out of the fit do.
    """
    told, pays = [], tables_pay(fit, unseen)
    if unseen:
        told.append(f"{_change(*_of_all(unseen))} on the validation records")
    held = fit.cross_validation
    if held is not None:
        is_alike = (held.tables.rmse_v < held.constant.rmse_v) == pays
        joint = "" if not told else ", and from " if is_alike else ", but from "
        told.append(f"{joint}{_change(held.constant, held.tables)} on held-out blocks")
    if not told:
        return ""
    if pays and unseen and _of_all(unseen)[1].rmse_v >= _of_all(unseen)[0].rmse_v:
        return f"tables help above 10 % SOC: RMSE from {''.join(told)}."
    if pays:
        return f"tables lower the RMSE from {''.join(told)}."
    return f"tables do not help: RMSE from {''.join(told)}. Prefer the constant circuit."


def tables_pay(fit: "TableFit", unseen: "Sequence[tuple[SocErrors, SocErrors]]" = ()) -> bool:
    """Whether tables are better where they were not fitted, as `pay_sentence` says it."""
    if not unseen:
        held = fit.cross_validation
        return held is not None and held.tables.is_worth(held.constant)
    constant, tables = _of_all(unseen)
    if constant.above_v is None or tables.above_v is None:
        return tables.rmse_v < constant.rmse_v
    if abs(tables.rmse_v / constant.rmse_v - 1) > ALIKE:
        return tables.rmse_v < constant.rmse_v
    # Nearly empty both may fail alike; what is above it decides.
    return tables.above_v < constant.above_v


def _of_all(unseen: "Sequence[tuple[SocErrors, SocErrors]]") -> "tuple[SocErrors, SocErrors]":
    """The errors of both over all records."""
    constant, tables = zip(*unseen, strict=True)
    return _together(constant), _together(tables)


def unseen_errors(result: "Result") -> "list[tuple[SocErrors, SocErrors]]":
    """The constant circuit's errors and the tables' on each validation record of a result."""
    from ..over_soc import SocErrors

    def errors(part: "MetricsPart") -> "SocErrors":
        return SocErrors(part.rmse_v, part.rmse_above_10_soc_v)

    if result.tables is None:
        return []
    both = zip(result.metrics.validation, result.tables.metrics.validation, strict=True)
    return [(errors(constant), errors(tables)) for constant, tables in both]


def _together(errors: "Sequence[SocErrors]") -> "SocErrors":
    """The root mean square over records, each counting alike."""

    def of(values: list[float]) -> float:
        return math.sqrt(sum(each**2 for each in values) / len(values))

    above = [each.above_v for each in errors if each.above_v is not None]
    return replace(
        errors[0],
        rmse_v=of([each.rmse_v for each in errors]),
        above_v=of(above) if len(above) == len(errors) else None,
    )


def _change(constant: "SocErrors", tables: "SocErrors") -> str:
    """From the constant circuit's error to the tables'."""
    change = f"{fixed(1e3 * constant.rmse_v, 1)} to {fixed(1e3 * tables.rmse_v, 1)} mV"
    if tables.above_v is not None and constant.above_v is not None:
        above = (fixed(1e3 * each, 1) for each in (constant.above_v, tables.above_v))
        change += f" ({' to '.join(above)} above 10 % SOC)"
    return change


def tables_sentences(part: "TablesPart", result: "Result") -> Iterator[str]:
    """What the tables give, how sure that is, and what to beware of."""
    fit, own_v = part.fit, part.metrics.identification.rmse_v
    constant_v, unseen = result.metrics.identification.rmse_v, unseen_errors(result)
    yield (
        f"With tables over SOC the RMSE is {millivolt(own_v)}; the constant circuit leaves "
        f"{millivolt(constant_v)}. The samples determine {fit.parameters} values."
    )
    yield f"Best possible: {best_tables(fit)}"
    if pays := pay_sentence(fit, unseen):
        yield pays[0].upper() + pays[1:]
    if part.settings.ocv_correction:
        yield (
            "The OCV correction absorbs errors of the OCV test, and with them any error of the SOC."
        )
    biased = sum(each.is_biased for each in fit.intervals)
    if biased:
        yield (
            "Smoothing and the straight lines between nodes may have moved "
            f"{biased} of {len(fit.intervals)} values by more than their standard error; their "
            "intervals include that."
        )


def tables_blocks(part: "TablesPart", result: "Result") -> tuple[Block, ...]:
    """Tables over SOC as the report has them."""
    told = tuple(tables_sentences(part, result))
    return Bullets(told), constants_table(part.fit), nodes_table(part.fit)


def compared_tables(found: "Sequence[Tabulated]", names: Sequence[str]) -> list[Section]:
    """Constant circuits and the same with tables over SOC, side by side."""
    if not found:
        return []
    rows = []
    for each in found:
        held = each.fit.cross_validation
        rows.append(
            (each.model, each.constant_parameters, held and held.constant, each.constant_errors)
        )
        rows.append((f"{each.model}:soc", each.fit.parameters, held and held.tables, each.errors))
    cells = {
        "circuit": lambda row: row[0],
        "values": lambda row: str(row[1]),
        "held out [mV]": lambda row: NOTHING if row[2] is None else errors_words(row[2]),
    }
    for place, name in enumerate(names):
        role = "identification" if place == 0 else "validation"
        cells[f"{name} ({role}) [mV]"] = lambda row, place=place: errors_words(row[3][place])
    table = make_table(
        "RMSE in mV, in brackets that above 10 % SOC: on blocks held out of the fit, and on each "
        "record. The constant circuit is the best one known, refitted for the held-out blocks.",
        rows,
        cells,
        list(cells),
    )
    told = []
    for each in found:
        unseen = list(zip(each.constant_errors, each.errors, strict=True))[1:]
        if pays := pay_sentence(each.fit, unseen):
            told.append(f"{each.model}: {pays}")
    told += [f"{each.model}: {best_tables(each.fit)}" for each in found]
    searched = [_searched(found, names)] if any(each.searches for each in found) else []
    return [Section("Tables over SOC", (Bullets(tuple(told)), table, *searched))]


def _searched(found: "Sequence[Tabulated]", names: Sequence[str]) -> Table:
    """What each method makes of the time constants, with the tables solved inside."""
    rows = [(each.model, search) for each in found for search in each.searches]
    cells = {
        "row": lambda row: f"{row[1].method} {row[0]}:soc",
        "sqrt(J) [mV]": lambda row: fixed(1e3 * row[1].objective_v, 4),
        "best [mV]": lambda row: fixed(1e3 * row[1].best_objective_v, 4),
        "worst [mV]": lambda row: fixed(1e3 * row[1].worst_objective_v, 4),
        "gap [%]": lambda row: fixed(100 * row[1].gap, 3),
        "seeds": lambda row: str(row[1].seeds),
        "evaluations": lambda row: str(row[1].evaluations),
    }
    for place in range(len(names)):
        role = "identification" if place == 0 else f"validation {place if len(names) > 2 else ''}"
        cells[f"{role.strip()} [mV]"] = lambda row, place=place: errors_words(row[1].errors[place])
    return make_table(
        "Each method searches the time constants; for each candidate the best tables are solved "
        "exactly. The median seed, beside the best and the worst. The gap is relative to the "
        "optimum that the grid and its descents find.",
        rows,
        cells,
        ["row", *list(cells)[7:]],
    )


def nodes_table(fit: "TableFit", where: str = "") -> Table:
    """Every table at every node that samples visit, with its interval."""
    rows = _visited(fit)
    cells = {"SOC [%]": lambda place: f"{100 * fit.tables.nodes[place]:g}"}
    for name, values in fit.tables.tables.items():
        known = {each.soc: each for each in fit.of_table(name)}

        def value(place: int, name: str = name, values: tuple = values) -> str:
            return figures(1e3 * values[place])

        def interval(place: int, known: dict = known) -> str:
            return _interval(known.get(fit.tables.nodes[place]), fit, scale=1e3)

        cells[f"{_name(name)} [{'mOhm' if 'Ohm' in name else 'mV'}]"] = value
        cells[f"{_name(name)}, 95 %"] = interval
    heads = [head for head in cells if head.endswith(", 95 %")]
    return make_table(
        f"The tables{where} at the nodes near samples; linear between nodes, constant beyond them.",
        rows,
        cells,
        heads,
    )


def constants_table(fit: "TableFit", where: str = "") -> Table:
    """What is the same at every SOC: time constants and, if any, gamma."""
    known = {each.name: each for each in fit.intervals if each.soc is None}
    return make_table(
        f"The parameters with one value at every SOC{where and ' and '}{where}.",
        list(fit.tables.constants),
        {
            "parameter": str,
            "value": lambda name: with_unit(name, fit.tables.constants[name]),
            "95 % interval": lambda name: _interval(known.get(name), fit),
        },
        ["parameter", "value", "95 % interval"],
    )


def middle_rows(fit: "TableFit") -> Iterator[tuple[str, str, str, str]]:
    """For the first screen: each table at 50 % SOC with its interval, and its range over SOC."""
    tables = fit.tables
    nodes = _visited(fit)
    middle = _middle(nodes, tables.nodes)
    for name, values in tables.tables.items():
        unit = name if "Ohm" in name else "mV"
        scale = 1.0 if "Ohm" in name else 1e3
        seen = [scale * values[place] for place in nodes]
        here = {each.soc: each for each in fit.of_table(name)}.get(tables.nodes[middle])
        value = scale * values[middle]
        yield (
            _name(name),
            with_unit(name, value) if "Ohm" in name else f"{figures(value, 2)} mV",
            "" if here is None else _between(unit, here, scale, fit),
            _range(unit, min(seen), max(seen)),
        )
    for name, value in tables.constants.items():
        here = next((e for e in fit.intervals if e.name == name and e.soc is None), None)
        interval = "" if here is None else _between(name, here, 1.0, fit)
        yield symbol(name), with_unit(name, value), interval, ""


def middle_heads(fit: "TableFit") -> tuple[str, str, str, str]:
    """The heads of `middle_rows`."""
    middle = fit.tables.nodes[_middle(_visited(fit), fit.tables.nodes)]
    return "", f"at {100 * middle:g} % SOC", "95 % interval", "over SOC"


def _visited(fit: "TableFit") -> list[int]:
    return [place for place, is_visited in enumerate(fit.tables.visited) if is_visited]


def _middle(places: list[int], nodes: Sequence[float]) -> int:
    return min(places, key=lambda place: abs(nodes[place] - MIDDLE_SOC))


def _name(name: str) -> str:
    return SHORT.get(name, symbol(name))


def _range(unit: str, low: float, high: float) -> str:
    return (
        between(unit, low, high) if unit != "mV" else f"{figures(low, 2)} to {figures(high, 2)} mV"
    )


def _between(unit: str, each: "NodeInterval", scale: float, fit: "TableFit") -> str:
    known = _determined(each, fit)
    return NOT_DETERMINED if known is None else _range(unit, scale * known[0], scale * known[1])


def _interval(each: "NodeInterval | None", fit: "TableFit", scale: float = 1.0) -> str:
    if each is None:
        return NOTHING
    known = _determined(each, fit)
    return NOT_DETERMINED if known is None else " to ".join(figures(scale * end) for end in known)


def _determined(each: "NodeInterval", fit: "TableFit") -> tuple[float, float] | None:
    """The ends of an interval; None where it is so wide that it says nothing."""
    if each.low is None or each.high is None:
        return None
    if each.name == OCV_CORRECTION:
        seen = [fit.tables.tables[each.name][place] for place in _visited(fit)]
        is_wide = each.high - each.low > max(seen) - min(seen)
    else:
        # Half the hysteresis may well be zero, a resistance or time constant may not.
        is_positive = each.low > 0
        is_wide = (
            each.high > WIDEST_FACTOR * each.low if is_positive else each.name != HALF_HYSTERESIS
        )
    return None if is_wide else (each.low, each.high)


def errors_words(errors: "SocErrors") -> str:
    """An RMSE in mV, in brackets that above 10 % SOC."""
    above = "" if errors.above_v is None else f" ({fixed(1e3 * errors.above_v, 1)})"
    return f"{fixed(1e3 * errors.rmse_v, 1)}{above}"
