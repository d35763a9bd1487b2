"""The report of a comparison, with its tables."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from ..plots.pictures import Illustration, record_roles
from . import comparison_sentences as say
from .comparison_sentences import answered, errors_on, leaders, records, rmse_on
from .decisions import (
    box_sentences,
    decision_sentences,
    files_table,
    reproduction_section,
    warnings_section,
)
from .document import Bullets, Document, Paragraph, Pictures, Section, Table, make_table
from .soc_tables import compared_tables
from .tables import METRICS, Cells, circuits_table, millivolts_cell, pairs_table
from .words import NOTHING, counted, fixed, joined, millivolt, significant

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..comparison.result import DifferencePart, RowPart
    from ..results import MetricsPart


def comparison_document(
    result: "ComparisonResult",
    illustrations: Iterable[Illustration] = (),
    seconds: Mapping[str, float] | None = None,
) -> Document:
    """The whole report of a comparison, ready for `to_html` and `to_markdown`.

    `illustrations` come from `comparison_illustrations`; `seconds` are the times of the rows by
    their names, which a stored comparison does not hold. Every sentence is made from the numbers.
    """
    pictures = Pictures(illustrations)
    parameters, *results = _results(result, pictures, seconds) if answered(result) else [None]
    sections = [
        Section("Verdict", (Bullets(tuple(_verdict(result))),)),
        *warnings_section(result.warnings),
        *([parameters] if parameters else []),
        _measured(result, pictures),
        Section("What was decided", (Bullets(tuple(_decisions(result))), methods_table(result))),
        *results,
    ]
    sections += compared_tables(result.tabulated, records(result))
    if any(row.failure for row in result.rows):
        sections.append(Section("Without an answer", (failures_table(result),)))
    sections.append(reproduction_section(result))
    return Document(_title(result), _summary(result), tuple(sections))


def _title(result: "ComparisonResult") -> str:
    names = [each.name for each in result.inputs if each.role == "identification"]
    return f"{counted(len(result.rows), 'row')} compared on {joined(names)}"


def _summary(result: "ComparisonResult") -> str:
    """The one or two sentences for a reader in a hurry."""
    rows = answered(result)
    if not rows:
        return "No row has an answer; the reasons are below."
    found: dict[str, list[str]] = {}
    for record, name in enumerate(records(result)):
        best = leaders(rows, record)
        place = f"{name} ({millivolt(rmse_on(best[0], record))})"
        found.setdefault(joined([row.name for row in best]), []).append(place)
    lowest = "; ".join(f"{names} on {joined(places)}" for names, places in found.items())
    return " ".join([f"Lowest error: {lowest}.", *list(say.model_sentences(result))[:1]])


def _verdict(result: "ComparisonResult") -> Iterator[str]:
    yield from say.ranking_sentences(result)
    yield from say.model_sentences(result)
    yield from say.gap_sentences(result)
    yield from say.bound_sentences(result)
    yield from say.failure_sentences(result)


def _measured(result: "ComparisonResult", pictures: Pictures) -> Section:
    conditions = [f"{role}-condition" for role in record_roles(1, len(records(result)) - 1)]
    return Section(
        "What was measured",
        (files_table(result), *pictures.of(*conditions, "ocv", "hysteresis")),
    )


def _decisions(result: "ComparisonResult") -> Iterator[str]:
    yield from decision_sentences(result)
    yield from box_sentences({name: (m.bounds, m.fixed) for name, m in result.models.items()})
    yield say.budget_sentence(result)


def _results(
    result: "ComparisonResult", pictures: Pictures, seconds: Mapping[str, float] | None
) -> Iterator[Section]:
    refined = any(row.refined_parameters is not None for row in answered(result))
    yield Section(
        "Parameters",
        (
            parameters_table(result),
            *([refined_table(result)] if refined else []),
            *pictures.of("parameters"),
        ),
    )
    notes = (*say.optimum_sentences(result), *say.note_sentences(result))
    yield Section(
        "Search",
        (
            search_table(result, seconds),
            *([Bullets(notes)] if notes else []),
            *pictures.of("convergence"),
            *pictures.starting("landscape"),
        ),
    )
    roles = record_roles(1, len(records(result)) - 1)
    for record, (name, role) in enumerate(zip(records(result), roles, strict=True)):
        yield Section(
            f"{'Identification' if record == 0 else 'Validation'}: {name}",
            (
                errors_table(result, record),
                Paragraph(say.soc_sentence(result, record)),
                bands_table(result, record),
                *_differences(result, record),
                *pictures.of(f"{role}-voltages", f"{role}-errors"),
            ),
        )


def _differences(result: "ComparisonResult", record: int) -> Iterator[Table]:
    table = differences_table(result, record)
    if table.rows:
        yield table


# With more pairs than these only those are shown that a reader asks for first.
ALL_PAIRS = 15
NARROW_MARK = "†"


def parameters_table(result: "ComparisonResult") -> Table:
    """Every row's own parameters and time constants (Li et al., 2023, Table 3)."""
    rows = answered(result)
    caption = "Parameters and time constants of each row's median seed, not refined."
    bounds = [f"{place}." for place in say.bound_places(result)]
    return circuits_table(
        " ".join([caption, *bounds]),
        {row.name: row.parameters or {} for row in rows},
        {},
    )


