"""The report of one identification."""

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..plots.sources import Illustration, record_roles
from ..plots.style import readable
from .decisions import (
    box_sentences,
    decision_sentences,
    files_table,
    guess_sentences,
    reproduction_section,
    warnings_section,
)
from .document import Bullets, Column, Document, Pictures, Section, Table
from .sentences import (
    BandQuantity,
    band_label,
    diagnostics_sentences,
    held_words,
    identifiability_sentences,
    profile_sentence,
    suggestion_sentences,
    uncertainty_sentence,
)
from .tables import METRICS, circuits_table, metrics_cells
from .verdict import best_possible, seeds_sentences, weakest_point
from .words import NOTHING, counted, fixed, joined, millivolt, percent, significant

if TYPE_CHECKING:
    from ..results import AssessmentPart, MetricsPart, Result
    from ..uncertainty import Band, Estimate, Examination

# Errors that agree this closely, relative, are told to be the same.
ALIKE = 0.01


def identification_document(
    result: "Result", illustrations: Iterable[Illustration] = (), *, summary_only: bool = False
) -> Document:
    """The whole report of an identification, ready for HTML, Markdown or a terminal.

    `illustrations` come from `identification_illustrations`; `summary_only` leaves it at the
    verdict, the parameters and the errors.
    """
    pictures = Pictures(illustrations)
    roles = _roles(result)
    answer = Section("Parameters", (parameters_table(result),))
    errors = Section(
        "Errors",
        (
            errors_table(result),
            *pictures.of(*(f"{role}-{kind}" for role in roles for kind in ("voltage", "error"))),
        ),
    )
    verdict = Section("Verdict", (Bullets(tuple(verdict_sentences(result))),))
    title = f"{result.model} identified on {result.name}"
    if summary_only:
        return Document(title, _summary(result), (verdict, answer, errors))
    sections = (
        verdict,
        *warnings_section(result.warnings),
        answer,
        *_uncertainty_section(result),
        errors,
        Section(
            "What was measured",
            (
                files_table(result),
                *pictures.of(*(f"{role}-condition" for role in roles), "ocv", "hysteresis"),
            ),
        ),
        Section("What was decided", (Bullets(tuple(_decisions(result))),)),
        Section(
            "Search",
            (
                Bullets((*seeds_sentences(result), _search_sentence(result))),
                seeds_table(result),
                optima_table(result),
                *pictures.of("convergence"),
                *pictures.starting("landscape"),
            ),
        ),
        reproduction_section(result),
    )
    return Document(title, _summary(result), sections)


def verdict_sentences(result: "Result") -> Iterator[str]:
    """How good the answer is, on the records it was fitted to and on others."""
    own = result.metrics.identification
    yield f"On {own.record} {result.model} errs by {millivolt(own.rmse_v)} (RMSE)."
    yield from validation_sentences(own, result.metrics.validation)
    yield f"Best possible: {best_possible(result)}"
    weakest = weakest_point(result)
    if weakest:
        yield f"Weakest point: {weakest}"
    for guess in guess_sentences(result):
        yield f"Assumed: {guess}"


def validation_sentences(
    own: "MetricsPart", validation: "tuple[MetricsPart, ...]"
) -> Iterator[str]:
    """How the error on records that were not fitted compares with the one that was."""
    for each in validation:
        error = f"On {each.record}, which it was not fitted to, it errs by {millivolt(each.rmse_v)}"
        if own.rmse_v == 0:
            yield f"{error}."
            continue
        ratio = each.rmse_v / own.rmse_v - 1
        if abs(ratio) <= ALIKE:
            yield f"{error}, as on the record it was fitted to."
        else:
            comparison = "more" if ratio > 0 else "less"
            yield f"{error}, {percent(abs(ratio))} {comparison} than on what it was fitted to."
    if not validation:
        yield "No record was given for validation, so nothing tells how it does on others."


