"""The report of one identification."""

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..over_soc import circuit_name
from ..plots.pictures import Illustration, record_roles
from ..plots.search import readable
from .candidates import candidates_section
from .decisions import (
    box_sentences,
    decision_sentences,
    files_table,
    guess_sentences,
    plan_blocks,
    reproduction_section,
    warnings_section,
)
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
    rows_table,
)
from .parameters import ocv_section
from .pulses import pulses_section
from .sentences import (
    BandQuantity,
    band_label,
    diagnostics_sentences,
    held_words,
    identifiability_sentences,
    uncertainty_sentence,
)
from .soc_tables import answer_tables, tables_section
from .temperatures import prediction_sentences
from .verdict import best_possible, seeds_sentences, weakest_point
from .words import (
    NOTHING,
    counted,
    degrees,
    duration,
    fixed,
    joined,
    millivolt,
    percent,
    significant,
)

if TYPE_CHECKING:
    from ..result_parts import AssessmentPart, MetricsPart, RefinedPart, SearchPart
    from ..results import Result
    from ..uncertainty import Band, Estimate, Examination

# Errors within this share of each other are called the same.
ALIKE = 0.01
NO_SEEDS = (
    "No seeds were run: the answer is the lowest point of a grid over the time constants, refined. "
    "Every error is computed by the scan."
)


def identification_document(
    result: "Result", illustrations: Iterable[Illustration] = (), *, summary_only: bool = False
) -> Document:
    """The whole report of an identification, ready for HTML, Markdown or a terminal.

    `illustrations` come from `identification_illustrations`; `summary_only` leaves it at the
    verdict, the parameters and the errors.
    """
    pictures = Pictures(illustrations)
    identified, validation = result.of_role("identification"), result.of_role("validation")
    roles = record_roles(len(identified), len(validation))
    constant = parameters_table(result)
    values = (constant,) if result.tables is None else answer_tables(result.fits)
    answer = Section("Parameters", (*pictures.of("summary"), *values))
    errors = Section(
        "Errors",
        (
            errors_table(result),
            *pictures.of(*(f"{role}-{kind}" for role in roles for kind in ("voltage", "error"))),
        ),
    )
    verdict = Section("Verdict", (Bullets(tuple(verdict_sentences(result))),))
    title = f"{circuit_name(result.model, result.over)}, identified on {result.name}"
    about = _cell_and_record(result)
    if summary_only:
        return Document(title, about, (answer, verdict, errors))
    beside = "The best constant circuit, for comparison"
    # Beside one value at every SOC it is the same, with intervals as if the OCV were known.
    is_same = result.over == "ocv"
    own = result.constant
    box = box_sentences({own.model: (own.bounds, own.fixed)})
    validated = [part.name for part in validation]
    sections = (
        answer,
        verdict,
        *candidates_section(result.candidates, result.tried, validated),
        *warnings_section(result.warnings),
        *tables_section(result, pictures),
        *ocv_section(result),
        *([Section(beside, (constant,))] if result.tables and not is_same else []),
        *pulses_section(
            result,
            pictures.of(
                *(f"{role}-{kind}" for role in roles for kind in ("pulses", "resistances"))
            ),
        ),
        *([] if is_same else _uncertainty_section(result)),
        errors,
        Section(
            "What was measured",
            (
                files_table(result),
                *plan_blocks(result),
                *pictures.of("ocv"),
            ),
        ),
        Section("What was decided", (Bullets((*decision_sentences(result), *box)),)),
        Section(
            "Search",
            (*_search_blocks(result), *pictures.of("convergence")),
        ),
        *more_figures(pictures),
        reproduction_section(result),
    )
    return Document(title, about, sections)


def _cell_and_record(result: "Result") -> str:
    """The cell and what it was measured on. Files seldom say a date, and a result holds none."""
    first, *others = result.of_role("identification")
    degc = [part.temperature_degc for part in (first, *others)]
    known = sorted({degrees(value) for value in degc if value is not None})
    at = f", at {joined(known)}" if known else ""
    extent = ""
    if not others:
        low, high = (round(100 * soc) for soc in first.soc_range or (0.0, 1.0))
        extent = f", {duration(first.duration_s or 0.0)}, SOC {low} to {high} %"
    return f"A cell of {result.cell.capacity_ah:.3g} Ah: {result.name}{extent}{at}."


