"""`barnax identify`: from a cycler's files to a checked circuit."""

import shlex
import threading
from contextlib import suppress
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from ..errors import InputError
from ..files import is_factor_file, write_whole
from ..settings import Scope, Settings, TableOptions
from .options import (
    INPUT,
    LIVE,
    OUTPUT,
    PAPER,
    REPORT,
    SEARCH,
    Files,
    Given,
    RecordOptions,
    SearchOptions,
    Tables,
    argument,
    flag,
    group,
    option,
    options_of,
    run_options,
)
from .output import DEFAULT_FOLDER, Output, drawn_files, free_name
from .session import Session, as_flags, flag_of, use_compilation_cache

if TYPE_CHECKING:
    from ..plan import Plan
    from ..results import Result

# The file beside a result by which the run is repeated.
PLAN = "plan.toml"


@group
class Choices:
    """The circuit, the method, and how closely the answer is examined."""

    circuit: Given = options_of(Settings(), SEARCH, "model", "method")
    scope: Given = options_of(Scope(), SEARCH)
    report: bool = REPORT
    live: bool = LIVE
    design: Path | None = option(
        OUTPUT, "FOLDER", "Show what this barnax design promised beside what the record reached."
    )
    paper: bool = PAPER


@group
class Identification:
    """All that identifying a circuit can be told."""

    files: Files
    of_records: RecordOptions
    search: SearchOptions
    chosen: Choices
    tables: Tables
    output: Output

    def given(self, records: list[Path]) -> dict[str, Any]:
        """The chosen options, by the names of `barnax.identify`."""
        shared = run_options(self.files, self.of_records, self.search, records)
        return {**shared, **self.chosen.circuit, **self.chosen.scope, **self.tables.chosen()}


@group
class Records:
    """The records to identify on."""

    records: list[Path] | None = argument(
        "[RECORD]...",
        "Dynamic record to identify on; several give one circuit for all of them. For a folder, or "
        "files without --ocv, barnax chooses roles and windows; a plan is run as it is. Without "
        "any, the bundled cell is identified.",
        None,
    )
    plan: bool = flag(
        INPUT,
        "--plan",
        "Only print the plan, as TOML: what would be done with which file. identify accepts it in "
        "place of the folder.",
    )


@group
class PulseTests:
    """The pulse tests to identify on."""

    records: list[Path] | None = argument(
        "[RECORD]...",
        "Pulse test (HPPC); several give one circuit. Without any, the bundled cell's test at "
        "25 degC is used, and its drive cycles for validation.",
        None,
    )


def identify(options: Identification, on: Records) -> None:
    """Identify the circuit of a cell, say how good it is, and write result.json and figures.

    Without arguments, it identifies the bundled cell.
    """
    if on.plan:
        return _print_plan(options, on.records or [])
    if on.records and all(is_factor_file(path) for path in on.records):
        return _fit_factors(options, on.records)
    _run("identify", options, on.records or [])


def _fit_factors(options: Identification, paths: list[Path]) -> None:
    """Tables of records of which only factors were kept, on the screen; files of `out` if given."""
    session = Session(is_quiet=options.output.quiet)
    with session.watch("Loading JAX"):
        use_compilation_cache()
        from ..factors import read_factors
        from ..job import Job
        from ..over_soc.kept import fit_kept
        from ..pipeline import bounded_tables
        from ..reporting.kept import kept_document
        from ..reporting.pulses import fit_csv
        from ..reporting.terminal import to_terminal

    job = Job(**options.given([]), watch=session.watch)
    known = {field.name for field in fields(TableOptions)} | {"bounds", "fix", "watch"}
    chosen = options.chosen
    shown = {"json": options.output.as_json, "report": chosen.report, "live": chosen.live}
    shown |= {"paper": chosen.paper, "design": chosen.design}
    idle = [*(job.chosen.keys() - known), *(name for name, value in shown.items() if value)]
    if idle:
        first = min(idle)
        what = "a window, `initial_soc` or `capacity`" if first == "window" else f"`{first}`"
        raise InputError(
            f"{what} does nothing for factor files, whose records were read and set up when "
            "they were kept; leave it out, or identify on the records"
        )
    kept = [record for path in paths for record in read_factors(path)]
    fit = fit_kept(kept, bounded_tables(job, but="[F]"))
    session.show(to_terminal(kept_document(kept, fit)))
    if folder := options.output.out:
        if (place := folder / "tables.csv").exists() and not options.output.force:
            raise InputError(f"{place}: is there already; give `out` another folder")
        write_whole(place, fit_csv(fit))
        session.show(["", str(place)])
    session.warn(fit.warnings)


def _print_plan(options: Identification, records: list[Path]) -> None:
    session = Session(is_quiet=options.output.quiet)
    with session.watch("Loading"):
        from ..job import Job
        from ..plan import plan_given, plan_of, plan_to_toml, with_choices

    if not records:
        raise InputError("`plan` is for files or a folder; give them")
    job = Job(**options.given(records), watch=session.watch)
    found = plan_of(job)
    plan = plan_given(job, "identify") if found is None else with_choices(found, job)
    typer.echo(plan_to_toml(plan), nl=False)


def hppc(options: Identification, on: PulseTests) -> None:
    """Identify tables over SOC from a pulse test, and print every pulse's resistances.

    Pulses, rests, capacity and OCV come from the test itself; --ocv sets another OCV.
    """
    _run("hppc", options, on.records or [])


