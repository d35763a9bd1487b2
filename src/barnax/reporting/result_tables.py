"""The tables of a result: its files, errors, circuits, parameters and searches."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..select.choose import Tried
from ..select.policy import Policy
from .document import (
    METRICS,
    Block,
    Bullets,
    Cells,
    Document,
    Paragraph,
    Section,
    Table,
    circuits_table,
    make_table,
    readable,
    rows_table,
    screen,
)
from .view import View
from .wording import sentences, wording
from .words import (
    NOTHING,
    band_label,
    counted,
    errors_words,
    fixed,
    gathered,
    joined,
    millivolt,
    percent,
    significant,
)

if TYPE_CHECKING:
    from ..comparison.result import ComparisonResult, ModelPart
    from ..plan import Plan
    from ..result_parts import Candidate, ConstantPart, InputPart, MetricsPart, PlannedFile
    from ..results import Result
    from ..uncertainty import Assessment, Band, Estimate, Profile
    from .words import BandQuantity

HASH_LETTERS = 16
# What a rung of the family adds.
ADDS = {
    "nodes": "more nodes",
    "pairs": "one more RC pair",
    "hysteresis": "a hysteresis",
    "switched": "a switched hysteresis",
    "law": "a law",
    "without": "rung taken back",
    None: "",
}


def files_table(stored: "Result | ComparisonResult") -> Table:
    """Every file that was read."""
    cells: Cells[InputPart] = {
        "file": lambda part: part.name,
        "used for": lambda part: "OCV test" if part.role == "ocv" else part.role,
        "sign of current": lambda part: part.sign.value if part.sign else "a table",
        "hash": lambda part: part.sha256[:HASH_LETTERS],
    }
    caption = "The files that were read. The hash is the beginning of the file's SHA-256."
    return make_table(caption, stored.inputs, cells, cells)


def plan_table(plan: "Sequence[PlannedFile]") -> Table:
    """Every file of a folder, and why it serves or not."""
    cells: Cells[PlannedFile] = {
        "file": lambda file: file.name,
        "used as": lambda file: file.role,
        "kind": lambda file: file.kind or NOTHING,
        "reason": lambda file: file.reason or NOTHING,
    }
    return make_table("The plan: what the files are, and how they are used.", plan, cells, cells)


def plan_screen(plan: "Plan") -> Document:
    """Every file, what it serves for and why, and the options that the files decide."""
    rows: list[tuple[str, str]] = []
    for part in plan.parts:
        what = f" ({part.kind})" if part.kind else ""
        reason = f": {part.reason}" if part.reason else ""
        rows.append((part.role, f"{part.name}{what}{reason}"))
    for name, value in plan.options.items():
        why = f", {plan.reasons[name]}" if name in plan.reasons else ""
        rows.append((name.replace("_", " "), f"{value}{why}"))
    blocks: list[Block] = [rows_table("", ["", ""], rows, [""], is_bare=True)]
    if plan.command == "hppc":
        blocks.append(Paragraph("A pulse test alone: identified with tables over SOC, as by hppc."))
    return screen(blocks)


def versions_table(stored: "Result | ComparisonResult") -> Table:
    """The versions that can change a digit."""
    heads = ["package", "version"]
    caption = "Package versions that can change the numbers."
    return rows_table(caption, heads, stored.versions.items(), heads)


def search_boxes(searched: "Mapping[str, ConstantPart | ModelPart]") -> list[tuple[Any, ...]]:
    """Every search box: the names of each range, the values that are held, and its models."""
    alike = gathered(
        ((tuple(box.bounds.items()), tuple(box.fixed.items())), model)
        for model, box in searched.items()
    )
    return [
        (gathered((ends, name) for name, ends in bounds), held, models)
        for (bounds, held), models in alike.items()
    ]


def metrics_table(rows: "Sequence[tuple[MetricsPart, str]]") -> Table:
    """Errors on records, and what each serves for (Li et al., 2023, Eq. 22 to 26)."""
    caption = f"Errors on {joined([f'{part.record} ({role})' for part, role in rows])}."
    metrics = [part for part, _ in rows]
    cells: Cells[MetricsPart] = {"record": lambda part: part.record, **METRICS}
    return make_table(caption, metrics, cells, ["record"])


def errors_table(result: "Result") -> Table:
    """Errors of the answer on every record."""
    metrics = result.metrics
    rows = [(part, "identification") for part in metrics.jointly]
    rows.append((metrics.identification, "all of these" if rows else "identification"))
    rows += [(part, "validation") for part in metrics.validation]
    return metrics_table(rows)


# The circuits that were tried.


def circuit_blocks(view: View, tried: Sequence[Tried] = ()) -> tuple[Block, ...]:
    """The answer and the constant circuit with their errors, and how the answer was chosen; nothing
    where there was no choice."""
    if len(view.candidates) < 2 and len(tried) < 2:
        return ()
    table = candidates_table(view)
    if not tried:
        return (table,)
    return Bullets(sentences("circuit.rule", Policy())), table, choice_table(tried)


def choice_document(result: "Result") -> Document:
    """How the circuit of a result was chosen."""
    blocks = circuit_blocks(View(result), result.tried)
    sections = (Section("Circuits", blocks),) if blocks else ()
    return Document("How the circuit was chosen", "", sections)


def candidates_table(view: View) -> Table:
    """The errors of every circuit on all records, the answer first."""
    cells: Cells[Candidate] = {
        "circuit": lambda candidate: candidate.name,
        "identification [mV]": lambda candidate: errors_words(candidate.identification),
    }
    for index, part in enumerate(view.validation):
        cells[f"{part.name} [mV]"] = lambda candidate, index=index: fixed(
            1e3 * candidate.validation_v[index], 1
        )
    text = ["circuit", "identification [mV]", "left out [mV]", "proved: better by at most", ""]
    cells["left out [mV]"] = lambda candidate: errors_words(candidate.held_out)
    cells["proved: better by at most"] = lambda candidate: (
        "not proved"
        if candidate.proved_gap is None or candidate.proved_gap >= 1
        else percent(candidate.proved_gap)
    )
    cells[""] = lambda candidate: "the answer" if candidate.is_answer else ""
    caption = "RMSE in mV, in brackets that above 10 % SOC, of the answer"
    caption += " and the constant circuit." if len(view.candidates) > 1 else "."
    return make_table(caption, view.candidates, cells, text)


def choice_table(tried: Sequence[Tried]) -> Table:
    """Every circuit that was tried, in order, with what it gained on the one before."""

    def gain(rung: Tried) -> str:
        if rung.gain is None:
            return NOTHING
        return f"{fixed(rung.gain.value, 3)} ({fixed(rung.gain.standard_error, 3)})"

    cells: Cells[Tried] = {
        "circuit": lambda rung: rung.circuit,
        "nodes": lambda rung: str(rung.nodes),
        "follows": lambda rung: joined(rung.follows),
        "adds": lambda rung: ADDS[rung.ladder],
        "fitted [mV]": lambda rung: fixed(1e3 * rung.rmse_v, 2),
        "held out [mV]": lambda rung: errors_words(rung.held_out),
        "gain (standard error)": gain,
        "": lambda rung: rung.outcome,
    }
    return make_table(
        wording("circuit.chosen"),
        tried,
        cells,
        ["circuit", "nodes", "adds", "held out [mV]", "gain (standard error)", ""],
    )


# The constant circuit.


def parameters_table(result: "Result") -> Table:
    """The constant circuit's parameters with their intervals, where those were computed."""
    if result.constant.assessment is None:
        values = readable(result.constant.parameters.to_dict())
        cells: Cells[str] = {"parameter": str, "value": lambda name: significant(values[name])}
        return make_table("The parameters.", values, cells, ["parameter"])
    uncertainty = result.constant.assessment.uncertainty

    def end(estimate: "Estimate", value: float | None) -> str:
        return NOTHING if estimate.relative_error is None else _end(estimate.name, value)

    of_estimate: Cells[Estimate] = {
        "parameter": lambda estimate: _shown(estimate.name)[0],
        "value": lambda estimate: significant(_shown(estimate.name)[1] * estimate.value),
        "from": lambda estimate: end(estimate, estimate.low),
        "to": lambda estimate: end(estimate, estimate.high),
        "SE": lambda estimate: percent(estimate.relative_error),
        "white-noise SE": lambda estimate: percent(estimate.white_noise_relative_error),
        "inflation": lambda estimate: fixed(estimate.inflation, 1),
        "held": lambda estimate: wording("circuit.held", estimate.held) if estimate.held else "",
    }
    return make_table(
        wording("circuit.parameters", uncertainty.confidence),
        uncertainty.estimates,
        of_estimate,
        ["parameter", "held"],
    )


