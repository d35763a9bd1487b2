"""Tables over SOC and temperature in words and tables: each temperature, and what is between."""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from .document import Block, Bullets, Table, make_table
from .sentences import better_than
from .soc_tables import MIDDLE_SOC, constants_table, errors_words, nodes_table, pay_sentence
from .words import NOTHING, duration, joined, millivolt, percent, symbol, with_unit

if TYPE_CHECKING:
    from ..over_soc import LeftOut, OverTemperature, TableFit
    from ..results import InputPart, Result, TablesPart


def degrees(temperature_degc: float) -> str:
    """A temperature as it is said."""
    return f"{temperature_degc + 0.0:.3g} degC"


def best_over_temperature(part: "TablesPart", over: "OverTemperature") -> str:
    """How close the tables of all temperatures together are to the best possible ones."""
    ranges = part.fit.tau_ranges_s
    ends = joined([duration(end) for end in (ranges[0][0], ranges[-1][1])], "to")
    is_close = over.proved_gap <= part.settings.proved_share
    if over.lower_bound_v <= 0:
        return "verified on a grid of time constants, not proved."
    aim = percent(part.settings.proved_share)
    how = "proved, " if is_close else f"proved, but not to the {aim} aimed at: "
    return (
        f"{how}no tables with time constants from {ends}, the same at each temperature, are "
        f"{better_than(over.proved_gap)}."
    )


def temperature_rows(part: "TablesPart", over: "OverTemperature") -> Iterator[tuple[str, ...]]:
    """For the first screen: a line for each temperature, then the shared constants."""
    place = _middle(part.fits)
    for fit, left in zip(part.fits, over.left_out, strict=True):
        values = [
            with_unit(name, values[place]) for name, values in fit.tables.tables.items()
            if name.endswith("[Ohm]")
        ]  # fmt: skip
        held = fit.cross_validation
        errors_v = (left.own.rmse_v, held and held.tables.rmse_v, left.errors.rmse_v)
        yield (
            degrees(left.temperature_degc),
            *values,
            *("" if each is None else f"{1e3 * each:#.3g} mV" for each in errors_v),
        )
    for name, value in part.fits[0].tables.constants.items():
        blanks = [""] * (len(part.fits[0].tables.r_ohm) + 3)
        yield symbol(name), with_unit(name, value), *blanks


def temperature_heads(part: "TablesPart") -> tuple[str, ...]:
    """The heads of `temperature_rows`."""
    soc = part.fits[0].tables.nodes[_middle(part.fits)]
    resistances = [f"R{number}" for number in range(len(part.fits[0].tables.r_ohm) + 1)]
    return f"at {100 * soc:g} % SOC", *resistances, "RMSE", "unseen", "left out"


def expectation(over: "OverTemperature") -> str:
    """What is to be expected of temperatures that were not measured."""
    worst: dict[bool, float] = {}
    for each in over.left_out:
        worst[each.is_between] = max(each.errors.rmse_v, worst.get(each.is_between, 0.0))
    told = [f"{millivolt(worst[True])} between the measured ones"] if True in worst else []
    told.append(f"{millivolt(worst[False])} beyond")
    text = f"expect up to {joined(told)}, by leaving out each temperature in turn."
    if len(over.left_out) == 2:
        text += " Between them it may be less; a third temperature would show it."
    return text


def prediction_sentences(result: "Result") -> Iterator[str]:
    """One sentence for each record of a result at a temperature without tables of its own."""
    if result.tables is None:
        return
    for each in result.of_role("validation"):
        if told := prediction_sentence(result.tables, each.name, each.temperature_degc):
            yield told


def prediction_sentence(part: "TablesPart", name: str, temperature_degc: float | None) -> str:
    """What a prediction at a temperature rests on; empty where it has tables of its own."""
    over = part.over_temperature
    if over is None or temperature_degc is None or over.measured_near(temperature_degc) is not None:
        return ""
    known = over.temperatures_degc
    if known[0] < temperature_degc < known[-1]:
        above = next(place for place, each in enumerate(known) if each > temperature_degc)
        ends = known[above - 1 : above + 1]
        how = f"lie between those of {joined([degrees(end) for end in ends])}"
    else:
        nearest = known[0] if temperature_degc <= known[0] else known[-1]
        how = f"are those of {degrees(nearest)}"
    told = joined([_left(each) for each in over.like(temperature_degc)])
    return (
        f"{name} is at {degrees(temperature_degc)}, which was not measured: its tables "
        f"{how}. Left out of the fit, {told}."
    )


