"""The answer of a run: the circuit of the family that the records support, identified, proved and
assessed, with the constant circuit from the population search."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import numpy as np

from ..cell import CircuitParameters
from ..errors import InputError
from ..execution import Watch, in_float64, threads
from ..fit.table_fit import with_level_ends
from ..fit.temperature import group_by_temperature
from ..fit.temperature_fits import R0, TableFits
from ..global_optimum.assumptions import hold_warning
from ..global_optimum.search import GlobalOptimum, find_global_optimum
from ..model.other_sampling import SHORT, least_r0_share, means_shifts_ohm, resampling
from ..model.prepared import PreparedRecord
from ..model.problem import Problem
from ..notices import Notice
from ..pulses import pulses_of
from ..records.lag import answers_ohm, late_r0_ohm
from ..result_parts import Candidate, ConstantPart, InputPart, MetricsBlock, bands_by_soc, versions
from ..results import Result
from ..search.answers import SAME_RMSE, Refinement
from ..search.evaluate import Evaluations, evaluate
from ..search.seeds import Descent, refine, search_seeds
from ..settings import Settings
from ..uncertainty import Assessment, assess, compile_linearization, examine
from .setup import Setup

# A resistance that is off by more than this share is worth a warning, even though its interval
# covers it.
FAR = 0.05


def search_and_assess(
    setup: Setup, optimizer: Any, settings: Settings, trust: str, watch: Watch
) -> Result:
    """The search, and at the same time everything independent of it, as a result with the warnings
    of its assessment. No failure of either is swallowed."""
    problem, warnings = setup.problem, list[Notice]()
    refinement = None
    with threads(3) as beside:
        fitting = beside.submit(_fitted, setup.fit, setup.records) if setup.fit else None
        linearization = beside.submit(compile_linearization, problem) if trust != "none" else None
        with watch("Finding the best constant circuit", 0):
            optimum = optimum_or_none(problem)
        if seeds := settings.seeds:
            descent, key = beside.submit(Descent, problem), jax.random.key(settings.key)
            with watch("Searching", seeds) as advance:
                search = search_seeds(problem, optimizer, key=key, seeds=seeds, progress=advance)
            with watch("Refining", seeds) as advance:
                refinement = refine(search, descent=descent.result(), progress=advance)
        with watch("Waiting for tables over SOC", 0):
            if linearization is not None:
                linearization.result()
            tables = fitting.result() if fitting else None
    parameters = best_of(refinement, optimum).parameters
    with watch("Evaluating", 0):
        by_circuit = partial(evaluate, parameters=parameters)
        validated = setup.validation(problem.circuit)
        evaluations = [Evaluations.of(by_circuit, problem.prepared_records, validated)]
        if tables is not None:
            validated = setup.validation(setup.records[0].circuit)
            evaluations.append(Evaluations.of(tables.evaluate, setup.records, validated))
    other = _resampled(problem, parameters)
    assessment = None
    with watch("Assessing", 0):
        if trust != "none":
            assessment = _attempt("the intervals", warnings, assess, problem, parameters)
        if tables is not None:
            tables = _assessed(setup, tables, evaluations[-1], warnings)
        elif other and assessment and assessment.uncertainty[R0].excludes(other.r0):
            warnings.append(hold_warning(problem, parameters.r0, other.r0))
        if assessment is not None:
            spanning = assessment.uncertainty.spanning(_others(problem, parameters, other))
            assessment = replace(assessment, uncertainty=spanning)
        if trust == "full" and assessment is not None:
            given = problem, parameters, assessment
            examination = _attempt("fitting again", warnings, examine, *given)
            assessment = replace(assessment, examination=examination)
    result = make_result(
        problem, evaluations, optimum, refinement, tables=tables, assessment=assessment,
        hold_shift_ohm=None if other is None else other.r0 - parameters.r0,
        tried=setup.tried, warnings=tuple(warnings),
    )  # fmt: skip
    return result.model_copy(update={"candidates": _candidates(setup, result)})


def best_of(
    refinement: Refinement | None, optimum: GlobalOptimum | None
) -> Refinement | GlobalOptimum:
    """The best constant circuit known, by the scan's RMSE: the better of the refined seeds and the
    global optimum.

    If both are the same optimum it is the latter, which does not depend on seeds. Raises
    `InputError` if there is neither.
    """
    if optimum is not None and (
        refinement is None or optimum.rmse_v <= refinement.rmse_v * (1 + SAME_RMSE)
    ):
        return optimum
    if refinement is None:
        raise InputError(
            "the bounds are too wide to look for the global optimum; narrow them with `bounds`, or "
            "search with `seeds`"
        )
    return refinement


def make_result(
    problem: Problem,
    evaluations: Sequence[Evaluations],
    optimum: GlobalOptimum | None = None,
    refinement: Refinement | None = None,
    *,
    tables: TableFits | None = None,
    assessment: Assessment | None = None,
    hold_shift_ohm: float | None = None,
    **more: Any,
) -> Result:
    """A storable `Result` of a searched problem; further arguments are fields of it, such as its
    candidates and warnings.

    Args:
        problem: The searched problem.
        evaluations: The best constant circuit on the records, then the tables, if any.
        optimum: The global optimum; None if the box is too wide to search.
        refinement: The seeds refined by Levenberg-Marquardt; None without seeds.
        tables: Tables over SOC that are the answer.
        assessment: Intervals and diagnostics of the constant circuit.
        hold_shift_ohm: The increase of its R0 if a sample's current flowed on its other side, if
            that is undetermined.
    """
    best = best_of(refinement, optimum)
    if optimum is not None and refinement is not None:
        optimum = optimum.beside(refinement)
    constant, of_answer = evaluations[0], evaluations[-1]
    part = ConstantPart(
        model=problem.circuit,
        parameters=best.parameters,
        source="seeds" if best is refinement else "global optimum",
        at_bound=best.at_bound,
        metrics=MetricsBlock.of(problem.name, constant),
        global_optimum=optimum,
        assessment=assessment,
        hold_shift_ohm=hold_shift_ohm,
        search=None if refinement is None else refinement.search,
        refined=refinement,
        bounds=dict(problem.bounds.ranges),
        fixed=dict(problem.bounds.fixed),
    )
    result = Result(
        schema_version=10,
        model=of_answer.identification[0].prepared.circuit,
        metrics=MetricsBlock.of(problem.name, of_answer),
        tables=tables,
        constant=part,
        pulses=tuple(pulse for one in constant.identification for pulse in pulses_of(one.prepared)),
        cell=problem.cell,
        inputs=(
            *(InputPart.simulated("identification", one) for one in constant.identification),
            *(InputPart.simulated("validation", one) for one in constant.validation),
        ),
        versions=versions(),
        **more,
    )
    result._evaluations = tuple(evaluations)
    return result


@in_float64
def _fitted(fit: Callable[[], TableFits], records: Sequence[PreparedRecord]) -> TableFits:
    """The tables of the answer, proved, with their intervals and held-out errors."""
    fits, groups = fit(), [records]
    if fits.over_temperature is not None:
        groups = [group for _, group in sorted(group_by_temperature(records).items())]
    level = tuple(with_level_ends(fit, group) for fit, group in zip(fits, groups, strict=True))
    return replace(fits, fits=level)


def _candidates(setup: Setup, result: Result) -> tuple[Candidate, ...]:
    """The constant circuit and the answer, with their errors."""
    alone, fits = result.without_tables(), result.fits
    held_out = {(one.circuit, one.nodes): one.held_out for one in setup.tried if not one.follows}
    of_constant = Candidate.of(alone, held_out.get((alone.model, 1)), fits.over is None)
    if of_constant.is_answer:
        return (of_constant,)
    crossed = result.fit.cross_validation if fits.over_temperature is None else None
    answer = Candidate.of(result, crossed.tables if crossed else None, True)
    # Without an OCV test the constant circuit uses the OCV fitted with the tables.
    return (answer,) if setup.has_fitted_ocv else (of_constant, answer)


def _assessed(
    setup: Setup, tables: TableFits, evaluations: Evaluations, warnings: list[Notice]
) -> TableFits:
    """The tables with their errors by SOC, and with intervals extended to other possible values of
    R0: with the other sampling if the sampling of the current is undetermined, with a lag, and with
    a pair in it that the samples cannot resolve."""
    records = [evaluation.prepared for evaluation in evaluations.identification]
    other, r0_ohm = tables.other_sampling(records), tables.mean_ohm(R0)
    shifts_ohm = [late_ohm - r0_ohm for late_ohm in _late_ohm(setup.problem)]
    shares = tables.least_r0_shares(records)
    if other is not None:
        shifts_ohm.append(other.most_ohm)
        shares |= other.shares
        if abs(other.r0_ohm) > FAR * r0_ohm:
            warnings.append(hold_warning(setup.problem, r0_ohm, r0_ohm + other.r0_ohm))
    of_means = means_shifts_ohm(records, tables.fits[0].tables, tables.named_ohm)
    return replace(
        tables.spanning(shifts_ohm, shares).spanning(of_means),
        by_soc=bands_by_soc(evaluations.identification),
        hold_shift_ohm=None if other is None else other.r0_ohm,
    )


def _others(
    problem: Problem, circuit: CircuitParameters, other: CircuitParameters | None
) -> list[CircuitParameters]:
    """The constant circuits that are equally possible: with the late part of the response in R0,
    with a pair in it that the samples cannot resolve, and with the other sampling."""
    low_ohm, _ = problem.bounds.ranges.get(R0, (circuit.r0, circuit.r0))
    least_ohm = max(least_r0_share(problem.prepared_records) * circuit.r0, low_ohm)
    r0_ohm = [*_late_ohm(problem), min(least_ohm, circuit.r0)]
    possible = [circuit.with_tables({R0: [ohm]}) for ohm in r0_ohm]
    if other is None:
        return possible
    most_ohm = max(other.r0 + SHORT * (other.r0 - circuit.r0), 0.0)
    return [*possible, other, other.with_tables({R0: [most_ohm]})]


def _late_ohm(problem: Problem) -> list[float]:
    """R0 with the late part of the response, from the records that have one."""
    answers = (answers_ohm(prepared.record) for prepared in problem.prepared_records)
    return [ohm for ohm in map(late_r0_ohm, answers) if ohm is not None]


def _resampled(problem: Problem, circuit: CircuitParameters) -> CircuitParameters | None:
    """The constant circuit under the other sampling of the current, in closed form at the same time
    constants; None if the sampling is not merely assumed."""
    ohm = circuit.named_ohm
    other = resampling(problem.prepared_records, circuit, ohm)
    if other is None:
        return None
    r_ohm = [
        ohm[one.resistance] * (1 + other.shares.get(one.resistance, 0.0)) for one in circuit.names
    ]
    given = circuit.r0, r_ohm, circuit.tau_s, circuit.gamma, circuit.elements
    return CircuitParameters.of_tau(*given).with_tables({R0: [max(circuit.r0 + other.r0_ohm, 0.0)]})


def optimum_or_none(problem: Problem) -> GlobalOptimum | None:
    """The global optimum; None if the box is too wide to search."""
    return find_global_optimum(problem) if problem.is_compressible else None


def _attempt(part: str, warnings: list[Notice], function: Callable[..., Any], *given: Any) -> Any:
    """The value of the function; if it fails, a warning: the answer is valid without it."""
    try:
        return function(*given)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError, RuntimeError) as problem:
        reason = str(problem) or type(problem).__name__
        warnings.append(Notice("answer.incomplete", {"part": part, "reason": reason}))
        return None
