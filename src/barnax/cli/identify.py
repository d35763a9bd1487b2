"""`barnax identify`: from a cycler's files to a checked circuit."""

import shlex
import sys
import threading
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ..errors import InputError
from .groups import INPUT, grouped
from .options import Choices, Output, SearchOptions, TableOptions, require_choice, run_options
from .output import DEFAULT_FOLDER, free_name, require_free, write_results
from .plans import arguments_of, with_options
from .record_options import Files, RecordOptions
from .session import APPEARANCE, Session, as_flags, use_compilation_cache, without_options

if TYPE_CHECKING:
    from ..results import Result


@grouped
def identify(
    files: Files,
    of_records: RecordOptions,
    search: SearchOptions,
    chosen: Choices,
    tables: TableOptions,
    output: Output,
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
        typer.Option(
            "--plan",
            help="Only print the plan, as TOML: what would be done with which file. identify "
            "accepts it in place of the folder.",
            rich_help_panel=INPUT,
        ),
    ] = False,
) -> None:
    """Identify the circuit of a cell, say how good it is, and write result.json and figures.

    Without arguments, it identifies the bundled cell.
    """
    if plan:
        return _print_plan(files, of_records, search, chosen, tables, records or [], output)
    _run("identify", records, files, of_records, search, chosen, tables, output)


def _print_plan(
    files: Files,
    of_records: RecordOptions,
    search: SearchOptions,
    chosen: Choices,
    tables: TableOptions,
    records: list[Path],
    output: Output,
) -> None:
    session = Session(is_quiet=output.quiet)
    with session.watch("Loading"):
        from ..plan import plan_of, plan_to_toml

    options = {**run_options(files, of_records, search, records), **tables.chosen()}
    planned = plan_of(**options, watch=session.watch)
    if planned is None:
        raise InputError("`plan` is for a folder, or for files without `ocv`")
    changed = with_options(planned, options["window"], files, chosen, tables)
    typer.echo(plan_to_toml(changed), nl=False)


@grouped
def hppc(
    files: Files,
    of_records: RecordOptions,
    search: SearchOptions,
    chosen: Choices,
    tables: TableOptions,
    output: Output,
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
    _run("hppc", records, files, of_records, search, chosen, tables, output)


def _run(
    command: Literal["identify", "hppc"],
    records: list[Path] | None,
    files: Files,
    of_records: RecordOptions,
    search: SearchOptions,
    chosen: Choices,
    tables: TableOptions,
    output: Output,
) -> None:
    session = Session(is_quiet=output.quiet or output.as_json)
    folder = output.out or (None if output.as_json else DEFAULT_FOLDER)
    if folder is not None:
        require_free(folder, output.force)
    with session.watch("Loading JAX"):
        use_compilation_cache()
        from ..cell import CIRCUITS
        from ..optimizers import OPTIMIZERS
        from ..plan import plan_of
        from ..reporting.plans import plan_lines

        if command == "hppc":
            from ..pulse_test import hppc as run
        else:
            from ..pipeline import identify as run

    if folder is not None:
        # Drawing needs modules that take a while to load, and waits for the search anyhow.
        module = "matplotlib.backends.backend_agg"
        threading.Thread(target=__import__, args=(module,), daemon=True).start()
    if chosen.model is not None:
        require_choice("model", chosen.model, CIRCUITS)
    require_choice("method", chosen.method, OPTIMIZERS)
    options = {
        **run_options(files, of_records, search, records or []),
        **tables.chosen(),
        "model": chosen.model,
        "method": chosen.method,
        "trust": chosen.trust,
        "watch": session.watch,
    }
    planned = plan_of(**options) if command == "identify" else None
    if planned is not None:
        planned = with_options(planned, options["window"], files, chosen, tables)
        if not planned.missing:
            session.show(plan_lines(planned, as_flags))
        options = arguments_of(planned, options, records or [])
    result = run(**options)
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
    from ..reporting import (
        identification_document,
        identification_illustrations,
        is_always,
        paper_files,
        report_files,
    )
    from ..reporting.pulses import pulses_csv, tables_csv

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
    from ..reporting import identification_document
    from ..reporting.terminal import first_screen, next_lines, parts_line, to_terminal

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
    flags = {f"--{name.replace('_', '-')}": value for name, value in options.items()}
    # What is for one record stands beside what others have, and after what it had itself.
    replaced = {flag: 2 for flag, value in flags.items() if "=" not in value}
    given = without_options(sys.argv[1:], {**APPEARANCE, **replaced})
    words = [word for pair in flags.items() for word in pair]
    if any(word == "-" or word.startswith("/dev/") for word in given):
        return f"{as_flags(advice)}: {shlex.join(words)}, with what was piped saved as a file", ""
    command = shlex.join(["barnax", *given, *words, "--out", str(free_name(DEFAULT_FOLDER))])
    return as_flags(advice), command
