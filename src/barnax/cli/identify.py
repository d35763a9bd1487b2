"""`barnax identify`: from a cycler's files to a checked circuit."""

import shlex
import threading
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

import barnax

from .. import reporting
from ..errors import InputError, attempt
from ..files import is_factor_file
from ..settings import TableOptions
from .options import Given, group, options_of, options_of_job
from .output import DEFAULT_FOLDER, PLAN, TABLES, Delivery, Output, drawn_files, new_run
from .session import Session, as_flags, flag_of


@group
class Identification:
    """Options of an identification.

    Output:
        design (FOLDER): Compare the intervals with those that this barnax design predicted.
    """

    job: Annotated[
        Given,
        options_of("files", "records", "model", "trust", "setup", "method", "search", "tables"),
    ]
    report: bool = False
    live: bool = False
    design: Path | None = None
    paper: bool = False
    output: Output


def identify(
    *, options: Identification, records: list[Path] | None = None, plan: bool = False
) -> None:
    """Identify the circuit of a cell, and say how good it is.

    Writes result.json, figures and the plan that repeats the run. Without
    arguments, it identifies the bundled cell.

    Arguments:
        records ([RECORD]...): Dynamic record to identify on; several give one circuit for all of
            them. For a folder, or files without --ocv, barnax chooses roles and windows; a plan is
            run as it is. Without any, the bundled cell is identified.

    Files:
        plan: Only print the plan, as TOML: the role of each file and what would be done with it.
            identify accepts it in place of the folder.
    """
    if plan:
        return _print_plan(options, records or [])
    if records and all(is_factor_file(path) for path in records):
        return _fit_factors(options, records)
    _run("identify", options, records or [])


def _fit_factors(options: Identification, paths: list[Path]) -> None:
    """Print the tables of records of which only factors were kept; files of `out` if given."""
    run = options.output.begun(None)
    from ..fit.factor_file import read_factors
    from ..fit.record_factors import fit_factors
    from ..fit.temperature_fits import TableFits
    from ..identification.setup import bounded_tables

    job = barnax.Job(**options_of_job(options.job), watch=run.watch)
    usable = {field.name for field in fields(TableOptions)} | {"bounds", "fix", "watch"}
    shown = {name: getattr(options, name) for name in ("report", "live", "paper", "design")}
    shown |= {"json": options.output.as_json}
    idle = [*(job.chosen.keys() - usable), *(name for name, value in shown.items() if value)]
    if idle:
        first = min(idle)
        what = "a window, `initial_soc` or `capacity`" if first == "window" else f"`{first}`"
        raise InputError(
            f"{what} does nothing for factor files, whose records were read and set up when "
            "they were kept; leave it out, or identify on the records"
        )
    factors = [record for path in paths for record in read_factors(path)]
    fit = fit_factors(factors, bounded_tables(job, but="[F]"))
    run.show_document(reporting.wording.document("factors", factors=factors, fit=fit))
    if run.folder is not None:
        run.write({TABLES: reporting.parameters.tables_csv(TableFits((fit,)))})
        run.show(["", str(run.folder / TABLES)])
    run.warn(fit.warnings)


def _print_plan(options: Identification, records: list[Path]) -> None:
    session = Session(is_quiet=options.output.quiet)
    with session.watch("Loading"):
        job = barnax.Job(records, **options_of_job(options.job), watch=session.watch)
    plan = barnax.plan.with_choices(barnax.plan.plan_of(job) or barnax.plan.plan_given(job), job)
    typer.echo(barnax.plan_to_toml(plan), nl=False)


def hppc(*, options: Identification, records: list[Path] | None = None) -> None:
    """Identify tables over SOC from a pulse test (HPPC).

    Every pulse's resistances are printed too. Pulses, rests, capacity and OCV
    come from the test itself; --ocv sets another OCV.

    Arguments:
        records ([RECORD]...): Pulse test (HPPC); several give one circuit. Without any, the bundled
            cell's test at 25 degC is used, and its drive cycles for validation.
    """
    _run("hppc", options, records or [])


