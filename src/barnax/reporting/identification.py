"""The report of one identification."""

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..plots.sources import Illustration, record_roles
from ..plots.style import readable
from .decisions import (
    Start,
    box_sentences,
    decision_sentences,
    files_table,
    reproduction_section,
    warnings_section,
)
from .document import Bullets, Column, Document, Pictures, Section, Table
from .tables import METRICS, circuits_table, metrics_cells
from .words import NOTHING, counted, fixed, joined, millivolt, percent, significant

if TYPE_CHECKING:
    from ..results import EstimatePart, ExaminationPart, MetricsPart, Result, TrustPart


_ENDS = ("from", "to")


def trust_section(result: "Result") -> list[Section]:
    """Intervals, what the data leave open and where the errors are, where that was assessed."""
    trust = result.trust
    if trust is None:
        return []
    sentences = [trust.uncertainty.words, *(each.text for each in trust.identifiability.findings)]
    if not trust.identifiability.findings:
        sentences.append("The data determine every free parameter.")
    sentences.append(trust.diagnostics.words)
    blocks = [_uncertainty_table(trust)]
    if trust.examination is not None:
        sentences.append(trust.examination.words)
        blocks.append(_examination_table(trust.examination))
    told = Bullets(tuple(sentence for sentence in sentences if sentence))
    return [Section("How far to trust this", (told, *blocks, _bands_table(trust)))]


def _uncertainty_table(trust: "TrustPart") -> Table:
    share = percent(trust.uncertainty.confidence)
    return Table(
        caption=f"{share} intervals that reckon with correlated errors; the standard error beside "
        "the plain one, which takes every sample for independent.",
        columns=(
            Column("parameter", role="text"),
            *(Column(head) for head in ("refined", "from", "to", "error", "plain", "times")),
            Column("held", role="text"),
        ),
        rows=tuple(
            _estimate_cells(name, each) for name, each in trust.uncertainty.parameters.items()
        ),
    )


def _estimate_cells(name: str, estimate: "EstimatePart") -> tuple[str, ...]:
    shown, scale = _readable(name)
    if estimate.standard_error is None or estimate.white_noise_standard_error is None:
        return (shown, significant(scale * estimate.value), *[NOTHING] * 5, estimate.held or "")
    errors = (estimate.standard_error, estimate.white_noise_standard_error)
    return (
        shown,
        significant(scale * estimate.value),
        *(_end(end, scale) for end in (estimate.low, estimate.high)),
        *(percent(error / estimate.value) for error in errors),
        fixed(estimate.inflation, 1),
        "",
    )


def _examination_table(examination: "ExaminationPart") -> Table:
    again = examination.bootstrap
    cut = ", cut short by the record" if again.is_cut else ""
    rows = []
    for name, each in examination.profiles.items():
        shown, scale = _readable(name)
        resampled = again.parameters.get(name)
        ends = [each.low, each.high]
        ends += [None, None] if resampled is None else [resampled.low, resampled.high]
        rows.append((shown, *(_end(end, scale) for end in ends)))
    return Table(
        caption="The same intervals by fitting again: by profile likelihood, and by a block "
        f"bootstrap of {again.replicates} replicates in blocks of {again.block_s:.0f} s{cut}.",
        columns=(
            Column("parameter", role="text"),
            *(Column(f"{kind}, {end}") for kind in ("profile", "bootstrap") for end in _ENDS),
        ),
        rows=tuple(rows),
    )


def _bands_table(trust: "TrustPart") -> Table:
    found = trust.diagnostics
    kinds = [("SOC", found.by_soc), ("current", found.by_current)]
    if found.by_temperature is not None:
        kinds.append(("temperature", found.by_temperature))
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
                band.label,
                str(band.samples),
                millivolt(band.rmse_v),
                millivolt(band.mean_v),
                percent(band.share),
            )
            for kind, bands in kinds
            for band in bands
        ),
    )


def _end(end: float | None, scale: float) -> str:
    return "open" if end is None else significant(scale * end, 4)


def _readable(name: str) -> tuple[str, float]:
    """A parameter's name with the unit it is shown in, and the factor to that."""
    return (name.replace("[Ohm]", "[mOhm]"), 1e3) if name.endswith("[Ohm]") else (name, 1.0)


# Errors that agree this closely, relative, are told to be the same.
ALIKE = 0.01


