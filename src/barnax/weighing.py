"""The work of a run: circuits are weighed, the best constant one searched, the answer assessed."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np

from .candidates import (
    FOLLOWING,
    THREE_PAIRS,
    TWO_PAIRS,
    WEIGHED,
    Candidate,
    best_of,
    is_alike,
    is_better,
    is_fast,
    spans_enough,
    tabulated_circuit,
)
from .checks.sampling import late_answers_ohm
from .display import Brief
from .errors import InputError
from .execution import threads
from .global_optimum import (
    GlobalOptimum,
    find_global_optimum,
    hold_warning,
    r0_with_one_more_pair,
    try_other_hold,
    with_better_directions,
    with_better_hold,
    without_sweep_drop,
)
from .inputs import Inputs, Watch, ranges_of
from .model.prepared import PreparedRecord, prepare_record
from .model.problem import Kind, Problem, known_to, make_problem, require_enough
from .model.search_space import Range
from .model.window import Window
from .notices import Notice, notice
from .over_soc import OwnOcv, SocErrors, TableFits, TableSettings, constant_held_out
from .run import Run, best_answer
from .search.evaluate import evaluate, evaluate_from_either, with_registered
from .search.refine import Descent, refine
from .search.seeds import search_seeds
from .settings import OVER_TEMPERATURE, Settings
from .table_run import R0, TableRun, fit_over
from .uncertainty import assess, compile_linearization, examine


@dataclass(frozen=True, eq=False, repr=False)
class Weighing(Brief):
    """Circuits to weigh: constant ones, of which one may be chosen already, and tables.

    Attributes:
        problems: Those of the constant circuits, the simplest first.
        chosen: The problem that the constant answer is of; None leaves it to the held-out errors.
        tabulated: The problems whose records tables are fitted to, the simplest first.
        tables: How they are fitted, and how blocks are held out, by circuit; a circuit without
            holds out nothing.
        validation: The records to validate on, prepared for the circuit of a problem.
        fitted: The tables of the first `tabulated`, where they are known already.
    """

    problems: tuple[Problem, ...]
    chosen: Problem | None
    tabulated: tuple[Problem, ...]
    tables: Mapping[str, TableSettings]
    validation: Callable[[Problem], list[PreparedRecord]]
    fitted: TableFits | None = None

    @property
    def first(self) -> Problem:
        return self.problems[0]

    @property
    def tabulated_names(self) -> tuple[str, ...]:
        """The circuits whose tables are weighed."""
        return tuple(tables.circuit for tables in self.tabulated)


def weigh(
    inputs: Inputs,
    windows: Mapping[str, Window],
    settings: Settings,
    tables: TableSettings,
    bounds: Mapping[str, Range] | str | Path | None,
    fix: Mapping[str, float] | None,
    advise: bool,
    own_ocv: OwnOcv | None = None,
) -> Weighing:
    """The circuits that are weighed, each with its problem; a given one comes first. Without an OCV
    test the tables came with the cell's OCV."""
    over, model = settings.over, settings.model
    tables = tables if own_ocv is None else own_ocv.settings
    tabulated = own_ocv.circuit if own_ocv else model or tabulated_circuit(inputs.cell)
    if over == OVER_TEMPERATURE or own_ocv is not None:
        models = (tabulated,)
    elif model is None:
        models = WEIGHED
    else:
        models = (model, *(name for name in WEIGHED if name != model)) if advise else (model,)
    source, ranges = ranges_of(bounds)
    # The circuit that was asked for complains of what it does not have.
    known = [
        (dict(ranges or {}), dict(fix or {}))
        if name == model
        else (known_to(name, ranges, models), known_to(name, fix, models))
        for name in models
    ]
    first = without_sweep_drop(_problem(inputs, windows, settings, models[0], source, *known[0]))
    first = with_better_hold(with_better_directions(first))
    # All have the OCV that the first circuit finds at rest, and the hold that it tells.
    records = [prepared.record for prepared in first.prepared_records]
    inputs, problems = replace(inputs, cell=first.cell, records=records), [first]
    for name, (own_ranges, own_fix) in zip(models[1:], known[1:], strict=True):
        try:
            made = _problem(inputs, windows, settings, name, source, own_ranges, own_fix)
        except InputError:
            # A box for the circuit that was asked for need not be one for another, and a short
            # record may be enough for a simpler one.
            if model is None and (own_ranges, own_fix) != known[0]:
                raise
            continue
        problems.append(with_better_directions(made))
    of = {problem.circuit: problem for problem in problems}
    # Tables have no capacitance to bound or hold.
    has_farads = any(name.endswith("[F]") for name in {**(ranges or {}), **(fix or {})})
    has_tables = over is not None or (model is None and not has_farads)
    wanted = {}
    if has_tables or (tables.folds and not has_farads):
        wanted = {
            name: replace(tables, bounds={**own, **tables.bounds}, fixed={**held, **tables.fixed})
            for name, (own, held) in zip(models, known, strict=True)
        }

    fitted = [of.get(tabulated, first)]
    is_open = model is None and own_ocv is None and not (ranges or fix or over == OVER_TEMPERATURE)
    if is_open and tabulated == TWO_PAIRS and is_fast(first.prepared_records):
        # A short record may be enough for two pairs alone.
        with suppress(InputError):
            fitted.append(_problem(inputs, windows, settings, THREE_PAIRS, source, None, None))
            wanted[THREE_PAIRS] = tables

    def validation(problem: Problem) -> list[PreparedRecord]:
        return [
            prepare_record(record, problem.cell, problem.circuit, windows[record.name])
            for record in inputs.validation
        ]

    # A validation record that does not fit its window is refused before the search, not after.
    _ = validation(first)
    chosen = of[model] if model is not None else problems[0] if len(problems) == 1 else None
    return Weighing(
        tuple(problems),
        chosen,
        tuple(fitted) if has_tables else (),
        wanted,
        validation,
        None if own_ocv is None else own_ocv.found,
    )


