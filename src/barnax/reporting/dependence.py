"""Dependences of resistances on more than the state of charge, in sentences."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from ..cell.dependence import BETA, KAPPA, ONSET
from .words import degrees, duration, figures

if TYPE_CHECKING:
    from ..over_soc import TableFit
    from ..result_parts import TablesPart

# Resistances that fall by less than this share at the average current do not follow it.
NEXT_TO_NOTHING = 0.01


def dependence_sentences(part: "TablesPart") -> Iterator[str]:
    """The dependences of tables' resistances, with intervals; nothing where that is SOC alone."""
    for degc, fit in part.found.by_degc:
        yield from _sentences(fit, "" if degc is None else f"at {degrees(degc)}, ")


def numbers_of(fit: "TableFit") -> Mapping[str, float]:
    """The numbers of what the resistances of tables follow, by name."""
    return {} if fit.tables.dependence is None else fit.tables.dependence.numbers


def _sentences(fit: "TableFit", where: str) -> Iterator[str]:
    known = fit.tables.dependence
    if known is None:
        return
    numbers = known.numbers
    ends = {node.name: node for node in fit.intervals if node.name in numbers}

    def interval(name: str, times: float, unit: str) -> str:
        node = ends.get(name)
        if node is None or node.low is None or node.high is None:
            return "not determined"
        return f"95 %: {figures(times * node.low, 2)} to {figures(times * node.high, 2)}{unit}"

    if BETA in numbers and known.reference_degc is not None:
        yield (
            f"{where}all of them fall by {100 * known.beta_per_k:.2g} % a kelvin with the measured "
            f"temperature ({interval(BETA, 100, ' %')}); tables are at "
            f"{degrees(known.reference_degc)}."
        )
    if KAPPA in numbers and known.heating_tau_s is not None:
        percent_a2 = 100 * known.kappa_per_a2
        yield (
            f"{where}all of them fall by {percent_a2:.2g} % an A^2 of the squared current, as in a "
            f"cell that heats itself ({interval(KAPPA, 100, ' %')}), in "
            f"{duration(known.heating_tau_s)}; tables are at {figures(known.reference_a2)} A^2, "
            "the average."
        )
        if known.kappa_per_a2 * known.reference_a2 < NEXT_TO_NOTHING:
            yield f"{where}at that average this is next to nothing: the data show no heating."
    if ONSET in numbers:
        yield (
            f"{where}those of the pairs fall with the current: i0 asinh(i / i0) flows in place of "
            f"i, with i0 = {figures(numbers[ONSET])} A ({interval(ONSET, 1, ' A')})."
        )