def _run(
    command: Literal["identify", "hppc"], options: Identification, records: list[Path]
) -> None:
    chosen, output, files = options.chosen, options.output, options.files
    inputs = [*records, *(files.ocv or ()), *(files.validate or ())]
    session, folder = output.begun(DEFAULT_FOLDER, inputs)
    with session.watch("Loading JAX"):
        use_compilation_cache()
        from .. import pipeline
        from ..experiment import Design
        from ..job import Job
        from ..plan import found_anywhere, plan_given, plan_of, plan_to_toml, with_choices
        from ..reporting.design_promised import promised_lines
        from ..reporting.terminal import plan_lines

    promise = None if chosen.design is None else Design.load(chosen.design)
    if folder is not None:
        # Drawing needs modules that take a while to load, and waits for the search anyhow.
        module = "matplotlib.backends.backend_agg"
        # No daemon: a process that ends while one loads C++ aborts.
        threading.Thread(target=__import__, args=(module,)).start()
    job = Job(**options.given(records), watch=session.watch)
    found = plan_of(job) if command == "identify" else None
    plan = None
    if found is not None:
        plan = with_choices(found, job)
        if not plan.missing:
            session.show(plan_lines(plan, as_flags))
    elif records:
        plan = plan_given(job, command)
    if plan is not None:
        job = Job(plan, watch=session.watch)
    is_pulsed = plan is None and command == "hppc"
    result = pipeline.hppc(job) if is_pulsed else pipeline.identify(job)
    unseen = None
    try:
        # Read while the figures are drawn.
        _show_answer(session, result, output.verbose)
        if promise is not None:
            session.show(promised_lines(promise, result, as_flags))
    except OSError as problem:
        # A screen that takes no more, such as a closed pipe, costs no result.
        unseen = problem
    draw = partial(result_files, result, chosen.report, chosen.paper, chosen.live)
    beside: dict[str, str] = {}
    # A name that no plan can hold costs the plan.
    with suppress(InputError):
        if plan is not None:
            beside[PLAN] = plan_to_toml(found_anywhere(plan, result.inputs))
    document = result.to_json()
    folder, written = output.deliver(session, folder, "result.json", document, draw, beside)
    if unseen is not None:
        raise unseen
    following = _next(result, folder, plan if PLAN in written else None, chosen.design)
    _show_files(session, folder, written, following)
    session.tell(result.notes)
    session.warn(result.warnings)


def result_files(
    result: "Result", report: bool, paper: bool = False, live: bool = False
) -> dict[str, bytes]:
    """The figures, and the report where it is wanted, by their path in the folder."""
    from ..reporting.identification import identification_document
    from ..reporting.illustrations import identification_illustrations
    from ..reporting.pulses import pulses_csv, tables_csv

    tables = {"tables.csv": tables_csv(result)} if result.tables else {}
    tables |= {"pulses.csv": pulses_csv(result.pulses)} if result.pulses else {}
    draw = partial(identification_illustrations, result, live=live)
    document_of = partial(identification_document, result)
    return tables | drawn_files(draw, document_of, report or live, paper)


def _show_answer(session: Session, result: "Result", verbose: bool) -> None:
    from ..reporting.first_screen import first_screen
    from ..reporting.identification import identification_document
    from ..reporting.terminal import to_terminal

    if verbose:
        session.show(to_terminal(identification_document(result).with_option_names(as_flags)))
    session.show(first_screen(result, as_flags))


def _show_files(
    session: Session, folder: Path | None, written: set[str], following: tuple[str, str]
) -> None:
    """Print the next step, and what was written."""
    from ..reporting.terminal import next_lines

    session.show(next_lines(*following))
    if folder is not None:
        names = ["report.html"] if "report.html" in written else []
        names.append("result.json")
        names += [name for name in ("tables.csv", "pulses.csv") if name in written]
        names += ["figures"] if any(name.startswith("figures/") for name in written) else []
        session.show_written(folder, names, f"barnax show {shlex.quote(str(folder))}")


def _next(
    result: "Result", folder: Path | None, plan: "Plan | None", design: Path | None
) -> tuple[str, str]:
    """The next step, and the command for it, empty where there is none.

    Options are given beside the plan that the run wrote; a design is met by the next run too.
    """
    from ..records.source import STDIN
    from ..reporting.verdict import next_step

    step = next_step(result)
    advice = as_flags(step.advice)
    if step.exports and folder is not None:
        return advice, shlex.join(["barnax", "export", str(folder), "--to", step.exports])
    if step.designs and folder is not None:
        return advice, shlex.join(["barnax", "design", str(folder)])
    if not step.options:
        return advice, ""
    words = [word for name, value in step.options.items() for word in (flag_of(name), value)]
    if plan is None or folder is None:
        return f"{advice}: {shlex.join(words)}", ""
    if any(part.path == STDIN or part.path.is_relative_to("/dev") for part in plan.parts):
        return f"{advice}: {shlex.join(words)}, with what was piped saved as a file", ""
    words += [] if design is None else ["--design", str(design)]
    words += ["--out", str(free_name(DEFAULT_FOLDER))]
    return advice, shlex.join(["barnax", "identify", str(folder / PLAN), *words])
