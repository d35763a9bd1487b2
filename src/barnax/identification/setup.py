"""The searches of a run: the constant circuit on its records, the circuit of the family chosen on
them, and without an OCV test the cell identified from the records themselves."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from ..cell import get_circuit
from ..cell.parameters import RATE
from ..execution import in_float64
from ..fit.certificate import certify
from ..fit.fitted_ocv import FittedOcv, compare_ocv, fit_temperatures_with_ocv, prove_with_ocv
from ..fit.registration import (
    ROUNDS,
    SETTLED,
    register,
    register_on_ocv_test,
    with_common_capacity,
    with_start,
)
from ..fit.settings import TableSettings
from ..fit.starts import RecordsWithoutOcvTest, Starts
from ..fit.table_fit import assemble_fit
from ..fit.table_problem import find_best, reduced_objective
from ..fit.temperature import fit_temperatures, group_by_temperature
from ..fit.temperature_fits import TableFits
from ..global_optimum.assumptions import (
    with_better_directions,
    with_better_hold,
    without_sweep_drop,
)
from ..global_optimum.search import find_global_optimum
from ..inputs import Inputs
from ..job import Job, window_of
from ..model.prepared import PreparedRecord, prepare_record
from ..model.problem import Problem, make_problem, require_enough
from ..model.search_space import Range
from ..model.window import Window
from ..notices import Notice
from ..records import Record
from ..select.choose import Choice, Fitted, Tried, choose
from ..select.family import limits_of
from ..select.policy import Policy
from ..settings import OVER_TEMPERATURE
from ..uncertainty.covariance import Covariance, linearize

# The circuit of the population search in addition to tables.
CONSTANT = "so-rc"
# A start is fitted with the circuit if its standard error has this effect on the voltage.
LEAST_DOUBT_V = 0.002


def settled(problem: Problem, fitted: FittedOcv | None = None) -> Problem:
    """The problem with the OCV at rest if sweeps measured it under load, and with the directions
    before the start and the sampling of the current that the voltage supports."""
    problem = without_sweep_drop(problem)
    if fitted is not None and get_circuit(problem.circuit).has_rate:
        # A hysteresis fitted with the OCV was identified with the better-fitting directions.
        records = [
            one.fitting_better(fitted.directions[one.record.name])
            if one.record.name in fitted.directions
            else one
            for one in problem.prepared_records
        ]
        problem = problem.keeping_computed(prepared_records=tuple(records))
    else:
        problem = with_better_directions(problem)
    return with_better_hold(problem)


def with_joint_starts(problem: Problem) -> Problem:
    """The problem of a single record with the start at which it fits best together with the
    circuit, with the rest's start and standard error as prior, if that error is worth
    millivolts."""
    first, *others = problem.prepared_records
    given, sd = first.start, float(first.start.soc_sd)
    doubt_v = sd * first.cell.ocv_slope(first.soc[:1])[0]
    # Several records determine each other's starts.
    is_open = doubt_v >= LEAST_DOUBT_V and not others and problem.is_compressible
    for _ in range(ROUNDS if is_open else 0):
        optimum = find_global_optimum(problem, prove=False)
        joint = Covariance.of(linearize(problem, optimum.parameters))
        # In standard errors of the given start.
        step, error = float(joint.nuisances_step[0]), float(joint.nuisances_error[0])
        away_soc = problem.prepared.start.soc + sd * step - given.soc
        move = away_soc, 0.0, sd * error, 0.0
        moved = with_start(first, first, *move, by="circuit", given_sd=sd)
        if moved is None:
            break
        start = replace(moved.start, direction_source=given.direction_source)
        problem = replace(problem, prepared_records=(replace(moved, start=start),))
        if abs(step) < SETTLED * error:
            break
    return problem


def first_circuit(inputs: Inputs, job: Job) -> str:
    """The circuit of the population search before another one is chosen."""
    if inputs.fitted_ocv is not None:
        return inputs.fitted_ocv.circuit
    start = limits_of(inputs.cell, TableSettings()).start
    return job.model or (CONSTANT if start == "1rc" else start)


def problem_of(
    inputs: Inputs,
    windows: Mapping[str, Window],
    job: Job,
    circuit: str,
    usual: Mapping[str, Range] | None = None,
) -> Problem:
    """The problem of a circuit, with `usual` bounds if none are given; compressed if the box allows
    it unless the objective is chosen."""
    problem = make_problem(
        inputs.records,
        inputs.cell,
        circuit,
        window=[windows[record.name] for record in inputs.records],
        bounds={**(usual or {}), **job.ranges.by_name},
        fixed=job.fix,
        coordinates=job.coordinates,
        objective="scan" if job.objective == "auto" else job.objective,
        source=job.ranges.source,
    )
    require_enough(problem)
    is_compressed = job.objective == "auto" and problem.is_compressible
    return problem.keeping_computed(kind="compressed") if is_compressed else problem


@dataclass(frozen=True, eq=False)
class Setup:
    """The problem, records and fit of a run.

    Attributes:
        problem: The constant circuit of the population search: the answer, or in addition to it.
        validation: The validation records, prepared for a circuit.
        fit: Fits and proves the tables that are the answer; None for a constant circuit.
        records: The records behind these.
        tried: The circuits tried.
        has_fitted_ocv: Whether the constant circuit has an OCV that was fitted with these tables.
    """

    problem: Problem
    validation: Callable[[str], list[PreparedRecord]]
    fit: Callable[[], TableFits] | None = None
    records: Sequence[PreparedRecord] = ()
    tried: tuple[Tried, ...] = ()
    has_fitted_ocv: bool = False


def asks_for_constant(job: Job) -> bool:
    """True if a constant circuit is requested: a model without tables, or a bounded or held
    capacitance, which tables do not have."""
    named = *job.ranges.by_name, *(job.fix or ())
    has_farads = any(name.endswith("[F]") for name in named)
    is_constant = (job.model is not None and job.over is None) or has_farads
    return is_constant and job.over != OVER_TEMPERATURE


def set_up(first: Problem, inputs: Inputs, windows: Mapping[str, Window], job: Job) -> Setup:
    """Set up a run: without an OCV test the tables came with the cell's OCV; for tables over
    temperature, and if a constant circuit is requested, there is nothing to choose."""
    # A table has no capacitance to bound or hold.
    tables = bounded_tables(job, but="[F]" if job.over is None else None)
    inputs, fitted = replace(inputs, cell=first.cell), inputs.fitted_ocv

    def prepared(records: Iterable[Record], circuit: str) -> list[PreparedRecord]:
        return [prepare_record(one, first.cell, circuit, windows[one.name]) for one in records]

    validation = partial(prepared, inputs.validation)

    # A validation record that does not fit its window is rejected before the search, not after.
    _ = validation(first.circuit)
    if fitted is not None:
        of_ocv = first.prepared_records, fitted.tried
        return Setup(first, validation, lambda: fitted.fits, *of_ocv, has_fitted_ocv=True)
    if job.over == OVER_TEMPERATURE:
        groups = group_by_temperature(first.prepared_records)
        fit = partial(fit_temperatures, groups, tables)
        return Setup(first, validation, fit, first.prepared_records)
    if asks_for_constant(job):
        return Setup(first, validation)
    limits = limits_of(first.cell, tables, job.model, None if job.over is None else True)

    def prepare(circuit: str) -> Sequence[PreparedRecord]:
        if not get_circuit(circuit).has_hysteresis:
            return prepared([one.record for one in first.prepared_records], circuit)
        if first.circuit == circuit:
            return first.prepared_records
        made = problem_of(inputs, windows, job.changed(bounds=None, fix=None), circuit)
        return with_better_directions(made).prepared_records

    choice = choose(prepare, tables, limits)
    chosen = choice.chosen
    problem, point = first, chosen.point
    registered = chosen.objective.prepared_records
    if point.is_constant and point.circuit != first.circuit:
        # With the bounds of the rate under which it was chosen.
        is_free = point.has_rate and RATE not in (job.fix or {})
        rate = {RATE: chosen.objective.ranges[RATE]} if is_free else None
        made = problem_of(inputs, windows, job, point.circuit, rate)
        problem = with_better_directions(made)
    problem = _on_windows(problem, registered)
    fit = None if point.is_constant and point.law is None else partial(_proved, chosen)
    return Setup(problem, validation, fit, registered, choice.tried)


def _proved(chosen: Fitted) -> TableFits:
    """The chosen tables, proved, with a comparison of a fitted OCV with the test's."""
    objective = chosen.objective
    fit = assemble_fit(objective, certify(objective, chosen.best))
    compared = compare_ocv(objective.prepared_records, fit, objective.settings)
    return TableFits((replace(fit, ocv_compared=compared),), settings=objective.settings)