def _left(each: "LeftOut") -> str:
    return (
        f"{degrees(each.temperature_degc)} was predicted to {millivolt(each.errors.rmse_v)} (with "
        f"its own tables {millivolt(each.own.rmse_v)})"
    )


def left_out_v(part: "TablesPart", record: "InputPart | None") -> float | None:
    """The largest error of the temperatures left out that were predicted as a record's is; None
    where it has tables of its own."""
    over, degc = part.over_temperature, None if record is None else record.temperature_degc
    if over is None or degc is None or over.measured_near(degc) is not None:
        return None
    return max(each.errors.rmse_v for each in over.like(degc))


def temperature_blocks(
    part: "TablesPart", over: "OverTemperature", constant_v: float
) -> tuple[Block, ...]:
    """What tables over SOC and temperature give, as the report has it."""
    by_degc = list(zip(over.temperatures_degc, part.fits, strict=True))
    at = f"of {degrees(over.temperatures_degc[part.fits.index(part.fit)])} alone"
    return (
        Bullets(tuple(_sentences(part, over, constant_v))),
        _temperature_table(part, over),
        constants_table(part.fit, f"at every temperature; intervals are those {at}"),
        *(nodes_table(fit, f" at {degrees(degc)}") for degc, fit in by_degc),
    )


def _sentences(part: "TablesPart", over: "OverTemperature", constant_v: float) -> Iterator[str]:
    degc = joined([degrees(each) for each in over.temperatures_degc])
    yield (
        f"With tables over SOC at {degc} the RMSE is "
        f"{millivolt(part.metrics.identification.rmse_v)}; one constant circuit for all "
        f"temperatures leaves {millivolt(constant_v)}."
    )
    yield f"Best possible: {best_over_temperature(part, over)}"
    costs = over.objective_v / over.separate_v - 1 if over.separate_v else 0.0
    yield (
        "The time constants are the same at every temperature; separate ones would lower the error "
        f"by {percent(max(costs, 0.0))}."
    )
    for each, fit in zip(over.temperatures_degc, part.fits, strict=True):
        if pays := pay_sentence(fit):
            yield f"At {degrees(each)}, {pays}"
    yield (
        "Between measured temperatures the logarithm of every resistance is linear in 1/T, and the "
        "OCV correction in T; beyond them the tables of the nearest temperature apply. How far off "
        f"this may be: {expectation(over)}"
    )


def _temperature_table(part: "TablesPart", over: "OverTemperature") -> Table:
    rows = list(zip(over.left_out, part.fits, strict=True))
    cells: dict[str, Callable] = {
        "temperature": lambda row: degrees(row[0].temperature_degc),
        "own tables [mV]": lambda row: errors_words(row[0].own),
        "held-out blocks [mV]": lambda row: _held_out(row[1]),
        "left out [mV]": lambda row: errors_words(row[0].errors),
        "predicted from": lambda row: "both sides" if row[0].is_between else "one side",
    }
    return make_table(
        "RMSE in mV, in brackets that above 10 % SOC: with the tables of that temperature, on "
        "blocks held out of the fit, and as predicted by the tables of the other temperatures.",
        rows,
        cells,
        list(cells),
    )


def _held_out(fit: "TableFit") -> str:
    held = fit.cross_validation
    return NOTHING if held is None else errors_words(held.tables)


def _middle(fits: "tuple[TableFit, ...]") -> int:
    """The node nearest to the middle that samples of every temperature visit, else of any."""
    nodes = fits[0].tables.nodes
    seen = [all(fit.tables.visited[place] for fit in fits) for place in range(len(nodes))]
    places = [place for place, is_seen in enumerate(seen) if is_seen] or range(len(nodes))
    return min(places, key=lambda place: abs(nodes[place] - MIDDLE_SOC))
