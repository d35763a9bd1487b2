"""`barnax identify`: from a cycler's files to checked circuit parameters."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from ..bundled import BUNDLED
from ..errors import InputError
from . import options
from .options import INPUT, SEARCH, parse_steps, require_choice
from .output import DEFAULT_FOLDER, png_bytes, require_free, write_folder
from .session import (
    Session,
    command_line,
    complete_circuits,
    complete_methods,
    use_compilation_cache,
)

if TYPE_CHECKING:
    from ..cell import CellModel
    from ..evaluate import Evaluation
    from ..records import Record
    from ..refinement import CrossCheck


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
    ocv: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="OCV test, pulse-rest or slow sweep; repeatable.",
            rich_help_panel=INPUT,
        ),
    ] = None,
    validate: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE", help="Record to validate on; repeatable.", rich_help_panel=INPUT
        ),
    ] = None,
    capacity: Annotated[
        float | None,
        typer.Option(
            metavar="AH", help="Capacity (default from the OCV test).", rich_help_panel=INPUT
        ),
    ] = None,
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
    coordinates: Annotated[
        options.Scale,
        typer.Option(
            metavar="rc|log",
            help="Search raw R and C, as the paper does, or logarithms of R and tau.",
            rich_help_panel=SEARCH,
        ),
    ] = "rc",
    seeds: Annotated[
        int,
        typer.Option(min=1, metavar="N", help="Independent runs.", rich_help_panel=SEARCH),
    ] = 30,
    population: Annotated[
        int,
        typer.Option(min=4, metavar="N", help="Candidates a generation.", rich_help_panel=SEARCH),
    ] = 30,
    iterations: Annotated[
        int,
        typer.Option(min=1, metavar="N", help="Generations.", rich_help_panel=SEARCH),
    ] = 500,
    key: Annotated[
        int,
        typer.Option(
            min=0,
            max=2**32 - 1,
            metavar="N",
            help="The number all randomness comes from.",
            rich_help_panel=SEARCH,
        ),
    ] = 0,
    bounds: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help='Bounds, in a table \\[bounds], such as "R0 \\[Ohm]" = \\[0.001, 0.1].',
            rich_help_panel=SEARCH,
        ),
    ] = None,
    fix: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help='Hold a parameter, such as "C1 \\[F]=500"; repeatable.',
            rich_help_panel=SEARCH,
        ),
    ] = None,
    ocv_fit: Annotated[
        options.OcvFit,
        typer.Option(
            metavar="FIT",
            help="OCV curves: polynomial (degree 7) or interpolated (PCHIP through the points).",
            rich_help_panel=INPUT,
        ),
    ] = "polynomial",
    hysteresis_fit: Annotated[
        options.HysteresisFit,
        typer.Option(
            metavar="FIT",
            help="Hysteresis segments: continuous (they meet at the knots) or independent (nine "
            "free parameters).",
            rich_help_panel=INPUT,
        ),
    ] = "continuous",
    current_sign: options.CurrentSign = "auto",
    ocv_current_sign: Annotated[
        options.Sign,
        typer.Option(
            metavar="SIGN", help="Sign of current in the OCV tests.", rich_help_panel=INPUT
        ),
    ] = "auto",
    validate_current_sign: Annotated[
        options.Sign,
        typer.Option(
            metavar="SIGN", help="Sign of current in the validation records.", rich_help_panel=INPUT
        ),
    ] = "auto",
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
    """Identify the circuit of a cell, cross-check it, and write result.json and figures.

    [bold]barnax identify[/bold] alone runs the bundled virtual cell: identification and
    validation records and both OCV tests.
    """
    session = Session(is_quiet=quiet or as_json)
    folder = out or (None if as_json else DEFAULT_FOLDER)
    if folder is not None:
        require_free(folder, force)
    records, ocv, validate = _files(records or [], ocv or [], validate or [])
    with session.stage("Loading JAX"):
        use_compilation_cache()
        import jax

        from ..bounds import parse_fixed, read_bounds
        from ..cell import CIRCUITS, characterize
        from ..course import make_course
        from ..descent import Descent
        from ..evaluate import evaluate_course
        from ..identification import identify as search
        from ..optimizers import OPTIMIZERS, make_optimizer
        from ..problem import make_problem
        from ..records import read_record
        from ..refinement import refine
        from ..report import identification_report
        from ..result import all_warnings, make_result
        from ..window import Window

    require_choice("--model", model, CIRCUITS)
    require_choice("--method", method, OPTIMIZERS)
    optimizer = make_optimizer(method, population, iterations)
    window = Window(
        start_time_s=start_time,
        start_after_step=start_after_step,
        initial_soc=initial_soc,
        score_steps=parse_steps(score_steps),
        score_from_s=score_from,
        score_to_s=score_to,
        rest_current_a=rest_current,
        initial_direction=1 if initial_direction is None else initial_direction,
    )
    ranges = read_bounds(bounds) if bounds is not None else {}
    with session.stage("Reading records"):

        def read(path: Path, sign: options.Sign) -> "Record":
            return read_record(path, current_sign=sign, current_hold=current_hold)

        tests = [read(path, ocv_current_sign) for path in ocv]
        dynamic = [read(path, current_sign) for path in records]
        others = [read(path, validate_current_sign) for path in validate]
    with session.stage("Characterizing the cell"):
        cell = characterize(
            tests,
            capacity_ah=capacity,
            ocv_fit=ocv_fit,
            hysteresis_fit=hysteresis_fit,
            rest_current_a=rest_current,
        )
        problem = make_problem(
            dynamic,
            cell,
            model,
            window=window,
            bounds=ranges,
            fixed=parse_fixed(fix or []),
            coordinates=coordinates,
            objective=objective,
            source=str(bounds.name) if bounds is not None else "--fix",
        )
        # A validation record that does not fit the window is refused before the search, not after.
        courses = [make_course(other, cell, model, window) for other in others]
    with ThreadPoolExecutor(max_workers=1) as beside:
        compiling = beside.submit(Descent, problem)
        with session.bar("Searching", seeds) as advance:
            found = search(
                problem, optimizer, key=jax.random.key(key), seeds=seeds, progress=advance
            )
        with session.bar("Cross-checking", seeds) as advance:
            checked = refine(found, descent=compiling.result(), progress=advance)
    with session.stage("Validating"):
        identified = [evaluate_course(course, checked.parameters) for course in problem.courses]
        validated = [evaluate_course(course, checked.parameters) for course in courses]
    result = make_result(checked, identified, validated, ocv=tests, command=command_line())
    if folder is not None:
        files = {"result.json": result.to_json().encode()}
        with session.stage("Drawing figures"):
            files |= _figures(cell, checked, identified, validated)
        files["timings.json"] = session.timings_json()
        write_folder(folder, files)
    if as_json:
        typer.echo(result.to_json(), nl=False)
    session.show(identification_report(checked, [*identified, *validated]))
    session.warn(all_warnings(problem, validated, tests))
    session.show([f"Results are in [bold]{escape(str(folder))}[/bold]."])


def _files(
    records: list[Path], ocv: list[Path], validate: list[Path]
) -> tuple[list[Path], list[Path], list[Path]]:
    """The files to work on: those given, or the bundled cell's where none is."""
    if not records:
        if ocv or validate:
            raise InputError("give a RECORD to identify on; --ocv and --validate only go with one")
        return [BUNDLED.record], [*BUNDLED.ocv], [BUNDLED.validation]
    if not ocv:
        raise InputError(
            f"{records[0]}: an OCV test of the same cell is needed as well; give it with --ocv"
        )
    return records, ocv, validate


def _figures(
    cell: "CellModel",
    checked: "CrossCheck",
    identified: "list[Evaluation]",
    validated: "list[Evaluation]",
) -> dict[str, bytes]:
    """PNG figures by their path below the results folder."""
    from ..plots import (
        plot_convergence,
        plot_error,
        plot_hysteresis,
        plot_ocv,
        plot_voltage,
    )

    figures = {
        "ocv": plot_ocv(cell),
        "hysteresis": plot_hysteresis(cell),
        "convergence": plot_convergence(checked.found, checked),
    }
    roles = [("identification", each) for each in _numbered(identified)]
    roles += [("validation", each) for each in enumerate(validated, 1)]
    for name, (number, evaluation) in roles:
        role = name if number is None else f"{name}-{number}"
        figures[f"{role}-voltage"] = plot_voltage(evaluation)
        figures[f"{role}-error"] = plot_error(evaluation)
    return {f"figures/{name}.png": png_bytes(figure) for name, figure in figures.items()}


def _numbered(evaluations: "list[Evaluation]") -> "list[tuple[int | None, Evaluation]]":
    """Each with its number, or the only one without."""
    if len(evaluations) == 1:
        return [(None, evaluations[0])]
    return [*enumerate(evaluations, 1)]
