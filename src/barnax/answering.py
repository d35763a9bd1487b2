"""The answer of a run: the weighed circuits searched, the best of them told and assessed."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import jax
import numpy as np

from .blas import one_blas_thread
from .candidates import FOLLOWING, Candidate, best_of, is_alike, is_better, spans_enough
from .checks.step_answers import late_answers_ohm
from .errors import InputError
from .execution import threads
from .global_optimum import (
    GlobalOptimum,
    OtherHold,
    find_global_optimum,
    hold_warning,
    r0_with_one_more_pair,
    try_other_hold,
)
from .inputs import Watch
from .model.prepared import PreparedRecord
from .model.problem import Problem
from .notices import Notice, notice
from .over_soc import (
    SocErrors,
    TableFit,
    TableFits,
    TableSettings,
    constant_held_out,
    is_worth_trying,
)
from .run import Answer, Run, best_answer
from .search.evaluate import Evaluation, evaluate, evaluate_from_either, with_registered
from .search.refine import Descent, Refinement, refine
from .search.seeds import Search, search_seeds
from .settings import Settings
from .table_run import R0, TableRun, fit_over
from .uncertainty import Assessment, assess, compile_linearization, examine
from .weighing import Weighing


@dataclass(frozen=True, eq=False)
class _Searched:
    """The answer of the search, and of what ran beside it, before any is evaluated.

    Attributes:
        place: That of the best constant circuit among the weighed ones.
        optima: The best circuit of each, None where its box is too wide to look.
        held_out: Its errors on held-out blocks, None where nothing was held out.
        fits: The tables, each with the problem whose records they are fitted to.
        search: What the seeds found, None without seeds.
        refinement: Where Levenberg-Marquardt took them.
        other_hold: The answer if a sample's current flowed on its other side.
        late_ohm: R0 if the voltage that lags its current were as late as its steps show.
        more_ohm: R0 if the circuit had one more pair.
    """

    place: int
    optima: list[GlobalOptimum | None]
    held_out: list[SocErrors | None]
    fits: list[tuple[Problem, TableFits]]
    search: Search | None
    refinement: Refinement | None
    other_hold: OtherHold | None
    late_ohm: Sequence[float]
    more_ohm: Sequence[float]

    @cached_property
    def answer(self) -> Answer:
        return best_answer(self.refinement, self.optima[self.place])


@dataclass(frozen=True, eq=False)
class _Compared:
    """The circuits with their errors: the constant answer's simulations, tables where they are the
    answer, and the errors that were held out of it."""

    identification: list[Evaluation]
    validation: list[Evaluation]
    candidates: tuple[Candidate, ...]
    tables: TableRun | None
    held_out: SocErrors | None


def search_and_assess(
    weighing: Weighing, optimizer: Any, settings: Settings, trust: str, watch: Watch, advise: bool
) -> Run:
    """The search, and what does not wait for it beside it. No failure of either is swallowed."""
    searched = _search(weighing, optimizer, settings, trust, watch, advise)
    problem, answer = weighing.problems[searched.place], searched.answer
    with watch("Evaluating", 0):
        compared = _compare(weighing, searched, settings)
    tables, warnings = compared.tables, []
    assessment = examination = None
    with watch("Assessing", 0):
        if trust != "none":
            assessment = _attempt(
                "answer.no-intervals", warnings, assess, problem, answer.parameters
            )
        if assessment is not None:
            assessment, tables = _widened(weighing, searched, compared, assessment, warnings)
        if tables is not None:
            tables = tables.spanning(tables.means_shifts_ohm)
        if trust == "full" and assessment is not None:
            given = problem, answer.parameters, assessment
            examination = _attempt("answer.no-examination", warnings, examine, *given)
    return Run(
        problem, searched.search, searched.refinement, searched.optima[searched.place], answer,
        compared.identification, compared.validation, assessment, examination, tables,
        compared.candidates, searched.other_hold, warnings=tuple(warnings),
    )  # fmt: skip


def _search(
    weighing: Weighing, optimizer: Any, settings: Settings, trust: str, watch: Watch, advise: bool
) -> _Searched:
    """The best constant circuit by held-out errors, searched, and everything else that is fitted,
    in threads beside it."""
    problems, over = weighing.problems, settings.over or "soc"
    with threads(3) as beside:
        fits_futures: list[tuple[Problem, Future[TableFits | None]]] = []
        for of in weighing.tabulated:
            simpler = fits_futures[0][1] if fits_futures else None
            fits_futures.append(_fitting(beside, over, weighing, of, simpler))
        held_out_futures = [
            beside.submit(_held_out_or_none, problem, weighing.tables.get(problem.circuit))
            if weighing.fitted is None and (len(problems) > 1 or fits_futures)
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
        problem = problems[place]
        if weighing.chosen is None and problem.circuit == FOLLOWING not in weighing.tabulated_names:
            fits_futures.append(_fitting(beside, over, weighing, problem))
        linearization = beside.submit(compile_linearization, problem) if trust != "none" else None
        other_hold = beside.submit(try_other_hold, problem) if advise else None
        jumps = [late_answers_ohm(prepared.record) for prepared in problem.prepared_records]
        late_ohm = [jump[0] + jump[1] for jump in jumps if jump is not None]
        # Where the voltage lags, one more pair would only take that up.
        has_more = trust != "none" and not late_ohm
        more_ohm = beside.submit(r0_with_one_more_pair, problem) if has_more else None
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
            return _Searched(
                place,
                optima,
                held_out,
                [(of, fits) for of, future in fits_futures if (fits := future.result())],
                search,
                refinement,
                other_hold.result() if other_hold else None,
                late_ohm,
                more_ohm.result() if more_ohm else (),
            )


def _compare(weighing: Weighing, searched: _Searched, settings: Settings) -> _Compared:
    """The errors of all circuits, and tables where they are worth it by what was held out, or
    asked for."""
    chosen, answer = weighing.problems[searched.place], searched.answer
    identified, validated, candidates = [], [], []
    for problem, optimum, held_out in zip(
        weighing.problems, searched.optima, searched.held_out, strict=True
    ):
        parameters = answer.parameters if problem is chosen else optimum and optimum.parameters
        if parameters is None:
            continue
        by_circuit = partial(evaluate, parameters=parameters)
        own = [by_circuit(record) for record in problem.prepared_records]
        others = [
            evaluate_from_either(record, problem.cell, by_circuit)
            for record in weighing.validation(problem)
        ]
        if problem is chosen:
            others = [with_registered(one, by_circuit) for one in others]
            identified, validated = own, others
        gap = None if optimum is None else optimum.proved_gap
        candidates.append(Candidate.of(problem.circuit, None, own, others, held_out, gap))
    tables, best_held_out = None, searched.held_out[searched.place]
    for problem, found in searched.fits:
        tried = TableRun.of(
            weighing.tables[problem.circuit],
            found,
            problem.prepared_records,
            weighing.validation(problem),
            problem.cell,
        )
        crossed = found.fits[0].cross_validation if found.over_temperature is None else None
        errors = crossed.tables if crossed else None
        proof = found.over_temperature or found.reference
        both = (tried.identification, tried.validation)
        if weighing.fitted is not None:
            # The constant circuit has an OCV that is fitted to the tables, and not to it.
            candidates = []
        candidates.append(
            Candidate.of(problem.circuit, found.over, *both, errors, proof.proved_gap)
        )
        is_worth = is_better(errors, best_held_out) and spans_enough(found.reference)
        if is_worth or (settings.over is not None and tables is None):
            tables, best_held_out = tried, errors
    of_answer = (tables.model, tables.found.over) if tables else (chosen.circuit, None)
    told = tuple(
        replace(candidate, is_answer=(candidate.model, candidate.over) == of_answer)
        for candidate in candidates
    )
    return _Compared(identified, validated, told, tables, best_held_out)


def _widened(
    weighing: Weighing,
    searched: _Searched,
    compared: _Compared,
    assessment: Assessment,
    warnings: list[Notice],
) -> tuple[Assessment, TableRun | None]:
    """The assessment and the tables, whose intervals reach over what else R0 may be: with the other
    hold of the current, a lag, one more pair, or a circuit that is no worse."""
    problem, own = weighing.problems[searched.place], searched.answer.parameters
    known, tables, other_hold = assessment.uncertainty, compared.tables, searched.other_hold
    is_beyond = other_hold is not None and R0 in known.beyond(other_hold.parameters)
    if other_hold is not None and is_beyond and tables is None:
        r0_ohm = own.r0, other_hold.parameters.r0
        warnings.append(hold_warning(problem, other_hold.value, *r0_ohm))
    # A circuit that was asked for is not weighed against others.
    weighed = weighing.problems if weighing.chosen is None else ()
    alike = partial(_alike_r0, weighed, searched.optima, searched.held_out)
    late_ohm = searched.late_ohm
    r0_ohm = [*searched.more_ohm, *late_ohm, *alike(searched.held_out[searched.place])]
    others = [own.with_tables({R0: [ohm]}) for ohm in r0_ohm]
    others += [other_hold.parameters] if other_hold else []
    assessment = replace(assessment, uncertainty=known.spanning(others))
    if tables is None:
        return assessment, None
    shifts_ohm = [ohm - tables.median_ohm(R0) for ohm in (*late_ohm, *alike(compared.held_out))]
    if other_hold is not None:
        warnings += tables.hold_warnings(problem, other_hold)
        shifts_ohm += [other_hold.parameters.r0 - own.r0, tables.hold_shift_ohm]
    shares = tables.hold_shares if other_hold is not None else None
    return assessment, tables.spanning(shifts_ohm, shares)


def _fitting(
    beside: Executor,
    over: str,
    weighing: Weighing,
    of: Problem,
    simpler: "Future[TableFits | None] | None" = None,
) -> "tuple[Problem, Future[TableFits | None]]":
    """Tables on the records of a problem, as they are being fitted; none where those of a simpler
    circuit leave nothing that they may be worth."""
    if weighing.fitted is not None:
        known: Future[TableFits | None] = Future()
        known.set_result(weighing.fitted)
        return of, known
    settings = weighing.tables[of.circuit]

    def fitted() -> TableFits | None:
        fits = simpler and simpler.result()
        if fits and not _may_be_worth(of.prepared_records, settings, fits.reference):
            return None
        return fit_over(over, of.prepared_records, settings)

    return of, beside.submit(fitted)


def _may_be_worth(
    prepared_records: Sequence[PreparedRecord], settings: TableSettings, fit: TableFit
) -> bool:
    records = [prepared.following(fit.tables.dependence) for prepared in prepared_records]
    try:
        with one_blas_thread():
            return is_worth_trying(records, settings, fit.objective_v, fit.low_end)
    except InputError:
        return False


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
