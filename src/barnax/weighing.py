"""Circuits to weigh in a run, constant ones and tables, each with the problem it is searched on."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from .candidates import THREE_PAIRS, TWO_PAIRS, WEIGHED, tabulated_circuit
from .cell import get_circuit
from .display import Brief
from .errors import InputError
from .global_optimum import with_better_directions, with_better_hold, without_sweep_drop
from .inputs import Inputs, ranges_of
from .model.prepared import PreparedRecord, prepare_record
from .model.problem import Kind, Problem, known_to, make_problem, require_enough
from .model.search_space import Range
from .model.window import Window
from .over_soc import OwnOcv, TableFits, TableSettings
from .settings import OVER_TEMPERATURE, Settings


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
    if own_ocv is not None and get_circuit(tabulated).has_rate:
        # A hysteresis of the records' own was fitted with the directions that fit better.
        first = _with_directions(first, own_ocv.directions)
    else:
        first = with_better_directions(first)
    first = with_better_hold(first)
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
    if is_open and tabulated == TWO_PAIRS and tables.folds:
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


def _with_directions(problem: Problem, others: Mapping[str, float]) -> Problem:
    """The problem whose records say which directions before the start were found to fit better."""
    records = tuple(
        prepared.fitting_better(others[prepared.record.name])
        if prepared.record.name in others
        else prepared
        for prepared in problem.prepared_records
    )
    return problem.keeping_computed(prepared_records=records)


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
