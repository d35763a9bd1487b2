"""The report of a comparison, with its tables."""

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from ..plots.pictures import Illustration, record_roles
from .comparison_verdict import NARROW, OnRecord, answered, on_records, verdict_sentences
from .document import (
    METRICS,
    Bullets,
    Cells,
    Document,
    Pictures,
    Section,
    Table,
    circuits_table,
    make_table,
    more_figures,
    pairs_table,
    rows_table,
    warnings_section,
)
from .result_tables import (
    circuit_blocks,
    files_table,
    reproduction_section,
    search_boxes,
)
from .view import View
from .wording import sentences
from .words import NOTHING, counted, fixed, joined, millivolts_cell, sentence, significant

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..comparison.result import RowPart
    from ..comparison.run import Difference

# With more pairs than this, only those with the leader or of one method are shown.
ALL_PAIRS = 15
NARROW_MARK = "†"
# A relative gap below this is rounding.
ROUNDING = 1e-7


def comparison_document(
    result: "ComparisonResult",
    illustrations: Iterable[Illustration] = (),
    seconds: Mapping[str, float] | None = None,
) -> Document:
    """The whole report of a comparison, ready for `to_html` and `to_markdown`.

    `illustrations` come from `comparison_illustrations`; `seconds` are the times of the rows by
    their names, which a stored comparison does not hold. Every sentence is made from the numbers.
    """
    pictures, records = Pictures(illustrations), on_records(result)
    parameters, *results = _results(result, pictures, seconds) if records else [None]
    roles = record_roles(1, len(records) - 1)
    conditions = [f"{role}-condition" for role in roles]
    validated = [part.name for part in result.inputs if part.role == "validation"]
    boxes = {name: (model.bounds, model.fixed) for name, model in result.models.items()}
    circuits = circuit_blocks(result.candidates, (), validated)
    decisions = (
        *sentences("decisions.decided", View(result)),
        *sentences("decisions.boxes", search_boxes(boxes)),
        budget_sentence(result),
    )
    sources = {row.method: row.source for row in result.rows}
    sections = [
        *([Section("Circuits", circuits)] if circuits else []),
        Section("Verdict", (Bullets(tuple(verdict_sentences(result))),)),
        *warnings_section(result.warnings),
        *([parameters] if parameters else []),
        Section(
            "What was measured",
            (files_table(result), *pictures.of(*conditions, "ocv", "hysteresis")),
        ),
        Section(
            "What was decided",
            (Bullets(decisions), pairs_table("The methods.", "method", "source", sources)),
        ),
        *results,
        *more_figures(pictures),
        reproduction_section(result),
    ]
    names = [part.name for part in result.inputs if part.role == "identification"]
    title = f"{counted(len(result.rows), 'row')} compared on {joined(names)}"
    return Document(title, "", tuple(sections))


def _results(
    result: "ComparisonResult", pictures: Pictures, seconds: Mapping[str, float] | None
) -> Iterator[Section]:
    records = on_records(result)
    tables = (parameters_table(result), *refined_tables(result))
    yield Section("Parameters", (*tables, *pictures.of("parameters")))
    notes = tuple(sentence(f"{row.name}: {note}") for row in answered(result) for note in row.notes)
    yield Section(
        "Search",
        (
            search_table(result, seconds),
            *([Bullets(notes)] if notes else []),
            *pictures.of("convergence"),
        ),
    )
    for on, role in zip(records, record_roles(1, len(records) - 1), strict=True):
        differences = [differences_table(result, on)] if on.differences else []
        yield Section(
            f"{'Validation' if on.is_validation else 'Identification'}: {on.name}",
            (
                errors_table(on),
                bands_table(on),
                *differences,
                *pictures.of(f"{role}-voltages", f"{role}-errors"),
            ),
        )


def budget_sentence(result: "ComparisonResult") -> str:
    """The budget of every method, and the meaning of a row."""
    budget = result.budget
    return (
        f"The budget of every method was {budget.evaluations} evaluations per seed "
        f"({budget.population} candidates, {budget.iterations} generations after the first), with "
        f"{counted(budget.seeds, 'seed')} from the key {budget.key}, in {budget.coordinates} "
        f"coordinates, with the {budget.objective} objective. Methods without random numbers ran "
        "once. A row shows the method's own answer before refinement: that of its median seed."
    )


def parameters_table(result: "ComparisonResult") -> Table:
    """Every row's own parameters and time constants (Li et al., 2023, Table 3)."""
    return circuits_table(
        "Parameters and time constants of each row's median seed, not refined.",
        {row.name: row.parameters or {} for row in answered(result)},
        {},
    )


