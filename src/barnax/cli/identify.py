"""`barnax identify`: from a cycler's files to checked circuit parameters."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from ..errors import InputError
from . import options
from .doubts import warn_of_doubts
from .figures import cell_figures, found_figures, report_with_figures
from .inputs import Files, choose_files, make_window, read_box, read_inputs
from .options import SEARCH, require_choice
from .output import DEFAULT_FOLDER, require_free, write_folder
from .session import (
    Session,
    command_line,
    complete_circuits,
    complete_methods,
    use_compilation_cache,
)

if TYPE_CHECKING:
    from ..global_optimum import GlobalOptimum
    from ..model.problem import Problem
    from ..search.refine import Refinement
    from ..uncertainty.assessment import Assessment


def identify(
    records: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[RECORD]...",
            help="Dynamic record to identify on, several to find one circuit for all of them; "
            "without any, the bundled cell runs.",
            show_default=False,
        ),
    ] = None,
    ocv: options.Ocv = None,
    validate: options.Validate = None,
    capacity: options.Capacity = None,
    model: Annotated[
        str,
        typer.Option(
            metavar="iso-rc|so-rc|esc|...",
            help="Circuit: two RC pairs with switched (iso-rc), no (so-rc) or dynamic (esc) "
            "hysteresis; 1rc, 3rc and 4rc have as many pairs and no hysteresis.",
            autocompletion=complete_circuits,
            rich_help_panel=SEARCH,
        ),
    ] = "iso-rc",
    method: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Optimizer: ibmo, ibmo-printed, ibmo-centered, bmo or another one of "
            "[bold]barnax optimizers[/bold].",
            autocompletion=complete_methods,
            rich_help_panel=SEARCH,
        ),
    ] = "ibmo",
    objective: options.Objective = "scan",
    coordinates: options.Coordinates = "rc",
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
    trust: options.Trust = "basic",
    report: options.Report = False,
    force: options.Force = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Identify the circuit of a cell, cross-check it, and write result.json and figures.

    [bold]barnax identify[/bold] alone runs the bundled virtual cell: identification and
    validation records and both OCV tests.
    """
    session = Session(is_quiet=quiet or as_json)
    folder = out or (None if as_json else DEFAULT_FOLDER)
    if folder is not None:
        require_free(folder, force)
    paths = choose_files(records or [], ocv or [], validate or [])
    files = Files(*paths, current_sign, ocv_current_sign, validate_current_sign, current_hold)
    command = command_line(files.names)
    with session.stage("Loading JAX"):
        use_compilation_cache()
        import jax

        from ..cell import CIRCUITS
        from ..model.inputs import prepare_record
        from ..model.problem import make_problem
        from ..optimizers import OPTIMIZERS, make_optimizer
        from ..reporting.terminal import identification_report, trust_report
        from ..results import make_result
        from ..search.evaluate import evaluate
        from ..search.refine import Descent, refine
        from ..search.seeds import search_seeds as search
        from ..uncertainty import compile_linearization, examine

    require_choice("--model", model, CIRCUITS)
    require_choice("--method", method, OPTIMIZERS)
    optimizer = make_optimizer(method, population, iterations)
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
    with session.stage("Setting up the problem"):
        problem = make_problem(
            inputs.records,
            inputs.cell,
            model,
            window=window,
            bounds=box.ranges,
            fixed=box.fixed,
            coordinates=coordinates,
            objective=objective,
            source=box.source,
        )
        # A validation record that does not fit the window is refused before the search, not after.
        prepared_records = [
            prepare_record(other, inputs.cell, model, window) for other in inputs.validation
        ]
    # Once, and not by two threads at the same time; who needs it says why there is none.
    with suppress(InputError):
        _ = problem.compressed
    # What does not wait for the search is done beside it.
    with ThreadPoolExecutor(max_workers=2) as beside:
        compiling = beside.submit(Descent, problem)
        draws = folder is not None and not report
        drawing = beside.submit(cell_figures, inputs.cell) if draws else None
        looking = beside.submit(_best_there_is, problem, session)
        beside.submit(compile_linearization, problem)
        with session.bar("Searching", seeds) as advance:
            found = search(
                problem,
                optimizer,
                key=jax.random.key(key),
                seeds=seeds,
                progress=advance,
            )
        with session.bar("Cross-checking", seeds) as advance:
            refinement = refine(found, descent=compiling.result(), progress=advance)
        assessing = beside.submit(_assessed, refinement, session)
        with session.stage("Waiting for the global optimum"):
            optimum = looking.result()
        with session.stage("Validating"):
            identified, validated = (
                [evaluate(prepared, refinement.parameters) for prepared in each]
                for each in (problem.prepared_records, prepared_records)
            )
        written = {}
        if drawing is not None:
            with session.stage("Drawing figures"):
                written = drawing.result() | found_figures(refinement, identified, validated)
        with session.stage("Waiting for the assessment"):
            assessment = assessing.result()
    examination = None
    if trust == "full":
        with session.stage("Fitting again"):
            examination = examine(refinement, assessment, key=jax.random.key(key))
    result = make_result(
        refinement,
        identified,
        validated,
        optimum=optimum,
        assessment=assessment,
        examination=examination,
        ocv=inputs.tests,
        command=command,
    )
    if folder is not None:
        written["result.json"] = result.to_json().encode()
        if report:
            with session.stage("Drawing figures"):
                written |= report_with_figures(result, refinement, identified, validated, optimum)
        written["timings.json"] = session.timings_json()
        folder = write_folder(folder, written, force, session)
    if as_json:
        typer.echo(result.to_json(), nl=False)
    told = [*trust_report(assessment, examination)]
    session.show(identification_report(refinement, [*identified, *validated], optimum, told))
    session.warn(result.warnings)
    session.show([f"Results are in [bold]{escape(str(folder))}[/bold]."])


def _best_there_is(problem: "Problem", session: Session) -> "GlobalOptimum | None":
    """The global optimum, None where the box is too wide to look for it."""
    from ..global_optimum import find_global_optimum

    try:
        with session.timed("Looking for the global optimum"):
            return find_global_optimum(problem)
    except InputError:
        return None


def _assessed(refinement: "Refinement", session: Session) -> "Assessment":
    from ..uncertainty import assess

    with session.timed("Assessing"):
        return assess(refinement)
