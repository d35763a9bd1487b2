"""`comparison.json`: what a comparison found, and from files to it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from ..baselines import Budget
from ..cell import CellModel, OcvTable
from ..errors import InputError
from ..execution import unwatched
from ..global_optimum.search import GlobalOptimum
from ..identification import search_and_assess
from ..inputs import listed, read_inputs, windows_of
from ..job import Job, takes_options
from ..model.coordinates import Scale
from ..model.problem import Kind
from ..model.search_space import ranges_of
from ..notices import Notice
from ..records import Record
from ..result_parts import Candidate, InputPart, all_versions
from ..run_setup import problem_of, set_up, settled
from ..schema import Document, Parameters, Part, Told
from ..settings import TableOptions
from .run import PAPER_ROWS, Comparison, Difference, Row, compare

# Options of one circuit, or of its tables.
_OF_ONE = {*vars(TableOptions()), *("model", "method", "over", "trust", "cell", "tables")}


class ModelPart(Part):
    """The search box of one model, and its global optimum where that is known."""

    bounds: dict[str, tuple[float, float]]
    fixed: Parameters
    optimum: GlobalOptimum | None = None


class ComparisonResult(Document):
    """The contents of `comparison.json`. Equal runs give equal bytes: no times, dates or folders.

    Times are in `timings.json`; reports take them separately, in s by the name of the row.

    Attributes:
        schema_version: Version of the schema.
        rows: One method on one model each.
        differences: Differences between rows, and their significance.
        candidates: The usual circuits, each the best of its kind, and tables over SOC.
        models: Box and global optimum of each model.
        budget: What every method could spend.
        coordinates: Search coordinates: "rc", or logarithms of R and tau.
        objective: How errors were computed: by "scan" or "compressed".
        cell: OCV, hysteresis voltage and capacity.
        inputs: Every file, with its digest and what was decided about it.
        warnings: What is doubtful, with what to do.
        versions: Versions of barnax and of what it computes with.
    """

    schema_version: Literal[6] = 6
    rows: tuple[Row, ...]
    differences: tuple[Difference, ...]
    candidates: tuple[Candidate, ...] = ()
    models: dict[str, ModelPart]
    budget: Budget
    coordinates: Scale
    objective: Kind
    cell: CellModel
    inputs: tuple[InputPart, ...]
    warnings: tuple[Told, ...]
    versions: dict[str, str]

    @model_validator(mode="after")
    def _be_whole(self) -> Self:
        for row in self.answered:
            if not row.answers or len(row.errors) != len(self.answered[0].errors):
                raise ValueError(f"{row.name} lacks answers, or errors on some record")
        if unknown := {row.model for row in self.rows} - self.models.keys():
            raise ValueError(f"there is no box of {', '.join(sorted(unknown))}")
        return self

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ComparisonResult) and self.to_json() == other.to_json()

    @property
    def answered(self) -> tuple[Row, ...]:
        """The rows that have an answer."""
        return tuple(row for row in self.rows if row.failure is None)

    what: ClassVar[str] = "barnax comparison"
    remedy: ClassVar[str] = "give the comparison.json that barnax compare wrote"


def make_comparison_result(
    comparison: Comparison,
    candidates: Sequence[Candidate] = (),
    *,
    ocv: Sequence[Record | OcvTable] = (),
    warnings: Sequence[Notice] = (),
) -> ComparisonResult:
    """A comparison as a `ComparisonResult`, which can be stored.

    Args:
        comparison: A comparison from `compare`.
        candidates: The circuit that held-out blocks choose, and a constant one.
        ocv: The OCV tests of the cell.
        warnings: Those of the inputs.
    """
    problems = {row.model: row.problem for row in comparison.rows}
    first = next(iter(problems.values()))
    inputs = [InputPart.of("identification", first.prepared.record)]
    if comparison.answered:
        own, *others = comparison.answered[0].evaluations
        inputs = [InputPart.simulated("identification", own)]
        inputs += [InputPart.simulated("validation", record) for record in others]
    inputs += [InputPart.of("ocv", test) for test in ocv]
    told = [warning for test in ocv for warning in test.warnings] + list(warnings)
    told += [warning for problem in problems.values() for warning in problem.warnings]
    for tried in (evaluation for row in comparison.rows for evaluation in row.evaluations):
        told += [*tried.prepared.record.warnings, *tried.prepared.warnings]
    return ComparisonResult(
        rows=comparison.rows,
        differences=comparison.differences,
        candidates=tuple(candidates),
        models={
            model: ModelPart(
                bounds=dict(problem.bounds.ranges),
                fixed=dict(problem.bounds.fixed),
                optimum=comparison.optima.get(model),
            )
            for model, problem in problems.items()
        },
        budget=comparison.budget,
        coordinates=first.scale,
        objective=first.kind,
        cell=first.cell,
        inputs=tuple(inputs),
        warnings=tuple(dict.fromkeys(told)),
        versions=all_versions(),
    )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ComparisonJob(Job):
    """A job whose circuits and methods are `rows`."""

    rows: Sequence[tuple[str, str]] = PAPER_ROWS

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.chosen.keys() & _OF_ONE:
            raise InputError(f"`{name}` is of one circuit; a comparison has `models` and `methods`")


@takes_options(ComparisonJob)
def compare_files(job: ComparisonJob) -> tuple[Comparison, ComparisonResult]:
    """Models and methods compared on one record, as objects and as a result that can be stored.

    All other options are those of `identify`, but for what is of one circuit: `model`, `method`,
    `trust`, `cell` and all of tables.

    Args:
        records: The file, `Record` or data frame to identify on. None: the bundled cell.
        ocv: The OCV test of the same cell.
        validate: Files, records or data frames to validate on.
        rows: Pairs of a circuit and a method of `METHODS`, by default those of the paper.
        setup: "li2023" for the OCV polynomial of Li et al. (2023), whose rows are the default.
        watch: Called for every row, as in `compare`.

    Raises `InputError` if an input cannot be used, or more than one record is given.
    """
    records, watch = listed(job.records), job.watch
    if len(records) > 1:
        raise InputError(
            f"a comparison uses one record, but {len(records)} were given; give the others with "
            "`validate`"
        )
    inputs = read_inputs(job)
    windows = windows_of(inputs, job.window, job.capacity)
    source, ranges = ranges_of(job.bounds)
    comparison = compare(
        inputs.records[0],
        inputs.cell,
        job.rows,
        validation=inputs.validation,
        window=windows[inputs.records[0].name],
        validation_windows=[windows[record.name] for record in inputs.validation],
        bounds=ranges,
        fixed=job.fix,
        coordinates=job.coordinates,
        objective="scan" if job.objective == "auto" else job.objective,
        budget=Budget(job.population, job.iterations, job.seeds, job.key),
        source=source,
        watch=watch,
    )
    with watch("Circuits", 0):
        alone = Job(seeds=0, bounds=job.bounds, fix=job.fix, tables=job.table_settings)
        setup = set_up(settled(problem_of(inputs, windows, alone)), inputs, windows, alone)
        usual = search_and_assess(setup, None, alone, "none", unwatched)
    result = make_comparison_result(
        comparison, usual.candidates, ocv=inputs.ocv, warnings=inputs.warnings
    )
    return comparison, result