def verdict_sentences(result: "Result") -> Iterator[str]:
    """The answer's errors on the records it was fitted to and on others, and its weak points."""
    own = result.metrics.identification
    circuit = circuit_name(result.model, result.over)
    yield f"The RMSE of {circuit} on {own.record} is {millivolt(own.rmse_v)}."
    yield from validation_sentences(own, result.metrics.validation)
    yield from prediction_sentences(result)
    yield f"Best possible: {best_possible(result)}"
    weakest = weakest_point(result)
    if weakest:
        yield f"Weakest point: {weakest}"
    for guess in guess_sentences(result):
        yield f"Assumed: {guess}"


def validation_sentences(
    own: "MetricsPart", validation: "tuple[MetricsPart, ...]"
) -> Iterator[str]:
    """The errors on validation records, compared with that of the identification."""
    for part in validation:
        beside = ""
        if own.rmse_v:
            ratio = part.rmse_v / own.rmse_v - 1
            how = f"{percent(abs(ratio))} {'more' if ratio > 0 else 'less'} than"
            beside = f", {'the same as' if abs(ratio) <= ALIKE else how} in identification"
        yield f"On {part.record}, a validation record, it is {millivolt(part.rmse_v)}{beside}."
    if not validation:
        yield "There is no validation record, so the error on other records is not known."


def parameters_table(result: "Result") -> Table:
    """The parameters with their intervals, where those were computed."""
    if result.constant.assessment is None:
        values = {
            name: significant(value)
            for name, value in readable(result.constant.parameters.to_dict()).items()
        }
        cells = {"parameter": str, "value": values.__getitem__}
        return make_table("The parameters.", values, cells, ["parameter"])
    found = result.constant.assessment.uncertainty
    return make_table(
        f"The parameters with {percent(found.confidence)} intervals that account for "
        "residual autocorrelation. SE: relative standard error; white-noise SE: the same if every "
        "sample were independent; inflation: the ratio of the two.",
        found.estimates,
        {
            "parameter": lambda estimate: _shown(estimate.name)[0],
            "value": lambda estimate: significant(_shown(estimate.name)[1] * estimate.value),
            "from": lambda estimate: _interval_end(estimate, estimate.low),
            "to": lambda estimate: _interval_end(estimate, estimate.high),
            "SE": lambda estimate: _share(estimate.relative_error),
            "white-noise SE": lambda estimate: _share(estimate.white_noise_relative_error),
            "inflation": lambda estimate: fixed(estimate.inflation, 1),
            "held": lambda estimate: held_words(estimate.held) if estimate.held else "",
        },
        ["parameter", "held"],
    )


def _search_blocks(result: "Result") -> list[Bullets | Table]:
    """The search, and the answers of its seeds where there were any."""
    search, refined = result.constant.search, result.constant.refined
    if search is None or refined is None:
        return [Bullets((*seeds_sentences(result), NO_SEEDS))]
    return [
        Bullets((*seeds_sentences(result), _search_sentence(search, refined))),
        seeds_table(result, search),
        optima_table(refined),
    ]


def seeds_table(result: "Result", search: "SearchPart") -> Table:
    """The seeds' answers before refinement."""
    seeds, rows = search.seeds, []
    found = [readable(seed.parameters.to_dict()) for seed in seeds]
    for name, value in readable(result.constant.parameters.to_dict()).items():
        values = [own[name] for own in found]
        rows.append([name, *map(significant, _beside(value, values))])
    own_v = result.constant.metrics.identification.rmse_v
    errors_v = _beside(own_v, [seed.rmse_v for seed in seeds])
    rows.append(["RMSE [mV]", *(fixed(1e3 * error_v, 4) for error_v in errors_v)])
    return rows_table(
        f"The answer beside what {counted(len(seeds), 'seed')} of {search.method} "
        "found before refinement.",
        ["parameter", "answer", "median", "lowest", "highest"],
        rows,
        ["parameter"],
    )


def _beside(answer: float, values: Sequence[float]) -> tuple[float, float, float, float]:
    return answer, float(np.median(values)), min(values), max(values)


def errors_table(result: "Result") -> Table:
    """Errors of the answer on every record (Li et al., 2023, Eq. 22 to 26)."""
    metrics = result.metrics
    rows = [(part, "identification") for part in metrics.jointly]
    rows.append((metrics.identification, "all of these" if rows else "identification"))
    rows += [(part, "validation") for part in metrics.validation]
    return metrics_table(rows)


