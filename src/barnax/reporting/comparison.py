"""The report of a comparison, with its tables."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

from ..search.answers import SAME_RMSE
from .document import Page, Picture
from .identification import search_boxes
from .illustrations import record_roles
from .view import View
from .wording import document

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..comparison.result import Difference, RecordErrors
    from ..results import Result

# With more pairs than this, only those with the leader or of one method are shown.
ALL_PAIRS = 15
# The simplest model, with which the others are compared.
BASE = "so-rc"


def comparison_document(
    result: "ComparisonResult",
    illustrations: Iterable[Picture] = (),
    seconds: Mapping[str, float] | None = None,
) -> Page:
    """The whole report of a comparison, for `to_html` and `to_markdown`.

    `illustrations` come from `comparison_illustrations`; `seconds` are the times of the rows by
    their names, which a stored comparison does not have. Every sentence is made from the numbers.
    """
    facts, view = verdict_facts(result), View(cast("Result", result))
    records = facts["records"]
    facts |= {
        "view": view,
        "boxes_of": search_boxes(result.models),
        "differences": [shown_differences(result, on) for on in records],
        "seconds": seconds or {},
        "sources": {row.method: row.source for row in result.rows},
    }
    roles = record_roles(1, len(records) - 1) if records else []
    return document("compared", illustrations, roles=roles, facts=facts)


@dataclass(frozen=True)
class RecordFindings:
    """Findings of a comparison on one record: the errors of each row, and their differences."""

    name: str
    is_validation: bool
    errors: "dict[str, RecordErrors]"
    differences: "list[Difference]"

    def rmse_v(self, row: str) -> float:
        return self.errors[row].metrics.rmse_v

    @property
    def ranked(self) -> list[str]:
        """The rows by increasing RMSE."""
        return sorted(self.errors, key=self.rmse_v)

    @property
    def leaders(self) -> list[str]:
        """The row with the lowest RMSE, and those with the same error."""
        max_v = self.rmse_v(self.ranked[0]) * (1 + SAME_RMSE)
        return [row for row in self.ranked if self.rmse_v(row) <= max_v]

    def between(self, first: str, second: str) -> "Difference | None":
        """The difference of two rows, in either order; None if they were not compared."""
        for difference in self.differences:
            if {difference.first, difference.second} == {first, second}:
                return difference
        return None


def on_records(result: "ComparisonResult") -> list[RecordFindings]:
    """The findings on the identification record, then on those for validation."""
    errors = {row.name: row.errors for row in result.answered}
    records = []
    for number, first in enumerate(next(iter(errors.values()), [])):
        name, is_validation = first.metrics.record, number > 0
        differences = [
            difference
            for difference in result.differences
            if difference.record == name and difference.is_validation == is_validation
        ]
        of_rows = {row: of_row[number] for row, of_row in errors.items()}
        records.append(RecordFindings(name, is_validation, of_rows, differences))
    return records


def verdict_facts(result: "ComparisonResult") -> dict[str, Any]:
    """The facts of the verdict: the rows on each record, and the effect of each model relative to
    the simplest one, by the best method that ran both."""
    records = on_records(result)
    present = list(dict.fromkeys(row.model for row in result.answered))
    plain = BASE if BASE in present or not present else present[0]
    changes = {}
    for rich in (model for model in present if model != plain):
        method = _best_of_both(records[0], plain, rich)
        pair = f"{method} {plain}", f"{method} {rich}"
        effects = [] if method is None else [_effect(on, *pair) for on in records]
        changes[rich] = {"method": method, "effects": effects}
    facts = {"result": result, "records": records, "plain": plain, "changes": changes}
    return facts | {"models": {name: result.models[name] for name in present}}


def _best_of_both(on: RecordFindings, plain: str, rich: str) -> str | None:
    """The method with the lowest errors of both models; None if none ran both."""
    methods = [row.removesuffix(f" {plain}") for row in on.errors if row.endswith(f" {plain}")]
    ran = [method for method in methods if f"{method} {rich}" in on.errors]
    both_v = {name: on.rmse_v(f"{name} {plain}") + on.rmse_v(f"{name} {rich}") for name in ran}
    return min(ran, key=both_v.__getitem__, default=None)


def _effect(on: RecordFindings, plain: str, rich: str) -> dict[str, Any]:
    """The effect of one model instead of another; "same" also if chance alone explains it."""
    plain_v, change_v = on.rmse_v(plain), on.rmse_v(rich) - on.rmse_v(plain)
    tested = on.between(rich, plain)
    is_chance = tested is not None and not tested.over_time.is_real
    kind = "better" if change_v < 0 else "worse"
    if is_chance or abs(change_v) <= SAME_RMSE * plain_v:
        kind = "same"
    return {"on": on, "change_v": change_v, "kind": kind}


def shown_differences(result: "ComparisonResult", on: RecordFindings) -> "list[Difference]":
    """The differences between rows on one record; of many pairs, those with the leader and those of
    one method."""
    if len(on.differences) <= ALL_PAIRS:
        return on.differences
    methods, leader = {row.name: row.method for row in result.rows}, on.ranked[0]
    return [
        difference
        for difference in on.differences
        if leader in (difference.first, difference.second)
        or methods[difference.first] == methods[difference.second]
    ]
