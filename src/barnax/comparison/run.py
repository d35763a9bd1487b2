"""Models and methods side by side on one cell: run, and compared with each other."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..baselines import METHODS, Budget, MethodFailure
from ..baselines.regression import outside_box
from ..cell import CellModel, get_circuit
from ..errors import InputError, require_choice
from ..execution import Watch, in_float64, unwatched
from ..global_optimum.assumptions import with_better_directions, without_sweep_drop
from ..global_optimum.search import GlobalOptimum, optimality_gap
from ..identification.answer import optimum_or_none, search_and_assess
from ..identification.setup import first_circuit, problem_of, set_up, settled
from ..inputs import listed, read_inputs, windows_of
from ..job import Job, takes_options, window_of
from ..model.prepared import PreparedRecord, prepare_record
from ..model.problem import Problem, applicable_to, make_problem
from ..records import Record
from ..result_parts import InputPart, versions
from ..search.evaluate import evaluate, evaluate_from_either
from ..search.seeds import FINAL_ROUNDS, FINAL_TOLERANCE, Descent, at_bound
from ..settings import TableOptions
from .result import (
    ComparisonResult,
    Difference,
    ModelPart,
    RecordErrors,
    Row,
    compare_over_seeds,
    compare_over_time,
)

# The rows of Li et al. (2023), Tables 3 to 5: model and method.
PAPER_ROWS = (
    ("so-rc", "ls"),
    ("so-rc", "pso"),
    ("so-rc", "bmo"),
    ("iso-rc", "bmo"),
    ("iso-rc", "ibmo"),
)
# Stages of progress in addition to the rows, which have their names.
REFINEMENT, OPTIMA, DIFFERENCES = "refinement", "global optima", "differences"


# Options of a single circuit, or of its tables.
_OF_ONE = {*vars(TableOptions()), *("model", "method", "over", "trust", "cell", "tables")}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ComparisonJob(Job):
    """A job whose circuits and methods are `rows`.

    Args:
        rows: Pairs of a circuit and a method of `METHODS`, by default those of Li et al. (2023).

    Raises `InputError` for an unknown circuit or method, and for an option of one circuit.

    >>> ComparisonJob(rows=[("so-rc", "guess")])
    Traceback (most recent call last):
    barnax.errors.InputError: `methods` 'guess' is not known; there are ls, rls, wrls, ...
    """

    rows: Sequence[tuple[str, str]] = PAPER_ROWS

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in [name for name in self.chosen if name in _OF_ONE]:
            raise InputError(f"`{name}` is of one circuit; a comparison has `models` and `methods`")
        for model, method in self.rows:
            get_circuit(model, "models")
            require_choice("methods", method, METHODS)


def compare(
    record: Record, cell: CellModel, job: ComparisonJob, validation: Sequence[Record] = ()
) -> ComparisonResult:
    """Several circuits and methods compared on the same data, box, budget and key.

    A method that fails has a row with the reason.

    Args:
        record: The record to identify on.
        cell: A cell from `characterize`.
        job: The rows, and from the options of `identify` those of the search and of windows. Bounds
            and fixed values apply to the circuits that have such a parameter; `watch` is called
            with the name of every row.
        validation: Records to validate on.

    Raises `InputError` if record, window or box do not fit.

    >>> compare(None, None, ComparisonJob(rows=[("so-rc", "guess")]))
    Traceback (most recent call last):
    barnax.errors.InputError: `methods` 'guess' is not known; there are ls, rls, wrls, ...
    """
    budget = Budget(job.population, job.iterations, job.seeds, job.key)
    objective = "scan" if job.objective == "auto" else job.objective
    models = tuple(dict.fromkeys(model for model, _ in job.rows))

    def make(model: str, cell: CellModel) -> Problem:
        given = job.ranges.by_name, job.fix
        bounds, fixed = (applicable_to(model, values, models) for values in given)
        return make_problem(
            record, cell, model,
            window=window_of(job.window, record.name), bounds=bounds, fixed=fixed,
            coordinates=job.coordinates, objective=objective, source=job.ranges.source,
        )  # fmt: skip

    # All use the rest OCV from the first model's circuit.
    cell = without_sweep_drop(make(models[0], cell)).cell
    problems = {model: with_better_directions(make(model, cell)) for model in models}
    others = [(other, window_of(job.window, other.name)) for other in validation]
    validated = {
        model: [prepare_record(other, cell, model, its) for other, its in others]
        for model in models
    }
    answered = [
        _run(problems[model], validated[model], method, budget, job.watch)
        for model, method in job.rows
    ]
    return _result(problems, answered, budget, job.watch)


def _result(
    problems: Mapping[str, Problem], answered: Sequence[Row], budget: Budget, watch: Watch
) -> ComparisonResult:
    """The result of answered rows: refined, with the global optima, and compared."""
    with watch(OPTIMA):
        optima = {model: optimum_or_none(problem) for model, problem in problems.items()}
    with watch(REFINEMENT):
        refined = _refine(answered, optima)
    with watch(DIFFERENCES):
        differences = _differences(refined, budget.key)
    first, *_ = problems.values()
    evaluated = next((row.evaluations for row in refined if row.failure is None), ())
    inputs = [
        InputPart.simulated("validation" if index else "identification", evaluation)
        for index, evaluation in enumerate(evaluated)
    ]
    notices = [warning for problem in problems.values() for warning in problem.warnings]
    for tried in (evaluation for row in refined for evaluation in row.evaluations):
        notices += [*tried.prepared.record.warnings, *tried.prepared.warnings]
    return ComparisonResult(
        rows=tuple(refined),
        differences=differences,
        models={
            model: ModelPart(
                bounds=dict(problem.bounds.ranges),
                fixed=dict(problem.bounds.fixed),
                optimum=optima[model],
            )
            for model, problem in problems.items()
        },
        budget=budget,
        coordinates=first.scale,
        objective=first.kind,
        cell=first.cell,
        inputs=tuple(inputs or [InputPart.of("identification", first.prepared.record)]),
        warnings=tuple(dict.fromkeys(notices)),
        versions=versions(),
    )


@in_float64
def _run(
    problem: Problem, validated: Sequence[PreparedRecord], method: str, budget: Budget, watch: Watch
) -> Row:
    """One row, before its refinement."""
    source, is_deterministic = METHODS[method].source, METHODS[method].is_deterministic
    row = Row(problem.circuit, method, source, is_deterministic, problem=problem)
    with watch(row.name) as advance:
        try:
            answers = METHODS[method].run(problem, budget, advance)
        except (MethodFailure, InputError) as failure:
            return replace(row, failure=str(failure))
        except np.linalg.LinAlgError:
            return replace(row, failure="its equations have no solution on these data")
    row = replace(row, answers=tuple(answers))
    parameters = row.median.parameters
    evaluated = partial(evaluate, parameters=parameters)
    evaluations = [evaluated(problem.prepared)]
    evaluations += [evaluate_from_either(prepared, evaluated) for prepared in validated]
    box = problem.log_coordinates
    return replace(
        row,
        evaluations=tuple(evaluations),
        errors=tuple(map(RecordErrors.of, evaluations)),
        # A linear method may leave the box; its note says so.
        at_bound=() if outside_box(parameters, problem) else at_bound(box, parameters),
    )


def _refine(rows: Sequence[Row], optima: Mapping[str, GlobalOptimum | None]) -> list[Row]:
    """The rows with the Levenberg-Marquardt refinement of each median seed, model by model, and the
    distance of that seed from the global optimum."""
    done = {row.name: row for row in rows}
    for model in dict.fromkeys(row.model for row in rows):
        here = [row for row in rows if row.model == model and row.failure is None]
        if not here:
            continue
        descent = Descent(here[0].problem)
        ends = descent([row.median.parameters for row in here], FINAL_TOLERANCE)
        ends, _ = descent.led_on(ends, FINAL_TOLERANCE, FINAL_ROUNDS)
        best = optima[model]
        for row, end in zip(here, ends, strict=True):
            gap = None if best is None else optimality_gap(row.median.rmse_v, best.rmse_v)
            done[row.name] = replace(row, refined=end, optimality_gap=gap)
    return [done[row.name] for row in rows]


def _differences(rows: Sequence[Row], key: int) -> tuple[Difference, ...]:
    """Every pair of answered rows on every record, the first row against the second."""
    differences = []
    for first, second in itertools.combinations([row for row in rows if row.failure is None], 2):
        over_seeds = compare_over_seeds(first.errors_v, second.errors_v)
        for index, both in enumerate(zip(first.evaluations, second.evaluations, strict=True)):
            one, other = (evaluation.error_v[evaluation.prepared.scored] for evaluation in both)
            differences.append(
                Difference(
                    first.name,
                    second.name,
                    record=both[0].prepared.record.name,
                    is_validation=index > 0,
                    over_time=compare_over_time(one, other, key),
                    over_seeds=None if index else over_seeds,
                )
            )
    return tuple(differences)


@takes_options(ComparisonJob)
def compare_files(job: ComparisonJob) -> ComparisonResult:
    """Models and methods compared on one record, as `compare` does, after the usual circuits.

    All other options are those of `identify`; those of a single circuit (`model`, `method`,
    `trust`, `cell` and tables) are refused.

    Args:
        records: The file, `Record` or data frame to identify on. None: the bundled cell.
        ocv: The OCV test of the same cell.
        validate: Files, records or data frames to validate on.
        rows: Pairs of a circuit and a method of `METHODS`, by default those of the paper.
        setup: "li2023" for the OCV polynomial of Li et al. (2023), whose rows are the default.
        watch: Called for every row, as in `compare`.

    Raises `InputError` if an input cannot be used, or more than one record is given.
    """
    records = listed(job.records)
    if len(records) > 1:
        raise InputError(
            f"a comparison uses one record, but {len(records)} were given; give the others with "
            "`validate`"
        )
    inputs = read_inputs(job)
    windows = windows_of(inputs, job.window, job.capacity)
    in_windows = job.changed(window=windows)
    compared = compare(inputs.records[0], inputs.cell, in_windows, inputs.validation)
    with job.watch("Circuits", 0):
        alone = Job(seeds=0, bounds=job.bounds, fix=job.fix)
        first = settled(problem_of(inputs, windows, alone, first_circuit(inputs, alone)))
        setup = set_up(first, inputs, windows, alone)
        usual = search_and_assess(setup, None, alone, "none", unwatched)
    tests = [InputPart.of("ocv", test) for test in inputs.ocv]
    notices = [warning for test in inputs.ocv for warning in test.warnings]
    notices += [*inputs.warnings, *compared.warnings]
    parts = {"candidates": usual.candidates, "inputs": (*compared.inputs, *tests)}
    return compared.model_copy(update={**parts, "warnings": tuple(dict.fromkeys(notices))})
