"""`barnax compare`: models and methods side by side on one cell."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from . import options
from .doubts import warn_of_doubts
from .inputs import Files, choose_files, make_window, read_box, read_inputs
from .options import SEARCH, require_choice
from .output import DEFAULT_FOLDER, report_files, require_free, write_folder
from .session import Session, command_line, use_compilation_cache

if TYPE_CHECKING:
    from ..comparison import Comparison, ComparisonResult


def compare(
    record: options.Record = None,
    ocv: options.Ocv = None,
    validate: options.Validate = None,
    capacity: options.Capacity = None,
    models: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,NAME",
            help="Circuits, with every method each (default the paper's five rows).",
            rich_help_panel=SEARCH,
        ),
    ] = None,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,NAME",
            help="Methods: ls, rls, varpro, lm, pso-lm, de, or one of "
            "[bold]barnax optimizers[/bold]; with every circuit each.",
            rich_help_panel=SEARCH,
        ),
    ] = None,
    coordinates: options.Coordinates = "rc",
    objective: options.Objective = "scan",
    seeds: options.Seeds = 30,
    population: options.Population = 30,
    iterations: options.Iterations = 500,
    key: options.RandomKey = 0,
    bounds: options.BoundsFile = None,
    fix: options.Fix = None,
    ocv_fit: options.OcvCurves = "polynomial",
    hysteresis_fit: options.HysteresisSegments = "continuous",
    current_sign: options.CurrentSign = "auto",
    ocv_current_sign: options.OcvCurrentSign = "auto",
    validate_current_sign: options.ValidateCurrentSign = "auto",
    current_hold: options.CurrentHold = "auto",
    rest_current: options.RestCurrent = None,
    initial_direction: options.InitialDirection = None,
    start_time: options.StartTime = None,
    start_after_step: options.StartAfterStep = None,
    initial_soc: options.InitialSoc = None,
    score_steps: options.ScoreSteps = None,
    score_from: options.ScoreFrom = None,
    score_to: options.ScoreTo = None,
    out: options.Out = None,
    force: options.Force = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Compare models and methods on one cell, and write tables, figures and a report.

    All get the same data, box, budget and key; a row is a method's own answer, unrefined.
    [bold]barnax compare[/bold] alone sets the paper's five rows side by side on the bundled cell.
    """
    session = Session(is_quiet=quiet or as_json)
    folder = out or (None if as_json else DEFAULT_FOLDER)
    if folder is not None:
        require_free(folder, force)
    paths = choose_files([record] if record else [], ocv or [], validate or [])
    files = Files(*paths, current_sign, ocv_current_sign, validate_current_sign, current_hold)
    command = command_line(files.names)
    with session.stage("Loading JAX"):
        use_compilation_cache()
        from ..baselines import METHODS, Budget
        from ..cell import CIRCUITS
        from ..comparison import PAPER_ROWS, compare, make_comparison_result
        from ..reporting.terminal import comparison_report

    rows = chosen_rows(models, methods, PAPER_ROWS)
    for model, method in rows:
        require_choice("--models", model, CIRCUITS)
        require_choice("--methods", method, METHODS)
    window = make_window(
        start_time=start_time,
        start_after_step=start_after_step,
        initial_soc=initial_soc,
        score_steps=score_steps,
        score_from=score_from,
        score_to=score_to,
        rest_current=rest_current,
        initial_direction=initial_direction,
    )
    box = read_box(bounds, fix)
    inputs = read_inputs(
        session,
        files,
        capacity=capacity,
        ocv_fit=ocv_fit,
        hysteresis_fit=hysteresis_fit,
        rest_current=rest_current,
    )
    given = (start_time, start_after_step, initial_soc, score_steps, score_from, score_to)
    warn_of_doubts(session, files, capacity, has_window=any(each is not None for each in given))
    total = sum(1 if METHODS[method].is_deterministic else seeds for _, method in rows)
    with session.bar("Comparing", total) as advance:

        @contextmanager
        def watch(name: str) -> Iterator[Callable[[int], None]]:
            with session.timed(name):
                yield advance

        comparison = compare(
            inputs.records[0],
            inputs.cell,
            rows,
            validation=inputs.validation,
            window=window,
            bounds=box.ranges,
            fixed=box.fixed,
            coordinates=coordinates,
            objective=objective,
            budget=Budget(population, iterations, seeds, key),
            source=box.source,
            watch=watch,
        )
    result = make_comparison_result(
        comparison, inputs.validation, ocv=inputs.tests, command=command
    )
    seconds = {row.name: session.seconds[row.name] for row in result.rows}
    if folder is not None:
        written = {"comparison.json": result.to_json().encode()}
        with session.stage("Drawing figures"):
            written |= _report(result, comparison, seconds)
        written["timings.json"] = session.timings_json()
        folder = write_folder(folder, written, force, session)
    if as_json:
        typer.echo(result.to_json(), nl=False)
    session.show(comparison_report(result, seconds))
    session.warn(result.warnings)
    session.show([f"The report is [bold]{escape(str(folder))}/report.html[/bold]."])


def chosen_rows(
    models: str | None, methods: str | None, default: Sequence[tuple[str, str]]
) -> list[tuple[str, str]]:
    """Pairs of model and method: the default rows, or all combinations of what was given.

    Where only models are given, they go with the default's methods, and the other way round.

    >>> chosen_rows("esc", None, [("so-rc", "ls"), ("so-rc", "pso")])
    [('esc', 'ls'), ('esc', 'pso')]
    """
    if models is None and methods is None:
        return list(default)
    usual_models, usual_methods = (dict.fromkeys(names) for names in zip(*default, strict=True))
    chosen_models = usual_models if models is None else _names(models)
    chosen_methods = usual_methods if methods is None else _names(methods)
    return list(itertools.product(chosen_models, chosen_methods))


def _names(text: str) -> dict[str, None]:
    """The names of a list, each once."""
    return dict.fromkeys(name.strip() for name in text.split(","))


def _report(
    result: "ComparisonResult", comparison: "Comparison", seconds: dict[str, float]
) -> dict[str, bytes]:
    """The report in both forms and its figures, by their path below the results folder."""
    from ..reporting import comparison_document, comparison_illustrations

    drawn = comparison_illustrations(result, comparison, comparison.optima)
    return report_files(comparison_document(result, drawn, seconds), drawn)