def refined_table(result: "ComparisonResult") -> Table:
    """Every row's median seed after Levenberg-Marquardt."""
    rows = {row.name: row for row in answered(result) if row.refined_parameters is not None}
    return circuits_table(
        "The same after Levenberg-Marquardt has refined the median seed in the same box.",
        {name: row.refined_parameters or {} for name, row in rows.items()},
        {"RMSE [mV]": lambda name: millivolts_cell(rows[name].refined_rmse_v)},
    )


def errors_table(result: "ComparisonResult", record: int) -> Table:
    """Errors of every row's own answer on one record (Li et al., 2023, Tables 4 and 5)."""
    rows = answered(result)
    best = leaders(rows, record)
    what = "identification record" if record == 0 else "validation record"

    def of_row(cell: "Callable[[MetricsPart], str]") -> "Callable[[RowPart], str]":
        return lambda row: cell(errors_on(row, record).metrics)

    cells = {head: of_row(cell) for head, cell in METRICS.items()}
    return make_table(
        f"Errors on {records(result)[record]}, {what}. Bold: the lowest RMSE.",
        rows,
        {"row": lambda row: row.name, **cells},
        ["row"],
        [(place, 1) for place, row in enumerate(rows) if row in best],
    )


def search_table(result: "ComparisonResult", seconds: Mapping[str, float] | None = None) -> Table:
    """What every row's search gave and cost on the identification record."""
    rows = answered(result)
    has_gap = any(row.optimality_gap is not None for row in rows)
    gap: Cells[RowPart] = {"gap [%]": lambda row: _percents(row.optimality_gap)}
    time: Cells[RowPart] = {"time [s]": lambda row: fixed((seconds or {}).get(row.name), 2)}
    cells: Cells[RowPart] = {
        "row": lambda row: row.name,
        "median [mV]": lambda row: millivolts_cell(rmse_on(row, 0)),
        "best [mV]": lambda row: millivolts_cell(row.spread and row.spread.best_rmse_v),
        "worst [mV]": lambda row: millivolts_cell(row.spread and row.spread.worst_rmse_v),
        "SD [mV]": lambda row: millivolts_cell(row.spread and row.spread.deviation_v),
        **(gap if has_gap else {}),
        "refined [mV]": lambda row: millivolts_cell(row.refined_rmse_v),
        "seeds": lambda row: str(len(row.seeds)),
        "evaluations": lambda row: NOTHING if row.evaluations is None else str(row.evaluations),
        **(time if seconds else {}),
    }
    caption = (
        "RMSE of the median, best and worst seed on the identification record, with the standard "
        "deviation (SD) over the seeds"
        + ("; optimality gap of the median seed" if has_gap else "")
        + "; the median seed after refinement; evaluations of the median seed"
        + (", and the time of all seeds, compilation included." if seconds else ".")
    )
    return make_table(caption, rows, cells, ["row"])


