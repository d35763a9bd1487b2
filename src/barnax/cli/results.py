"""Commands on a stored result: show it, validate it, replay a record with it."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from ..errors import InputError
from ..settings import Reading, Window
from .options import (
    FILTER,
    FORCE,
    HOW_READ,
    INPUT,
    OUTPUT,
    PAPER,
    QUIET,
    REPORT,
    STORED,
    WINDOW,
    Given,
    RecordOptions,
    argument,
    flag,
    group,
    option,
    options_of,
)
from .output import Output, drawn_files, require_free_file, write_file
from .session import Session, as_flags, shown, use_compilation_cache

if TYPE_CHECKING:
    from ..records import Source
    from ..replay import SocReplay
    from ..reporting.document import Table
    from ..results import Result
    from ..search.evaluate import Evaluation

SOC_FOLDER = Path("barnax-soc")


@group
class OnRecord:
    """A stored result and a record; the window stored of it applies, unless changed."""

    result: Path = STORED
    record: Path = argument("RECORD", "Record to simulate.")
    of_records: RecordOptions
    read: Given = options_of(Reading(), INPUT, *HOW_READ)
    whole_record: bool = flag(
        WINDOW, "--whole-record", "Use the whole record, ignoring its stored window."
    )

    @property
    def how(self) -> dict[str, Any]:
        """The chosen ways to read the record."""
        from ..inputs import lags_of, require_records

        lags = lags_of(Reading(**self.read))
        require_records(lags, {self.record.name})
        return {**self.read, "voltage_lag": lags.get(self.record.name, lags.get(""))}

    def meeting(self, stored: "Result") -> "tuple[Source, Window | None]":
        """The record's file, and its window where options change that.

        Raises `InputError` for an option that is given for another record.
        """
        from ..inputs import source_of
        from ..model.window import merged
        from ..result_filter import window_of

        name, chosen = self.record.name, self.of_records.chosen()
        unknown = sorted(chosen.keys() - {"", name})
        if unknown:
            raise InputError(f"an option is given for {unknown[0]!r}; the record is {name}")
        given = Window(**{**chosen.get("", {}), **chosen.get(name, {})})
        source = source_of(self.record, {}, Reading(**self.read))
        if self.whole_record:
            return source, given
        return source, merged(window_of(stored, source), given) if chosen else None


def load(path: Path) -> "Result":
    """The result in a file, or in a folder that identify wrote."""
    from ..results import Result

    return Result.load(path)


@group
class Shown:
    """One result, or several."""

    results: list[Path] = argument(
        "RESULT...",
        "The folder that identify wrote, or its result.json; two or more are shown side by side.",
    )
    choice: bool = flag(OUTPUT, "--choice", "Show how the circuit was chosen, and no more.")


def show(of: Shown) -> None:
    """Print a result in full, or two results side by side, and what differs.

    Two cells, two ages or two temperatures: the parameters with their
    intervals, and which differ beyond them.
    """
    from ..reporting.candidates import choice_document
    from ..reporting.identification import identification_document
    from ..reporting.terminal import to_terminal

    session = Session(is_quiet=False)
    if len(of.results) > 1:
        from ..reporting.parameters import show as side_by_side

        beside = side_by_side(*of.results, names=_names(of.results))
        session.show(to_terminal(beside.document.with_option_names(as_flags)))
        return
    stored = load(of.results[0])
    if of.choice:
        if not stored.tried:
            raise InputError(f"{of.results[0]}: its circuit was asked for, so none was chosen")
        session.show(to_terminal(choice_document(stored)))
        return
    session.show(to_terminal(identification_document(stored).with_option_names(as_flags)))


def _names(paths: list[Path]) -> tuple[str, ...]:
    """Names of results: their folders, or the files where one folder holds several."""
    folders = [path if path.is_dir() else path.resolve().parent for path in paths]
    names = tuple(folder.resolve().name for folder in folders)
    return names if len({*names}) == len(names) else tuple(map(str, paths))


@group
class Errors:
    """The form in which errors on a record are printed."""

    as_json: bool = flag(OUTPUT, "--json", "Print the errors as JSON.")
    report: Path | None = option(
        OUTPUT, "FILE", "Also write the errors and their figures, as HTML."
    )
    force: bool = FORCE
    quiet: bool = QUIET


def validate(on: OnRecord, output: Errors) -> None:
    """Simulate an identified circuit on another record, and print its errors.

    The window of a record that the result is of applies, unless options
    change it; of another record all is simulated.
    """
    session = Session(is_quiet=output.quiet or output.as_json)
    with session.watch("Loading JAX"):
        use_compilation_cache()
        from ..reporting.identification import metrics_table
        from ..reporting.starts import moved_start_sentence
        from ..reporting.temperatures import prediction_sentence
        from ..reporting.terminal import terminal_table
        from ..storing import metrics_part

    if output.report is not None:
        require_free_file(output.report, output.force)
    stored = load(on.result)
    record, window = on.meeting(stored)
    with session.watch("Simulating"):
        evaluation = stored.validate(record, window, **on.how)
    metrics = metrics_part(evaluation)
    if output.as_json:
        typer.echo(metrics.model_dump_json(by_alias=True, indent=1))
    table = metrics_table([(metrics, "validation")])
    session.show([terminal_table(table)])
    if told := moved_start_sentence(metrics):
        session.show([shown(told[:1].upper() + told[1:] + ".")])
    if output.report is not None:
        with session.watch("Drawing figures"):
            write_file(output.report, _validation_page(evaluation, table, stored.answer))
        session.show(["", f"  {shown(output.report)}"])
    degc = evaluation.prepared.temperature_degc
    told = prediction_sentence(stored.fits, on.record.name, degc)
    session.show([shown(told)] if told else [])
    session.warn(evaluation.warnings)


def _validation_page(evaluation: "Evaluation", table: "Table", answer: str) -> bytes:
    from ..plots import plot_error, plot_voltage
    from ..plots.pictures import illustrate
    from ..reporting.document import Document, Section, picture
    from ..reporting.render import to_html

    record = evaluation.prepared.record.name
    figures = (
        illustrate("voltage", record, plot_voltage, evaluation),
        illustrate("error", record, plot_error, evaluation),
    )
    drawn = tuple(map(picture, figures))
    document = Document(f"{answer} on {record}", "", (Section("Errors", (table, *drawn)),))
    return to_html(document).encode()


@group
class FilterOptions:
    """The filter that replays the record, and the parameters it estimates."""

    filter: Literal["sum", "ekf", "ukf"] = option(
        FILTER,
        "sum|ekf|ukf",
        "Gaussian sum of extended Kalman filters, one extended or one unscented Kalman filter.",
        "sum",
    )
    estimate: str = option(
        FILTER,
        "NAME,NAME",
        "Parameters to estimate: offset (of the current), capacity, R0, R1, tau1 and so on; '' for "
        "none.",
        "offset,capacity",
    )
    tables: bool = flag(
        FILTER,
        "--tables/--no-tables",
        "Use the tables over SOC if the result has them, or not.",
        True,
    )
    report: bool = REPORT
    paper: bool = PAPER


def soc(on: OnRecord, chosen: FilterOptions, output: Output) -> None:
    """Replay a record through a Kalman filter, and say how well the circuit tracks its SOC.

    The filter runs from a right start, from starts 20 % too low and too high,
    with a current offset, and with a wrong capacity. The window of a
    record that the result is of applies, unless options change it.
    """
    session, folder = output.begun(SOC_FOLDER, (on.result, on.record))
    with session.watch("Loading JAX"):
        use_compilation_cache()
        from ..replay import replay_soc
        from ..reporting.terminal import soc_screen
        from ..result_filter import FilterSettings

    stored = load(on.result)
    record, window = on.meeting(stored)
    names = tuple(name.strip() for name in chosen.estimate.split(",") if name.strip())
    settings = FilterSettings(chosen.filter, names, tables=chosen.tables)
    with session.watch("Replaying"):
        replay = replay_soc(stored, record, window, settings, **on.how)
    draw = partial(_soc_figures, replay, chosen.report, chosen.paper)
    folder, written = output.deliver(session, folder, "soc.json", replay.to_json(), draw)
    session.show(soc_screen(replay))
    if folder is not None:
        names = ["report.html"] if "report.html" in written else []
        session.show_written(folder, [*names, "soc.json", "figures"])
    session.warn(replay.warnings)


def _soc_figures(replay: "SocReplay", report: bool, paper: bool) -> dict[str, bytes]:
    from ..reporting.illustrations import replay_illustration
    from ..reporting.replay import replay_document

    document_of = partial(replay_document, replay)
    return drawn_files(lambda: [replay_illustration(replay)], document_of, report, paper)
