"""`barnax identify`: from a cycler's files to a checked circuit."""

import shlex
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.markup import escape

from .options import (
    SEARCH,
    Files,
    Output,
    RecordOptions,
    SearchOptions,
    complete_circuits,
    complete_methods,
    grouped,
    require_choice,
)
from .output import DEFAULT_FOLDER, require_free, write_folder
from .session import Session, as_flags, command_line, use_compilation_cache, without_appearance

if TYPE_CHECKING:
    from ..results import Result


@grouped
def identify(
    files: Files,
    of_records: RecordOptions,
    search: SearchOptions,
    output: Output,
    records: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[RECORD]...",
            help="Dynamic record to identify on; several give one circuit for all of them. "
            "Without any, the bundled cell is identified.",
            show_default=False,
        ),
    ] = None,
    model: Annotated[
        str,
        typer.Option(
            metavar="iso-rc|so-rc|esc|...",
            help="Circuit: two RC pairs with switched (iso-rc), no (so-rc) or dynamic (esc) "
            "hysteresis; 1rc, 3rc and 4rc have that many pairs and no hysteresis.",
            autocompletion=complete_circuits,
            rich_help_panel=SEARCH,
        ),
    ] = "iso-rc",
    method: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Optimizer: ibmo, ibmo-centered, pso or any other that "
            "[bold]barnax optimizers[/bold] lists.",
            autocompletion=complete_methods,
            rich_help_panel=SEARCH,
        ),
    ] = "ibmo",
    trust: Annotated[
        Literal["none", "basic", "full"],
        typer.Option(
            metavar="none|basic|full",
            help="How closely the answer is examined: basic gives intervals, identifiability and "
            "residuals; full also profile likelihoods, a block bootstrap, and what would lower "
            "the error.",
            rich_help_panel=SEARCH,
        ),
    ] = "basic",
    report: Annotated[
        bool,
        typer.Option("--report", help="Also write report.html and report.md, with every figure."),
    ] = False,
) -> None:
    """Identify the circuit of a cell, say how good it is, and write result.json and figures.

    Without arguments it identifies the bundled virtual cell.
    """
    session = Session(is_quiet=output.quiet or output.as_json)
    folder = output.out or (None if output.as_json else DEFAULT_FOLDER)
    if folder is not None:
        require_free(folder, output.force)
    given = [records or [], files.ocv or [], files.validate or []]
    if folder is not None:
        # Drawing needs modules that take a while to load, and waits for the search anyhow.
        threading.Thread(target=__import__, args=("barnax.reporting",), daemon=True).start()
    with session.watch("Loading JAX"):
        use_compilation_cache()
        from ..cell import CIRCUITS
        from ..gather import Reading, file_names
        from ..optimizers import OPTIMIZERS
        from ..pipeline import Settings
        from ..pipeline import identify as run_pipeline

    require_choice("model", model, CIRCUITS)
    require_choice("method", method, OPTIMIZERS)
    settings = Settings(
        model, method, search.objective, search.coordinates,
        search.seeds, search.population, search.iterations, search.key,
    )  # fmt: skip
    result = run_pipeline(
        given[0], ocv=given[1], validate=given[2],
        settings=settings, window=of_records.windows(), ocv_capacity=files.ocv_capacity,
        bounds=search.bounds, fix=search.fixed,
        reading=Reading(
            files.current_sign, files.ocv_current_sign, files.validate_current_sign,
            files.current_hold,
        ),
        ocv_fit=files.ocv_fit, hysteresis_fit=files.hysteresis_fit, trust=trust,
        command=command_line(file_names([path for paths in given for path in paths])),
        watch=session.watch,
    )  # fmt: skip
    if folder is not None:
        folder = _write(session, folder, result, report, output.force)
    if output.as_json:
        typer.echo(result.to_json(), nl=False)
    _show(session, result, folder, output.verbose, report)
    session.warn(result.warnings)


def _write(session: Session, folder: Path, result: "Result", report: bool, is_forced: bool) -> Path:
    """The folder of a result: the answer first, and what of the figures can be drawn."""
    written = {"result.json": result.to_json().encode()}
    with session.watch("Drawing figures"):
        try:
            written |= result_files(result, report)
        except Exception as problem:
            # The answer is there; what fails to be drawn costs only itself.
            session.warn([f"the figures could not be drawn ({problem}); the result is written"])
    written["timings.json"] = session.timings_json()
    place = write_folder(folder, written, is_forced)
    if place != folder:
        session.warn([f"{folder}: something else has appeared there; the results are in {place}"])
    return place


def result_files(result: "Result", report: bool) -> dict[str, bytes]:
    """The figures, and the report where it is wanted, by their path in the folder."""
    from ..reporting import (
        identification_document,
        identification_illustrations,
        is_always,
        report_files,
    )

    if not report:
        drawn = identification_illustrations(result.run, is_always)
        return {f"figures/{each.name}.png": each.png for each in drawn}
    drawn = identification_illustrations(result.run)
    return report_files(identification_document(result, drawn).spelled(as_flags), drawn)


def _show(
    session: Session, result: "Result", folder: Path | None, verbose: bool, report: bool
) -> None:
    from ..reporting import identification_document
    from ..reporting.terminal import first_screen, next_line, parts_line, to_terminal

    if verbose:
        session.show(to_terminal(identification_document(result).spelled(as_flags)))
    session.show(first_screen(result, as_flags))
    session.show([next_line(_next(result))])
    if folder is not None:
        names = [f"{folder}/report.html"] if report else []
        names += [f"{folder}/result.json", "figures", f"{session.elapsed_s:.1f} s"]
        names.append(f"barnax show {shlex.quote(str(folder))} for all details")
        session.show(["", parts_line(names)])


def _next(result: "Result") -> str:
    """What to do next, as a command that runs as printed."""
    from ..reporting.verdict import next_step

    words, advice = next_step(result)
    if not words:
        return advice
    given = without_appearance(sys.argv[1:])
    command = shlex.join(["barnax", *given, *words, "--out", "barnax-out-2"])
    return escape(as_flags(f"{command}   {advice}"))
