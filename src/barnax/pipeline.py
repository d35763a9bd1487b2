"""From files to an identified circuit: what `barnax identify` runs, and a notebook calls.

Records are read once and checked, and the cell is characterized. Constant circuits, each with its
global optimum, and tables over SOC are weighed against each other by their errors on blocks held
out of the fit. Thirty seeds search the best constant circuit, and the answer is assessed and
validated.
"""

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

import jax
import numpy as np

from .bundled import BUNDLED
from .candidates import (
    CONTRADICTED,
    WEIGHED,
    Candidate,
    best_of,
    is_better,
    spans_enough,
    tabulated_circuit,
)
from .cell import CellModel
from .cell.curves import HysteresisFit, OcvFit
from .display import Brief
from .errors import InputError
from .execution import threads
from .global_optimum import (
    GlobalOptimum,
    find_global_optimum,
    hold_warning,
    try_other_hold,
    with_better_directions,
    with_better_hold,
    without_sweep_drop,
)
from .inputs import (
    OVER_TEMPERATURE,
    Given,
    Inputs,
    Reading,
    Settings,
    Watch,
    listed,
    ranges_of,
    read_inputs,
    read_validation,
    telling,
    unwatched,
    windows_of,
)
from .model.prepared import PreparedRecord, prepare_record
from .model.problem import Kind, Problem, known_to, make_problem
from .model.search_space import Range
from .model.window import Window
from .optimizers import make_optimizer
from .over_soc import (
    SocErrors,
    TableSettings,
    constant_held_out,
    group_by_temperature,
    require_temperature,
    require_temperatures,
)
from .plan import plans_first
from .plan.running import prepare_pulse_tests
from .records import Record
from .records.fingerprint import Content
from .results import Result
from .run import Run, best_answer, make_result
from .search.evaluate import Evaluation, evaluate, evaluate_from_either
from .search.refine import Descent, refine
from .search.seeds import search_seeds
from .table_run import TableRun, fit_over, table_warnings
from .uncertainty import assess, compile_linearization, examine

Chosen = TypeVar("Chosen")
# What a warning says first where the full examination failed.
FITTING_AGAIN = "fitting again"


Function = TypeVar("Function", bound=Callable[..., Result])
# What `**options` stand for.
_FIELDS = tuple(
    inspect.Parameter(
        field.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=getattr(group(), field.name),
        annotation=field.type,
    )
    for group in (Settings, Reading, TableSettings)
    for field in fields(group)
)


def _showing(options: Iterable[inspect.Parameter]) -> Callable[[Function], Function]:
    """A signature with these in place of `**options`, for editors and the reference."""

    def shown(function: Any) -> Any:
        own = inspect.signature(function)
        kept = {name: one for name, one in own.parameters.items() if name != "options"}
        kept |= {one.name: one for one in options if one.name not in kept}
        function.__signature__ = own.replace(parameters=[*kept.values()])
        return function

    return shown


