"""The report of a comparison."""

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from ..plots.sources import Illustration, record_roles
from .comparison_sentences import (
    answered,
    bound_sentences,
    budget_sentence,
    failure_sentences,
    gap_sentences,
    leaders,
    model_sentences,
    note_sentences,
    optimum_sentences,
    ranking_sentences,
    records,
    rmse_on,
    soc_sentence,
)
from .decisions import (
    box_sentences,
    decision_sentences,
    files_table,
    reproduction_section,
    warnings_section,
)
from .document import Bullets, Document, Paragraph, Pictures, Section, Table
from .soc_tables import compared_tables
from .tables import (
    bands_table,
    differences_table,
    errors_table,
    failures_table,
    methods_table,
    parameters_table,
    refined_table,
    search_table,
)
from .words import counted, joined, millivolt

if TYPE_CHECKING:
    from ..comparison import ComparisonResult


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
    return " ".join([f"Lowest error: {lowest}.", *list(model_sentences(result))[:1]])


def _verdict(result: "ComparisonResult") -> Iterator[str]:
    yield from ranking_sentences(result)
    yield from model_sentences(result)
    yield from gap_sentences(result)
    yield from bound_sentences(result)
    yield from failure_sentences(result)


def _measured(result: "ComparisonResult", pictures: Pictures) -> Section:
    conditions = [f"{role}-condition" for role in record_roles(1, len(records(result)) - 1)]
    return Section(
        "What was measured",
        (files_table(result), *pictures.of(*conditions, "ocv", "hysteresis")),
    )


def _decisions(result: "ComparisonResult") -> Iterator[str]:
    yield from decision_sentences(result)
    yield from box_sentences({name: (m.bounds, m.fixed) for name, m in result.models.items()})
    yield budget_sentence(result)


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
    notes = (*optimum_sentences(result), *note_sentences(result))
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
                Paragraph(soc_sentence(result, record)),
                bands_table(result, record),
                *_differences(result, record),
                *pictures.of(f"{role}-voltages", f"{role}-errors"),
            ),
        )


def _differences(result: "ComparisonResult", record: int) -> Iterator[Table]:
    table = differences_table(result, record)
    if table.rows:
        yield table