def refined_tables(result: "ComparisonResult") -> list[Table]:
    """Every row's median seed after Levenberg-Marquardt, where any was refined."""
    rows = {row.name: row for row in answered(result) if row.refined_parameters is not None}
    if not rows:
        return []

    def gap(row: "RowPart") -> float | None:
        refined_v, optimum_v = row.refined_rmse_v, result.models[row.model].optimum_rmse_v
        return None if refined_v is None or not optimum_v else refined_v / optimum_v - 1

    table = circuits_table(
        "The same after Levenberg-Marquardt has refined the median seed in the same box, with its "
        "optimality gap.",
        {name: row.refined_parameters or {} for name, row in rows.items()},
        {
            "RMSE [mV]": lambda name: millivolts_cell(rows[name].refined_rmse_v),
            "gap [%]": lambda name: _percents(gap(rows[name])),
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
    time: Cells[RowPart] = {"time [s]": lambda row: fixed((seconds or {}).get(row.name), 2)}
    cells: Cells[RowPart] = {
        "row": lambda row: row.name,
        "median [mV]": lambda row: millivolts_cell(own.rmse_v(row.name)),
        "best [mV]": lambda row: millivolts_cell(row.spread and row.spread.best_rmse_v),
        "worst [mV]": lambda row: millivolts_cell(row.spread and row.spread.worst_rmse_v),
        "SD [mV]": lambda row: millivolts_cell(row.spread and row.spread.deviation_v),
        "gap [%]": lambda row: _percents(row.optimality_gap),
        "seeds": lambda row: str(len(row.seeds)),
        "evaluations": lambda row: NOTHING if row.evaluations is None else str(row.evaluations),
        **(time if seconds else {}),
    }
    caption = (
        "RMSE of the median, best and worst seed on the identification record, with the standard "
        "deviation (SD) over the seeds; optimality gap and evaluations of the median seed"
        + ("; time of all seeds, compilation included." if seconds else ".")
    )
    return make_table(caption, answered(result), cells, ["row"])


def bands_table(on: OnRecord) -> Table:
    """Errors by state of charge on one record, for the bands that hold any sample."""
    found = enumerate(next(iter(on.errors.values())).bands)
    told = {place: band for place, band in found if band.samples}
    ranges = [f"{100 * band.low_soc:g}–{100 * band.high_soc:g} %" for band in told.values()]
    samples = [f"{b.samples} in {name}" for b, name in zip(told.values(), ranges, strict=True)]
    rows = []
    for row, own in on.errors.items():
        bands = [own.bands[place] for place in told]
        errors_v = [error_v for band in bands for error_v in (band.rmse_v, band.mean_v)]
        rows.append([row, *map(millivolts_cell, errors_v)])
    return rows_table(
        f"Errors on {on.name} by state of charge: RMSE and mean of measured minus simulated "
        f"voltage. Samples: {joined(samples)}.",
        ["row", *(f"{name} {what} [mV]" for name in ranges for what in ("RMSE", "mean"))],
        rows,
        ["row"],
    )


def differences_table(result: "ComparisonResult", on: OnRecord) -> Table:
    """The differences between rows on one record, and whether each is more than chance."""
    found, note = on.differences, ""
    if len(found) > ALL_PAIRS:
        methods, leader = {row.name: row.method for row in result.rows}, on.ranked[0]
        found = [
            difference
            for difference in found
            if leader in (difference.first, difference.second)
            or methods[difference.first] == methods[difference.second]
        ]
        note = " Shown are the pairs with the leader and those of one method."
    if any(difference.over_time.is_block_capped for difference in found):
        note += f" {NARROW_MARK}: {NARROW}."
    has_seeds = any(difference.over_seeds is not None for difference in found)
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
            difference.over_seeds and difference.over_seeds.p_value, 2
        )
    caption = (
        f"Differences of RMSE on {on.name}, first row minus second, with the 95 % interval of a "
        "moving-block bootstrap over time"
        + ("; seeds won and lost by the first row, and Wilcoxon's p." if has_seeds else ".")
        + note
    )
    return make_table(caption, found, cells, ["first", "second", "significant"])


def _percents(ratio: float | None) -> str:
    """A ratio in percent, two digits or all before the point; zero where it is rounding's."""
    if ratio is None:
        return NOTHING
    value = 0.0 if abs(ratio) < ROUNDING else 100 * ratio
    return fixed(value, 0) if abs(value) >= 10 else significant(value, 2)
