"""Models and methods side by side on one cell: what each row of a comparison is."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Self

import numpy as np
from jaxtyping import Float

from ..baselines import METHODS, Answer, Budget, MethodFailure
from ..baselines.regression import outside_box
from ..cell import CellModel
from ..display import Brief
from ..errors import InputError
from ..execution import Watch, in_float64, unwatched
from ..global_optimum.search import (
    GlobalOptimum,
    optimality_gap,
    with_better_directions,
    without_sweep_drop,
)
from ..identification import optimum_or_none
from ..model.coordinates import Scale
from ..model.prepared import PreparedRecord, prepare_record
from ..model.problem import Kind, Problem, known_to, make_problem
from ..model.search_space import Range
from ..model.window import Window
from ..records import Record
from ..result_parts import MetricsPart
from ..schema import Unstored
from ..search.evaluate import Evaluation, evaluate, evaluate_from_either
from ..search.refine import FINAL_ROUNDS, FINAL_TOLERANCE, AtBound, Descent, RefinedSeed, at_bound
from .statistics import (
    BandError,
    Resampled,
    SeedPairs,
    compare_over_seeds,
    compare_over_time,
    errors_by_soc,
)


@dataclass(frozen=True)
class RecordErrors:
    """Errors of a row's own answer on one record, in all and by SOC."""

    metrics: MetricsPart
    bands: tuple[BandError, ...]

    @classmethod
    def of(cls, evaluation: Evaluation) -> Self:
        """The errors of an evaluation."""
        prepared = evaluation.prepared
        bands = errors_by_soc(evaluation.error_v, prepared.soc, prepared.scored)
        return cls(MetricsPart.of(evaluation), bands)


@dataclass(frozen=True, eq=False, repr=False)
class Row(Brief):
    """One method on one model. Everything but `refined` is of the method's own answers.

    Attributes:
        model: Name of the circuit.
        method: One of `METHODS`.
        source: Where the method comes from.
        is_deterministic: True for a method that draws nothing.
        answers: One a seed, a single one where the method draws nothing, and none where it failed.
        failure: Why there is no answer.
        errors: Those of the median seed on the identification record, then on each validation
            record.
        at_bound: Its parameters that are at an end of the box.
        refined: What Levenberg-Marquardt makes of it.
        optimality_gap: Its RMSE over the global optimum's, minus one.
        problem: What was identified; None of a stored row.
        evaluations: What `errors` are of; none likewise.
    """

    model: str
    method: str
    source: str
    is_deterministic: bool
    answers: tuple[Answer, ...] = ()
    failure: str | None = None
    errors: tuple[RecordErrors, ...] = ()
    at_bound: tuple[AtBound, ...] = ()
    refined: RefinedSeed | None = None
    optimality_gap: float | None = None
    problem: Unstored[Any] = None
    evaluations: Unstored[tuple[Evaluation, ...]] = ()

    @property
    def name(self) -> str:
        return f"{self.method} {self.model}"

    @property
    def median(self) -> Answer:
        """The seed whose RMSE is the median; of an even number, the better of the middle two."""
        ranked = sorted(self.answers, key=lambda answer: answer.rmse_v)
        return ranked[(len(ranked) - 1) // 2]

    @property
    def errors_v(self) -> Float[np.ndarray, "seeds"]:
        """RMSE of every seed, in V, in the order of the seeds."""
        return np.array([answer.rmse_v for answer in self.answers])

    @property
    def spread_v(self) -> tuple[float, float, float] | None:
        """The best and the worst RMSE of the seeds and their standard deviation, in V; None of a
        method that draws nothing. A seed that failed altogether is infinitely far away."""
        if self.is_deterministic:
            return None
        errors_v = self.errors_v
        deviation_v = 0.0 if len(errors_v) == 1 else math.inf
        if len(errors_v) > 1 and np.isfinite(errors_v).all():
            deviation_v = float(np.std(errors_v, ddof=1))
        return float(errors_v.min()), float(errors_v.max()), deviation_v


@dataclass(frozen=True)
class Difference:
    """The error of one row minus another's, on one record, and whether it is more than chance.

    `first` and `second` are row names. `over_time` resamples blocks of samples; `over_seeds`
    pairs the seeds on the identification record, and is None elsewhere and where neither row
    draws anything.
    """

    first: str
    second: str
    record: str
    is_validation: bool
    over_time: Resampled
    over_seeds: SeedPairs | None


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Brief):
    """All rows of a comparison, in the given order, and the differences between them.

    Attributes:
        rows: One method on one model each.
        budget: What every method could spend.
        differences: Differences between rows, and their significance.
        optima: Global optima by model; a model whose box is too wide has none.
    """

    rows: tuple[Row, ...]
    budget: Budget
    differences: tuple[Difference, ...]
    optima: Mapping[str, GlobalOptimum]

    @property
    def answered(self) -> tuple[Row, ...]:
        """The rows that have an answer."""
        return tuple(row for row in self.rows if row.failure is None)


# The rows of Li et al. (2023), Tables 3 to 5: model and method.
PAPER_ROWS = (
    ("so-rc", "ls"),
    ("so-rc", "pso"),
    ("so-rc", "bmo"),
    ("iso-rc", "bmo"),
    ("iso-rc", "ibmo"),
)
# What is watched beside the rows, which are by their names.
REFINEMENT, OPTIMA, DIFFERENCES = "refinement", "global optima", "differences"