def parameters_table(result: "Result") -> Table:
    """The parameters with their intervals, where those were computed."""
    if result.assessment is None:
        rows = [(name, significant(value)) for name, value in readable(result.parameters).items()]
        columns = (Column("parameter", role="text"), Column("value"))
        return Table("The parameters.", columns, tuple(rows))
    found = result.assessment.uncertainty
    return Table(
        caption=f"The parameters with {percent(found.confidence)} intervals that account for "
        "residual autocorrelation. SE: standard error; white-noise SE: the one that takes every "
        "sample for independent; inflation: the ratio of both.",
        columns=(
            Column("parameter", role="text"),
            *(
                Column(head)
                for head in ("value", "from", "to", "SE", "white-noise SE", "inflation")
            ),
            Column("held", role="text"),
        ),
        rows=tuple(_estimate_cells(each) for each in found.estimates),
    )


def _estimate_cells(each: "Estimate") -> tuple[str, ...]:
    shown, scale = _shown(each.name)
    value = significant(scale * each.value)
    if each.relative_error is None or each.white_noise_relative_error is None:
        return (shown, value, *[NOTHING] * 5, held_words(each.held) if each.held else "")
    return (
        shown,
        value,
        *(_end(end, scale) for end in (each.low, each.high)),
        *(percent(share) for share in (each.relative_error, each.white_noise_relative_error)),
        fixed(each.inflation, 1),
        "",
    )


def seeds_table(result: "Result") -> Table:
    """What the seeds found before refinement."""
    answer = readable(result.parameters)
    seeds = [readable(seed.parameters.to_dict()) for seed in result.search.seeds]
    rows = []
    for name, value in answer.items():
        spread = np.array([seed[name] for seed in seeds])
        rows.append((name, *map(significant, (value, np.median(spread), *_range(spread)))))
    errors_mv = 1e3 * np.array([seed.rmse_v for seed in result.search.seeds])
    own_mv = 1e3 * result.metrics.identification.rmse_v
    figures = (own_mv, np.median(errors_mv), *_range(errors_mv))
    rows.append(("RMSE [mV]", *(f"{value:.4f}" for value in figures)))
    return Table(
        caption=f"The answer beside what {counted(len(seeds), 'seed')} of {result.search.method} "
        "found before refinement.",
        columns=(
            Column("parameter", role="text"),
            *(Column(head) for head in ("answer", "median", "lowest", "highest")),
        ),
        rows=tuple(rows),
    )


def errors_table(result: "Result") -> Table:
    """Errors of the answer on every record (Li et al., 2023, Eq. 22 to 26)."""
    rows = [(each, "identification") for each in result.metrics.jointly]
    rows.append((result.metrics.identification, "all of these" if rows else "identification"))
    rows += [(each, "validation") for each in result.metrics.validation]
    return metrics_table(rows)


def metrics_table(rows: "Sequence[tuple[MetricsPart, str]]") -> Table:
    """Errors on records, and what each serves for."""
    return Table(
        caption=f"Errors on {joined([f'{each.record} ({role})' for each, role in rows])}.",
        columns=(Column("record", role="text"), *METRICS),
        rows=tuple((each.record, *metrics_cells(each)) for each, _ in rows),
    )


def optima_table(result: "Result") -> Table:
    """The distinct optima that are known, the best first."""
    optima = {f"optimum {place}": each for place, each in enumerate(result.refined.optima, 1)}
    return circuits_table(
        "The places where the refined seeds ended, the best first.",
        {name: each.parameters.to_dict() for name, each in optima.items()},
        (Column("RMSE", "mV"), Column("seeds")),
        lambda name: (f"{1e3 * optima[name].rmse_v:.4f}", str(optima[name].seeds)),
        first=Column("place", role="text"),
    )