def _run(
    command: Literal["identify", "hppc"], options: Identification, records: list[Path]
) -> None:
    named = [*options.job.get("ocv", ()), *options.job.get("validate", ())]
    # A name may be that of a file in the folder.
    inputs = [path for path in named if not any((each / path).exists() for each in records)]
    run = options.output.begun(DEFAULT_FOLDER, *records, *inputs)
    promise = None if options.design is None else barnax.Design.load(options.design)
    if run.folder is not None:
        # Drawing needs modules that load slowly, and waits for the search anyway.
        module = "matplotlib.backends.backend_agg"
        # Not a daemon: a process that ends while one loads C++ aborts.
        threading.Thread(target=__import__, args=(module,)).start()
    job = barnax.Job(records, **options_of_job(options.job), watch=run.watch)
    chosen = barnax.plan.plan_of(job) if command == "identify" else None
    plan = barnax.plan.with_choices(chosen or barnax.plan.plan_given(job, command), job)
    if promise is not None:
        plan = _sampled_by(promise, plan)
    # If roles were chosen, the reasons are printed during the run.
    are_chosen = all(part.reason for part in plan.parts) and not plan.missing
    if are_chosen:
        run.show_document(reporting.wording.document("planned", plan=plan))
    job = barnax.Job(plan, watch=run.watch) if records else job
    is_pulsed = command == "hppc" and not records
    result = barnax.hppc(job) if is_pulsed else barnax.identify(job)
    texts = {"result.json": result.to_json()}
    # If a plan cannot represent a name, only the plan is missing.
    toml = attempt(barnax.plan_to_toml, barnax.plan.with_whole_paths(plan, result.inputs))
    texts |= {PLAN: toml} if isinstance(toml, str) else {}
    try:
        if plan.stored and not are_chosen:
            run.show_document(reporting.wording.document("planned", plan=plan))
        # To be read while the figures are drawn.
        if options.output.verbose:
            run.show_document(reporting.identification.identification_document(result))
        run.show_document(reporting.first_screen.first_screen(result))
        if promise is not None:
            run.show_document(reporting.design.promised_screen(promise, result))
    finally:
        # If the screen cannot be written, as with a closed pipe, the result is still saved.
        draw = partial(result_files, result, options.report, options.paper, options.live)
        run.deliver(texts, draw)
    run.show([reporting.terminal.next_step(*_next(result, run, plan, options.design))])
    names = ["report.html", "result.json", TABLES, "pulses.csv", "figures"]
    run.show_written(names, following=f"barnax show --all {shlex.quote(str(run.folder))}")
    run.warn(result.warnings, result.notes)


def _sampled_by(promise: "barnax.Design", plan: "barnax.Plan") -> "barnax.Plan":
    """The plan with the sampling of the current that only the record of a designed test shows."""
    from ..records import read_record, read_source

    on = plan.of_role("identification")
    is_file = len(on) == 1 and not (on[0].span_s or on[0].more) and on[0].path.is_file()
    if "current_hold" in plan.options or not is_file:
        return plan
    part, reading = on[0], barnax.Job(**plan.options)
    source = read_source(part.path, **reading.of_tables)
    source = replace(source, name=part.name)
    sampling = promise.sampling_of(read_record(source, **reading.of_record(part.name)))
    if sampling is None:
        return plan
    shown = replace(part, source=source, sampling=sampling)
    return replace(plan, parts=tuple(shown if each is part else each for each in plan.parts))


def result_files(
    result: "barnax.Result", report: bool, paper: bool = False, live: bool = False
) -> dict[str, bytes]:
    """The figures, and the report if requested, by their paths in the folder."""
    tables: dict[str, bytes] = {}
    if result.over:
        tables[TABLES] = reporting.parameters.tables_csv(result.fits)
    if result.pulses:
        tables["pulses.csv"] = reporting.pulses.pulses_csv(result.pulses)
    draw = partial(reporting.illustrations.identification_illustrations, result, live=live)
    document_of = partial(reporting.identification.identification_document, result)
    return tables | drawn_files(draw, document_of, report or live, paper)


