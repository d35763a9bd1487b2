"""The report of a comparison, with its tables."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

from ..global_optimum.search import optimality_gap
from ..search.refine import SAME_RMSE
from .document import (
    METRICS,
    Block,
    Cells,
    Document,
    Picture,
    Table,
    circuits_table,
    make_table,
    rows_table,
)
from .illustrations import record_roles
from .result_tables import circuit_blocks, files_table, search_boxes, versions_table
from .view import View
from .wording import document, wording
from .words import NOTHING, bound_words, fixed, gathered, millivolts_cell, significant

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..comparison.result import Difference, RecordErrors, Row
    from ..results import Result

# With more pairs than this, only those with the leader or of one method are shown.
ALL_PAIRS = 15
NARROW_MARK = "†"
# A relative gap below this is rounding.
ROUNDING = 1e-7
# The plainest model, which the others are compared with.
BASE = "so-rc"


def comparison_document(
    result: "ComparisonResult",
    illustrations: Iterable[Picture] = (),
    seconds: Mapping[str, float] | None = None,
) -> Document:
    """The whole report of a comparison, ready for `to_html` and `to_markdown`.

    `illustrations` come from `comparison_illustrations`; `seconds` are the times of the rows by
    their names, which a stored comparison does not hold. Every sentence is made from the numbers.
    """
    facts, view = verdict_facts(result), View(cast("Result", result))
    records = facts["records"]
    roles = record_roles(1, len(records) - 1) if records else []
    sources = {row.method: row.source for row in result.rows}
    heads = ["method", "source"]
    blocks: dict[str, tuple[Block, ...]] = {
        "circuits": circuit_blocks(view),
        "files": (files_table(result),),
        "methods": (rows_table("The methods.", heads, sources.items(), heads),),
        "versions": (versions_table(result),),
    }
    if records:
        blocks["parameters"] = (parameters_table(result), *refined_tables(result))
        blocks["search"] = (search_table(result, seconds),)
    for on, role in zip(records, roles, strict=True):
        differences = [differences_table(result, on)] if on.differences else []
        blocks[role] = (errors_table(on), bands_table(on), *differences)
    facts |= {
        "result": result,
        "view": view,
        "boxes_of": search_boxes(result.models),
    }
    return document("compared", blocks, illustrations, roles=roles, facts=facts)


@dataclass(frozen=True)
class OnRecord:
    """Findings of a comparison on one record: the errors of each row, and their differences."""

    name: str
    is_validation: bool
    errors: "dict[str, RecordErrors]"
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
        for difference in self.differences:
            if {difference.first, difference.second} == {first, second}:
                return difference
        return None


def on_records(result: "ComparisonResult") -> list[OnRecord]:
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
        records.append(OnRecord(name, is_validation, of_rows, differences))
    return records


def verdict_facts(result: "ComparisonResult") -> dict[str, Any]:
    """What the verdict is made of: the rows on each record, the effect of each model against the
    plainest, by the best method that ran both, the global optima, and what ended at a bound."""
    rows, records = result.answered, on_records(result)
    present = list(dict.fromkeys(row.model for row in rows))
    plain = BASE if BASE in present or not present else present[0]
    changes = {}
    for rich in (model for model in present if model != plain):
        method = _best_of_both(records[0], plain, rich)
        pair = f"{method} {plain}", f"{method} {rich}"
        effects = [] if method is None else [_effect(on, *pair) for on in records]
        changes[rich] = {"method": method, "effects": effects}
    models = {name: result.models[name] for name in present}
    at_bound = ((bound_words(b.name, b.side), row.name) for row in rows for b in row.at_bound)
    return {
        "rows": result.rows,
        "answered": len(rows),
        "records": records,
        "plain": plain,
        "changes": changes,
        "models": models,
        "unknown": [name for name, model in models.items() if model.optimum is None],
        "at_bound": gathered(at_bound),
    }


def _best_of_both(on: OnRecord, plain: str, rich: str) -> str | None:
    """The method with the lowest errors of both models, None where none ran both."""
    methods = [row.removesuffix(f" {plain}") for row in on.errors if row.endswith(f" {plain}")]
    ran = [method for method in methods if f"{method} {rich}" in on.errors]
    both_v = {name: on.rmse_v(f"{name} {plain}") + on.rmse_v(f"{name} {rich}") for name in ran}
    return min(ran, key=both_v.__getitem__, default=None)


def _effect(on: OnRecord, plain: str, rich: str) -> dict[str, Any]:
    """The effect of one model instead of another; "same" too where chance alone explains it."""
    plain_v, change_v = on.rmse_v(plain), on.rmse_v(rich) - on.rmse_v(plain)
    tested = on.between(rich, plain)
    is_chance = tested is not None and not tested.over_time.is_real
    kind = "better" if change_v < 0 else "worse"
    if is_chance or abs(change_v) <= SAME_RMSE * plain_v:
        kind = "same"
    return {"on": on, "change_v": change_v, "kind": kind}


def parameters_table(result: "ComparisonResult") -> Table:
    """Every row's own parameters and time constants (Li et al., 2023, Table 3)."""
    return circuits_table(
        "Parameters and time constants of each row's median seed, not refined.",
        {row.name: row.median.parameters.to_dict() for row in result.answered},
        {},
    )


