"""A comparison in sentences: who leads, by how much, and whether a model pays."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from .sentences import better_than
from .words import bound_words, counted, joined, millivolt, percent, sentence

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..comparison.result import BandPart, DifferencePart, RecordErrorsPart, RowPart


# Rows whose RMSE agree this closely, relative, found the same answer.
SAME_RMSE = 1e-5
# An optimality gap below this is no loss to anyone; above it an answer is not the best there is.
REACHED = 1e-3
LOW_SOC = 0.2
NARROW = "the residuals stay correlated longer than a block, so the interval is too narrow"

Change = Literal["better", "worse", "same"]

# The plainest model, against which others must show that they pay, and one more question.
BASE = "so-rc"
SWITCHES = ("iso-rc", "esc")
ADDITIONS = {
    (BASE, "iso-rc"): "the hysteresis correction (iso-rc)",
    (BASE, "esc"): "the dynamic hysteresis (esc)",
    SWITCHES: "hysteresis that follows the charge passed (esc instead of iso-rc)",
}

# Of fewer seeds even a win of all has a p over 5 %.
ENOUGH_SEEDS = 6


def answered(result: "ComparisonResult") -> "list[RowPart]":
    """The rows that have an answer."""
    return [row for row in result.rows if row.identification is not None]


def records(result: "ComparisonResult") -> list[str]:
    """The names of the records: the identification record, then those for validation."""
    rows = answered(result)[:1]
    return [errors.metrics.record for row in rows for errors in _every(row)]


def errors_on(row: "RowPart", record: int) -> "RecordErrorsPart":
    """A row's errors on a record by its place in `records`."""
    return _every(row)[record]


def rmse_on(row: "RowPart", record: int) -> float:
    """A row's RMSE in V on a record by its place in `records`."""
    return errors_on(row, record).metrics.rmse_v


def ranked(rows: "Sequence[RowPart]", record: int) -> "list[RowPart]":
    """Rows with the lowest RMSE on a record first."""
    return sorted(rows, key=lambda row: rmse_on(row, record))


def leaders(rows: "Sequence[RowPart]", record: int) -> "list[RowPart]":
    """The row with the lowest RMSE on a record, and those that found the same."""
    best_v = rmse_on(ranked(rows, record)[0], record)
    return [row for row in ranked(rows, record) if rmse_on(row, record) <= best_v * (1 + SAME_RMSE)]


def contrast(
    result: "ComparisonResult", first: "RowPart", second: "RowPart", record: int
) -> "DifferencePart | None":
    """How two rows differ on a record, in either order, or None where that was not compared."""
    pair = {first.name, second.name}
    same = (each for each in differences_on(result, record) if {each.first, each.second} == pair)
    return next(same, None)


def differences_on(result: "ComparisonResult", record: int) -> "list[DifferencePart]":
    """The differences between rows on a record by its place in `records`."""
    name = records(result)[record]
    return [
        each
        for each in result.differences
        if each.record == name and each.is_validation == (record > 0)
    ]


def _every(row: "RowPart") -> "list[RecordErrorsPart]":
    return [*([row.identification] if row.identification else []), *row.validation]


def ranking_sentences(result: "ComparisonResult") -> Iterator[str]:
    """The leader on each record, its lead over the next, and who else cannot be told from it."""
    rows = answered(result)
    if not rows:
        yield "No row has an answer."
        return
    for record in range(len(records(result))):
        best = leaders(rows, record)
        yield " ".join([_leader(result, record, best), *_lead(result, record, best)])
    if len(records(result)) == 1:
        yield "There is no validation record, so the errors on other records are not known."


def _leader(result: "ComparisonResult", record: int, best: "list[RowPart]") -> str:
    name, names = records(result)[record], joined([row.name for row in best])
    lowest = millivolt(rmse_on(best[0], record))
    rows = answered(result)
    if len(rows) == 1:
        return f"On {name}, the RMSE of {names} is {lowest}; there is no other row to compare with."
    role = "the identification record" if record == 0 else "a validation record"
    have = "have" if len(best) > 1 else "has"
    told = f"On {name}, {role}, {names} {have} the lowest RMSE, {lowest}."
    first = leaders(rows, 0)
    if record == 0 or any(row in first for row in best):
        return told
    place = ranked(rows, record).index(first[0]) + 1
    return (
        f"{told} {first[0].name}, the best in identification, is number {place} of "
        f"{len(rows)} with {millivolt(rmse_on(first[0], record))}."
    )


def _lead(result: "ComparisonResult", record: int, best: "list[RowPart]") -> Iterator[str]:
    """The lead over the next row, and the rows that are worse by more than chance."""
    others = [row for row in ranked(answered(result), record) if row not in best]
    if not others:
        return
    found = {row.name: contrast(result, best[0], row, record) for row in others}
    following = found[others[0].name]
    lead_v = rmse_on(others[0], record) - rmse_on(best[0], record)
    if following is None:
        yield f"The next is {others[0].name}, with {millivolt(lead_v)} more."
    else:
        yield from _lead_sentences(following, best[0].name, others[0].name, lead_v)
    for is_real, told in (
        (False, "not significantly different either"),
        (True, "significantly worse"),
    ):
        names = [
            row.name
            for row in others[1:]
            if (each := found[row.name]) is not None and each.over_time.is_real == is_real
        ]
        if names:
            yield f"{joined(names)} {'is' if len(names) == 1 else 'are'} {told}."