@_showing(_FIELDS)
@plans_first
def identify(
    records: Given | Sequence[Given] = (),
    *,
    ocv: Given | Sequence[Given] = (),
    validate: Given | Sequence[Given] = (),
    settings: Settings | None = None,
    tables: TableSettings | None = None,
    window: Window | Mapping[str, Window] | None = None,
    capacity: float | None = None,
    ocv_capacity: float | None = None,
    bounds: Mapping[str, Range] | str | Path | None = None,
    fix: Mapping[str, float] | None = None,
    reading: Reading | None = None,
    setup: Literal["li2023"] | None = None,
    ocv_fit: OcvFit | None = None,
    hysteresis_fit: HysteresisFit = "continuous",
    trust: Literal["none", "basic", "full"] = "basic",
    cell: CellModel | None = None,
    advise: bool = True,
    command: Sequence[str] = (),
    watch: Watch = unwatched,
    **options: Any,
) -> Result:
    """The circuit of a cell, identified, proved, assessed and validated.

    Every field of `Settings`, `Reading` and `TableSettings` can be given by its name too.

    Args:
        records: Files, `Record`s or data frames to identify on, one or several. None: the bundled
            cell. For a folder, a plan, or files without `ocv`, roles and windows are chosen
            (`plan.plan`).
        ocv: Files, records, data frames or tables of the OCV test of the same cell.
        validate: Files, records or data frames to validate on.
        settings: The circuit, and how to search for it.
        tables: How tables over SOC are fitted; needs `over`.
        window: The part of a record that is simulated: one for all records, or a mapping from
            record names to windows, with "" for the others.
        capacity: Capacity of the cell in Ah when the records were measured.
        ocv_capacity: Capacity in Ah in the OCV test, where that does not span full to empty.
        bounds: Lowest and highest value by PyBaMM's names (`"R0 [Ohm]"`, `"C1 [F]"`, `"tau1 [s]"`),
            or a TOML file of them.
        fix: Parameters that keep a value, by the same names.
        reading: How files are read.
        setup: "li2023" for the set-up of Li et al. (2023): iso-rc alone, on an OCV polynomial.
        ocv_fit: The OCV curve: a monotone interpolation, the default, or a polynomial of degree
            seven.
        hysteresis_fit: Five segments of the hysteresis voltage, joined or each by itself.
        trust: "none", "basic" (intervals) or "full" (further fits).
        cell: A known cell, which needs no `ocv`.
        advise: Also weigh the usual circuits where `model` is given, and try the other hold of the
            current where that is assumed.
        command: The command that was run, kept in the result.
        watch: Called with the title of every stage and its number of steps; returns a context
            manager that gives a function to call with the steps done.

    Raises `InputError` if an input cannot be used, naming file, row, value and remedy.

    >>> import barnax
    >>> result = barnax.identify(seeds=2, iterations=5, trust="none")
    >>> result
    Result(model='so-rc', over='soc', rmse_v=0.0070419...)
    """
    settings = _with_options(settings or Settings(), options)
    reading = _with_options(reading or Reading(), options)
    tables = _with_options(tables or TableSettings(), options)
    if setup == "li2023":
        settings = replace(settings, model=settings.model or "iso-rc")
        ocv_fit = ocv_fit or "polynomial"
    elif setup is not None:
        raise InputError(f"`setup` {setup!r} is not known; there is 'li2023'")
    if settings.over is None and settings.model is not None and tables != TableSettings():
        raise InputError("settings of tables need `over` 'soc'; give it too, or no `model`")
    if options:
        own = sorted(options.keys() & {each.name for each in fields(Window)})
        remedy = f"; give window=barnax.Window({own[0]}=...)" if own else ""
        raise TypeError(f"identify() has no option {', '.join(sorted(options))}{remedy}")
    optimizer = make_optimizer(settings.method, settings.population, settings.iterations)
    if trust not in ("none", "basic", "full"):
        raise InputError(f"`trust` {trust!r} is not known; there are none, basic, full")
    inputs = read_inputs(
        records, ocv, validate, reading,
        capacity=capacity, ocv_capacity=ocv_capacity,
        ocv_fit=ocv_fit or "interpolated", hysteresis_fit=hysteresis_fit,
        window=window, cell=cell, over_temperature=settings.over == OVER_TEMPERATURE,
        watch=watch,
    )  # fmt: skip
    with telling(inputs.warnings), watch("Setting up the problem", 0):
        windows = windows_of(inputs, window, capacity)
        weighing = _weighing(inputs, windows, settings, tables, bounds, fix, advise)
        if settings.over == OVER_TEMPERATURE:
            require_temperatures(group_by_temperature(weighing.first.prepared_records))
            for each in weighing.validation(weighing.first):
                require_temperature(each)
    run = _search_and_assess(weighing, optimizer, settings, trust, watch, advise)
    run = replace(run, ocv=inputs.ocv)
    read = [*inputs.records, *inputs.validation, *inputs.ocv]
    notes = dict.fromkeys(text for each in read if isinstance(each, Record) for text in each.notes)
    run = replace(run, notes=tuple(notes), warnings=_all_warnings(inputs.warnings, run))
    return make_result(run, command)


