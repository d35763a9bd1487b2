"""From files to an identified circuit: what `barnax identify` runs, and a notebook calls.

Records are read once and checked, and the cell is characterized. Constant circuits, each with its
global optimum, and tables over SOC are weighed against each other by their errors on blocks held
out of the fit. Thirty seeds search the best constant circuit, and the answer is assessed and
validated.
"""

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

from .bundled import BUNDLED
from .candidates import (
    CONTRADICTED,
)
from .cell import CellModel
from .cell.curves import HysteresisFit, OcvFit
from .errors import InputError
from .global_optimum import (
    with_better_directions,
    without_sweep_drop,
)
from .inputs import (
    OVER_TEMPERATURE,
    Given,
    Reading,
    Settings,
    Watch,
    listed,
    read_inputs,
    telling,
    unwatched,
    windows_of,
)
from .model.problem import Problem
from .model.search_space import Range
from .model.window import Window
from .optimizers import make_optimizer
from .over_soc import (
    TableSettings,
    group_by_temperature,
    require_temperature,
    require_temperatures,
)
from .plan import plans_first
from .plan.running import prepare_pulse_tests
from .records import Record
from .results import Result
from .run import Run
from .storing import make_result
from .table_run import table_warnings
from .weighing import Weighing, search_and_assess, weigh

Chosen = TypeVar("Chosen")


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
        tables: How tables over SOC are fitted; needs `over` where `model` is given.
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
        weighing = weigh(inputs, windows, settings, tables, bounds, fix, advise)
        if settings.over == OVER_TEMPERATURE:
            require_temperatures(group_by_temperature(weighing.first.prepared_records))
            for each in weighing.validation(weighing.first):
                require_temperature(each)
    run = search_and_assess(weighing, optimizer, settings, trust, watch, advise)
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
    alone = Weighing((better,), better, None, {}, lambda problem: [])
    run = search_and_assess(alone, optimizer, settings, trust, unwatched, False)
    return make_result(replace(run, warnings=_all_warnings((), run)))


def _with_options(settings: Chosen, options: dict[str, Any]) -> Chosen:
    """The settings with the options that are theirs, which are taken out."""
    own = {name: options.pop(name) for name in list(options) if hasattr(settings, name)}
    changed: Any = settings
    return replace(changed, **own)


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
