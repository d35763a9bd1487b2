"""From files to an identified circuit: what `barnax identify` runs, and a notebook calls.

Records are read once and checked, and the cell is characterized. The circuit is chosen by its
errors on blocks held out of the fit, and its global optimum is proved. Thirty seeds search a
constant circuit, and the answer is assessed and validated.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..cell import CellModel
from ..checks.against_cell import compare_resistances
from ..checks.check_input import MAX_HALF_WIDTH
from ..checks.roles import are_unfit
from ..execution import unwatched
from ..fit.folds import is_loaded
from ..fit.registration import rest_warnings
from ..fit.temperature import group_by_temperature, require_temperatures
from ..fit.temperature_fits import R0, fit_warnings, require_temperature
from ..global_optimum.assumptions import with_better_directions, without_sweep_drop
from ..inputs import Inputs, read_inputs, windows_of, with_warnings_in_errors
from ..job import Job, takes_options, windows_by_name
from ..model.prepared import PreparedRecord
from ..model.problem import Problem
from ..model.window import Window
from ..notices import Notice
from ..optimizers import make_optimizer
from ..plan import plan_given, plan_of, planned
from ..plan.document import GIVEN
from ..records import Record
from ..records.hold import sampled_as
from ..result_parts import InputPart
from ..results import Result
from ..search.evaluate import step_warnings
from ..settings import OVER_TEMPERATURE, Settings, Trust
from .answer import search_and_assess
from .setup import (
    Setup,
    first_circuit,
    fit_ocv,
    problem_of,
    register_all,
    set_up,
    settled,
    with_joint_starts,
)

# The range of SOC in which a charge counts: on an LFP cell, 1 % lost between two testers is 100 to
# 400 mV below 5 % SOC, and a charge stays on the steep end of the OCV above 95 %.
BETWEEN_ENDS = (0.03, 0.95)


@takes_options(Job)
def identify(job: Job) -> Result:
    """The circuit of a cell, identified, proved, assessed and validated.

    A `Job` has all of these options, and can be given instead of them.

    Args:
        records: Files, `Record`s or data frames to identify on, one or several. None: the bundled
            cell. For a folder, a plan, or files without `ocv`, roles and windows are chosen
            (`plan.plan`).

    Raises `InputError` if an input cannot be used, naming file, row, value and remedy.

    >>> import barnax
    >>> result = barnax.identify(model="so-rc", seeds=0, trust="none")
    >>> result
    Result(model='so-rc', rmse_v=0.023172...
    """
    plan = plan_of(job)
    if plan is None:
        return _identified(job)
    result = _identified(planned(plan, job), plan.warnings)
    cell, reason = result.cell, plan.reasons.get("capacity", GIVEN)
    if reason != GIVEN and not cell.ocv_is_fitted:
        # The user gave no capacity: the plan did.
        cell = replace(cell, capacity_origin=reason)
    return result.model_copy(update={"plan": plan.stored, "cell": cell})


def _identified(job: Job, of_plan: Sequence[Notice] = ()) -> Result:
    """The result of a job in which every file has its role."""
    optimizer = make_optimizer(job.method, job.population, job.iterations)
    inputs = read_inputs(job, fit_ocv)
    of_ocv = () if inputs.fitted_ocv is None else inputs.fitted_ocv.warnings
    inputs = replace(inputs, warnings=(*of_plan, *inputs.warnings, *of_ocv))
    with with_warnings_in_errors(inputs.warnings), job.watch("Choosing the circuit", 0):
        prepare = with_ocv_test if inputs.fitted_ocv is None else _with_fitted_ocv
        inputs, windows, first = prepare(job, inputs)
        setup = set_up(first, inputs, windows, job)
        if job.over == OVER_TEMPERATURE:
            require_temperatures(group_by_temperature(first.prepared_records))
            for prepared in setup.validation(first.circuit):
                require_temperature(prepared)
    result = search_and_assess(setup, optimizer, job, job.trust, job.watch)
    read = [*inputs.records, *inputs.validation, *inputs.ocv]
    notes = [one for record in read if isinstance(record, Record) for one in record.notes]
    tests = tuple(InputPart.of("ocv", test) for test in inputs.ocv)
    return _with_warnings(result, setup.problem, inputs).model_copy(
        update={"inputs": (*result.inputs, *tests), "notes": tuple(dict.fromkeys(notes))}
    )


def with_ocv_test(job: Job, inputs: Inputs) -> tuple[Inputs, dict[str, Window], Problem]:
    """The inputs, windows and constant problem of records with an OCV test, which determines starts
    and capacities; where it does not, the voltages with the circuit do."""
    windows = windows_of(inputs, job.window, job.capacity)
    circuit = first_circuit(inputs, job)
    given = problem_of(inputs, windows, job, circuit)
    records, between = _between_ends(given.cell, given.prepared_records)
    if given.is_compressible:
        # If the box is too wide to reduce records for, it is searched, but starts are not fitted.
        records = register_all(job, records)
    moved = windows | {one.record.name: one.window for one in records}
    inputs = _as_counted(inputs, windows, moved)
    inputs = replace(inputs, warnings=(*inputs.warnings, *between))
    first = settled(given if moved == windows else problem_of(inputs, moved, job, circuit))
    if not job.keep_starts:
        first = with_joint_starts(first)
        moved |= {one.record.name: one.window for one in first.prepared_records}
    return _as_sampled(inputs, first), moved, first


def _with_fitted_ocv(
    job: Job, inputs: Inputs, is_last: bool = False
) -> tuple[Inputs, dict[str, Window], Problem]:
    """The inputs, windows and constant problem of records whose OCV was fitted with their tables:
    repeated if it was fitted with a sampling of the current other than the one that the voltages
    support."""
    given = {**windows_by_name(job.window), **inputs.fitted_ocv.windows}
    windows = windows_of(inputs, given, job.capacity)
    circuit = first_circuit(inputs, job)
    first = settled(problem_of(inputs, windows, job, circuit), inputs.fitted_ocv)
    sampled = _as_sampled(inputs, first)
    pairs = zip(inputs.records, sampled.records, strict=True)
    if is_last or all(before.hold.value == after.hold.value for before, after in pairs):
        return sampled, windows, first
    # The capacity is kept from the first fit.
    cell = inputs.cell
    fitted = fit_ocv(job.changed(capacity=cell.capacity_ah), sampled.records)
    cell = replace(fitted.cell, capacity_origin=cell.capacity_origin)
    return _with_fitted_ocv(job, replace(sampled, cell=cell, fitted_ocv=fitted), is_last=True)


def _as_sampled(inputs: Inputs, problem: Problem) -> Inputs:
    """The inputs with the sampling of the current that a problem settled."""
    records = [prepared.record for prepared in problem.prepared_records]
    validation = [sampled_as(record, records) for record in inputs.validation]
    return replace(inputs, records=records, validation=validation)


def _between_ends(
    cell: CellModel, records: Sequence[PreparedRecord]
) -> tuple[list[PreparedRecord], list[Notice]]:
    """The records; the ends of charges on a flat OCV are not scored if there is also a record under
    load, unless samples are chosen, with a notice for each. They would worsen the fit of the
    drive."""
    counted, notices = list(records), list[Notice]()
    under_load = [prepared for prepared in records if cell.has_flat_ocv and is_loaded(prepared)]
    for index, prepared in enumerate(records if under_load else ()):
        window, soc = prepared.window, prepared.soc[prepared.scored]
        are_chosen = window.score_steps, window.score_soc, window.score_from_s, window.score_to_s
        # Most of the charge must be charged, and lie between the ends.
        least_soc = float(np.ptp(soc)) / 2
        is_charge = prepared not in under_load and soc[-1] - soc[0] > least_soc
        low, high = BETWEEN_ENDS
        ends = low if soc.min() < low else 0.0, high if soc.max() > high else 1.0
        if any(chosen is not None for chosen in are_chosen) or not is_charge or ends == (0.0, 1.0):
            continue
        if np.ptp(np.clip(soc, *ends)) > least_soc:
            counted[index] = prepared.in_window(replace(window, score_soc=ends))
            at = {"low_soc": ends[0], "high_soc": ends[1]}
            notices.append(Notice("charge.between-ends", at, prepared.record.name))
    return counted, notices


def _as_counted(
    inputs: Inputs, given: Mapping[str, Window], windows: Mapping[str, Window]
) -> Inputs:
    """The inputs with the capacity of the cell that the OCV test gives for all records identified
    on: testers of one cell count some percent apart, and records are mostly from one of them."""
    names = [record.name for record in inputs.records]
    registrations = [windows[name].registration for name in names]
    by_test = [level.origin for level in registrations if level and level.origin.by == "OCV test"]
    if len(by_test) < len(names) or any(given[name].capacity_ah for name in names):
        return inputs
    counted_ah = [windows[name].capacity_ah or 0.0 for name in names]
    pairs = zip(counted_ah, by_test, strict=True)
    share = sum(record_ah / level.given_capacity_ah for record_ah, level in pairs) / len(names)

    def counted(cell: CellModel) -> CellModel:
        return replace(
            cell,
            capacity_ah=share * cell.capacity_ah,
            capacity_origin="by which the records identified on agree with the OCV test, which "
            f"has {cell.capacity_ah:.4f} Ah",
            elsewhere=tuple(map(counted, cell.elsewhere)),
        )

    return replace(inputs, cell=counted(inputs.cell))


@takes_options(Job)
def hppc(job: Job) -> Result:
    """Tables over SOC from one or more pulse tests, and the resistances of every pulse.

    All other options are those of `identify`. Pulses and rests are detected in the records. Tests
    at several temperatures give tables for each temperature.

    Args:
        records: Pulse tests: files, `Record`s or data frames. None: that of the bundled cell at 25
            degC, validated on its drive cycle.
        ocv: The OCV test. Without one, the OCV is interpolated between the rests of the pulse test;
            for several tests at one temperature, those of the first.
        validate: Files, records or data frames to validate on.
        window: The simulated part of a record; by default from the end of the rest before the first
            pulse.
        capacity: Capacity of the cell in Ah; by default the charge between the ends of the test.

    Raises `InputError` if a record has no pulses, and in the cases of `identify`.
    """
    return _identified(planned(plan_given(job, "hppc"), job))


def identify_problem(
    problem: Problem, settings: Settings | None = None, *, trust: Trust = "basic"
) -> Result:
    """`identify` for an existing problem.

    Args:
        problem: A problem from `make_problem`.
        settings: Search settings; None runs no seeds, and the answer is the global optimum.
        trust: How closely to examine the answer, as in `identify`.
    """
    settings = settings or Settings(seeds=0)
    optimizer = make_optimizer(settings.method, settings.population, settings.iterations)
    better = with_better_directions(without_sweep_drop(problem))
    alone = Setup(better, lambda circuit: [])
    result = search_and_assess(alone, optimizer, settings, trust, unwatched)
    return _with_warnings(result, better)


def _with_warnings(result: Result, problem: Problem, inputs: Inputs | None = None) -> Result:
    """The result with every warning once, in the order of the flow, including those of its
    assessment."""
    identified, of_constant = result.evaluations.identification, result.without_tables().evaluations
    of_tests = [one for test in inputs.ocv for one in test.warnings] if inputs else []
    warnings = [*of_tests, *(inputs.warnings if inputs else ()), *problem.warnings]
    warnings += [
        Notice("answer.worse-than-constant", {"r2": one.metrics.r2}, one.prepared.record.name)
        for one in of_constant.identification
        if one.metrics.r2 < 0
    ]
    records = [(one.prepared.record, one.prepared.temperature_degc) for one in identified]
    warnings += compare_resistances(records)
    bounds = {bound.name for bound in result.at_bound}
    lower_ends = [
        (fact.low or 0.0) / fact.value
        for fact in result.fit.facts
        if fact.name == R0 and fact.is_mean and fact.is_assessed and fact.value and R0 not in bounds
    ]
    for one in identified:
        warnings += step_warnings(one, result.fits.of(one.prepared), *lower_ends)
    for prepared in (one.prepared for one in of_constant.validation):
        warnings += [*prepared.record.warnings, *prepared.warnings, *rest_warnings(prepared)]
    warnings += fit_warnings(result.fits, result.evaluations)
    warnings = _without_contradicted(result, warnings)
    return result.model_copy(
        update={"warnings": tuple(dict.fromkeys([*warnings, *result.warnings]))}
    )


def _without_contradicted(result: Result, warnings: Sequence[Notice]) -> list[Notice]:
    """The warnings without those contradicted by another one, or by the answer."""
    # A warning on its file already gives rows and voltages.
    closed = {one.subject for one in warnings if one.code == "closure.open"}
    kept = [one for one in warnings if one.code != "ocv-test.open" or one.subject not in closed]
    names = {part.name for part in result.of_role("identification")}
    is_test_right = all(one.code != "ocv-test.disagrees" for one in kept)
    if are_unfit(names, kept, by_steps=True):
        # Too few current steps cannot separate OCV from slow resistances: the test is not at fault.
        kept = [one for one in kept if one.code != "ocv-test.disagrees"]
    is_by_test = is_test_right and not result.cell.ocv_is_fitted
    if is_by_test and _half_width(result) <= MAX_HALF_WIDTH:
        # A fit with an OCV test may determine what the steps alone do not.
        kept = [
            one for one in kept if not (one.code == "role.unfit" and "half_width" in one.values)
        ]
    return kept


def _half_width(result: Result) -> float:
    """The median half-width of the answer's intervals of R0, as a share of it; infinite if most are
    open."""
    intervals = [one for fit in result.fits for one in fit.intervals if one.name == R0]
    halves = [
        (one.high - one.low) / (2 * one.value)
        if one.low is not None and one.high is not None and one.value > 0
        else np.inf
        for one in intervals
    ]
    return float(np.median(halves or [np.inf]))
