"""Tables over SOC, and over temperature, in words and tables: how good they are, every node."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ..cell.parameters import HALF_HYSTERESIS, OCV, OCV_CORRECTION
from ..cell.soc_axis import ABOVE_SOC
from .candidates import (
    errors_words,
    ocv_test_sentences,
)
from .document import Bullets, Cells, Pictures, Section, Table, make_table, rows_table
from .sentences import better_than, rounded_up
from .temperatures import expectation, numbers_of, resistance_sentences
from .words import (
    NOTHING,
    capitalized,
    degrees,
    duration,
    figures,
    interval_beside,
    joined,
    millivolt,
    one_sided,
    percent,
    symbol,
    with_unit,
)

if TYPE_CHECKING:
    from ..over_soc import (
        CrossValidation,
        LeftOut,
        NodeInterval,
        OverTemperature,
        TableFit,
        TableFits,
        TableSettings,
    )
    from ..results import Result

# A value within this share of its interval from an end is marked.
AT_EDGE, EDGE = 0.01, "(*)"
SHORT = {OCV_CORRECTION: "OCV correction", HALF_HYSTERESIS: "half hysteresis"}
GRID = "verified on a grid of time constants"


def tables_section(result: "Result", pictures: Pictures) -> list[Section]:
    """Tables over SOC, and over temperature, as the report has them; none without tables."""
    if result.tables is None:
        return []
    told = Bullets(tuple(_sentences(result, result.tables.settings)))
    over, drawn = result.fits.over_temperature, pictures.starting("tables")
    if over is None:
        head = "Fitted OCV" if result.over == "ocv" else "Tables over SOC"
        return [Section(head, (told, *drawn))]
    others = [
        nodes_table(fit, f" at {degrees(degc)}")
        for degc, fit in result.fits.by_degc
        if degc is not None and fit is not result.fit
    ]
    tables = (_temperature_table(result.fits, over), *others)
    return [Section("Tables over SOC and temperature", (told, *tables, *drawn))]


def answer_tables(found: "TableFits") -> tuple[Table, ...]:
    """The values of tables; of several temperatures, those nearest to 25 degC."""
    degc, fit = found.reference_degc, found.reference
    if not fit.is_over_soc:
        return (constants_table(fit),)
    if degc is None:
        return means_table(fit), constants_table(fit), nodes_table(fit)
    alone = degrees(degc)
    both, where = f" and at every temperature; intervals are those of {alone} alone", f" at {alone}"
    return means_table(fit, where), constants_table(fit, both), nodes_table(fit, where)


def _sentences(result: "Result", settings: "TableSettings") -> Iterator[str]:
    """The tables' errors, proofs and dependences, and cautions."""
    fit, over = result.fit, result.fits.over_temperature
    own = millivolt(result.metrics.identification.rmse_v)
    constant = millivolt(result.constant.metrics.identification.rmse_v)
    beside = f"the constant circuit {result.constant.model}"
    if over is not None:
        degc = [degrees(value) for value in over.temperatures_degc]
        yield (
            f"With tables over SOC at {joined(degc)} the RMSE is {own}; {beside}, one for "
            f"all temperatures, leaves {constant}."
        )
        yield f"Best possible: {best_of(result.fits, result.model, settings.proved_share)}"
        yield from (f"Resistances: {text}" for text in resistance_sentences(result))
        costs = over.objective_v / over.separate_v - 1 if over.separate_v else 0.0
        yield (
            "The time constants are the same at every temperature; separate ones would lower the "
            f"error by {percent(max(costs, 0.0))}."
        )
        for at, own_fit in zip(degc, result.fits, strict=True):
            held = own_fit.cross_validation
            if held is not None:
                own, one = errors_words(held.tables), errors_words(held.constant)
                yield f"At {at}, {own} mV on held-out blocks; one value at every SOC {one}."
        yield (
            "Between measured temperatures the logarithm of every resistance is linear in 1/T, and "
            "the OCV correction in T; beyond them the tables of the nearest temperature apply. How "
            f"far off this may be: {expectation(over)}"
        )
        return
    ends = duration(fit.tau_ranges_s[0][0]), duration(fit.tau_ranges_s[-1][1])
    if result.over == "ocv":
        yield f"With a fitted OCV the RMSE is {own}."
    else:
        whose = " with the OCV of the tables" if result.cell_model.is_of_records else ""
        yield f"With tables over SOC the RMSE is {own}; {beside}{whose} leaves {constant}."
    yield (
        f"The samples determine {fit.parameters} values. Time constants from {joined(ends, 'to')} "
        "were searched."
    )
    yield f"Best possible: {best_of(result.fits, result.model, settings.proved_share)}"
    yield from (f"Resistances: {text}" for text in resistance_sentences(result))
    yield from map(capitalized, ocv_test_sentences(result))
    if settings.ocv_correction and not result.cell.is_of_records:
        yield (
            "The OCV correction absorbs errors of the OCV test, and with them any error of the SOC."
        )
    biased = sum(node.is_biased for node in fit.intervals)
    if biased:
        yield (
            "Smoothing and the straight lines between nodes may have moved "
            f"{biased} of {len(fit.intervals)} values by more than their standard error; their "
            "intervals include that."
        )


