"""Tables over SOC in words and tables: how good they are, whether they pay, and every node."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ..cell.tables import HALF_HYSTERESIS, OCV_CORRECTION
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
    from ..results import TablesPart

# What stands for a table where there is room for one value.
MIDDLE_SOC = 0.5
SHORT = {OCV_CORRECTION: "OCV", HALF_HYSTERESIS: "hysteresis"}


def best_tables(fit: "TableFit") -> str:
    """How close the tables are to the best possible ones."""
    ranges = [duration(end) for end in (fit.tau_ranges_s[0][0], fit.tau_ranges_s[-1][1])]
    where = f"no tables with time constants from {joined(ranges, 'to')} are more than"
    gap = f"{where} {percent(fit.proved_gap)} better"
    if fit.status == "certified":
        return f"proved, {gap}."
    return f"verified on a grid of time constants; the proof got to: {gap}."


def pay_sentence(fit: "TableFit") -> str:
    """Whether tables pay, by blocks held out of the fit; empty where none were."""
    held = fit.cross_validation
    if held is None:
        return ""
    pays = held.tables.is_worth(held.constant)
    change = f"{fixed(1e3 * held.constant.rmse_v, 1)} to {fixed(1e3 * held.tables.rmse_v, 1)} mV"
    if held.tables.above_v is not None and held.constant.above_v is not None:
        above = (fixed(1e3 * each, 1) for each in (held.constant.above_v, held.tables.above_v))
        change += f" ({' to '.join(above)} above 10 % SOC)"
    change += " on blocks of the records held out of the fit"
    if pays:
        return f"tables pay here: {change}."
    return f"tables do not pay here: {change}; the constant circuit is the safer one."


def tables_sentences(part: "TablesPart", constant_v: float) -> Iterator[str]:
    """What the tables give, how sure that is, and what to beware of."""
    fit, own_v = part.fit, part.metrics.identification.rmse_v
    yield (
        f"With tables over SOC the RMSE is {millivolt(own_v)}; the constant circuit leaves "
        f"{millivolt(constant_v)}. {fit.parameters} values are determined by samples."
    )
    yield f"Best possible: {best_tables(fit)}"
    if pays := pay_sentence(fit):
        yield pays[0].upper() + pays[1:]
    if part.settings.ocv_correction:
        yield (
            "The OCV correction takes up what the OCV test leaves, and an error of the SOC with it."
        )
    biased = sum(each.is_biased for each in fit.intervals)
    if biased:
        yield (
            f"{biased} of {len(fit.intervals)} values may be moved further by smoothing than their "
            "standard error; their intervals include that."
        )


def tables_blocks(part: "TablesPart", constant_v: float) -> tuple[Block, ...]:
    """Tables over SOC as the report has them."""
    told = tuple(tables_sentences(part, constant_v))
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
        role = "identified on" if place == 0 else "validation"
        cells[f"{name} ({role}) [mV]"] = lambda row, place=place: errors_words(row[3][place])
    table = make_table(
        "RMSE in mV, in brackets above 10 % SOC: on blocks held out of the fit, and on each "
        "record. The constant circuit is the best one known, fitted anew for the held-out blocks.",
        rows,
        cells,
        list(cells),
    )
    told = [f"{each.model}: {pay_sentence(each.fit)}" for each in found]
    return [Section("Tables over SOC", (Bullets(tuple(told)), table))]


def nodes_table(fit: "TableFit", where: str = "") -> Table:
    """Every table at every node that samples visit, with its interval."""
    rows = _visited(fit)
    cells = {"SOC [%]": lambda place: f"{100 * fit.tables.nodes[place]:g}"}
    for name, values in fit.tables.tables.items():
        known = {each.soc: each for each in fit.of_table(name)}

        def value(place: int, name: str = name, values: tuple = values) -> str:
            return figures(1e3 * values[place])

        def interval(place: int, known: dict = known) -> str:
            return _interval(known.get(fit.tables.nodes[place]), scale=1e3)

        cells[f"{_name(name)} [{'mOhm' if 'Ohm' in name else 'mV'}]"] = value
        cells[f"{_name(name)}, 95 %"] = interval
    heads = [head for head in cells if head.endswith(", 95 %")]
    return make_table(
        f"The tables{where} at the nodes that samples visit; linear between nodes, constant beyond "
        "them.",
        rows,
        cells,
        heads,
    )


def constants_table(fit: "TableFit", where: str = "") -> Table:
    """What is the same at every SOC: time constants and, if any, gamma."""
    known = {each.name: each for each in fit.intervals if each.soc is None}
    return make_table(
        f"What is one value at every SOC{where and ' and '}{where}.",
        list(fit.tables.constants),
        {
            "parameter": str,
            "value": lambda name: with_unit(name, fit.tables.constants[name]),
            "95 % interval": lambda name: _interval(known.get(name)),
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
            "" if here is None else _between(unit, here, scale),
            _range(unit, min(seen), max(seen)),
        )
    for name, value in tables.constants.items():
        here = next((e for e in fit.intervals if e.name == name and e.soc is None), None)
        interval = "" if here is None else _between(name, here, 1.0)
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


def _between(unit: str, each: "NodeInterval", scale: float) -> str:
    if each.low is None or each.high is None:
        return "not determined"
    return _range(unit, scale * each.low, scale * each.high)


def _interval(each: "NodeInterval | None", scale: float = 1.0) -> str:
    if each is None:
        return NOTHING
    if each.low is None or each.high is None:
        return "open"
    return f"{figures(scale * each.low)} to {figures(scale * each.high)}"


def errors_words(errors: "SocErrors") -> str:
    """An RMSE in mV, in brackets that above 10 % SOC."""
    above = "" if errors.above_v is None else f" ({fixed(1e3 * errors.above_v, 1)})"
    return f"{fixed(1e3 * errors.rmse_v, 1)}{above}"