def bands_table(result: "ComparisonResult", record: int) -> Table:
    """Errors by state of charge on one record, for the bands that hold any sample."""
    rows = answered(result)
    cells: Cells[RowPart] = {"row": lambda row: row.name}
    samples = []

    def of_band(place: int, name: str) -> "Callable[[RowPart], str]":
        return lambda row: millivolts_cell(getattr(errors_on(row, record).bands[place], name))

    for place, band in enumerate(errors_on(rows[0], record).bands):
        if band.samples:
            head = f"{100 * band.low_soc:g}–{100 * band.high_soc:g} %"
            samples.append(f"{band.samples} in {head}")
            cells[f"{head} RMSE [mV]"] = of_band(place, "rmse_v")
            cells[f"{head} mean [mV]"] = of_band(place, "mean_v")
    caption = (
        f"Errors on {records(result)[record]} by state of charge: RMSE and mean of measured minus "
        f"simulated voltage. Samples: {joined(samples)}."
    )
    return make_table(caption, rows, cells, ["row"])


def differences_table(result: "ComparisonResult", record: int) -> Table:
    """The differences between rows on one record, and whether each is more than chance."""
    rows = answered(result)
    found = say.differences_on(result, record)
    note = ""
    if len(found) > ALL_PAIRS:
        leader = say.ranked(rows, record)[0].name
        found = [each for each in found if _is_asked_for(each, leader, rows)]
        note = " Shown are the pairs with the leader and those of one method."
    if any(each.over_time.is_block_capped for each in found):
        note += f" {NARROW_MARK}: {say.NARROW}."
    has_seeds = any(each.over_seeds is not None for each in found)
    cells: Cells[DifferencePart] = {
        "first": lambda each: each.first,
        "second": lambda each: each.second,
        "difference [mV]": lambda each: millivolts_cell(each.over_time.difference_v),
        "from [mV]": lambda each: millivolts_cell(each.over_time.interval_v[0]),
        "to [mV]": lambda each: millivolts_cell(each.over_time.interval_v[1]),
        "significant": lambda each: (
            ("yes" if each.over_time.is_real else "no")
            + (NARROW_MARK if each.over_time.is_block_capped else "")
        ),
    }
    if has_seeds:
        cells["wins–losses"] = lambda each: (
            f"{each.over_seeds.wins}–{each.over_seeds.losses}" if each.over_seeds else NOTHING
        )
        cells["p"] = lambda each: significant(each.over_seeds and each.over_seeds.p_value, 2)
    caption = (
        f"Differences of RMSE on {records(result)[record]}, first row minus second, with the 95 % "
        "interval of a moving-block bootstrap over time"
        + ("; seeds won and lost by the first row, and Wilcoxon's p." if has_seeds else ".")
        + note
    )
    return make_table(caption, found, cells, ["first", "second", "significant"])


def methods_table(result: "ComparisonResult") -> Table:
    """Where every method comes from."""
    sources = {row.method: row.source for row in result.rows}
    return pairs_table("The methods.", "method", "source", sources)


def failures_table(result: "ComparisonResult") -> Table:
    """The rows without an answer."""
    failures = {row.name: row.failure for row in result.rows if row.failure is not None}
    return pairs_table("Rows without an answer.", "row", "why", failures)


def _is_asked_for(each: "DifferencePart", leader: str, rows: "Sequence[RowPart]") -> bool:
    methods = {row.name: row.method for row in rows}
    return leader in (each.first, each.second) or methods[each.first] == methods[each.second]


def _percents(ratio: float | None) -> str:
    """A ratio in percent, two digits or all before the point."""
    value = None if ratio is None else 100 * ratio
    return fixed(value, 0) if value and abs(value) >= 10 else significant(value, 2)
