"""The comparison itself: every row run, cross-checked and set against every other."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import replace

import numpy as np

from ..bounds import Bounds, Range
from ..cell import CellModel, get_circuit
from ..coordinates import Scale
from ..course import Course, make_course
from ..descent import Descent
from ..errors import InputError
from ..evaluate import evaluate_course
from ..methods import METHODS, Answer, Budget, MethodFailure
from ..methods.stored import can_be_stored, from_arrays, to_arrays
from ..methods.transfer_function import outside_box
from ..optimum import GlobalOptimum, global_optimum, regret
from ..precision import in_float64
from ..problem import Kind, Problem, make_problem
from ..programs import Finished
from ..records import Record
from ..refinement import FINAL_ROUNDS, FINAL_TOLERANCE, at_bound
from ..window import Window
from .rows import Comparison, Difference, Row
from .statistics import compare_over_seeds, compare_over_time, errors_by_soc

# The rows of Li et al. (2023), Tables 3 to 5: model and method.
PAPER_ROWS = (
    ("so-rc", "ls"),
    ("so-rc", "pso"),
    ("so-rc", "bmo"),
    ("iso-rc", "bmo"),
    ("iso-rc", "ibmo"),
)
# Asked with a row's name, or with what else is done, it gives a context that is told of finished
# seeds.
Watch = Callable[[str], AbstractContextManager[Callable[[int], None]]]
CROSS_CHECK, OPTIMA, DIFFERENCES = "cross-check", "global optima", "differences"


def unwatched(name: str) -> AbstractContextManager[Callable[[int], None]]:
    """Watch nothing."""
    del name
    return nullcontext(lambda gained: None)


def compare(
    record: Record,
    cell: CellModel,
    rows: Sequence[tuple[str, str]] = PAPER_ROWS,
    *,
    validation: Sequence[Record] = (),
    window: Window | None = None,
    bounds: Mapping[str, Range] | None = None,
    fixed: Mapping[str, float] | None = None,
    coordinates: Scale = "rc",
    objective: Kind = "scan",
    budget: Budget | None = None,
    source: str = "bounds",
    watch: Watch = unwatched,
    finished: Finished | None = None,
) -> Comparison:
    """Every row's method on its model, on the same data, box, budget and key.

    `rows` are pairs of a model and a method of `barnax.methods.METHODS`. Bounds and fixed values
    apply to the models that have such a parameter. `watch` is asked for a context for every row,
    by its name, and is told in it how many seeds have finished. `finished` holds the searches that
    are done and is filled on the way: given again with all else the same, the comparison goes on
    from there to the same bits. A method that cannot answer is a row that says why. Raises
    `InputError` where record, window or box do not fit, `ValueError` for an unknown model or
    method.

    >>> compare(None, None, [("so-rc", "guess")])
    Traceback (most recent call last):
    ValueError: no method is called 'guess'; there are ls, rls, varpro, ...
    """
    for _, method in rows:
        if method not in METHODS:
            raise ValueError(f"no method is called {method!r}; there are {', '.join(METHODS)}")
    budget, window = budget or Budget(), window or Window()
    problems = make_problems(
        record,
        cell,
        list(dict.fromkeys(model for model, _ in rows)),
        window=window,
        bounds=bounds or {},
        fixed=fixed or {},
        coordinates=coordinates,
        objective=objective,
        source=source,
    )
    courses = {
        model: [problem.course, *(make_course(other, cell, model, window) for other in validation)]
        for model, problem in problems.items()
    }
    finished = {} if finished is None else finished
    answered = [
        _run(problems[model], courses[model], method, budget, watch, finished)
        for model, method in rows
    ]
    with watch(CROSS_CHECK):
        refined = _refine(answered)
    with watch(OPTIMA):
        optima = _optima(problems)
    with watch(DIFFERENCES):
        differences = _differences(refined, budget.key)
    measured = tuple(_with_regret(row, optima) for row in refined)
    return Comparison(measured, budget, differences, optima)


def make_problems(
    record: Record,
    cell: CellModel,
    models: Sequence[str],
    *,
    window: Window,
    bounds: Mapping[str, Range],
    fixed: Mapping[str, float],
    coordinates: Scale,
    objective: Kind,
    source: str,
) -> dict[str, Problem]:
    """One problem a model; a bound or fixed value goes to the models that know its name."""
    known = {model: _names_of(model) for model in models}
    everywhere = set().union(*known.values())

    def known_to(model: str, values: Mapping) -> dict:
        # A name that no model knows is left for the first to complain of.
        return {
            name: value
            for name, value in values.items()
            if name in known[model] or name not in everywhere
        }

    return {
        model: make_problem(
            record,
            cell,
            model,
            window=window,
            bounds=known_to(model, bounds),
            fixed=known_to(model, fixed),
            coordinates=coordinates,
            objective=objective,
            source=source,
        )
        for model in models
    }


def _names_of(model: str) -> set[str]:
    """Every name under which a parameter of a model can be bounded or fixed."""
    circuit = get_circuit(model)
    return set(Bounds.default(1.0, 1.0, 1.0, pairs=circuit.pairs, has_rate=circuit.has_rate).names)


@in_float64
def _run(
    problem: Problem,
    courses: Sequence[Course],
    method: str,
    budget: Budget,
    watch: Watch,
    finished: Finished,
) -> Row:
    """One row, before its cross-check."""
    row = Row(problem.circuit, method, problem, METHODS[method].is_deterministic)
    with watch(row.name) as advance:
        try:
            answers = _answers(row, method, budget, advance, finished)
        except (MethodFailure, InputError, np.linalg.LinAlgError) as failure:
            return replace(row, failure=str(failure))
    row = replace(row, answers=tuple(answers))
    evaluations = [evaluate_course(course, row.median.parameters) for course in courses]
    bands = [
        errors_by_soc(each.error_v, each.course.soc, each.course.scored) for each in evaluations
    ]
    parameters = row.median.parameters
    box = problem.objective_in("log").coordinates
    return replace(
        row,
        notes=row.median.notes,
        evaluations=tuple(evaluations),
        bands=tuple(bands),
        # A linear method may leave the box; its note says so.
        at_bound=() if outside_box(parameters, problem) else at_bound(box, parameters),
    )


def _answers(
    row: Row, method: str, budget: Budget, advance: Callable[[int], None], finished: Finished
) -> list[Answer]:
    """What the method finds, or found before."""
    if row.name in finished:
        answers = from_arrays(finished[row.name], get_circuit(row.model))
        advance(len(answers))
        return answers
    answers = METHODS[method].run(row.problem, budget, advance)
    if can_be_stored(answers):
        finished[row.name] = to_arrays(answers)
    return answers


def _refine(rows: Sequence[Row]) -> list[Row]:
    """The rows with what Levenberg-Marquardt makes of each median seed, model by model."""
    done = {row.name: row for row in rows}
    for model in dict.fromkeys(row.model for row in rows):
        here = [row for row in rows if row.model == model and row.failure is None]
        if not here:
            continue
        descent = Descent(here[0].problem)
        ends = descent([row.median.parameters for row in here], FINAL_TOLERANCE)
        for _ in range(FINAL_ROUNDS):
            moving = [index for index, end in enumerate(ends) if not end.has_converged]
            if not moving:
                break
            starts = [ends[index].parameters for index in moving]
            again = descent(starts, FINAL_TOLERANCE, holds_bounds=True)
            for index, end in zip(moving, again, strict=True):
                ends[index] = end
        for row, end in zip(here, ends, strict=True):
            done[row.name] = replace(row, refined=end)
    return [done[row.name] for row in rows]


def _optima(problems: Mapping[str, Problem]) -> dict[str, GlobalOptimum]:
    """The global optimum of every model whose box is not too wide for it."""
    found = {}
    for model, problem in problems.items():
        with suppress(InputError):
            found[model] = global_optimum(problem)
    return found


def _with_regret(row: Row, optima: Mapping[str, GlobalOptimum]) -> Row:
    if row.failure is not None or row.model not in optima:
        return row
    return replace(row, regret=regret(row.median.rmse_v, optima[row.model].rmse_v))


def _differences(rows: Sequence[Row], key: int) -> tuple[Difference, ...]:
    """Every pair of answered rows on every record, the first row against the second."""
    found = []
    pairs = itertools.combinations([row for row in rows if row.failure is None], 2)
    for first, second in pairs:
        for place, evaluations in enumerate(
            zip(first.evaluations, second.evaluations, strict=True)
        ):
            one, other = (each.error_v[each.course.scored] for each in evaluations)
            over_seeds = compare_over_seeds(first.errors_v, second.errors_v)
            found.append(
                Difference(
                    first=first.name,
                    second=second.name,
                    record=evaluations[0].course.record.name,
                    is_validation=place > 0,
                    over_time=compare_over_time(one, other, key),
                    over_seeds=None if place > 0 else over_seeds,
                )
            )
    return tuple(found)
