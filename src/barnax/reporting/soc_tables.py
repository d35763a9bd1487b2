"""Tables over SOC, and over temperature, in words and tables: how good they are, every node."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ..cell.elements import names_beside
from ..cell.parameters import HALF_HYSTERESIS, OCV, OCV_CORRECTION
from ..cell.soc_axis import ABOVE_SOC
from ..table_run import MIDDLE_SOC
from ..uncertainty.covariance import WIDEST_FACTOR
from .candidates import (
    errors_words,
    ocv_test_sentences,
)
from .document import Bullets, Cells, Pictures, Section, Table, make_table, rows_table
from .sentences import better_than
from .temperatures import expectation, numbers_of, resistance_sentences
from .words import (
    NOTHING,
    aligned_millivolt,
    between,
    capitalized,
    degrees,
    duration,
    figures,
    joined,
    millivolt,
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

NOT_DETERMINED = "not determined"
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
        return constants_table(fit), nodes_table(fit)
    alone = degrees(degc)
    both = f" and at every temperature; intervals are those of {alone} alone"
    return constants_table(fit, both), nodes_table(fit, f" at {alone}")


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
    gap = f"no {what} are over {percent(fit.proved_gap)} better."
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
        intervals = [*map(_on_another_record, intervals)]
    known = {(node.name, node.soc): node for node in intervals}
    heads = ["SOC [%]"]
    for name in fit.tables.tables:
        heads += [f"{_name(name)} [{'mOhm' if 'Ohm' in name else 'mV'}]", f"{_name(name)}, 95 %"]
    rows = []
    for place in _visited(fit):
        soc = fit.tables.nodes[place]
        row = [f"{100 * soc:g}"]
        for name, values in fit.tables.tables.items():
            node = known.get((name, soc))
            row += [figures(1e3 * values[place]) + _edge(node), _interval(node, fit, scale=1e3)]
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
        "95 % interval": lambda name: _interval_of(known.get(name), fit),
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


def middle_of_tables(found: "TableFits", records: int) -> tuple[list[str], list[tuple[str, ...]]]:
    """Heads and rows: each table at 50 % SOC with its interval and its range, or the resistances
    and errors of each temperature; then what is the same at every SOC. The range leaves out nodes
    below 10 % SOC, where curves bend more than lines between nodes follow.

    The head of the intervals says what they are of: the `records` identified on, or of three and
    more what another one would show.
    """
    if found.over_temperature is not None:
        return _middle_by_temperature(found.fits, found.over_temperature)
    fit, nodes = found.reference, found.reference.tables.nodes
    visited = _visited(fit)
    middle = min(visited, key=lambda place: abs(nodes[place] - MIDDLE_SOC))
    are_several = any(node.record_low is not None for node in fit.intervals)
    # The intervals of one record may miss what another record would show.
    kind = "another record" if are_several else "this record" if records == 1 else "these records"
    where = f"at {100 * nodes[middle]:g} % SOC"
    if not fit.is_over_soc:
        seen_soc = [100 * node.soc for node in fit.of_table(OCV) if node.soc is not None]
        where = f"at {min(seen_soc):.0f} to {max(seen_soc):.0f} % SOC"
    ranged = [place for place in visited if nodes[place] >= ABOVE_SOC] or visited
    over = "over SOC" if ranged == visited else f"above {percent(ABOVE_SOC)} SOC"
    heads = ["", where, kind, over if fit.is_over_soc else "", "", "", ""]
    known = {}
    for node in fit.intervals:
        is_of_others = are_several and node.soc is not None
        ends = determined_ends(_on_another_record(node) if is_of_others else node, fit)
        known[node.name, node.soc] = (
            NOT_DETERMINED if ends is None else between(node.name, *ends, node.value)
        )
    constants = fit.tables.constants
    rows = []
    for name, values in fit.tables.tables.items():
        if name == OCV_CORRECTION:
            continue
        told = {node.soc for node in fit.of_table(name) if node.low is not None}
        seen = [values[n] for n in ranged if nodes[n] in told] or [values[n] for n in ranged]
        here = known.get((name, nodes[middle]), "")
        ranges = between(name, min(seen), max(seen)) if fit.is_over_soc else ""
        row = [_name(name), *_under_one_unit(with_unit(name, values[middle]), here, ranges)]
        # A pair's time constant stands beside its resistance.
        tau = names_beside(name).tau
        if tau in constants:
            value = with_unit(tau, constants[tau])
            row += [symbol(tau), *_under_one_unit(value, known.get((tau, None), ""))]
        rows.append((*row, *[""] * (len(heads) - len(row))))
    for name, value in constants.items():
        if not name.startswith("tau") and name not in numbers_of(fit):
            row = (symbol(name), with_unit(name, value), known.get((name, None), ""))
            rows.append((*row, *[""] * (len(heads) - len(row))))
    return heads, rows


def _under_one_unit(value: str, *others: str) -> list[str]:
    """A value with its unit, and what stands beside it without the same unit."""
    unit = value.rpartition(" ")[2]
    # An interval whose ends have two units keeps both.
    return [
        value,
        *(
            text if " " in text.partition(" to ")[0] else text.removesuffix(f" {unit}")
            for text in others
        ),
    ]


def _middle_by_temperature(
    fits: "Sequence[TableFit]", over: "OverTemperature"
) -> tuple[list[str], list[tuple[str, ...]]]:
    nodes = fits[0].tables.nodes
    # The node nearest to the middle that every temperature visits; else any node.
    everywhere = set.intersection(*(set(_visited(fit)) for fit in fits))
    places = sorted(everywhere) or range(len(nodes))
    middle = min(places, key=lambda place: abs(nodes[place] - MIDDLE_SOC))
    names = [name for name in fits[0].tables.tables if name.endswith("[Ohm]")]
    heads = [f"at {100 * nodes[middle]:g} % SOC", *map(symbol, names), "RMSE", "unseen", "left out"]
    rows = []
    for fit, left in zip(fits, over.left_out, strict=True):
        held = fit.cross_validation
        values = [with_unit(name, fit.tables.tables[name][middle]) for name in names]
        errors = (left.own, held and held.tables, left.errors)
        told = [aligned_millivolt(error and error.rmse_v) for error in errors]
        rows.append((degrees(left.temperature_degc), *values, *told))
    for name, value in fits[0].tables.constants.items():
        if name in numbers_of(fits[0]):
            continue
        rows.append((symbol(name), with_unit(name, value), *[""] * (len(names) + 2)))
    return heads, rows


def _visited(fit: "TableFit") -> list[int]:
    return [place for place, is_visited in enumerate(fit.tables.visited) if is_visited]


def _name(name: str) -> str:
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


def _interval(node: "NodeInterval | None", fit: "TableFit", scale: float = 1.0) -> str:
    if node is None:
        return NOTHING
    known = determined_ends(node, fit)
    return NOT_DETERMINED if known is None else " to ".join(figures(scale * end) for end in known)


def _interval_of(node: "NodeInterval | None", fit: "TableFit") -> str:
    """An interval in the unit of the value that it stands beside."""
    known = None if node is None else determined_ends(node, fit)
    if node is None or known is None:
        return _interval(node, fit)
    value = with_unit(node.name, node.value)
    return _under_one_unit(value, between(node.name, *known, node.value))[1]


def _edge(node: "NodeInterval | None") -> str:
    """A mark where a value is at an end of its own interval."""
    if node is None or node.low is None or node.high is None or node.record_low is not None:
        return ""
    near = AT_EDGE * (node.high - node.low)
    return f" {EDGE}" if min(node.value - node.low, node.high - node.value) <= near else ""


def _on_another_record(node: "NodeInterval") -> "NodeInterval":
    return replace(node, low=node.record_low, high=node.record_high)


def determined_ends(node: "NodeInterval", fit: "TableFit") -> tuple[float, float] | None:
    """The ends of an interval; None where it is so wide that it says nothing."""
    if node.low is None or node.high is None:
        return None
    if node.name == OCV_CORRECTION:
        seen = [fit.tables.tables[node.name][place] for place in _visited(fit)]
        is_wide = node.high - node.low > max(seen) - min(seen)
    else:
        # Half the hysteresis may well be zero, a resistance or time constant may not.
        is_positive = node.low > 0
        is_wide = (
            node.high > WIDEST_FACTOR * node.low if is_positive else node.name != HALF_HYSTERESIS
        )
    return None if is_wide else (node.low, node.high)