def _problem(
    inputs: Inputs,
    windows: Mapping[str, Window],
    settings: Settings,
    model: str,
    source: str,
    ranges: Mapping[str, Range] | None,
    fix: Mapping[str, float] | None,
) -> Problem:
    """The problem, compressed where the box allows it unless the objective is chosen."""

    def make(objective: Kind) -> Problem:
        return make_problem(
            inputs.records,
            inputs.cell,
            model,
            window=[windows[record.name] for record in inputs.records],
            bounds=ranges,
            fixed=fix,
            coordinates=settings.coordinates,
            objective=objective,
            source=source,
        )

    problem = make("scan" if settings.objective == "auto" else settings.objective)
    require_enough(problem)
    if settings.objective != "auto":
        return problem
    try:
        _ = problem.compressed
    except InputError:
        return problem
    return problem.keeping_computed(kind="compressed")


def search_and_assess(
    weighing: Weighing, optimizer: Any, settings: Settings, trust: str, watch: Watch, advise: bool
) -> Run:
    """The search, and what does not wait for it beside it. No failure of either is swallowed."""
    problems, over = weighing.problems, settings.over or "soc"
    with threads(3) as beside:
        tables_futures = [_fitting(beside, over, weighing, tables) for tables in weighing.tabulated]
        held_out_futures = [
            beside.submit(_held_out_or_none, problem, weighing.tables.get(problem.circuit))
            if weighing.fitted is None and (len(problems) > 1 or tables_futures)
            else None
            for problem in problems
        ]
        with watch("Weighing circuits", len(problems)) as advance:
            optima = []
            for problem in problems:
                optima.append(_optimum_or_none(problem))
                advance(1)
            held_out = [future.result() if future else None for future in held_out_futures]
            if weighing.fitted is not None:
                # The OCV here is that of all samples: only with its own are the errors alike.
                crossed = weighing.fitted.reference.cross_validation
                held_out = [crossed and crossed.constant] * len(problems)
        place = best_of(held_out) if weighing.chosen is None else problems.index(weighing.chosen)
        problem, optimum = problems[place], optima[place]
        if weighing.chosen is None and problem.circuit == FOLLOWING not in weighing.tabulated_names:
            tables_futures.append(_fitting(beside, over, weighing, problem))
        linearization = beside.submit(compile_linearization, problem) if trust != "none" else None
        other_hold_future = beside.submit(try_other_hold, problem) if advise else None
        jumps = [late_answers_ohm(prepared.record) for prepared in problem.prepared_records]
        late_ohm = [jump[0] + jump[1] for jump in jumps if jump is not None]
        # Where the voltage lags, one more pair would only take that up.
        has_more = trust != "none" and not late_ohm
        more_future = beside.submit(r0_with_one_more_pair, problem) if has_more else None
        search = refinement = None
        if settings.seeds:
            descent = beside.submit(Descent, problem)
            with watch("Searching", settings.seeds) as advance:
                search = search_seeds(
                    problem,
                    optimizer,
                    key=jax.random.key(settings.key),
                    seeds=settings.seeds,
                    progress=advance,
                )
            with watch("Refining", settings.seeds) as advance:
                refinement = refine(search, descent=descent.result(), progress=advance)
        with watch("Waiting for tables over SOC", 0):
            if linearization is not None:
                linearization.result()
            fits = [(of, future.result()) for of, future in tables_futures]
            other_hold = other_hold_future.result() if other_hold_future else None
            more_ohm = more_future.result() if more_future else ()
    answer = best_answer(refinement, optimum)
    warnings: list[Notice] = []
    candidates: list[Candidate] = []
    with watch("Evaluating", 0):
        identified, validated = [], []
        for weighed, its, held in zip(problems, optima, held_out, strict=True):
            parameters = answer.parameters if weighed is problem else its and its.parameters
            if parameters is None:
                continue
            by_circuit = partial(evaluate, parameters=parameters)
            own = [by_circuit(record) for record in weighed.prepared_records]
            others = [
                evaluate_from_either(record, weighed.cell, by_circuit)
                for record in weighing.validation(weighed)
            ]
            if weighed is problem:
                others = [with_registered(one, by_circuit) for one in others]
                identified, validated = own, others
            gap = None if its is None else its.proved_gap
            candidates.append(Candidate.of(weighed.circuit, None, own, others, held, gap))
        table_run, best_held_out = None, held_out[place]
        for of, found in fits:
            tried = TableRun.of(
                weighing.tables[of.circuit],
                found,
                of.prepared_records,
                weighing.validation(of),
                of.cell,
            )
            held = found.fits[0].cross_validation if found.over_temperature is None else None
            errors = held.tables if held else None
            proof = found.over_temperature or found.reference
            both = (tried.identification, tried.validation)
            candidates.append(Candidate.of(of.circuit, over, *both, errors, proof.proved_gap))
            is_worth = is_better(errors, best_held_out) and spans_enough(found.reference)
            if is_worth or (settings.over is not None and table_run is None):
                table_run, best_held_out = tried, errors
    is_answer = (table_run.model, over) if table_run else (problem.circuit, None)
    told = tuple(
        replace(candidate, is_answer=(candidate.model, candidate.over) == is_answer)
        for candidate in candidates
    )
    assessment = examination = None
    with watch("Assessing", 0):
        if trust != "none":
            assessment = _attempt(
                "answer.no-intervals", warnings, assess, problem, answer.parameters
            )
        if assessment is not None:
            known, own = assessment.uncertainty, answer.parameters
            is_beyond = other_hold is not None and R0 in known.beyond(other_hold.parameters)
            if other_hold is not None and is_beyond and table_run is None:
                r0_ohm = own.r0, other_hold.parameters.r0
                warnings.append(hold_warning(problem, other_hold.value, *r0_ohm))
            # A circuit that was asked for is not weighed against others.
            weighed = problems if weighing.chosen is None else ()
            alike = partial(_alike_r0, weighed, optima, held_out)
            r0_ohm = [*more_ohm, *late_ohm, *alike(held_out[place])]
            others = [own.with_tables({R0: [ohm]}) for ohm in r0_ohm]
            others += [other_hold.parameters] if other_hold else []
            assessment = replace(assessment, uncertainty=known.spanning(others))
            if table_run is not None:
                shifts_ohm = [
                    late - table_run.median_ohm(R0) for late in (*late_ohm, *alike(best_held_out))
                ]
                if other_hold is not None:
                    warnings += table_run.hold_warnings(problem, other_hold)
                    shifts_ohm += [other_hold.parameters.r0 - own.r0, table_run.hold_shift_ohm]
                table_run = table_run.spanning(shifts_ohm)
        if table_run is not None:
            table_run = table_run.spanning(table_run.means_shifts_ohm)
        if trust == "full" and assessment is not None:
            key = jax.random.key(settings.key)
            given = problem, answer.parameters, assessment
            examination = _attempt("answer.no-examination", warnings, examine, *given, key=key)
    return Run(
        problem, search, refinement, optimum, answer, identified, validated, assessment,
        examination, table_run, told, other_hold, warnings=tuple(warnings),
    )  # fmt: skip


