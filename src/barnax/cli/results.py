"""Commands on a stored result: show it, write its page, validate it, replay a record with it."""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

import barnax

from .. import reporting
from ..errors import InputError, attempt
from ..settings import Reading, Window
from .options import Given, group, options_of, windows_of
from .output import RESULTS, Output, add_file, drawn_files, page_of, require_free_file, write_file
from .session import Session, require_platform, shown

if TYPE_CHECKING:
    from ..records import Source

PAGE = "report.html"


@group
class ResultOnRecord:
    """A stored result and a record, whose stored window applies unless options change it.

    Arguments:
        record (RECORD): Record to simulate.

    Records (FILE=VALUE for one of them):
        whole_record: Use the whole record, ignoring its stored window.
    """

    result: Path
    record: Path
    of_records: Annotated[Given, options_of("records")]
    read: Annotated[Given, options_of("reading")]
    whole_record: bool = False

    def meeting(self, stored: "barnax.Result") -> "tuple[Source, Window | None]":
        """The record's file, and its window if options change it.

        Raises `InputError` for an option that is given for another record.
        """
        from ..inputs import source_of
        from ..model.window import merged
        from ..result_filter import window_of

        name, windows = self.record.name, windows_of(self.of_records)
        if unknown := sorted(windows.keys() - {"", name}):
            raise InputError(f"an option is given for {unknown[0]!r}; the record is {name}")
        given = windows.get(name) or windows.get("") or Window()
        reading = Reading(**self.read)
        source = source_of(self.record, {}, reading)
        if self.whole_record:
            return source, given
        window = window_of(stored, source, source, reading) if windows else None
        return source, window and merged(window, given)


def show(*, results: list[Path], whole: bool = False, choice: bool = False) -> None:
    """Print a result, or several side by side with what differs.

    One result is shown as identify printed it, with its warnings but without the
    plan and the next step. Two cells, two ages or two temperatures are compared by
    their parameters and intervals, and by which differ beyond them.

    Arguments:
        results (RESULT...): The folder that identify wrote, or its result.json; two or more are
            shown side by side.

    Output:
        whole (--all): Print every decision, table and warning.
        choice: Show how the circuit was chosen, and no more.
    """
    session = Session(is_quiet=False)
    if len(results) > 1:
        return session.show_document(barnax.show(*results, names=_names(results)).document)
    stored = barnax.Result.load(results[0])
    if choice and not stored.tried:
        raise InputError(f"{results[0]}: its circuit was asked for, so none was chosen")
    if choice:
        return session.show_document(
            reporting.wording.document("chosen", view=reporting.view.View(stored))
        )
    if whole:
        return session.show_document(reporting.identification.identification_document(stored))
    session.show_document(reporting.first_screen.first_screen(stored))
    session.warn(stored.warnings)


def _names(paths: list[Path]) -> tuple[str, ...]:
    """Names of results: their folders, or the files if one folder has several."""
    folders = [path if path.is_dir() else path.resolve().parent for path in paths]
    names = tuple(folder.resolve().name for folder in folders)
    return names if len({*names}) == len(names) else tuple(map(str, paths))


def validate(
    *,
    on: ResultOnRecord,
    as_json: bool = False,
    report: Path | None = None,
    force: bool = False,
    quiet: bool = False,
) -> None:
    """Print the errors of an identified circuit on another record.

    A record that the result was identified on keeps its window, unless options
    change it; any other record is simulated as a whole.

    Output:
        as_json (--json): Print the errors as JSON.
        report (FILE): Also write the errors and their figures, as HTML.
    """
    session = Session(is_quiet=quiet or as_json)
    session.load_jax()
    from ..result_parts import MetricsBlock

    if report is not None:
        require_free_file(report, force)
    stored = barnax.Result.load(on.result)
    record, window = on.meeting(stored)
    with session.watch("Simulating"):
        evaluation = stored.validate(record, window, **on.read)
    if as_json:
        block = MetricsBlock(identification=evaluation.metrics, validation=())
        # A constant voltage has no R2: JSON has null, and no NaN.
        plain = json.loads(block.model_dump_json(by_alias=True))["identification"]
        typer.echo(json.dumps(plain, indent=1))
    document = _validation(evaluation, stored)
    session.show_document(document)
    if report is not None:
        with session.watch("Drawing figures"):
            write_file(report, page_of(document))
        session.show(["", f"  {shown(report)}"])
    session.warn(evaluation.warnings)


def _validation(
    evaluation: "barnax.Evaluation", stored: "barnax.Result"
) -> "reporting.document.Page":
    """The errors of a circuit on a record, with figures, which a terminal leaves out."""
    record, illustrate = evaluation.prepared.record.name, reporting.illustrations.illustrate
    plots = {"voltage": barnax.plots.plot_voltage, "error": barnax.plots.plot_error}
    drawn = [illustrate(name, record, plot, evaluation) for name, plot in plots.items()]
    facts = {"result": stored, "errors": evaluation.metrics}
    degc = evaluation.prepared.temperature_degc
    return reporting.wording.document("validated", drawn, temperature_degc=degc, **facts)