def refined_tables(result: "ComparisonResult") -> list[Table]:
    """Every row's median seed after Levenberg-Marquardt, where any was refined."""
    refined = {row.name: row.refined for row in result.answered if row.refined is not None}
    if not refined:
        return []
    optima = {row.name: result.models[row.model].optimum for row in result.rows}

    def gap(name: str) -> float | None:
        optimum = optima[name]
        return None if optimum is None else optimality_gap(refined[name].rmse_v, optimum.rmse_v)

    table = circuits_table(
        wording("comparison.refined"),
        {name: end.parameters.to_dict() for name, end in refined.items()},
        {
            "RMSE [mV]": lambda name: millivolts_cell(refined[name].rmse_v),
            "gap [%]": lambda name: _percents(gap(name)),
        },
    )
    return [table]


def errors_table(on: OnRecord) -> Table:
    """Errors of every row's own answer on one record (Li et al., 2023, Tables 4 and 5)."""
    what = "validation record" if on.is_validation else "identification record"
    errors = on.errors.items()
    return rows_table(
        f"Errors on {on.name}, {what}. Bold: the lowest RMSE.",
        ["row", *METRICS],
        ([row, *(cell(own.metrics) for cell in METRICS.values())] for row, own in errors),
        ["row"],
        [(place, 1) for place, row in enumerate(on.errors) if row in on.leaders],
    )


def search_table(result: "ComparisonResult", seconds: Mapping[str, float] | None = None) -> Table:
    """The errors and cost of every row's search on the identification record."""
    own = on_records(result)[0]

    def spread(row: "Row", place: int) -> str:
        return millivolts_cell(None if row.spread_v is None else row.spread_v[place])

    cells: Cells[Row] = {
        "row": lambda row: row.name,
        "median [mV]": lambda row: millivolts_cell(own.rmse_v(row.name)),
        "best [mV]": lambda row: spread(row, 0),
        "worst [mV]": lambda row: spread(row, 1),
        "SD [mV]": lambda row: spread(row, 2),
        "gap [%]": lambda row: _percents(row.optimality_gap),
        "seeds": lambda row: str(len(row.answers)),
        "evaluations": lambda row: str(row.median.evaluations),
    }
    if seconds:
        cells["time [s]"] = lambda row: fixed(seconds.get(row.name), 2)
    caption = wording("comparison.search", bool(seconds))
    return make_table(caption, result.answered, cells, ["row"])


def bands_table(on: OnRecord) -> Table:
    """Errors by state of charge on one record, for the bands that hold any sample."""
    bands = enumerate(next(iter(on.errors.values())).bands)
    filled = {number: band for number, band in bands if band.samples}
    ranges = [f"{100 * band.low_soc:g}–{100 * band.high_soc:g} %" for band in filled.values()]
    samples = [f"{b.samples} in {name}" for b, name in zip(filled.values(), ranges, strict=True)]
    rows = []
    for row, errors in on.errors.items():
        of_row = [errors.bands[number] for number in filled]
        errors_v = [error_v for band in of_row for error_v in (band.rmse_v, band.mean_v)]
        rows.append([row, *map(millivolts_cell, errors_v)])
    heads = ["row", *(f"{name} {what} [mV]" for name in ranges for what in ("RMSE", "mean"))]
    return rows_table(wording("comparison.bands", on.name, samples), heads, rows, ["row"])


def differences_table(result: "ComparisonResult", on: OnRecord) -> Table:
    """The differences between rows on one record, and whether each is more than chance."""
    differences, are_some = on.differences, len(on.differences) > ALL_PAIRS
    if are_some:
        methods, leader = {row.name: row.method for row in result.rows}, on.ranked[0]
        differences = [
            difference
            for difference in differences
            if leader in (difference.first, difference.second)
            or methods[difference.first] == methods[difference.second]
        ]
    is_marked = any(difference.over_time.is_block_capped for difference in differences)
    has_seeds = any(difference.over_seeds is not None for difference in differences)
    cells: Cells[Difference] = {
        "first": lambda difference: difference.first,
        "second": lambda difference: difference.second,
        "difference [mV]": lambda difference: millivolts_cell(difference.over_time.difference_v),
        "from [mV]": lambda difference: millivolts_cell(difference.over_time.interval_v[0]),
        "to [mV]": lambda difference: millivolts_cell(difference.over_time.interval_v[1]),
        "significant": lambda difference: (
            ("yes" if difference.over_time.is_real else "no")
            + (NARROW_MARK if difference.over_time.is_block_capped else "")
        ),
    }
    if has_seeds:
        cells["wins–losses"] = lambda difference: (
            f"{difference.over_seeds.wins}–{difference.over_seeds.losses}"
            if difference.over_seeds
            else NOTHING
        )
        cells["p"] = lambda difference: significant(
            difference.over_seeds.p_value if difference.over_seeds else None, 2
        )
    facts = has_seeds, are_some, NARROW_MARK if is_marked else ""
    caption = wording("comparison.differences", on.name, *facts)
    return make_table(caption, differences, cells, ["first", "second", "significant"])


def _percents(ratio: float | None) -> str:
    """A ratio in percent, two digits or all before the point; zero where it is rounding's."""
    if ratio is None:
        return NOTHING
    value = 0.0 if abs(ratio) < ROUNDING else 100 * ratio
    return fixed(value, 0) if abs(value) >= 10 else significant(value, 2)