def _on_windows(problem: Problem, registered: Sequence[PreparedRecord]) -> Problem:
    """The problem with starts and capacities registered on other records."""
    windows = {one.record.name: one.window for one in registered}
    if all(windows[one.record.name] == one.window for one in problem.prepared_records):
        return problem
    records = tuple(one.in_window(windows[one.record.name]) for one in problem.prepared_records)
    return replace(problem, prepared_records=records)


def register_all(job: Job, records: Sequence[PreparedRecord]) -> list[PreparedRecord]:
    """The records, registered on the OCV test if their rests contradict it, and if a constant
    circuit is requested, several of them on each other; otherwise that follows once a circuit is
    chosen."""
    circuit, chosen = job.model or CONSTANT, job.table_settings
    has_no_amplitude = chosen.half_hysteresis and not get_circuit(circuit).has_rate
    if chosen.keep_starts or not chosen.ocv_correction or has_no_amplitude:
        return list(records)
    tables = bounded_tables(job, but="[F]")
    if not get_circuit(circuit).has_rate:
        # On a flat OCV, registration needs a circuit with a hysteresis, whose rate may be bounded.
        bounds = {name: ends for name, ends in tables.bounds.items() if name != RATE}
        fixed = {name: value for name, value in tables.fixed.items() if name != RATE}
        tables = replace(tables, bounds=bounds, fixed=fixed)
    alone = [
        one
        if one.circuit == circuit and one.window.registration is None
        else replace(one, circuit=circuit).in_window(one.window.unregistered)
        for one in records
    ]
    by_test = with_common_capacity(
        alone, [register_on_ocv_test(prepared, tables) for prepared in alone]
    )
    return register(by_test, tables) if asks_for_constant(job) and by_test[1:] else by_test