@_showing(inspect.signature(identify).parameters.values())
def hppc(
    records: Given | Sequence[Given] = (),
    *,
    ocv: Given | Sequence[Given] = (),
    validate: Given | Sequence[Given] = (),
    window: Window | Mapping[str, Window] | None = None,
    capacity: float | None = None,
    reading: Reading | None = None,
    watch: Watch = unwatched,
    **options: Any,
) -> Result:
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
        reading: How files are read.
        watch: Called for every stage, as in `identify`.

    Raises `InputError` if a record has no pulses, and where `identify` does.
    """
    if not listed(records):
        records, validate = BUNDLED.hppc[1], validate or BUNDLED.validation
    prepared = prepare_pulse_tests(
        records, ocv=ocv, window=window, capacity=capacity, reading=reading, watch=watch, **options
    )
    return identify(validate=validate, **prepared)


def identify_problem(
    problem: Problem,
    settings: Settings | None = None,
    *,
    trust: Literal["none", "basic"] = "basic",
) -> Result:
    """`identify` for a problem that is set up already.

    Args:
        problem: A problem from `make_problem`.
        settings: How to search; None runs no seeds, and the answer is the global optimum.
        trust: "none" or "basic" (intervals).
    """
    settings = settings or Settings(seeds=0)
    optimizer = make_optimizer(settings.method, settings.population, settings.iterations)
    better = with_better_directions(without_sweep_drop(problem))
    alone = Weighing((better,), better, None, None, lambda problem: [])
    run = _search_and_assess(alone, optimizer, settings, trust, unwatched, False)
    return make_result(replace(run, warnings=_all_warnings((), run)))


def _with_options(settings: Chosen, options: dict[str, Any]) -> Chosen:
    """The settings with the options that are theirs, which are taken out."""
    own = {name: options.pop(name) for name in list(options) if hasattr(settings, name)}
    changed: Any = settings
    return replace(changed, **own)


@dataclass(frozen=True, eq=False, repr=False)
class Weighing(Brief):
    """What is weighed: constant circuits, of which one may be chosen already, and tables.

    Attributes:
        problems: Those of the constant circuits, the simplest first.
        chosen: The problem that the constant answer is of; None leaves it to the held-out errors.
        tabulated: The problem whose records tables are fitted to, None without tables.
        tables: How they are fitted, and how blocks are held out; None holds out nothing.
        validation: The records to validate on, prepared for the circuit of a problem.
    """

    problems: tuple[Problem, ...]
    chosen: Problem | None
    tabulated: Problem | None
    tables: TableSettings | None
    validation: Callable[[Problem], list[PreparedRecord]]

    @property
    def first(self) -> Problem:
        return self.problems[0]


def _weighing(
    inputs: Inputs,
    windows: Mapping[str, Window],
    settings: Settings,
    tables: TableSettings,
    bounds: Mapping[str, Range] | str | Path | None,
    fix: Mapping[str, float] | None,
    advise: bool,
) -> Weighing:
    """The circuits that are weighed, each with its problem; a given one comes first."""
    over, model = settings.over, settings.model
    tabulated = model or tabulated_circuit(inputs.cell)
    if over == OVER_TEMPERATURE:
        models = (tabulated,)
    elif model is None:
        models = WEIGHED
    else:
        models = (model, *(each for each in WEIGHED if each != model)) if advise else (model,)
    source, ranges = ranges_of(bounds)
    known = [(known_to(each, ranges, models), known_to(each, fix, models)) for each in models]
    first = without_sweep_drop(_problem(inputs, windows, settings, models[0], source, *known[0]))
    first = with_better_hold(with_better_directions(first))
    # All have the OCV that the first circuit finds at rest, and the hold that it tells.
    records = [each.record for each in first.prepared_records]
    inputs, problems = replace(inputs, cell=first.cell, records=records), [first]
    for name, (own_ranges, own_fix) in zip(models[1:], known[1:], strict=True):
        try:
            made = _problem(inputs, windows, settings, name, source, own_ranges, own_fix)
        except InputError:
            # A box for the circuit that was asked for need not be one for another.
            if model is None:
                raise
            continue
        problems.append(with_better_directions(made))
    of = {each.circuit: each for each in problems}
    has_tables = over is not None or model is None
    wanted = None
    if tables.folds or has_tables:
        place = models.index(tabulated)
        ranges = {**known[place][0], **tables.bounds}
        wanted = replace(tables, bounds=ranges, fixed={**known[place][1], **tables.fixed})

    def validation(problem: Problem) -> list[PreparedRecord]:
        return [
            prepare_record(record, problem.cell, problem.circuit, windows[record.name])
            for record in inputs.validation
        ]

    # A validation record that does not fit its window is refused before the search, not after.
    _ = validation(first)
    chosen = of[model] if model is not None else problems[0] if len(problems) == 1 else None
    return Weighing(
        tuple(problems), chosen, of[tabulated] if has_tables else None, wanted, validation
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

    if settings.objective != "auto":
        return make(settings.objective)
    problem = make("scan")
    try:
        _ = problem.compressed
    except InputError:
        return problem
    return problem.keeping_computed(kind="compressed")


def _search_and_assess(
    weighing: Weighing,
    optimizer: Any,
    settings: Settings,
    trust: str,
    watch: Watch,
    advise: bool,
) -> Run:
    """The search, and what does not wait for it beside it. No failure of either is swallowed."""
    problems, over = weighing.problems, settings.over or "soc"
    with threads(3) as beside:
        tables_future = None
        if weighing.tabulated is not None and weighing.tables is not None:
            records = weighing.tabulated.prepared_records
            tables_future = beside.submit(fit_over, over, records, weighing.tables)
        held_out_futures = [
            beside.submit(_held_out_or_none, each, weighing.tables)
            if len(problems) > 1 or tables_future
            else None
            for each in problems
        ]
        with watch("Weighing circuits", len(problems)) as advance:
            optima = []
            for each in problems:
                optima.append(_optimum_or_none(each))
                advance(1)
            held_out = [each.result() if each else None for each in held_out_futures]
        place = best_of(held_out) if weighing.chosen is None else problems.index(weighing.chosen)
        problem, optimum = problems[place], optima[place]
        linearization = beside.submit(compile_linearization, problem) if trust != "none" else None
        other_hold_future = beside.submit(try_other_hold, problem) if advise else None
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
            found = tables_future.result() if tables_future else None
            other_hold = other_hold_future.result() if other_hold_future else None
    answer = best_answer(refinement, optimum)
    warnings: list[str] = []
    candidates: list[Candidate] = []
    with watch("Evaluating", 0):
        identified, validated = [], []
        for each, its, held in zip(problems, optima, held_out, strict=True):
            parameters = answer.parameters if each is problem else its and its.parameters
            if parameters is None:
                continue
            by_circuit = partial(evaluate, parameters=parameters)
            own = [by_circuit(record) for record in each.prepared_records]
            others = [
                evaluate_from_either(record, each.cell, by_circuit)
                for record in weighing.validation(each)
            ]
            if each is problem:
                identified, validated = own, others
            candidates.append(Candidate.of(each.circuit, None, own, others, held))
        table_run = None
        if found is not None and weighing.tabulated is not None and weighing.tables is not None:
            of = weighing.tabulated
            table_run = TableRun.of(
                weighing.tables, found, of.prepared_records, weighing.validation(of), of.cell
            )
            held = found.fits[0].cross_validation if found.over_temperature is None else None
            errors = held.tables if held else None
            candidates.append(
                Candidate.of(
                    of.circuit, over, table_run.identification, table_run.validation, errors
                )
            )
            is_worth = is_better(errors, held_out[place]) and spans_enough(found.reference)
            if settings.over is None and not is_worth:
                table_run = None
    is_answer = ("", over) if table_run else (problem.circuit, None)
    told = tuple(
        replace(each, is_answer=(each.over == is_answer[1] and is_answer[0] in ("", each.model)))
        for each in candidates
    )
    assessment = examination = None
    with watch("Assessing", 0):
        if trust != "none":
            assessment = _attempt("the intervals", warnings, assess, problem, answer.parameters)
            if assessment is not None and other_hold is not None:
                known = assessment.uncertainty
                if "R0 [Ohm]" in known.beyond(other_hold.parameters):
                    warnings.append(hold_warning(problem, answer.parameters, other_hold))
                spanning = known.spanning(other_hold.parameters)
                assessment = replace(assessment, uncertainty=spanning)
        if table_run is not None and other_hold is not None:
            table_run = table_run.spanning(other_hold.parameters.r0 - answer.parameters.r0)
        if trust == "full" and assessment is not None:
            key = jax.random.key(settings.key)
            examination = _attempt(
                FITTING_AGAIN, warnings, examine, problem, answer.parameters, assessment, key=key
            )
    return Run(
        problem, search, refinement, optimum, answer, identified, validated, assessment,
        examination, table_run, told, other_hold, warnings=tuple(warnings),
    )  # fmt: skip


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
    what: str, warnings: list[str], function: Callable[..., Any], *given: Any, **more: Any
):
    """What the function gives; where it fails, a warning: the answer stands without it."""
    try:
        return function(*given, **more)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError, RuntimeError) as problem:
        reason = str(problem) or type(problem).__name__
        warnings.append(f"{what} could not be computed ({reason}); the rest of the result is valid")
        return None


def _all_warnings(of_inputs: Sequence[str], run: Run) -> tuple[str, ...]:
    """Every warning of a run once, in the order of the flow."""
    texts = [text for record in run.ocv for text in record.warnings]
    texts += of_inputs
    texts += run.problem.warnings
    for each in run.identification:
        if each.metrics.r2 < 0:
            texts.append(
                f"{each.prepared.record.name}: the circuit does worse than a constant voltage "
                f"would (R2 {each.metrics.r2:.3g}); see the other warnings about its file, and "
                "check its window, `fix` and `bounds`"
            )
    for each in run.validation:
        texts += [*each.prepared.record.warnings, *each.prepared.warnings]
    if run.tables is None:
        texts += [
            f"{each.name} is at its {each.side} bound: the bounds set it, not the data"
            for each in run.answer.at_bound
        ]
        texts += _contradictions(run)
    else:
        texts += table_warnings(run.tables)
    return tuple(dict.fromkeys([*texts, *run.warnings]))


def _contradictions(run: Run) -> Iterator[str]:
    """What another constant circuit, fitted to the same data, says against the answer's."""
    own = next((each for each in run.candidates if each.is_answer), None)
    others = [each for each in run.candidates if not each.is_answer and each.over is None]
    if own is None or not others:
        return
    best = min(others, key=lambda each: each.identification.rmse_v)
    if CONTRADICTED * best.identification.rmse_v < own.identification.rmse_v:
        yield (
            f"the data contradict {own.model}: {best.model}, also the best of its kind, leaves "
            f"{1e3 * best.identification.rmse_v:.3g} mV where {own.model} leaves "
            f"{1e3 * own.identification.rmse_v:.3g} mV, so the intervals of {own.model} do not "
            f"hold; identify with `model` {best.model}"
        )