def best_of(found: "TableFits", model: str, aim: float) -> str:
    """The gap between the tables, of all temperatures together, and the best possible ones."""
    over = found.over_temperature
    if over is None:
        return best_tables(found.reference, model)
    if over.lower_bound_v <= 0:
        return f"{GRID}, not proved."
    short = "" if over.proved_gap <= aim else f"but not to the {percent(aim)} aimed at: "
    shared = f"no {model} tables in the bounds, with the same time constants at each temperature,"
    return f"proved, {short}{shared} are {better_than(over.proved_gap)}."


def best_tables(fit: "TableFit", model: str) -> str:
    """The gap between the tables of one temperature and the best possible ones."""
    what = f"{model} {'tables' if fit.is_over_soc else 'circuit and OCV'} in the bounds"
    gap = f"no {what} are over {rounded_up(fit.proved_gap)} better."
    if fit.status == "certified":
        return f"proved: {gap}"
    if fit.lower_bound_v <= 0:
        return f"{GRID}, not proved."
    if fit.tables.dependence is not None:
        return f"proved with what the resistances follow held as fitted, from one start: {gap}"
    return f"{GRID}; the proof stopped after {fit.boxes:,} boxes: {gap}"


def nodes_table(fit: "TableFit", where: str = "") -> Table:
    """Every table at every node that samples visit, with its interval."""
    are_several = any(node.record_low is not None for node in fit.intervals)
    intervals = [node for node in fit.intervals if node.soc is not None]
    if are_several:
        intervals = [own.on_another_record for own in intervals]
    known = {(node.name, node.soc): node for node in intervals}
    heads = ["SOC [%]"]
    for name in fit.tables.tables:
        short = short_name(name)
        heads += [f"{short} [{'mOhm' if 'Ohm' in name else 'mV'}]", f"{short}, 95 %"]
    rows = []
    for place in _visited(fit):
        soc = fit.tables.nodes[place]
        row = [f"{100 * soc:g}"]
        for name, values in fit.tables.tables.items():
            node = known.get((name, soc))
            row += [figures(1e3 * values[place]) + _edge(node), _interval(node, 1e3)]
        rows.append(row)
    mark = " 95 %: what another record of the cell would show." if are_several else ""
    if any(map(_edge, intervals)):
        mark += (
            f" {EDGE}: the value is at one end of its interval: smoothing over SOC moved it. The "
            "interval is that of a fit with a hundredth of the smoothing, extended to the value."
        )
    return rows_table(
        f"The tables{where} at the nodes near samples; linear between nodes, beyond by smoothing."
        f"{mark}",
        heads,
        rows,
    )


def means_table(fit: "TableFit", where: str = "") -> Table:
    """The mean of every table over SOC, with its interval."""
    cells: Cells[NodeInterval] = {
        "mean": lambda mean: short_name(mean.name),
        "value": lambda mean: with_unit(mean.name, mean.value),
        "95 % interval": lambda mean: _interval_of(with_unit(mean.name, mean.value), mean),
    }
    return make_table(f"Means{where} {over_soc_words(fit)}.", fit.means, cells, cells)