def _lead_sentences(
    found: "DifferencePart", leader: str, other: str, lead_v: float
) -> Iterator[str]:
    over_time, seeds = found.over_time, found.over_seeds
    # Stored may be the second row against the first.
    sign = 1 if found.first == leader else -1
    low_v, high_v = sorted(-sign * end_v for end_v in over_time.interval_v)
    narrow, sure = (f" ({NARROW})", "may be") if over_time.is_block_capped else ("", "is")
    chance, holds = (sure, "excludes") if over_time.is_real else ("is not", "includes")
    yield (
        f"The lead of {millivolt(lead_v)} over the next, {other}, {chance} significant: its 95 % "
        f"interval over time, {1e3 * low_v:.2f} to {millivolt(high_v)}, {holds} zero{narrow}."
    )
    if seeds is not None:
        wins, losses = (seeds.wins, seeds.losses)[::sign]
        few = "; too few seeds to tell" if wins + losses < ENOUGH_SEEDS else ""
        yield (
            f"Seed by seed, it wins {wins} times and loses {losses} times (Wilcoxon signed-rank "
            f"p = {seeds.p_value:.2g}{few})."
        )


def gap_sentences(result: "ComparisonResult") -> Iterator[str]:
    """For each model how far above its global optimum the rows are, before and after refinement."""
    unknown = []
    for name, model in result.models.items():
        mine = [row for row in answered(result) if row.model == name]
        optimum_v = model.optimum_rmse_v
        if mine and not optimum_v:
            unknown.append(name)
        if not mine or not optimum_v:
            continue
        sureness = f" ({model.optimum_status})" if model.optimum_status else ""
        optimum = f"the global optimum of {name}, {millivolt(optimum_v)}{sureness}"
        own = {row.name: row.optimality_gap for row in mine}
        refined = {
            row.name: row.refined_rmse_v and row.refined_rmse_v / optimum_v - 1 for row in mine
        }
        before = _reach("Before refinement", own, optimum)
        yield f"{before} {_reach('After refinement', refined, 'it')}".strip()
    if unknown:
        yield (
            f"The global optimum of {joined(unknown)} is not known, so neither are the optimality "
            "gaps of their rows."
        )


def _reach(how: str, of_rows: dict[str, float | None], optimum: str) -> str:
    gaps = {name: gap for name, gap in of_rows.items() if gap is not None}
    if not gaps:
        return ""
    there = [name for name, gap in gaps.items() if gap <= REACHED]
    far = joined([f"{percent(gap)} for {name}" for name, gap in gaps.items() if gap > REACHED])
    if not there:
        return f"{how}, no row reaches {optimum}; the optimality gap is {far}."
    verb = "reaches" if len(there) == 1 else "reach"
    who = "every row reaches" if not far and len(gaps) > 1 else f"{joined(there)} {verb}"
    excess = f"; the optimality gap is {far}" if far else ""
    return f"{how}, {who} {optimum}, to {percent(REACHED)}{excess}."


def optimum_sentences(result: "ComparisonResult") -> Iterator[str]:
    """How sure the global optimum of each model is."""
    for name, model in result.models.items():
        if model.optimum_status is not None:
            proved = f"no circuit in the bounds is {better_than(model.optimum_proved_gap or 0.0)}"
            how = "proved" if model.optimum_status == "certified" else "found on a grid"
            yield f"The global optimum of {name} is {how}: {proved}."


def bound_sentences(result: "ComparisonResult") -> Iterator[str]:
    """Which parameters the box decided, and in which rows."""
    for place in bound_places(result):
        yield f"{place}: set by the bounds, not by the data."


def bound_places(result: "ComparisonResult") -> Iterator[str]:
    """The parameters at a bound, each with the rows where it is there."""
    found: dict[str, list[str]] = {}
    rows = answered(result)
    for row in rows:
        for each in row.at_bound:
            found.setdefault(bound_words(each.name, each.side), []).append(row.name)
    for place, names in found.items():
        yield f"{place} in {'every row' if len(names) == len(rows) > 1 else joined(names)}"


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
        return f"No scored sample of {name} lies below {percent(LOW_SOC)} state of charge."
    # Without any error, no part of it lies anywhere.
    share = low_squares / _squares(bands) if low_squares else 0.0
    return (
        f"{percent(low_samples / sum(band.samples for band in bands))} of the samples lie below "
        f"{percent(LOW_SOC)} state of charge, and they have {percent(share)} of the squared error "
        f"of {best.name}."
    )


def _squares(bands: "Sequence[BandPart]") -> float:
    return sum(band.samples * band.rmse_v**2 for band in bands if band.rmse_v is not None)