def assessment_tables(assessment: "Assessment") -> tuple[Table, ...]:
    """The intervals by profile likelihood, where those were computed, and the errors by band."""
    by = assessment.diagnostics
    kinds: dict[BandQuantity, tuple[Band, ...]] = {"SOC": by.by_soc, "current": by.by_current}
    if by.by_temperature is not None:
        kinds["temperature"] = by.by_temperature
    cells: Cells[tuple[BandQuantity, Band]] = {
        "by": lambda row: row[0],
        "band": lambda row: band_label(*row),
        "samples": lambda row: str(row[1].samples),
        "RMSE": lambda row: millivolt(row[1].rmse_v),
        "mean": lambda row: millivolt(row[1].mean_v),
        "share of the squared error": lambda row: percent(row[1].share),
    }
    caption = f"Errors by {joined(list(kinds))}; the mean is measured minus simulated."
    bands: list[tuple[BandQuantity, Band]]
    bands = [(kind, band) for kind, of_kind in kinds.items() for band in of_kind]
    table = make_table(caption, bands, cells, ["by", "band"])
    if assessment.examination is None:
        return (table,)
    of_profile: Cells[Profile] = {
        "parameter": lambda profile: _shown(profile.name)[0],
        "profile, from": lambda profile: _end(profile.name, profile.low),
        "profile, to": lambda profile: _end(profile.name, profile.high),
    }
    caption = "The same intervals from further fits, by profile likelihood."
    profiles = assessment.examination.profiles
    return make_table(caption, profiles, of_profile, ["parameter"]), table


