"""`barnax identify`: from a cycler's files to a checked circuit."""

import shlex
import sys
import threading
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from ..errors import InputError
from .groups import INPUT, flag, grouped
from .options import Identification, require_choice, run_options
from .output import DEFAULT_FOLDER, free_name, write_results
from .session import APPEARANCE, Session, as_flags, flag_of, use_compilation_cache, without_options

if TYPE_CHECKING:
    from ..model.window import Window
    from ..plan import Part, Plan
    from ..results import Result

# Options of the run that a plan may hold; those of records go into its windows.
PLANNED = (
    "ocv_capacity", "ocv_fit", "hysteresis_fit", "model", "method", "trust", "over",
    "current_hold", "current_sign", "ocv_current_sign", "validate_current_sign", "columns",
)  # fmt: skip


@grouped
def identify(
    options: Identification,
    records: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[RECORD]...",
            help="Dynamic record to identify on; several give one circuit for all of them. For a "
            "folder, or files without --ocv, barnax chooses roles and windows; a plan is run as it "
            "is. Without any, the bundled cell is identified.",
            show_default=False,
        ),
    ] = None,
    plan: Annotated[
        bool,
        flag(
            INPUT,
            "--plan",
            "Only print the plan, as TOML: what would be done with which file. identify "
            "accepts it in place of the folder.",
        ),
    ] = False,
) -> None:
    """Identify the circuit of a cell, say how good it is, and write result.json and figures.

    Without arguments, it identifies the bundled cell.
    """
    if plan:
        return _print_plan(options, records or [])
    _run("identify", options, records or [])


def _print_plan(options: Identification, records: list[Path]) -> None:
    session = Session(is_quiet=options.output.quiet)
    with session.watch("Loading"):
        from ..plan import plan_of, plan_to_toml

    given = run_options(options.files, options.of_records, options.search, records)
    planned = plan_of(**given, **options.tables.chosen(), watch=session.watch)
    if planned is None:
        raise InputError("`plan` is for a folder, or for files without `ocv`")
    typer.echo(plan_to_toml(_changed(planned, given["window"], options)), nl=False)


