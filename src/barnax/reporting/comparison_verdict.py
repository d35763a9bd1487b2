"""The verdict of a comparison: who leads, by how much, and whether a model pays."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from ..search.refine import SAME_RMSE
from .words import better_than, bound_words, gathered, joined, millivolt, sentence

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..comparison.result import RecordErrorsPart, RowPart
    from ..comparison.run import Difference

NARROW = "the residuals stay correlated longer than a block, so the interval is too narrow"
# The plainest model, which the others are compared with.
BASE = "so-rc"

Change = Literal["better", "worse", "same"]


@dataclass(frozen=True)
class OnRecord:
    """Findings of a comparison on one record: the errors of each row, and their differences."""

    name: str
    is_validation: bool
    errors: "dict[str, RecordErrorsPart]"
    differences: "list[Difference]"

    def rmse_v(self, row: str) -> float:
        return self.errors[row].metrics.rmse_v

    @property
    def ranked(self) -> list[str]:
        """The rows, the lowest RMSE first."""
        return sorted(self.errors, key=self.rmse_v)

    @property
    def leaders(self) -> list[str]:
        """The row with the lowest RMSE, and those that found the same."""
        max_v = self.rmse_v(self.ranked[0]) * (1 + SAME_RMSE)
        return [row for row in self.ranked if self.rmse_v(row) <= max_v]

    def between(self, first: str, second: str) -> "Difference | None":
        """The difference of two rows, in either order; None where they were not compared."""
        pair = {first, second}
        found = (
            difference
            for difference in self.differences
            if {difference.first, difference.second} == pair
        )
        return next(found, None)


def answered(result: "ComparisonResult") -> "list[RowPart]":
    """The rows that have an answer."""
    return [row for row in result.rows if row.identification is not None]


def on_records(result: "ComparisonResult") -> list[OnRecord]:
    """The findings on the identification record, then on those for validation."""
    errors = {
        row.name: [
            errors_part
            for errors_part in (row.identification, *row.validation)
            if errors_part is not None
        ]
        for row in answered(result)
    }
    found = []
    for place, first in enumerate(next(iter(errors.values()), [])):
        name, is_validation = first.metrics.record, place > 0
        differences = [
            difference
            for difference in result.differences
            if difference.record == name and difference.is_validation == is_validation
        ]
        of_rows = {row: of_row[place] for row, of_row in errors.items()}
        found.append(OnRecord(name, is_validation, of_rows, differences))
    return found


def verdict_sentences(result: "ComparisonResult") -> Iterator[str]:
    """The leader, the gain of each model, the global optima, and cautions."""
    yield from ranking_sentences(result)
    yield from model_sentences(result)
    yield from optimum_sentences(result)
    yield from bound_sentences(result)
    for row in result.rows:
        if row.failure is not None:
            yield sentence(f"{row.name} gave no answer: {row.failure}")


def ranking_sentences(result: "ComparisonResult") -> Iterator[str]:
    """The leader on each record, and whether its lead over the next is more than chance."""
    records = on_records(result)
    if not records:
        yield "No row has an answer."
    for on in records:
        role = "a validation" if on.is_validation else "the identification"
        have = "have" if len(on.leaders) > 1 else "has"
        lowest = millivolt(on.rmse_v(on.leaders[0]))
        told = f"On {on.name}, {role} record, {joined(on.leaders)} {have} the lowest RMSE, {lowest}"
        others = [row for row in on.ranked if row not in on.leaders]
        yield f"{told}.{_lead(on, on.leaders[0], others[0])}" if others else f"{told}."
    if len(records) == 1:
        yield "There is no validation record, so the errors on other records are not known."


def _lead(on: OnRecord, leader: str, other: str) -> str:
    lead = millivolt(on.rmse_v(other) - on.rmse_v(leader))
    found = on.between(leader, other)
    if found is None:
        return f" The next is {other}, with {lead} more."
    over_time = found.over_time
    # The stored difference may be of the second row minus the first.
    sign = 1 if found.first == leader else -1
    low_v, high_v = sorted(-sign * end_v for end_v in over_time.interval_v)
    narrow, sure = (f"; {NARROW}", "may be") if over_time.is_block_capped else ("", "is")
    return (
        f" The lead of {lead} over {other} {sure if over_time.is_real else 'is not'} significant "
        f"(95 % interval {1e3 * low_v:.2f} to {millivolt(high_v)}{narrow})."
    )


def model_sentences(result: "ComparisonResult") -> Iterator[str]:
    """A sentence for each model against the plainest, by the best method that ran both."""
    records = on_records(result)
    present = list(dict.fromkeys(row.model for row in answered(result)))
    if not present:
        return
    plain = BASE if BASE in present else present[0]
    for rich in (model for model in present if model != plain):
        method = _best_of_both(records[0], plain, rich)
        if method is None:
            yield (
                f"No method ran both {plain} and {rich}, so the effect of the model cannot be "
                "separated from that of the method."
            )
            continue
        changes, told = [], []
        for on in records:
            error = "the validation error" if on.is_validation else "the identification error"
            where = f" on {on.name}" if on.is_validation and len(records) > 2 else ""
            change, said = _effect(on, f"{method} {plain}", f"{method} {rich}", error + where)
            changes.append(change)
            told.append(said)
        what = f"With {method}, {rich} instead of {plain} {joined(told)}"
        yield f"{what}: {conclusion(changes[0], changes[1:])}."


def _best_of_both(on: OnRecord, plain: str, rich: str) -> str | None:
    """The method with the lowest errors of both models, None where none ran both."""
    methods = [row.removesuffix(f" {plain}") for row in on.errors if row.endswith(f" {plain}")]
    ran = [method for method in methods if f"{method} {rich}" in on.errors]
    both_v = {name: on.rmse_v(f"{name} {plain}") + on.rmse_v(f"{name} {rich}") for name in ran}
    return min(ran, key=both_v.__getitem__, default=None)


def _effect(on: OnRecord, plain: str, rich: str, error: str) -> tuple[Change, str]:
    """The effect of one model instead of another; "same" too where chance alone explains it."""
    plain_v, rich_v = on.rmse_v(plain), on.rmse_v(rich)
    if rich_v == plain_v:
        return "same", f"does not change {error}"
    verb = "lowers" if rich_v < plain_v else "raises"
    said = f"{verb} {error} by {millivolt(abs(rich_v - plain_v))}"
    found = on.between(rich, plain)
    is_chance = found is not None and not found.over_time.is_real
    if is_chance or abs(rich_v - plain_v) <= SAME_RMSE * plain_v:
        return "same", f"{said} (not significant)"
    return "better" if rich_v < plain_v else "worse", said


def conclusion(identified: Change, validated: Sequence[Change]) -> str:
    """One conclusion from the changes on the identification record and on the others."""
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


def optimum_sentences(result: "ComparisonResult") -> Iterator[str]:
    """The global optimum of each model, from which the optimality gaps count."""
    unknown = []
    for name in dict.fromkeys(row.model for row in answered(result)):
        model = result.models[name]
        if not model.optimum_rmse_v:
            unknown.append(name)
            continue
        how = ""
        if model.optimum_status is not None:
            sure = "proved" if model.optimum_status == "certified" else "found on a grid"
            better = better_than(model.optimum_proved_gap or 0.0)
            how = f", {sure}: no circuit in the bounds is {better}"
        yield f"The global optimum of {name} is {millivolt(model.optimum_rmse_v)}{how}."
    if unknown:
        yield f"The global optimum of {joined(unknown)} is not known, nor are optimality gaps."


def bound_sentences(result: "ComparisonResult") -> Iterator[str]:
    """The parameters that ended at a bound, with their rows."""
    rows = answered(result)
    at_bound = ((bound_words(b.name, b.side), row.name) for row in rows for b in row.at_bound)
    for place, names in gathered(at_bound).items():
        where = "every row" if len(names) == len(rows) > 1 else joined(names)
        yield f"{place} in {where}: set by the bounds, not by the data."