def soc(
    *,
    on: ResultOnRecord,
    filter: Literal["sum", "ekf", "ukf"] = "sum",
    estimate: str = "offset,capacity",
    tables: bool = True,
    report: bool = False,
    paper: bool = False,
    output: Output,
) -> None:
    """Replay a record through a Kalman filter that tracks its SOC.

    The filter runs from the correct start, from starts 20 % too low and too high,
    with a current offset, and with a wrong capacity. A record that the result was
    identified on keeps its window, unless options change it.

    Filter:
        filter (sum|ekf|ukf): Gaussian sum of extended Kalman filters, one extended or one unscented
            Kalman filter.
        estimate (NAME,NAME): Parameters to estimate: offset (of the current), capacity, R0, R1,
            tau1 and so on; '' for none.
        tables (--tables/--no-tables): Use the result's tables over SOC, or its constants.
    """
    run = output.begun("barnax-soc", on.result, on.record)
    stored = barnax.Result.load(on.result)
    record, window = on.meeting(stored)
    names = tuple(name.strip() for name in estimate.split(",") if name.strip())
    settings = barnax.FilterSettings(filter, names, tables=tables)
    with run.watch("Replaying"):
        replay = barnax.replay_soc(stored, record, window, settings, **on.read)
    document_of = partial(reporting.replay.replay_document, replay)

    def drawn() -> "list[reporting.document.Picture]":
        plot = barnax.plots.plot_soc_replay
        return [reporting.illustrations.illustrate("soc", replay.record, plot, replay)]

    draw = partial(drawn_files, drawn, document_of, report, paper)
    run.deliver({"soc.json": replay.to_json()}, draw)
    run.show_document(reporting.replay.soc_screen(replay))
    run.show_written([PAGE, "soc.json", "figures"])
    run.warn(replay.warnings)


def report(
    *,
    result: Path,
    out: Path | None = None,
    data: list[Path] | None = None,
    live: bool = False,
    force: bool = False,
) -> None:
    """Write the report of a stored result as one HTML page.

    Figures of identify and hppc are drawn again from the measured files. Without
    these, and for compare and soc, figures over time are left out.

    Arguments:
        result (RESULT): The folder that identify, hppc, compare, soc or fleet wrote, or its
            result.json, comparison.json or soc.json.

    Output:
        out (FILE): The page (default: report.html next to the result).
    """
    page = out or (result if result.is_dir() else result.parent) / PAGE
    require_free_file(page, force)
    session = Session(is_quiet=False)
    with session.watch("Writing the report"):
        document, missing = _document(_file_of(result), data or (), live)
        if missing:
            left_out = f"{document.summary} Figures over time are left out: {missing}."
            document = replace(document, summary=left_out.strip())
        add_file(page, page_of(document))
    if missing:
        session.warn([f"figures over time are left out: {missing}"])
    session.show([str(page)])


def _file_of(path: Path) -> Path:
    """The file of a result; a fleet's folder."""
    if not path.is_dir():
        return path
    for name in RESULTS:
        if (path / name).is_file():
            return path / name
    if (path / "cells.parquet").is_file():
        return path
    raise InputError(f"{path}: holds no result; give the folder that a command of barnax wrote")


def _document(
    path: Path, data: Sequence[Path], live: bool
) -> "tuple[reporting.document.Page, str]":
    """The document of a stored result, and why figures over time are missing, if they are."""
    if path.is_dir():
        from ..fleet.summary import read_fleet, summarize

        rows = read_fleet(path)
        missing = "the worst fits are drawn by barnax fleet, with its manifest"
        drawn = reporting.fleet.fleet_illustrations(rows, {})
        return reporting.fleet.fleet_document(summarize(rows), drawn), missing
    require_platform()
    keys = _keys(path)
    if "scenarios" in keys:
        missing = "soc.json has no estimates over time; barnax soc --report draws them"
        stored = barnax.SocReplay.from_json(path)
        return reporting.replay.replay_document(stored), missing
    if "rows" in keys:
        stored = barnax.ComparisonResult.from_json(path)
        missing = "comparison.json has no records; barnax compare draws them"
        drawn = reporting.illustrations.comparison_illustrations(stored)
        return reporting.comparison.comparison_document(stored, drawn), missing
    result, missing = barnax.Result.load(path, data=data), ""
    drawn = attempt(reporting.illustrations.identification_illustrations, result, live=live)
    if isinstance(drawn, InputError):
        drawn, missing = reporting.illustrations.stored_illustrations(result), str(drawn)
    return reporting.identification.identification_document(result, drawn), missing


def _keys(path: Path) -> set[str]:
    """The keys of a file; anything but JSON is refused when it is read as a result."""
    try:
        return {*json.loads(path.read_text(encoding="utf-8"))}
    except (OSError, ValueError, TypeError, RecursionError):
        return set()