@grouped
def hppc(
    options: Identification,
    records: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[RECORD]...",
            help="Pulse test (HPPC); several give one circuit. Without any, the bundled cell's "
            "test at 25 degC is used, and its drive cycles for validation.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Identify tables over SOC from a pulse test, and print every pulse's resistances.

    Pulses, rests, capacity and OCV come from the test itself; --ocv sets another OCV.
    """
    _run("hppc", options, records or [])


def _run(
    command: Literal["identify", "hppc"], options: Identification, records: list[Path]
) -> None:
    chosen, output = options.chosen, options.output
    files = options.files
    inputs = [*records, *(files.ocv or ()), *(files.validate or ())]
    session, folder = output.begun(DEFAULT_FOLDER, inputs)
    with session.watch("Loading JAX"):
        use_compilation_cache()
        from ..cell import CIRCUITS
        from ..optimizers import OPTIMIZERS
        from ..plan import plan_of
        from ..reporting.terminal import plan_lines

        if command == "hppc":
            from ..pulse_test import hppc as run
        else:
            from ..pipeline import identify as run

    if folder is not None:
        # Drawing needs modules that take a while to load, and waits for the search anyhow.
        module = "matplotlib.backends.backend_agg"
        # No daemon: a process that ends while one loads C++ aborts.
        threading.Thread(target=__import__, args=(module,)).start()
    if chosen.model is not None:
        require_choice("model", chosen.model, CIRCUITS)
    require_choice("method", chosen.method, OPTIMIZERS)
    given = {
        **run_options(options.files, options.of_records, options.search, records),
        **options.tables.chosen(),
        "model": chosen.model,
        "method": chosen.method,
        "trust": chosen.trust,
        "watch": session.watch,
    }
    planned = plan_of(**given) if command == "identify" else None
    if planned is not None:
        planned = _changed(planned, given["window"], options)
        if not planned.missing:
            session.show(plan_lines(planned, as_flags))
        given = _arguments(planned, given, records)
    result = run(**given)
    written: set[str] = set()
    if folder is not None:
        answer = {"result.json": result.to_json().encode()}
        draw = partial(result_files, result, chosen.report, chosen.paper)
        folder, written = write_results(session, folder, answer, draw, output.force)
    if output.as_json:
        typer.echo(result.to_json(), nl=False)
    _show(session, result, folder, written, output.verbose)
    session.warn(result.warnings)


def result_files(result: "Result", report: bool, paper: bool = False) -> dict[str, bytes]:
    """The figures, and the report where it is wanted, by their path in the folder."""
    from ..plots import column_width
    from ..reporting.identification import identification_document
    from ..reporting.illustrations import identification_illustrations, is_always
    from ..reporting.pulses import pulses_csv, tables_csv
    from ..reporting.render import paper_files, report_files

    tables = {"tables.csv": tables_csv(result)} if result.tables else {}
    tables |= {"pulses.csv": pulses_csv(result.pulses)} if result.pulses else {}
    if paper:
        with column_width():
            tables |= paper_files(identification_illustrations(result.run))
    if not report:
        drawn = identification_illustrations(result.run, is_always)
        return tables | {f"figures/{each.name}.png": each.png for each in drawn}
    drawn = identification_illustrations(result.run)
    return tables | report_files(identification_document(result, drawn).spelled(as_flags), drawn)


def _show(
    session: Session, result: "Result", folder: Path | None, written: set[str], verbose: bool
) -> None:
    from ..reporting.identification import identification_document
    from ..reporting.terminal import next_lines, parts_line, to_terminal
    from ..reporting.verdict import first_screen

    if verbose:
        session.show(to_terminal(identification_document(result).spelled(as_flags)))
    session.show(first_screen(result, as_flags))
    session.show(next_lines(*_next(result)))
    if folder is not None:
        names = [f"{folder}/report.html"] if "report.html" in written else []
        names.append(f"{folder}/result.json")
        names += [name for name in ("tables.csv", "pulses.csv") if name in written]
        names += ["figures"] if any(name.startswith("figures/") for name in written) else []
        names.append(f"{session.elapsed_s:.1f} s")
        session.show(["", parts_line(names)])
        session.show([parts_line([f"barnax show {shlex.quote(str(folder))} for all details"])])


def _next(result: "Result") -> tuple[str, str]:
    """What to do next, and the command that does it where one does."""
    from ..reporting.verdict import next_step

    options, advice = next_step(result)
    if not options:
        return as_flags(advice), ""
    flags = {flag_of(name): value for name, value in options.items()}
    # What is for one record stands beside what others have, and after what it had itself.
    replaced = {flag: 2 for flag, value in flags.items() if "=" not in value}
    given = without_options(sys.argv[1:], {**APPEARANCE, **replaced})
    words = [word for pair in flags.items() for word in pair]
    if any(word == "-" or word.startswith("/dev/") for word in given):
        return f"{as_flags(advice)}: {shlex.join(words)}, with what was piped saved as a file", ""
    command = shlex.join(["barnax", *given, *words, "--out", str(free_name(DEFAULT_FOLDER))])
    return as_flags(advice), command


def _changed(
    planned: "Plan", window: "Window | dict[str, Window] | None", options: Identification
) -> "Plan":
    """The plan with what the command line says otherwise."""
    flags = {word.partition("=")[0] for word in sys.argv}
    given = {
        name: value
        for group in (options.files, options.chosen, options.tables)
        for name, value in vars(group).items()
        if name in PLANNED and flag_of(name) in flags
    }
    return planned.changed(window, **given)


def _arguments(planned: "Plan", options: dict[str, Any], records: list[Path]) -> dict[str, Any]:
    """What `identify` is called with: the plan, and all that it does not settle."""
    left = {
        name: value
        for name, value in options.items()
        if name not in {*planned.options, "ocv", "validate", "window"}
    }
    return {**left, "records": planned, "command": _command(planned, records)}


def _command(planned: "Plan", records: list[Path]) -> list[str]:
    """The command that does the same without planning, of the same files where they are cut."""
    from ..model.window import OPTIONS as WINDOW_OPTIONS

    settled = {**APPEARANCE, "--report": 1, "--paper": 1, "--plan": 1}
    served = [part for part in planned.parts if part.role != "not used"]
    if any(part.span_s for part in served):
        names = dict.fromkeys(part.path.name for part in served)
        kept = without_options(sys.argv[2:], settled)
        return ["barnax", "identify", *names, *(w for w in kept if Path(w) not in records)]
    words = [part.name for part in planned.of_role("identification")]
    words += [word for part in planned.of_role("OCV test") for word in ("--ocv", part.name)]
    words += [word for part in planned.of_role("validation") for word in ("--validate", part.name)]
    for part in planned.parts:
        words += _window_words(part)
    for name, value in planned.options.items():
        if not (name == "over" and planned.command == "hppc"):
            words += [flag_of(name), _written(value)]
    decided = [*WINDOW_OPTIONS, *PLANNED, "ocv", "validate"]
    settled |= {flag_of(name): 2 for name in decided}
    kept = without_options(sys.argv[2:], settled)
    return ["barnax", planned.command, *words, *(w for w in kept if Path(w) not in records)]


def _window_words(part: "Part") -> list[str]:
    from ..model.window import OPTIONS as WINDOW_OPTIONS

    words = []
    for option, (name, *_) in WINDOW_OPTIONS.items():
        value = getattr(part.window, name)
        if value is not None:
            words += [flag_of(option), f"{part.name}={_written(value)}"]
    return words


def _written(value: Any) -> str:
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