def bounded_tables(job: Job, but: str | None = None) -> TableSettings:
    """Settings of tables, with the bounds and fixed values of the circuit, except those in a unit
    that tables do not have."""
    tables = job.table_settings

    def kept(given: Mapping[str, Any] | None) -> dict[str, Any]:
        return {name: v for name, v in (given or {}).items() if but is None or but not in name}

    bounds, fixed = kept(job.ranges.by_name), kept(job.fix)
    return replace(tables, bounds={**bounds, **tables.bounds}, fixed={**fixed, **tables.fixed})


@in_float64
def fit_ocv(job: Job, records: Sequence[Record]) -> FittedOcv:
    """The cell of records that have no OCV test, with their tables, or one value at every SOC.

    Raises `InputError` if a requested option needs a test.
    """
    model = job.model and get_circuit(job.model)
    asked = {
        f"the hysteresis of {job.model}": model and model.has_hysteresis and not model.has_rate,
        "an OCV polynomial": job.ocv_fit == "polynomial",
    }
    for what, is_asked in asked.items():
        if is_asked:
            raise Notice("ocv-test.missing", {"asked": what}).error()
    windows = {record.name: window_of(job.window, record.name).unregistered for record in records}
    tables = bounded_tables(job)
    untested = RecordsWithoutOcvTest.of(records, windows, tables, job.capacity)
    if job.over == OVER_TEMPERATURE:
        return fit_temperatures_with_ocv(untested, job.model or "so-rc")
    over_soc = None if job.model is None and job.over is None else job.over is not None
    limits = limits_of(untested.level, tables, job.model, over_soc, has_ocv=True)
    starts: dict[str, Starts] = {}

    def prepare(circuit: str) -> list[PreparedRecord]:
        starts[circuit] = untested.starts(circuit, next(iter(starts.values()), None))
        return untested.prepared(circuit, starts[circuit].windows)

    choice = choose(prepare, tables, limits)
    chosen, point = choice.chosen, choice.chosen.point
    if len(records) > 1 and point.circuit not in starts:
        # The others' starts are those at which this circuit fits best.
        prepared = [one.with_dependence(point.law) for one in prepare(point.circuit)]
        objective = reduced_objective(prepared, chosen.objective.settings)
        chosen = Fitted(point, objective, find_best(objective), chosen.loss)
    # Circuits with the same kind of hysteresis share their starts.
    alike = (circuit for circuit in starts if get_circuit(circuit).has_rate == point.has_rate)
    chosen_starts = starts[point.circuit if point.circuit in starts else next(alike)]
    proved = prove_with_ocv(untested, chosen.objective, chosen.best, chosen_starts)
    warnings = (*proved.warnings, *_left_out(choice))
    return replace(proved, tried=choice.tried, warnings=warnings)


def _left_out(choice: Choice) -> Iterator[Notice]:
    """The warnings if the requested circuit leaves out an effect that the records support."""
    left_out = {tried.ladder: tried for tried in choice.tried if tried.outcome == "not asked for"}
    if "hysteresis" in left_out:
        given = choice.chosen.point.circuit, left_out["hysteresis"].circuit
        yield Notice("tables.hysteresis-left-out", {"circuit": given[0], "instead": given[1]})
    if "law" in left_out:
        yield Notice("tables.direction-left-out")
    for tried in choice.tried:
        if tried.ladder == "hysteresis" and tried.outcome == "not determined":
            turned_soc = 3 / Policy.fastest_rate
            yield Notice(
                "tables.turns-at-once", {"turned_soc": turned_soc, "instead": tried.circuit}
            )
            return