def metrics_table(rows: "Sequence[tuple[MetricsPart, str]]") -> Table:
    """Errors on records, and what each serves for."""
    caption = f"Errors on {joined([f'{part.record} ({role})' for part, role in rows])}."
    metrics = [part for part, _ in rows]
    cells: Cells[MetricsPart] = {"record": lambda part: part.record, **METRICS}
    return make_table(caption, metrics, cells, ["record"])


def optima_table(refined: "RefinedPart") -> Table:
    """The distinct optima that are known, the best first."""
    optima = {f"optimum {place}": optimum for place, optimum in enumerate(refined.optima, 1)}
    return circuits_table(
        "The circuits at which the refined seeds ended, the best first.",
        {name: optimum.parameters.to_dict() for name, optimum in optima.items()},
        {
            "RMSE [mV]": lambda name: f"{1e3 * optima[name].rmse_v:.4f}",
            "seeds": lambda name: str(optima[name].seeds),
        },
        first="optimum",
    )


def _uncertainty_section(result: "Result") -> list[Section]:
    """The parameters that the data determine, and the errors by band; none where not assessed."""
    found = result.constant.assessment
    if found is None:
        return []
    whose, sentences = "", []
    if result.tables is not None:
        whose = f" of constant {result.constant.model}"
        sentences = [f"This section is about constant {result.constant.model}, not the tables."]
    sentences.append(uncertainty_sentence(found.uncertainty))
    sentences += identifiability_sentences(found.identifiability)
    sentences += diagnostics_sentences(found.diagnostics)
    blocks = []
    if found.examination is not None:
        blocks.append(_examination_table(found.examination))
    told = Bullets(tuple(sentence for sentence in sentences if sentence))
    return [Section("What the data determine", (told, *blocks, _bands_table(found, whose)))]


def _examination_table(examination: "Examination") -> Table:
    return make_table(
        "The same intervals from further fits, by profile likelihood.",
        examination.profiles,
        {
            "parameter": lambda profile: _shown(profile.name)[0],
            "profile, from": lambda profile: _end(profile.name, profile.low),
            "profile, to": lambda profile: _end(profile.name, profile.high),
        },
        ["parameter"],
    )


def _bands_table(found: "AssessmentPart", whose: str) -> Table:
    by = found.diagnostics
    kinds: dict[BandQuantity, tuple[Band, ...]] = {"SOC": by.by_soc, "current": by.by_current}
    if by.by_temperature is not None:
        kinds["temperature"] = by.by_temperature
    rows = [
        [
            kind,
            band_label(kind, band),
            str(band.samples),
            millivolt(band.rmse_v),
            millivolt(band.mean_v),
            percent(band.share),
        ]
        for kind, bands in kinds.items()
        for band in bands
    ]
    return rows_table(
        f"Errors{whose} by {joined(list(kinds))}; the mean is measured minus simulated.",
        ["by", "band", "samples", "RMSE", "mean", "share of the squared error"],
        rows,
        ["by", "band"],
    )


def _search_sentence(search: "SearchPart", refined: "RefinedPart") -> str:
    return (
        f"{search.method} searched with {counted(len(search.seeds), 'seed')} of "
        f"{search.population} candidates and {counted(search.iterations, 'generation')} from the "
        f"key {search.key}, in {search.coordinates} coordinates, by the {search.objective} "
        f"objective: {search.evaluations} evaluations. Levenberg-Marquardt then refined every "
        f"seed's answer in the same box, in {refined.evaluations} more. Every error is computed "
        "by the scan."
    )


def _interval_end(estimate: "Estimate", end: float | None) -> str:
    return NOTHING if estimate.relative_error is None else _end(estimate.name, end)


def _share(ratio: float | None) -> str:
    return NOTHING if ratio is None else percent(ratio)


def _end(name: str, end: float | None) -> str:
    return "open" if end is None else significant(_shown(name)[1] * end, 4)


def _shown(name: str) -> tuple[str, float]:
    """A parameter's name with the unit it is shown in, and the factor to that."""
    return (name.replace("[Ohm]", "[mOhm]"), 1e3) if name.endswith("[Ohm]") else (name, 1.0)