def over_soc_words(fit: "TableFit") -> str:
    """The range of SOC that means are over; empty of a constant circuit."""
    soc = visited_soc(fit) if fit.is_over_soc else [own.soc or 0.0 for own in fit.of_table(OCV)]
    if not soc:
        return ""
    low = max(soc[0], min(ABOVE_SOC, soc[-1]))
    return f"over {100 * low:.0f}-{100 * soc[-1]:.0f} % SOC"


def visited_soc(fit: "TableFit") -> list[float]:
    """The nodes of tables that samples visit."""
    return [fit.tables.nodes[place] for place in _visited(fit)]


def constants_table(fit: "TableFit", where: str = "") -> Table:
    """The parameters with one value at every SOC: time constants, gamma if there is one, and
    resistances of one node."""
    values = fit.tables.constants
    if not fit.is_over_soc:
        values = {name: value for name, (value,) in fit.tables.tables.items()} | values
    known = {node.name: node for node in fit.intervals if node.soc is None or not fit.is_over_soc}
    cells: Cells[str] = {
        "parameter": symbol,
        "value": lambda name: with_unit(name, values[name]),
        "95 % interval": lambda name: (
            _interval_of(with_unit(name, values[name]), known[name]) if name in known else NOTHING
        ),
    }
    elsewhere = "" if fit.is_over_soc else "; tables.csv has the OCV"
    caption = f"The parameters with one value at every SOC{where}{elsewhere}."
    names = [name for name in values if not where or name not in numbers_of(fit)]
    return make_table(caption, names, cells, cells)


def _temperature_table(fits: "TableFits", over: "OverTemperature") -> Table:
    cells: Cells[tuple[LeftOut, CrossValidation | None]] = {
        "temperature": lambda row: degrees(row[0].temperature_degc),
        "own tables [mV]": lambda row: errors_words(row[0].own),
        "held-out blocks [mV]": lambda row: errors_words(row[1] and row[1].tables),
        "left out [mV]": lambda row: errors_words(row[0].errors),
        "predicted from": lambda row: "both sides" if row[0].is_between else "one side",
    }
    return make_table(
        "RMSE in mV, in brackets that above 10 % SOC: with the tables of that temperature, on "
        "blocks held out of the fit, and as predicted by the tables of the other temperatures.",
        zip(over.left_out, (fit.cross_validation for fit in fits), strict=True),
        cells,
        cells,
    )


def _visited(fit: "TableFit") -> list[int]:
    return [place for place, is_visited in enumerate(fit.tables.visited) if is_visited]


def short_name(name: str) -> str:
    """How the head of a column calls a table."""
    return SHORT.get(name, symbol(name))


def left_out_sentences(result: "Result") -> Iterator[str]:
    """The error of each record as predicted by the others, where several were identified on."""
    held = result.fit.cross_validation
    if not held or not held.by_record:
        return
    names = [part.name for part in result.of_role("identification")]
    told = [
        f"{name} {errors_words(errors)}"
        for name, errors in zip(names, held.by_record, strict=False)
    ]
    yield f"predicted by the other records, in mV (above 10 % SOC): {'; '.join(told)}"


def _interval(node: "NodeInterval | None", scale: float) -> str:
    if node is None:
        return NOTHING
    open_end = one_sided(node.low, node.high, lambda end: figures(scale * end))
    if open_end or node.low is None or node.high is None:
        return open_end
    return f"{figures(scale * node.low)} to {figures(scale * node.high)}"


def _interval_of(value: str, node: "NodeInterval") -> str:
    """An interval in the unit of the value that it stands beside."""
    return interval_beside(value, node.name, node.low, node.high, node.value)


def _edge(node: "NodeInterval | None") -> str:
    """A mark where a value is at an end of its own interval."""
    if node is None or node.low is None or node.high is None or node.record_low is not None:
        return ""
    near = AT_EDGE * (node.high - node.low)
    return f" {EDGE}" if min(node.value - node.low, node.high - node.value) <= near else ""
