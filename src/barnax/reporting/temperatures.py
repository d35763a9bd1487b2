"""Tables beyond SOC, in sentences: what resistances follow, and other temperatures."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from ..cell.dependence import BETA, CHARGE, KAPPA, ONSET
from ..cell.model import NEAR_DEGC
from .words import degrees, duration, figures, joined, millivolt

if TYPE_CHECKING:
    from ..over_soc import OverTemperature, TableFit, TableFits
    from ..results import Result

# A smaller relative fall of resistances at the average current counts as none.
NEXT_TO_NOTHING = 0.01


def resistance_sentences(result: "Result") -> Iterator[str]:
    """What the resistances of tables follow beside SOC."""
    yield from dependence_sentences(result.fits)


def dependence_sentences(found: "TableFits") -> Iterator[str]:
    """What resistances follow beside SOC, with intervals; nothing where that is SOC alone."""
    for degc, fit in found.by_degc:
        told = list(_sentences(fit, "" if degc is None else f"at {degrees(degc)}, "))
        yield from told


def numbers_of(fit: "TableFit") -> Mapping[str, float]:
    """The numbers of what the resistances of tables follow, by name."""
    return {} if fit.tables.dependence is None else fit.tables.dependence.numbers


def _sentences(fit: "TableFit", where: str) -> Iterator[str]:
    known = fit.tables.dependence
    if known is None:
        return
    numbers = known.numbers
    ends = {node.name: node for node in fit.intervals if node.name in numbers}

    def interval(name: str, times: float, unit: str, digits: int = 2) -> str:
        node = ends.get(name)
        if node is None or node.low is None or node.high is None:
            return "not determined"
        ends_in_unit = (figures(times * end, digits) for end in (node.low, node.high))
        return f"95 %: {' to '.join(ends_in_unit)}{unit}"

    if BETA in numbers and known.reference_degc is not None:
        yield (
            f"{where}all of them fall by {100 * known.beta_per_k:.2g} % a kelvin with the measured "
            f"temperature ({interval(BETA, 100, ' %')}); the tables are those at "
            f"{degrees(known.reference_degc)}."
        )
    if KAPPA in numbers and known.heating_tau_s is not None:
        percent_a2 = 100 * known.kappa_per_a2
        yield (
            f"{where}all of them fall by {percent_a2:.2g} % an A^2 of the squared current, as in a "
            f"cell that heats itself ({interval(KAPPA, 100, ' %')}), in "
            f"{duration(known.heating_tau_s)}; the tables are those at the average, "
            f"{figures(known.reference_a2)} A^2."
        )
        if known.kappa_per_a2 * known.reference_a2 < NEXT_TO_NOTHING:
            yield f"{where}at that average this is next to nothing: the data show no heating."
    if ONSET in numbers:
        yield (
            f"{where}those of the pairs fall with the current: i0 asinh(i / i0) flows in place of "
            f"i, with i0 = {figures(numbers[ONSET])} A ({interval(ONSET, 1, ' A')})."
        )
    if CHARGE in numbers:
        yield (
            f"{where}all of them on charge are {figures(numbers[CHARGE])} times those on discharge "
            f"({interval(CHARGE, 1, '', 4)}), unless a hysteresis turns at once, which looks much "
            "the same; tables are the geometric mean of the two."
        )


def temperature_ocv_sentences(stored: "Result") -> Iterator[str]:
    """The source of the OCV at each temperature."""
    over = stored.fits.over_temperature
    if not over:
        return
    cell, whose = stored.cell_model, "an OCV test"
    if cell.is_of_records:
        whose = "its records"
    elif not cell.elsewhere:
        yield "all temperatures have the same OCV; `ocv` takes a test of each of them."
        return
    degc = [model.temperature_degc or 0.0 for model in (cell, *cell.elsewhere)]
    without = [
        degrees(value)
        for value in over.temperatures_degc
        if min(abs(own - value) for own in degc) > NEAR_DEGC
    ]
    where = joined(list(map(degrees, sorted(degc))))
    if not without:
        yield f"each temperature has its own, of {whose} at {where}."
    else:
        yield f"that at {joined(without)} follows from those of {whose} at {where}."


def expectation(over: "OverTemperature") -> str:
    """The error to expect at temperatures that were not measured."""
    worst: dict[bool, float] = {}
    for left_out in over.left_out:
        worst[left_out.is_between] = max(
            left_out.errors.rmse_v, worst.get(left_out.is_between, 0.0)
        )
    told = [f"{millivolt(worst[True])} between the measured ones"] if True in worst else []
    told.append(f"{millivolt(worst[False])} beyond them")
    text = (
        "left out in turn and predicted from the others, each had an error of at most "
        f"{joined(told)}; on another record it may be larger."
    )
    if len(over.left_out) == 2:
        text += " A third temperature would show the error between them."
    return text


def prediction_sentences(result: "Result") -> Iterator[str]:
    """One sentence for each record of a result at a temperature without tables of its own."""
    for part in result.of_role("validation"):
        if told := prediction_sentence(result.fits, part.name, part.temperature_degc):
            yield told


def prediction_sentence(found: "TableFits", name: str, temperature_degc: float | None) -> str:
    """The basis of a prediction at a temperature; empty where it has tables of its own."""
    over = found.over_temperature
    if over is None or temperature_degc is None or over.measured_near(temperature_degc) is not None:
        return ""
    known = over.temperatures_degc
    if known[0] < temperature_degc < known[-1]:
        above = next(place for place, degc in enumerate(known) if degc > temperature_degc)
        ends = known[above - 1 : above + 1]
        how = f"lie between those of {joined([degrees(end) for end in ends])}"
    else:
        nearest = known[0] if temperature_degc <= known[0] else known[-1]
        how = f"are those of {degrees(nearest)}"
        known_by = found.at(nearest).dependence
        if known_by is not None and known_by.beta_per_k:
            how += ", with resistances that follow its temperature from there"
    told = [
        f"{degrees(left.temperature_degc)} was predicted to {millivolt(left.errors.rmse_v)} (with "
        f"its own tables {millivolt(left.own.rmse_v)})"
        for left in over.like(temperature_degc)
    ]
    return (
        f"{name} is at {degrees(temperature_degc)}, which was not measured: its tables "
        f"{how}. Left out of the fit, {joined(told)}."
    )