def _uncertainty_section(result: "Result") -> list[Section]:
    """What the data determine, and where the errors are, where that was assessed."""
    found = result.assessment
    if found is None:
        return []
    sentences = [uncertainty_sentence(found.uncertainty)]
    sentences += identifiability_sentences(found.identifiability)
    sentences += diagnostics_sentences(found.diagnostics)
    blocks = []
    if found.examination is not None:
        sentences += suggestion_sentences(
            found.examination.suggestions, result.metrics.identification.rmse_v
        )
        sentences += [profile_sentence(each) for each in found.examination.profiles]
        blocks.append(_examination_table(found.examination))
    told = Bullets(tuple(each for each in sentences if each))
    return [Section("What the data determine", (told, *blocks, _bands_table(found)))]


def _examination_table(examination: "Examination") -> Table:
    again = examination.bootstrap
    cut = ", cut short by the record" if again.is_cut else ""
    rows = []
    for each in examination.profiles:
        shown, scale = _shown(each.name)
        resampled = again.parameters.get(each.name)
        ends = [each.low, each.high]
        ends += [None, None] if resampled is None else [resampled.low, resampled.high]
        rows.append((shown, *(_end(end, scale) for end in ends)))
    return Table(
        caption="The same intervals by fitting again: by profile likelihood, and by a block "
        f"bootstrap of {again.replicates} replicates in blocks of {again.block_s:.0f} s{cut}.",
        columns=(
            Column("parameter", role="text"),
            *(
                Column(f"{kind}, {end}")
                for kind in ("profile", "bootstrap")
                for end in ("from", "to")
            ),
        ),
        rows=tuple(rows),
    )


def _bands_table(found: "AssessmentPart") -> Table:
    by = found.diagnostics
    kinds: list[tuple[BandQuantity, tuple[Band, ...]]] = [
        ("SOC", by.by_soc),
        ("current", by.by_current),
    ]
    if by.by_temperature is not None:
        kinds.append(("temperature", by.by_temperature))
    return Table(
        caption=f"Errors by {joined([kind for kind, _ in kinds])}; the mean is measured minus "
        "simulated.",
        columns=(
            Column("by", role="text"),
            Column("band", role="text"),
            Column("samples"),
            Column("RMSE"),
            Column("mean"),
            Column("share of the squared error"),
        ),
        rows=tuple(
            (
                kind,
                band_label(kind, band),
                str(band.samples),
                millivolt(band.rmse_v),
                millivolt(band.mean_v),
                percent(band.share),
            )
            for kind, bands in kinds
            for band in bands
        ),
    )


def _summary(result: "Result") -> str:
    own, others = result.metrics.identification, result.metrics.validation
    parts = [f"{millivolt(own.rmse_v)} on {own.record}"]
    parts += [f"{millivolt(each.rmse_v)} on {each.record}" for each in others]
    return f"RMSE {joined(parts)}. Best possible: {best_possible(result)}"


def _decisions(result: "Result") -> Iterator[str]:
    yield from decision_sentences(result)
    yield from box_sentences({result.model: (result.bounds, result.fixed)})


def _search_sentence(result: "Result") -> str:
    search = result.search
    return (
        f"{search.method} searched with {counted(len(search.seeds), 'seed')} of "
        f"{search.population} candidates and {counted(search.iterations, 'generation')} from the "
        f"key {search.key}, in {search.coordinates} coordinates, by the {search.objective} "
        f"objective: {search.evaluations} evaluations. Levenberg-Marquardt then refined every "
        f"seed's answer in the same box, in {result.refined.evaluations} more. Every error is the "
        "scan's."
    )


def _roles(result: "Result") -> list[str]:
    return record_roles(len(result.of_role("identification")), len(result.of_role("validation")))


def _range(values: np.ndarray) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _end(end: float | None, scale: float) -> str:
    return "open" if end is None else significant(scale * end, 4)


def _shown(name: str) -> tuple[str, float]:
    """A parameter's name with the unit it is shown in, and the factor to that."""
    return (name.replace("[Ohm]", "[mOhm]"), 1e3) if name.endswith("[Ohm]") else (name, 1.0)