def budget_sentence(result: "ComparisonResult") -> str:
    """What every method could spend, and what a row is."""
    budget = result.budget
    return (
        f"The budget of every method was {budget.evaluations} evaluations per seed "
        f"({budget.population} candidates, {budget.iterations} generations after the first), with "
        f"{counted(budget.seeds, 'seed')} from the key {budget.key}, in {budget.coordinates} "
        f"coordinates, with the {budget.objective} objective. Methods without random numbers ran "
        "once. A row shows the method's own answer before refinement: that of its median seed."
    )


@dataclass(frozen=True)
class Effect:
    """What a model changes on one record against another, in V; negative is better.

    `change` is "same" too where chance alone explains the difference.
    """

    record: str
    difference_v: float
    change: Change


def model_sentences(result: "ComparisonResult") -> Iterator[str]:
    """A sentence for each model against the plainest, by the best method that ran both."""
    present = list(dict.fromkeys(row.model for row in answered(result)))
    if not present:
        return
    base = BASE if BASE in present else present[0]
    pairs = [(base, model) for model in present if model != base]
    if base not in SWITCHES and set(SWITCHES) <= set(present):
        pairs.append(SWITCHES)
    for pair in pairs:
        rows = _same_method(result, *pair)
        addition = ADDITIONS.get(pair, f"{pair[1]} instead of {pair[0]}")
        if rows is None:
            yield (
                f"No method ran both {pair[0]} and {pair[1]}, so the effect of {addition} cannot "
                "be separated from that of the method."
            )
            continue
        effects = [_effect(result, *rows, record) for record in range(len(records(result)))]
        yield (
            f"With {rows[0].method}, {addition} {joined(_changes(effects))}: "
            f"{conclusion(effects[0].change, [each.change for each in effects[1:]])}."
            f"{_at_the_optima(result, *pair)}"
        )


def conclusion(identified: Change, validated: Sequence[Change]) -> str:
    """What the changes on the identification record and on the others come to."""
    kinds = set(validated)
    if not kinds:
        return {
            "better": "without a validation record, it is not known whether the gain carries over",
            "worse": "on this record it does not help",
            "same": "on this record it makes no significant difference",
        }[identified]
    if kinds >= {"better", "worse"}:
        return "it helps on some of these records, but not on others"
    if "better" in kinds:
        if identified == "worse":
            return "it helps in validation, but not in identification"
        return "on these data it helps"
    if "worse" in kinds or identified == "worse":
        return "on these data it does not help"
    if identified == "better":
        return "the gain does not carry over, so on these data it does not help"
    return "on these data it makes no significant difference"


def _at_the_optima(result: "ComparisonResult", plain: str, rich: str) -> str:
    """What the model changes where no method's own error is in it, as far as that is known."""
    plain_v, rich_v = (result.models[name].optimum_rmse_v for name in (plain, rich))
    if not plain_v or not rich_v:
        return ""
    if abs(rich_v - plain_v) <= SAME_RMSE * plain_v:
        change = "does not change the identification error"
    else:
        verb = "lowers" if rich_v < plain_v else "raises"
        change = f"{verb} the identification error by {millivolt(abs(rich_v - plain_v))}"
    return f" At the global optima of both models, whatever the method, it {change}."


def _same_method(
    result: "ComparisonResult", plain: str, rich: str
) -> "tuple[RowPart, RowPart] | None":
    """The rows of both models by one method: the one with the lowest errors on its own record."""
    rows = {(row.method, row.model): row for row in answered(result)}
    methods = [method for method, model in rows if model == plain and (method, rich) in rows]
    if not methods:
        return None
    best = min(
        methods,
        key=lambda method: rmse_on(rows[method, plain], 0) + rmse_on(rows[method, rich], 0),
    )
    return rows[best, plain], rows[best, rich]


def _effect(result: "ComparisonResult", plain: "RowPart", rich: "RowPart", record: int) -> Effect:
    plain_v, rich_v = rmse_on(plain, record), rmse_on(rich, record)
    compared = contrast(result, rich, plain, record)
    is_chance = compared is not None and not compared.over_time.is_real
    if is_chance or abs(rich_v - plain_v) <= SAME_RMSE * plain_v:
        change: Change = "same"
    else:
        change = "better" if rich_v < plain_v else "worse"
    name = records(result)[record]
    return Effect(name, rich_v - plain_v, change)


def _changes(effects: Sequence[Effect]) -> list[str]:
    """What is lowered and raised, the first on the identification record."""
    roles = ["the identification error"]
    if len(effects) == 2:
        roles.append("the validation error")
    else:
        roles += [f"the validation error on {each.record}" for each in effects[1:]]
    return [_change(role, each) for role, each in zip(roles, effects, strict=True)]


def _change(role: str, effect: Effect) -> str:
    size = millivolt(abs(effect.difference_v))
    if effect.difference_v == 0:
        return f"does not change {role}"
    verb = "lowers" if effect.difference_v < 0 else "raises"
    chance = " (not significant)" if effect.change == "same" else ""
    return f"{verb} {role} by {size}{chance}"