def compare(
    record: Record,
    cell: CellModel,
    rows: Sequence[tuple[str, str]] = PAPER_ROWS,
    *,
    validation: Sequence[Record] = (),
    window: Window | None = None,
    validation_windows: Sequence[Window] | None = None,
    bounds: Mapping[str, Range] | None = None,
    fixed: Mapping[str, float] | None = None,
    coordinates: Scale = "rc",
    objective: Kind = "scan",
    budget: Budget | None = None,
    source: str = "bounds",
    watch: Watch = unwatched,
) -> Comparison:
    """Several circuits and methods compared on the same data, box, budget and key.

    A method that fails has a row that says why.

    Args:
        record: The record to identify on.
        cell: A cell from `characterize`.
        rows: Pairs of a circuit and a method of `METHODS`.
        validation: Records to validate on.
        window: The part of the record that is simulated.
        validation_windows: Those of the validation records; by default `window`.
        bounds: Lowest and highest value by PyBaMM's names, for the circuits that have such a
            parameter.
        fixed: Parameters that keep a value, by the same names.
        coordinates: Search coordinates: "rc", or logarithms of R and tau.
        objective: How errors are computed: by simulation of every sample, or from a reduced record.
        budget: What every method may spend.
        source: What messages call the origin of the bounds.
        watch: Called with the name of every row and its number of seeds; returns a context manager
            that gives a function to call with the seeds finished.

    Raises `InputError` if record, window or box do not fit, and for an unknown circuit or method.

    >>> compare(None, None, [("so-rc", "guess")])
    Traceback (most recent call last):
    barnax.errors.InputError: no method is called 'guess'; there are ls, rls, wrls, ...
    """
    for _, method in rows:
        if method not in METHODS:
            raise InputError(f"no method is called {method!r}; there are {', '.join(METHODS)}")
    budget, window = budget or Budget(), window or Window()
    windows = [window] * len(validation) if validation_windows is None else validation_windows
    models = tuple(dict.fromkeys(model for model, _ in rows))

    def make(model: str, cell: CellModel) -> Problem:
        return make_problem(
            record,
            cell,
            model,
            window=window,
            bounds=known_to(model, bounds, models),
            fixed=known_to(model, fixed, models),
            coordinates=coordinates,
            objective=objective,
            source=source,
        )

    # All have the OCV that the first model's circuit finds at rest.
    cell = without_sweep_drop(make(models[0], cell)).cell
    problems = {model: with_better_directions(make(model, cell)) for model in models}
    prepared_records = {model: [problem.prepared] for model, problem in problems.items()}
    for model, prepared in prepared_records.items():
        prepared += [
            prepare_record(other, cell, model, its)
            for other, its in zip(validation, windows, strict=True)
        ]
    answered = [
        _run(problems[model], prepared_records[model], method, budget, watch)
        for model, method in rows
    ]
    with watch(REFINEMENT):
        refined = _refine(answered)
    with watch(OPTIMA):
        known = {model: optimum_or_none(problem) for model, problem in problems.items()}
    optima = {model: optimum for model, optimum in known.items() if optimum is not None}
    with watch(DIFFERENCES):
        differences = _differences(refined, budget.key)
    for place, row in enumerate(refined):
        if row.failure is None and row.model in optima:
            gap = optimality_gap(row.median.rmse_v, optima[row.model].rmse_v)
            refined[place] = replace(row, optimality_gap=gap)
    return Comparison(tuple(refined), budget, differences, optima)


@in_float64
def _run(
    problem: Problem,
    prepared_records: Sequence[PreparedRecord],
    method: str,
    budget: Budget,
    watch: Watch,
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
    identified, *others = prepared_records
    parameters = row.median.parameters
    evaluations = [evaluate(identified, parameters)]
    own = partial(evaluate, parameters=parameters)
    evaluations += [evaluate_from_either(prepared, own) for prepared in others]
    box = problem.log_coordinates
    return replace(
        row,
        evaluations=tuple(evaluations),
        errors=tuple(map(RecordErrors.of, evaluations)),
        # A linear method may leave the box; its note says so.
        at_bound=() if outside_box(parameters, problem) else at_bound(box, parameters),
    )


def _refine(rows: Sequence[Row]) -> list[Row]:
    """The rows with what Levenberg-Marquardt makes of each median seed, model by model."""
    done = {row.name: row for row in rows}
    for model in dict.fromkeys(row.model for row in rows):
        here = [row for row in rows if row.model == model and row.failure is None]
        if not here:
            continue
        descent = Descent(here[0].problem)
        ends = descent([row.median.parameters for row in here], FINAL_TOLERANCE)
        ends, _ = descent.led_on(ends, FINAL_TOLERANCE, FINAL_ROUNDS)
        for row, end in zip(here, ends, strict=True):
            done[row.name] = replace(row, refined=end)
    return [done[row.name] for row in rows]


def _differences(rows: Sequence[Row], key: int) -> tuple[Difference, ...]:
    """Every pair of answered rows on every record, the first row against the second."""
    found = []
    for first, second in itertools.combinations([row for row in rows if row.failure is None], 2):
        over_seeds = compare_over_seeds(first.errors_v, second.errors_v)
        for place, both in enumerate(zip(first.evaluations, second.evaluations, strict=True)):
            one, other = (evaluation.error_v[evaluation.prepared.scored] for evaluation in both)
            found.append(
                Difference(
                    first.name,
                    second.name,
                    record=both[0].prepared.record.name,
                    is_validation=place > 0,
                    over_time=compare_over_time(one, other, key),
                    over_seeds=None if place else over_seeds,
                )
            )
    return tuple(found)