def seed_tables(result: "Result") -> tuple[Table, ...]:
    """The seeds' answers before refinement, and the distinct optima after it; nothing without."""
    search, refined = result.constant.search, result.constant.refined
    if search is None or refined is None:
        return ()
    seeds = [readable(seed.parameters.to_dict()) for seed in search.seeds]
    rows = [
        [name, *map(significant, _beside(value, [seed[name] for seed in seeds]))]
        for name, value in readable(result.constant.parameters.to_dict()).items()
    ]
    answer_v = result.constant.metrics.identification.rmse_v
    errors_v = _beside(answer_v, [seed.rmse_v for seed in search.seeds])
    rows.append(["RMSE [mV]", *(fixed(1e3 * error_v, 4) for error_v in errors_v)])
    caption = f"The answer beside what {counted(len(seeds), 'seed')} of {search.method} found"
    heads = ["parameter", "answer", "median", "lowest", "highest"]
    optima = {f"optimum {number}": optimum for number, optimum in enumerate(refined.optima, 1)}
    return rows_table(f"{caption} before refinement.", heads, rows, ["parameter"]), circuits_table(
        "The circuits at which the refined seeds ended, the best first.",
        {name: optimum.parameters.to_dict() for name, optimum in optima.items()},
        {
            "RMSE [mV]": lambda name: f"{1e3 * optima[name].rmse_v:.4f}",
            "seeds": lambda name: str(optima[name].seeds),
        },
        first="optimum",
    )


def _beside(answer: float, values: Sequence[float]) -> tuple[float, float, float, float]:
    return answer, float(np.median(values)), min(values), max(values)


def _end(name: str, end: float | None) -> str:
    return "open" if end is None else significant(_shown(name)[1] * end, 4)


def _shown(name: str) -> tuple[str, float]:
    """A parameter's name with the unit it is shown in, and the factor to that."""
    return (name.replace("[Ohm]", "[mOhm]"), 1e3) if name.endswith("[Ohm]") else (name, 1.0)
