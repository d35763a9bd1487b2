"""The answer of a run: the circuit of the family that the records support, found, proved and
assessed, with the constant circuit that the population searches beside it."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import numpy as np

from .blas import one_blas_thread
from .cell import CircuitParameters, Dependence, get_circuit
from .cell.parameters import RATE
from .checks.step_answers import late_answers_ohm
from .constant_problem import problem_of
from .errors import InputError
from .execution import in_float64, threads
from .global_optimum import (
    GlobalOptimum,
    find_global_optimum,
    hold_warning,
    with_better_directions,
)
from .inputs import Inputs, Watch
from .model.prepared import PreparedRecord, prepare_record
from .model.problem import Problem
from .model.sampling import ocv_shift_ohm, other_sampling, resistance_shares, shift_ohm
from .model.search_space import ranges_of
from .model.window import Window
from .notices import Notice, notice
from .over_soc import (
    OwnOcv,
    TableFits,
    TableSettings,
    compare_with_own,
    fit_temperatures,
    group_by_temperature,
    register,
)
from .over_soc.certificate import certify
from .over_soc.fit import fit_of, level_beyond
from .over_soc.problem import find_best, reduced_objective
from .run import Answer, Candidate, Run, best_answer
from .search.evaluate import Evaluation, evaluate, evaluate_from_either, with_registered
from .search.refine import Descent, refine
from .search.seeds import search_seeds
from .select import Fitted, Tried, choose, limits_of
from .settings import OVER_TEMPERATURE, Settings
from .table_run import R0, TableRun
from .uncertainty import Assessment, assess, compile_linearization, examine

# A resistance that is off by more than this share is worth a warning, though its interval says so.
FAR = 0.05


@dataclass(frozen=True, eq=False)
class Setup:
    """What is searched in a run.

    Attributes:
        problem: The constant circuit that the population searches: the answer, or beside it.
        validation: The records to validate on, made ready for a circuit.
        tables: How tables are fitted.
        chosen: The answer, where the family was tried; with its tables still without a proof.
        tried: What was tried.
        fits: Tables that are known already.
        over_temperature: Whether tables of every temperature are fitted.
    """

    problem: Problem
    validation: Callable[[str], list[PreparedRecord]]
    tables: TableSettings
    chosen: Fitted | None = None
    tried: tuple[Tried, ...] = ()
    fits: TableFits | None = None
    over_temperature: bool = False

    @property
    def has_tables(self) -> bool:
        """True where the answer is tables, of resistances or of the OCV."""
        point = self.chosen and self.chosen.point
        is_table = point is not None and not (point.is_constant and point.law is None)
        return is_table or self.fits is not None or self.over_temperature


def set_up(
    first: Problem,
    inputs: Inputs,
    windows: Mapping[str, Window],
    settings: Settings,
    tables: TableSettings,
    own: OwnOcv | None = None,
    **box: Any,
) -> Setup:
    """What is searched: without an OCV test the tables came with the cell's OCV; over temperature,
    and with a constant circuit that is asked for, there is nothing to choose."""
    inputs = replace(inputs, cell=first.cell)
    records = {prepared.record.name: prepared.record for prepared in first.prepared_records}

    def validation(circuit: str) -> list[PreparedRecord]:
        return [
            prepare_record(record, first.cell, circuit, windows[record.name])
            for record in inputs.validation
        ]

    # A validation record that does not fit its window is refused before the search, not after.
    _ = validation(first.circuit)
    if own is not None:
        return Setup(first, validation, own.settings, tried=own.tried, fits=own.found)
    if settings.over == OVER_TEMPERATURE:
        return Setup(first, validation, tables, over_temperature=True)
    bounds = ranges_of(box.get("bounds"))[1] or {}
    named = {*bounds, *(box.get("fix") or {})}
    has_farads = any(name.endswith("[F]") for name in named)
    if (settings.model is not None and settings.over is None) or has_farads:
        return Setup(first, validation, tables)
    over_soc = None if settings.over is None else True
    limits = limits_of(first.cell, tables, settings.model, over_soc)

    def prepare(circuit: str) -> Sequence[PreparedRecord]:
        own_windows = {name: windows[name] for name in records}
        if not get_circuit(circuit).has_hysteresis:
            return [
                prepare_record(record, first.cell, circuit, own_windows[name])
                for name, record in records.items()
            ]
        if first.circuit == circuit:
            return first.prepared_records
        made = problem_of(inputs, windows, settings, circuit)
        return with_better_directions(made).prepared_records

    choice = choose(prepare, tables, limits)
    chosen = _registered(choice.chosen, tables)
    problem, point = first, chosen.point
    prepared = chosen.objective.prepared_records
    if point.is_constant and point.circuit != first.circuit:
        if point.has_rate and RATE not in named:
            # As fast as it was when it was chosen.
            box = {**box, "bounds": {**bounds, RATE: chosen.objective.ranges[RATE]}}
        problem = with_better_directions(
            problem_of(inputs, windows, settings, point.circuit, **box)
        )
    problem = _on_windows(problem, prepared)
    return Setup(problem, validation, chosen.objective.settings, chosen, choice.tried)


def _on_windows(problem: Problem, registered: Sequence[PreparedRecord]) -> Problem:
    """The problem with starts and capacities as other records tell them."""
    windows = {own.record.name: own.window for own in registered}
    if all(windows[own.record.name] == own.window for own in problem.prepared_records):
        return problem
    records = tuple(own.in_window(windows[own.record.name]) for own in problem.prepared_records)
    return replace(problem, prepared_records=records)


@in_float64
def _registered(chosen: Fitted, tables: TableSettings) -> Fitted:
    """The chosen circuit with starts and capacities of several records registered by each other."""
    told = chosen.objective.prepared_records
    if len(told) < 2 or tables.keep_starts or not tables.ocv_correction:
        return chosen
    own = chosen.objective.settings
    records = register(told, replace(own, ocv_correction=True))
    known = records[0].window.registration
    if known is None or records[0].window == told[0].window:
        return chosen
    law = Dependence(**{**known.follows}) if known.follows else None  # pyright: ignore
    records = [record.following(law) for record in records]
    objective = reduced_objective(records, own)
    with one_blas_thread():
        best = find_best(objective)
    return Fitted(replace(chosen.point, law=law), objective, best, chosen.loss)


def search_and_assess(
    setup: Setup, optimizer: Any, settings: Settings, trust: str, watch: Watch, advise: bool
) -> Run:
    """The search, and what does not wait for it beside it. No failure of either is swallowed."""
    problem, warnings = setup.problem, []
    search = refinement = None
    with threads(3) as beside:
        fitting: Future[TableFits] | None = None
        if setup.has_tables:
            fitting = beside.submit(_fitted, setup)
        linearization = beside.submit(compile_linearization, problem) if trust != "none" else None
        with watch("Finding the best constant circuit", 0):
            optimum = _optimum_or_none(problem)
        if settings.seeds:
            descent = beside.submit(Descent, problem)
            with watch("Searching", settings.seeds) as advance:
                key = jax.random.key(settings.key)
                search = search_seeds(
                    problem, optimizer, key=key, seeds=settings.seeds, progress=advance
                )
            with watch("Refining", settings.seeds) as advance:
                refinement = refine(search, descent=descent.result(), progress=advance)
        with watch("Waiting for tables over SOC", 0):
            if linearization is not None:
                linearization.result()
            fits = fitting.result() if fitting else None
    answer = best_answer(refinement, optimum)
    other = _otherwise_sampled(problem, answer.parameters) if advise else None
    with watch("Evaluating", 0):
        identified, validated = _evaluated(setup, answer)
        tables = None if fits is None else _table_run(setup, fits)
    assessment = examination = None
    with watch("Assessing", 0):
        if trust != "none":
            assessment = _attempt(
                "answer.no-intervals", warnings, assess, problem, answer.parameters
            )
        if assessment is not None:
            assessment, tables = _widened(problem, answer, tables, other, assessment, warnings)
        if tables is not None:
            tables = tables.spanning(tables.means_shifts_ohm)
        if trust == "full" and assessment is not None:
            given = problem, answer.parameters, assessment
            examination = _attempt("answer.no-examination", warnings, examine, *given)
    return Run(
        problem, search, refinement, optimum, answer, identified, validated, assessment,
        examination, tables, _candidates(setup, optimum, identified, validated, tables),
        setup.tried, other and other.r0 - answer.parameters.r0, warnings=tuple(warnings),
    )  # fmt: skip


def _fitted(setup: Setup) -> TableFits:
    """The tables of the answer, proved, with their intervals and held-out errors."""
    records = [setup.problem.prepared_records]
    if setup.fits is not None:
        fits = setup.fits
    elif setup.over_temperature:
        fits = fit_temperatures(group_by_temperature(*records), setup.tables)
    else:
        assert setup.chosen is not None, "a point of the family"
        objective = setup.chosen.objective
        with one_blas_thread():
            proof = certify(objective, setup.chosen.best)
        records = [objective.prepared_records]
        fit = fit_of(objective, proof)
        own = compare_with_own(*records, fit, objective.settings)
        fits = TableFits((replace(fit, own_ocv=own),))
    if fits.over_temperature is not None:
        records = [group for _, group in sorted(group_by_temperature(*records).items())]
    level = [level_beyond(fit.tables, own) for fit, own in zip(fits, records, strict=True)]
    pairs = zip(fits, level, strict=True)
    return replace(fits, fits=tuple(replace(fit, tables=tables) for fit, tables in pairs))


def _evaluated(setup: Setup, answer: Answer) -> tuple[list[Evaluation], list[Evaluation]]:
    """The constant circuit on the records identified on, and on those validated on."""
    problem = setup.problem
    by_circuit = partial(evaluate, parameters=answer.parameters)
    others = [
        with_registered(evaluate_from_either(record, problem.cell, by_circuit), by_circuit)
        for record in setup.validation(problem.circuit)
    ]
    return [by_circuit(record) for record in problem.prepared_records], others


def _table_run(setup: Setup, fits: TableFits) -> TableRun:
    chosen, problem = setup.chosen, setup.problem
    records = chosen.objective.prepared_records if chosen else problem.prepared_records
    circuit = chosen.point.circuit if chosen else problem.circuit
    return TableRun.of(setup.tables, fits, records, setup.validation(circuit), problem.cell)


def _candidates(
    setup: Setup,
    optimum: GlobalOptimum | None,
    identified: Sequence[Evaluation],
    validated: Sequence[Evaluation],
    tables: TableRun | None,
) -> tuple[Candidate, ...]:
    """The constant circuit and the answer, with their errors."""
    circuit = setup.problem.circuit
    held_out = {(own.circuit, own.nodes): own.held_out for own in setup.tried if not own.follows}
    gap = None if optimum is None else optimum.proved_gap
    constant = Candidate.of(
        circuit, None, identified, validated, held_out.get((circuit, 1)), gap, tables is None
    )
    if tables is None:
        return (constant,)
    found = tables.found
    crossed = found.fits[0].cross_validation if found.over_temperature is None else None
    proof = found.over_temperature or found.reference
    answer = Candidate.of(
        tables.model,
        found.over,
        tables.identification,
        tables.validation,
        crossed and crossed.tables,
        proof.proved_gap,
        True,
    )
    # Without an OCV test the constant circuit has an OCV that is fitted to the tables.
    return (answer,) if setup.fits is not None else (constant, answer)


def _widened(
    problem: Problem,
    answer: Answer,
    tables: TableRun | None,
    other: CircuitParameters | None,
    assessment: Assessment,
    warnings: list[Notice],
) -> tuple[Assessment, TableRun | None]:
    """The assessment and the tables, whose intervals reach over what else R0 may be: with the other
    sampling of the current, or a lag."""
    own, known = answer.parameters, assessment.uncertainty
    if other is not None and tables is None and R0 in known.beyond(other):
        warnings.append(hold_warning(problem, own.r0, other.r0))
    jumps = [late_answers_ohm(prepared.record) for prepared in problem.prepared_records]
    late_ohm = [jump[0] + jump[1] for jump in jumps if jump is not None]
    others = [own.with_tables({R0: [ohm]}) for ohm in late_ohm]
    others += [other] if other else []
    assessment = replace(assessment, uncertainty=known.spanning(others))
    if tables is None:
        return assessment, None
    shifts_ohm = [ohm - tables.mean_ohm(R0) for ohm in late_ohm]
    if other is not None:
        shifts_ohm.append(tables.hold_shift_ohm)
        if abs(shifts_ohm[-1]) > FAR * tables.mean_ohm(R0):
            r0_ohm = tables.mean_ohm(R0), tables.mean_ohm(R0) + shifts_ohm[-1]
            warnings.append(hold_warning(problem, *r0_ohm))
    shares = tables.hold_shares if other is not None else None
    return assessment, tables.spanning(shifts_ohm, shares)


def _otherwise_sampled(problem: Problem, own: CircuitParameters) -> CircuitParameters | None:
    """The constant circuit as it would be with the other sampling of the current, to the closed
    form; None where the sampling is not only assumed."""
    for prepared in problem.prepared_records:
        if prepared.record.hold.strength != "assumed":
            continue
        sampling, interval_s = prepared.record.hold.value, prepared.median_interval_s
        other = other_sampling(sampling)
        moved_ohm = shift_ohm(sampling, other, own, own.named_ohm, interval_s)
        moved_ohm += ocv_shift_ohm(sampling, other, prepared)
        shares = resistance_shares(sampling, other, own, interval_s)
        rows = {name: [own.named_ohm[name] * (1 + share)] for name, share in shares.items()}
        return own.with_tables({R0: [max(own.r0 + moved_ohm, 0.0)], **rows})
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