def _next(
    result: "barnax.Result", run: Delivery, plan: "barnax.Plan", design: Path | None
) -> tuple[str, str]:
    """The next step, and its command, empty if there is none.

    Options are added to the plan that the run wrote; the next run compares a design too.
    """
    from ..records.source import STDIN

    step, folder = reporting.first_screen.next_step(result), run.folder
    advice = as_flags(step.advice)
    if step.also and (words := _with_record(plan, step.also)):
        return advice, new_run(*words)
    words = [word for name, value in step.options.items() for word in (flag_of(name), value)]
    if step.command != "identify" and folder is not None:
        return advice, shlex.join(["barnax", step.command, str(folder), *words])
    if step.command != "identify" or not words:
        return advice, ""
    if any(part.path == STDIN or part.path.is_relative_to("/dev") for part in plan.parts):
        return f"{advice}: {shlex.join(words)}, with what was piped saved as a file", ""
    if folder is None or PLAN not in run.written:
        return f"{advice}: {shlex.join(words)}", ""
    words += [] if design is None else ["--design", str(design)]
    return advice, new_run(str(folder / PLAN), *words)


def _with_record(plan: "barnax.Plan", name: str) -> list[str]:
    """The arguments that add a record to the identification; none if the plan was not chosen, or if
    more than its files was given, which arguments cannot repeat."""
    from ..plan.document import GIVEN

    flags = {"identification": [], "OCV test": ["--ocv"], "validation": ["--validate"]}
    words = [
        word
        for role, flag in flags.items()
        for part in plan.parts
        if role == ("identification" if part.name == name else part.role)
        for word in (*flag, *map(str, part.paths))
    ]
    is_given = GIVEN in plan.reasons.values() or any(
        part.span_s
        or not part.reason
        or (part.window.initial_soc is not None and not part.plans_soc)
        for part in plan.parts
    )
    return [] if is_given or plan.window != barnax.Window() else words


def pack(
    *,
    record: Path,
    cells: str | None = None,
    separate_time_constants: bool = False,
    job: Annotated[Given, options_of("files", "records", "tables")],
    output: Output,
) -> None:
    """Identify every cell of a pack, and flag outliers.

    Prints resistances, capacity and SOC relative to the mean cell. Writes
    cells.csv, a fleet's dataset of them, a figure, and the mean cell's
    result.json.

    Arguments:
        record (FILE): Record with one current and many cell voltages.

    Files:
        cells ('V*'): Columns of the cell voltages, as patterns separated by commas (default:
            columns whose names differ by a number).
        separate_time_constants: Fit every cell's time constants, not only the mean cell's.
    """
    if "validate" in job:
        raise InputError("`validate` does nothing for a pack, whose record is the only one")
    run = output.begun("barnax-pack", record, *job.get("ocv", ()))
    given = {name: value for name, value in options_of_job(job).items() if name != "over"}
    given |= {"cells": cells, "separate_time_constants": separate_time_constants}
    identified = barnax.identify_pack(record, **given, watch=run.watch)
    run.show_document(reporting.fleet.pack_document(identified))

    def draw() -> dict[str, bytes]:
        from ..fleet.dataset import rows_bytes
        from ..fleet.rows import pack_rows

        return {
            "cells.parquet": rows_bytes(pack_rows(identified, record.stem)),
            "figures/cells.png": barnax.plots.encode(identified.figure()),
        }

    texts = {"result.json": identified.result.to_json()}
    run.deliver(texts | {"cells.csv": reporting.fleet.cells_csv(identified)}, draw)
    run.show_written(["cells.csv", "cells.parquet", "result.json", "figures"])
    run.warn(identified.result.warnings)
