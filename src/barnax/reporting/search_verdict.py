"""How far each row stayed from the best there is, what failed, and where the box decided."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from .comparison_view import answered, errors_on, leaders, records
from .words import counted, joined, millivolt, percent, sentence

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..comparison.parts import BandPart

# A regret below this is no loss to anyone; above it an answer is not the best there is.
REACHED = 1e-3
LOW_SOC = 0.2


def regret_sentences(result: "ComparisonResult") -> Iterator[str]:
    """For each model how far above its global optimum the rows are, before and after refinement."""
    rows = answered(result)
    unknown = []
    for name, model in result.models.items():
        mine = [row for row in rows if row.model == name]
        if not mine:
            continue
        if not model.optimum_rmse_v:
            unknown.append(name)
            continue
        sureness = f" ({model.optimum_status})" if model.optimum_status else ""
        optimum = f"the global optimum of {name}, {millivolt(model.optimum_rmse_v)}{sureness}"
        own = {row.name: row.regret for row in mine if row.regret is not None}
        refined = {
            row.name: row.refined_rmse_v / model.optimum_rmse_v - 1
            for row in mine
            if row.refined_rmse_v is not None
        }
        yield f"{_reach('By itself', own, optimum)} {_reach('Refined', refined, 'it')}".strip()
    if unknown:
        yield (
            f"The global optimum of {joined(unknown)} is not known, so nothing tells how far their "
            "rows are from the best there is."
        )


def _reach(how: str, regrets: dict[str, float], optimum: str) -> str:
    if not regrets:
        return ""
    short = {name: regret for name, regret in regrets.items() if regret > REACHED}
    there = [name for name in regrets if name not in short]
    if not short:
        everyone = "every row reaches" if len(regrets) > 1 else f"{there[0]} reaches"
        return f"{how}, {everyone} {optimum}, to {percent(REACHED)}."
    far = joined([f"{percent(regret)} for {name}" for name, regret in short.items()])
    if not there:
        return f"{how}, no row reaches {optimum}; the excess is {far}."
    verb = "reaches" if len(there) == 1 else "reach"
    return f"{how}, {joined(there)} {verb} {optimum}, to {percent(REACHED)}; the excess is {far}."


def optimum_sentences(result: "ComparisonResult") -> Iterator[str]:
    """How sure the global optimum of each model is."""
    for name, model in result.models.items():
        if model.optimum_verdict is not None:
            yield sentence(f"{name}: {model.optimum_verdict}")


def bound_sentences(result: "ComparisonResult") -> Iterator[str]:
    """Which parameters the box decided, and in which rows."""
    found: dict[str, list[str]] = {}
    for row in answered(result):
        for place in row.at_bound:
            found.setdefault(place, []).append(row.name)
    total = len(answered(result))
    for place, names in found.items():
        who = "every row" if len(names) == total > 1 else joined(names)
        yield f"{place} in {who}: there the box decides, not the data."


def failure_sentences(result: "ComparisonResult") -> Iterator[str]:
    """The rows without an answer, and why."""
    for row in result.rows:
        if row.failure is not None:
            yield sentence(f"{row.name} gave no answer: {row.failure}")


def note_sentences(result: "ComparisonResult") -> Iterator[str]:
    """What the methods say about their own answers."""
    for row in answered(result):
        for note in row.notes:
            yield sentence(f"{row.name}: {note}")


def soc_sentence(result: "ComparisonResult", record: int) -> str:
    """How much of the leader's squared error lies at a low state of charge."""
    best = leaders(answered(result), record)[0]
    bands = errors_on(best, record).bands
    low = [band for band in bands if band.high_soc <= LOW_SOC]
    low_samples, low_squares = sum(band.samples for band in low), _squares(low)
    name = records(result)[record]
    if low_samples == 0:
        return f"No sample of {name} that counts lies below {percent(LOW_SOC)} state of charge."
    # Without any error, no part of it lies anywhere.
    share = low_squares / _squares(bands) if low_squares else 0.0
    return (
        f"{percent(low_samples / sum(band.samples for band in bands))} of the samples lie below "
        f"{percent(LOW_SOC)} state of charge, and they hold {percent(share)} of the squared error "
        f"of {best.name}."
    )


def _squares(bands: "Sequence[BandPart]") -> float:
    return sum(band.samples * band.rmse_v**2 for band in bands if band.rmse_v is not None)


def budget_sentence(result: "ComparisonResult") -> str:
    """What every method could spend, and what a row is."""
    budget = result.budget
    return (
        f"Every method could spend {budget.evaluations} evaluations a seed "
        f"({budget.population} candidates, {budget.iterations} generations and the first) in "
        f"{counted(budget.seeds, 'seed')} from the key {budget.key}, in {budget.coordinates} "
        f"coordinates, by the {budget.objective} objective; methods that draw nothing ran once. A "
        "row is the method's own answer, not refined: that of its median seed."
    )
