"""From files to an identified circuit: what `barnax identify` runs, and a notebook calls.

Records are read once and checked, and the cell is characterized. The circuit is chosen by its
errors on blocks held out of the fit, and its global optimum is proved. Thirty seeds search a
constant circuit, and the answer is assessed and validated.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from .bundled import BUNDLED
from .cell import CellModel
from .checks.against_cell import compare_resistances
from .checks.roles import MAX_HALF_WIDTH, are_unfit
from .constant_problem import CONSTANT, first_problem, with_joint_starts
from .errors import InputError
from .global_optimum import with_better_directions, without_sweep_drop
from .identification import Setup, search_and_assess, set_up
from .inputs import Inputs, listed, read_inputs, telling, unwatched, windows_by_name, windows_of
from .job import Job, takes_options
from .model.prepared import PreparedRecord, prepare_record
from .model.problem import Problem
from .model.window import Window
from .notices import Notice, notice
from .optimizers import make_optimizer
from .over_soc import (
    OwnOcv,
    TableSettings,
    counted_alike,
    group_by_temperature,
    is_loaded,
    register_alone,
    require_temperature,
    require_temperatures,
    rest_warnings,
)
from .own_ocv_run import bounded_tables, own_ocv_of
from .plan import plan_of, planned
from .plan.running import prepare_pulse_tests
from .records import Record
from .records.hold import sampled_as
from .results import Result
from .run import Run
from .search.evaluate import step_warnings
from .settings import OVER_TEMPERATURE, Settings, Trust
from .storing import make_result
from .table_run import R0, table_warnings

# The SOC between which a charge counts: on an LFP cell, 1 % that is lost between two testers is
# worth 100 to 400 mV below 5 % SOC, and a charge stands on the steep end of the OCV above 95 %.
BETWEEN_ENDS = (0.03, 0.95)


@takes_options(Job)
def identify(job: Job) -> Result:
    """The circuit of a cell, identified, proved, assessed and validated.

    A `Job` has all of these options, and can be given in their place.

    Args:
        records: Files, `Record`s or data frames to identify on, one or several. None: the bundled
            cell. For a folder, a plan, or files without `ocv`, roles and windows are chosen
            (`plan.plan`).

    Raises `InputError` if an input cannot be used, naming file, row, value and remedy.

    >>> import barnax
    >>> result = barnax.identify(model="so-rc", seeds=0, trust="none", advise=False)
    >>> result
    Result(model='so-rc', rmse_v=0.023172...
    """
    found = plan_of(job)
    if found is None:
        return _identified(job)
    result = _identified(planned(found, job), found.warnings)
    return result.model_copy(update={"plan": found.stored})


def _identified(job: Job, of_plan: Sequence[Notice] = ()) -> Result:
    """The same, where every file has its role."""
    is_over_temperature = job.over == OVER_TEMPERATURE
    optimizer = make_optimizer(job.method, job.population, job.iterations)
    found: list[OwnOcv] = []
    given = job

    def cell_of(without_test: Sequence[Record], asked: Job = given) -> CellModel:
        """The cell of records that have no OCV test."""
        found.append(own_ocv_of(asked, without_test))
        return found[-1].cell

    inputs = read_inputs(
        job.records, job.ocv, job.validate, job, job,
        capacity=job.capacity, window=job.window, cell=job.cell,
        over_temperature=is_over_temperature, watch=job.watch, without_test=cell_of,
    )  # fmt: skip
    inputs = replace(inputs, warnings=(*of_plan, *inputs.warnings))
    if found:
        # The tables came with the OCV; a constant circuit with that OCV is another fit, whose
        # intervals would take the OCV for known.
        own = {**windows_by_name(job.window), **found[0].windows}
        inputs = replace(inputs, warnings=(*inputs.warnings, *found[0].warnings))
        job = job.changed(window=own, over=job.over or "soc")
    with telling(inputs.warnings), job.watch("Choosing the circuit", 0):
        windows = windows_of(inputs, job.window, job.capacity)
        if not found:
            windows, between = _between_ends(inputs, windows)
            inputs = replace(inputs, warnings=(*inputs.warnings, *between))
            told, windows = windows, _registered(job, inputs, windows)
            inputs = _as_counted(inputs, told, windows)
        box = {"bounds": job.bounds, "fix": job.fix}
        first = first_problem(inputs, windows, job, found[-1] if found else None, **box)
        if not found and not job.keep_starts:
            first = with_joint_starts(first)
            fitted = {own.record.name: own.window for own in first.prepared_records}
            windows = {**windows, **fitted}
        held = [prepared.record for prepared in first.prepared_records]
        is_other = any(
            one.hold.value != record.hold.value
            for one, record in zip(held, inputs.records, strict=True)
        )
        inputs = replace(
            inputs, records=held, validation=[sampled_as(one, held) for one in inputs.validation]
        )
        if found and is_other:
            # An OCV of the records' own was fitted with the other sampling of the current. Its
            # capacity is that of the first fit.
            again = cell_of(held, given.changed(capacity=inputs.cell.capacity_ah))
            again = replace(again, capacity_origin=inputs.cell.capacity_origin)
            inputs = replace(inputs, cell=again)
            windows = {**windows, **found[-1].windows}
            first = first_problem(inputs, windows, job, found[-1], **box)
        # A table has no capacitance to bound or hold.
        tables = bounded_tables(job, but="[F]" if job.over is None else None)
        setup = set_up(first, inputs, windows, job, tables, *found[-1:], **box)
        if is_over_temperature:
            require_temperatures(group_by_temperature(first.prepared_records))
            for prepared in setup.validation(first.circuit):
                require_temperature(prepared)
    run = search_and_assess(setup, optimizer, job, job.trust, job.watch, job.advise)
    run = replace(run, ocv=inputs.ocv)
    read = [*inputs.records, *inputs.validation, *inputs.ocv]
    notes = dict.fromkeys(
        one for record in read if isinstance(record, Record) for one in record.notes
    )
    run = replace(run, notes=tuple(notes), warnings=_all_warnings(inputs.warnings, run))
    return make_result(run)


def _between_ends(
    inputs: Inputs, windows: Mapping[str, Window]
) -> tuple[dict[str, Window], list[Notice]]:
    """The windows, in which a charge beside a record under load, on a flat OCV, does not count at
    the ends that it reaches unless samples are chosen; each is told. The drive would be fitted
    worse for them."""
    known, told = dict(windows), list[Notice]()
    if not inputs.cell.has_flat_ocv:
        return known, told
    simulated = list[PreparedRecord]()
    for record in inputs.records:
        with suppress(InputError):
            simulated.append(prepare_record(record, inputs.cell, CONSTANT, known[record.name]))
    under_load = [prepared for prepared in simulated if is_loaded(prepared)]
    for prepared in simulated if under_load else ():
        name, window, soc = prepared.record.name, prepared.window, prepared.soc[prepared.scored]
        are_chosen = window.score_steps, window.score_soc, window.score_from_s, window.score_to_s
        # Most of what it moves must be charged, and lie between the ends.
        least_soc = float(np.ptp(soc)) / 2
        is_charge = prepared not in under_load and soc[-1] - soc[0] > least_soc
        low, high = BETWEEN_ENDS
        ends = low if soc.min() < low else 0.0, high if soc.max() > high else 1.0
        if any(chosen is not None for chosen in are_chosen) or not is_charge or ends == (0.0, 1.0):
            continue
        if np.ptp(np.clip(soc, *ends)) > least_soc:
            known[name] = replace(window, score_soc=ends)
            told.append(notice("charge.between-ends", name, low_soc=ends[0], high_soc=ends[1]))
    return known, told


def _registered(job: Job, inputs: Inputs, windows: Mapping[str, Window]) -> dict[str, Window]:
    """The windows, with what the OCV test tells of the start and capacity of records whose rests it
    contradicts."""
    circuit, chosen = job.model or CONSTANT, job.table_settings
    if chosen.keep_starts or not chosen.ocv_correction:
        return dict(windows)
    try:
        tables = bounded_tables(job, but="[F]")
        told = [
            prepare_record(record, inputs.cell, circuit, windows[record.name].as_told)
            for record in inputs.records
        ]
        found = counted_alike(told, [register_alone(prepared, tables) for prepared in told])
        return {**windows, **{prepared.record.name: prepared.window for prepared in found}}
    except InputError:
        # What tables cannot be fitted to is refused, or not, by what is fitted to it.
        return dict(windows)


def _as_counted(
    inputs: Inputs, told: Mapping[str, Window], windows: Mapping[str, Window]
) -> Inputs:
    """The inputs whose cell has the capacity that its OCV test tells of all records identified on:
    testers of one cell count some percent apart, and records are mostly of one of them."""
    names = [record.name for record in inputs.records]
    known = [windows[name].registration for name in names]
    by_test = [level.origin for level in known if level and level.origin.by == "OCV test"]
    if len(by_test) < len(names) or any(told[name].capacity_ah for name in names):
        return inputs
    counted_ah = [windows[name].capacity_ah or 0.0 for name in names]
    pairs = zip(counted_ah, by_test, strict=True)
    share = sum(own_ah / level.told_capacity_ah for own_ah, level in pairs) / len(names)

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
    """Tables over SOC from one or several pulse tests, and the resistances of every pulse.

    All other options are those of `identify`. Pulses and rests are found in the records. Tests at
    several temperatures give tables for each temperature.

    Args:
        records: Pulse tests: files, `Record`s or data frames. None: that of the bundled cell at 25
            degC, validated on its drive cycle.
        ocv: The OCV test. Without one, the rests of the pulse test are the OCV, interpolated; of
            several tests at one temperature, those of the first.
        validate: Files, records or data frames to validate on.
        window: The part of a record that is simulated; by default from the end of the rest before
            the first pulse.
        capacity: Capacity of the cell in Ah; by default the charge between the ends of the test.

    Raises `InputError` if a record has no pulses, and where `identify` does.
    """
    if not listed(job.records):
        job = job.changed(
            records=BUNDLED.hppc[1], validate=listed(job.validate) or BUNDLED.validation
        )
    return identify(prepare_pulse_tests(job))


def identify_problem(
    problem: Problem, settings: Settings | None = None, *, trust: Trust = "basic"
) -> Result:
    """`identify` for a problem that is set up already.

    Args:
        problem: A problem from `make_problem`.
        settings: How to search; None runs no seeds, and the answer is the global optimum.
        trust: How closely to examine the answer, as in `identify`.
    """
    settings = settings or Settings(seeds=0)
    optimizer = make_optimizer(settings.method, settings.population, settings.iterations)
    better = with_better_directions(without_sweep_drop(problem))
    alone = Setup(better, lambda circuit: [], TableSettings())
    run = search_and_assess(alone, optimizer, settings, trust, unwatched, False)
    return make_result(replace(run, warnings=_all_warnings((), run)))


def _all_warnings(of_inputs: Sequence[Notice], run: Run) -> tuple[Notice, ...]:
    """Every warning of a run once, in the order of the flow."""
    told = [warning for record in run.ocv for warning in record.warnings]
    told += of_inputs
    told += run.problem.warnings
    for evaluation in run.identification:
        if evaluation.metrics.r2 < 0:
            name = evaluation.prepared.record.name
            told.append(notice("answer.worse-than-constant", name, r2=evaluation.metrics.r2))
    told += compare_resistances(
        [
            (evaluation.prepared.record, evaluation.prepared.temperature_degc)
            for evaluation in run.identification
        ]
    )
    for evaluation in (run.tables or run).identification:
        told += step_warnings(evaluation)
    for evaluation in run.validation:
        told += [*evaluation.prepared.record.warnings, *evaluation.prepared.warnings]
        told += rest_warnings(evaluation.prepared)
    if run.tables is None:
        told += [
            notice("answer.at-bound", name=hit.name, side=hit.side) for hit in run.answer.at_bound
        ]
    else:
        told += table_warnings(run.tables)
    # Its file says so already, with rows and voltages.
    closed = {one.subject for one in told if one.code == "closure.open"}
    told = [one for one in told if one.code != "ocv-test.open" or one.subject not in closed]
    names = {evaluation.prepared.record.name for evaluation in run.identification}
    is_test_right = all(one.code != "ocv-test.disagrees" for one in told)
    if are_unfit(names, told, by_steps=True):
        # Too few steps of current tell no OCV from slow resistances: the test is not to blame.
        told = [one for one in told if one.code != "ocv-test.disagrees"]
    is_by_test = is_test_right and not run.problem.cell.is_of_records
    if is_by_test and _half_width(run) <= MAX_HALF_WIDTH:
        # What an OCV test lets the fit tell, the steps by themselves need not.
        told = [
            one for one in told if not (one.code == "role.unfit" and "half_width" in one.values)
        ]
    return tuple(dict.fromkeys([*told, *run.warnings]))


def _half_width(run: Run) -> float:
    """The median half-width of the answer's intervals of R0, as a share of it; infinite where most
    are open."""
    if run.tables is not None:
        fits = run.tables.found.fits
        intervals = [own for fit in fits for own in fit.intervals if own.name == R0]
    else:
        estimates = run.assessment.uncertainty.estimates if run.assessment else ()
        intervals = [own for own in estimates if own.name == R0]
    halves = [
        (own.high - own.low) / (2 * own.value)
        if own.low is not None and own.high is not None and own.value > 0
        else np.inf
        for own in intervals
    ]
    return float(np.median(halves or [np.inf]))