def validate_stored(
    stored: Result,
    record: Given,
    window: Window | None = None,
    *,
    current_sign: str = "auto",
    current_hold: str = "auto",
    columns: Mapping[str, str] | str = "",
    series: int = 1,
) -> tuple[Evaluation, list[str]]:
    """A stored circuit on another record, as its evaluation and the warnings about that record.

    Args:
        stored: The result, with tables over SOC or without.
        record: A file, `Record` or data frame.
        window: The part of the record that is simulated; by default the window on which the records
            identified on agree.
        current_sign: The sign of the file's current; "auto" decides from the data.
        current_hold: When a sample's current flows; "auto" decides from the data.
        columns: Names of columns, as for `read_record`.
        series: How many cells are in series, as for `read_record`.

    Raises `InputError` if the record or its window cannot be used.
    """
    reading = Reading(
        validate_current_sign=current_sign,
        current_hold=current_hold,
        columns=columns,
        series=series,
    )
    window = window or stored.common_window
    cell = stored.cell_model
    measured, warnings = read_validation(record, reading, window, cell, stored.measured_at)
    content = Content(measured)
    for own in stored.of_role("identification"):
        if own.sha256 == measured.sha256 or (own.fingerprint and content.holds(own.fingerprint)):
            warnings.append(
                f"{measured.name}: this is {own.name}, on which the circuit was identified; "
                "validate on another record"
            )
    with telling(warnings):
        prepared = prepare_record(measured, cell, stored.model, window)
    if stored.tables is not None:
        by_circuit = stored.tables.found.evaluate
    else:
        by_circuit = partial(evaluate, parameters=stored.constant.circuit_parameters)
    evaluation = evaluate_from_either(prepared, cell, by_circuit)
    told = (*warnings, *measured.notes, *measured.warnings, *prepared.warnings)
    return evaluation, list(dict.fromkeys(told))