def _fitting(
    beside: Executor, over: str, weighing: Weighing, of: Problem
) -> "tuple[Problem, Future[TableFits]]":
    """Tables on the records of a problem, as they are being fitted."""
    if weighing.fitted is not None:
        known: Future[TableFits] = Future()
        known.set_result(weighing.fitted)
        return of, known
    return of, beside.submit(fit_over, over, of.prepared_records, weighing.tables[of.circuit])


def _alike_r0(
    problems: Sequence[Problem],
    optima: Sequence[GlobalOptimum | None],
    held_out: Sequence[SocErrors | None],
    held: SocErrors | None,
) -> list[float]:
    """R0 in ohm of the circuits that what was held out tells no better or worse than one."""
    return [
        optimum.parameters.r0
        for problem, optimum, errors in zip(problems, optima, held_out, strict=False)
        if optimum is not None and is_alike(held, errors)
    ]


def _held_out_or_none(problem: Problem, settings: TableSettings | None) -> SocErrors | None:
    """A constant circuit's errors on held-out blocks; None where there are none."""
    if settings is None:
        return None
    try:
        return constant_held_out(problem.prepared_records, settings)
    except InputError:
        return None


def _optimum_or_none(problem: Problem) -> GlobalOptimum | None:
    """The global optimum, None where the box is too wide to look for it."""
    try:
        return find_global_optimum(problem)
    except InputError:
        return None


def _attempt(
    code: str, warnings: list[Notice], function: Callable[..., Any], *given: Any, **more: Any
):
    """The value of the function; where it fails, a warning: the answer stands without it."""
    try:
        return function(*given, **more)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError, RuntimeError) as problem:
        warnings.append(notice(code, reason=str(problem) or type(problem).__name__))
        return None