def identification_document(
    result: "Result", illustrations: Iterable[Illustration] = ()
) -> Document:
    """The whole report of an identification, ready for `to_html` and `to_markdown`.

    `illustrations` come from `identification_illustrations`.
    """
    pictures = Pictures(illustrations)
    roles = _roles(result)
    sections = [
        Section("Verdict", (Bullets(tuple(verdict_sentences(result))),)),
        *warnings_section(result.warnings),
        Section(
            "What was measured",
            (
                files_table(result),
                *pictures.of(*(f"{role}-condition" for role in roles), "ocv", "hysteresis"),
            ),
        ),
        Section("What was decided", (Bullets(tuple(_decisions(result))),)),
        Section("Parameters", (parameters_table(result),)),
        *trust_section(result),
        Section(
            "Errors",
            (
                errors_table(result),
                *pictures.of(
                    *(f"{role}-{kind}" for role in roles for kind in ("voltage", "error"))
                ),
            ),
        ),
        Section(
            "Search",
            (optima_table(result), *pictures.of("convergence"), *pictures.starting("landscape")),
        ),
        reproduction_section(result),
    ]
    name = result.metrics.identification.record
    return Document(f"{result.model} identified on {name}", _summary(result), tuple(sections))


def verdict_sentences(result: "Result") -> Iterator[str]:
    """How good the answer is, on the records it was fitted to and on others."""
    own = result.metrics.identification
    yield f"On {own.record} the refined {result.model} errs by {millivolt(own.rmse_v)} (RMSE)."
    yield from validation_sentences(own, result.metrics.validation)
    yield result.refined.verdict
    if result.global_optimum is not None:
        yield result.global_optimum.words


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
    """Refined values, and the spread of the seeds' own answers."""
    refined = readable(result.parameters)
    seeds = [readable(seed.parameters) for seed in result.search.seeds]
    spread = {name: np.array([seed[name] for seed in seeds]) for name in refined}
    count = counted(len(seeds), "seed")
    errors_mv = 1e3 * np.array([seed.rmse_v for seed in result.search.seeds])
    rows = [
        (name, *map(significant, (value, np.median(spread[name]), *_range(spread[name]))))
        for name, value in refined.items()
    ]
    errors = (1e3 * result.refined.rmse_v, np.median(errors_mv), *_range(errors_mv))
    rows.append(("RMSE [mV]", *(f"{value:.4f}" for value in errors)))
    return Table(
        caption=f"The refined parameters; median, lowest and highest of the answers of {count} of "
        f"{result.search.method}, before refinement.",
        columns=(
            Column("parameter", role="text"),
            *(Column(head) for head in ("refined", "median", "lowest", "highest")),
        ),
        rows=tuple(rows),
    )


def errors_table(result: "Result") -> Table:
    """Errors of the refined parameters on every record (Li et al., 2023, Eq. 22 to 26)."""
    own = result.metrics.identification
    several = [(part.metrics, "identification") for part in result.jointly]
    together = "all of these" if several else "identification"
    rows = [
        *several,
        (own, together),
        *((each, "validation") for each in result.metrics.validation),
    ]
    return Table(
        caption="Errors of the refined parameters.",
        columns=(Column("record", role="text"), Column("serves for", role="text"), *METRICS),
        rows=tuple((metrics.record, role, *metrics_cells(metrics)) for metrics, role in rows),
    )


def optima_table(result: "Result") -> Table:
    """Where the refined seeds ended."""
    optima = {f"optimum {place}": each for place, each in enumerate(result.refined.optima, 1)}
    return circuits_table(
        "The places where the refined seeds ended, the best first.",
        {name: each.parameters for name, each in optima.items()},
        (Column("RMSE", "mV"), Column("seeds")),
        lambda name: (f"{1e3 * optima[name].rmse_v:.4f}", str(optima[name].seeds)),
        first=Column("place", role="text"),
    )


def _summary(result: "Result") -> str:
    own, others = result.metrics.identification, result.metrics.validation
    parts = [f"{millivolt(own.rmse_v)} on {own.record}"]
    parts += [f"{millivolt(each.rmse_v)} on {each.record}" for each in others]
    first = result.refined.verdict.partition(". ")[0].rstrip(".")
    return f"RMSE {joined(parts)}. {first}."


def _decisions(result: "Result") -> Iterator[str]:
    search = result.search
    yield from decision_sentences(result, _starts(result))
    yield from box_sentences({result.model: (result.bounds, result.fixed)})
    yield (
        f"{search.method} searched with {counted(len(search.seeds), 'seed')} of "
        f"{search.population} candidates and {counted(search.iterations, 'generation')} from the "
        f"key {search.key}, in {search.coordinates} coordinates, by the {search.objective} "
        f"objective: {search.evaluations} evaluations. Levenberg-Marquardt then refined every "
        "seed's answer in the same box."
    )


def _starts(result: "Result") -> list[Start]:
    if result.jointly:
        return [
            (part.metrics.record, part.initial_soc, part.initial_soc_reason)
            for part in result.jointly
        ]
    name = result.metrics.identification.record
    return [(name, result.initial_soc, result.initial_soc_reason)]


def _roles(result: "Result") -> list[str]:
    return record_roles(max(1, len(result.jointly)), len(result.metrics.validation))


def _range(values: np.ndarray) -> tuple[float, float]:
    return float(values.min()), float(values.max())
