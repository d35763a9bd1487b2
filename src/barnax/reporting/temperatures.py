"""Expected errors of tables at temperatures that were not measured, in sentences."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from .words import degrees, joined, millivolt

if TYPE_CHECKING:
    from ..over_soc import OverTemperature
    from ..result_parts import TablesPart
    from ..results import Result


def expectation(over: "OverTemperature") -> str:
    """The error to expect at temperatures that were not measured."""
    worst: dict[bool, float] = {}
    for left_out in over.left_out:
        worst[left_out.is_between] = max(
            left_out.errors.rmse_v, worst.get(left_out.is_between, 0.0)
        )
    told = [f"{millivolt(worst[True])} between the measured ones"] if True in worst else []
    told.append(f"{millivolt(worst[False])} beyond")
    text = (
        f"the error was at most {joined(told)} where each temperature was left out in turn; on "
        "another record it may be more."
    )
    if len(over.left_out) == 2:
        text += " Between them it may be less; a third temperature would show it."
    return text


def prediction_sentences(result: "Result") -> Iterator[str]:
    """One sentence for each record of a result at a temperature without tables of its own."""
    if result.tables is None:
        return
    for part in result.of_role("validation"):
        if told := prediction_sentence(result.tables, part.name, part.temperature_degc):
            yield told


def prediction_sentence(part: "TablesPart", name: str, temperature_degc: float | None) -> str:
    """The basis of a prediction at a temperature; empty where it has tables of its own."""
    over = part.over_temperature
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
        known_by = part.found.at(nearest).dependence
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
