"""Commands on a stored result: show, validate, rerun and export it."""

import hashlib
import itertools
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import InputError
from .groups import OUTPUT, WINDOW, flag, grouped
from .options import ExportChoices, Quiet, StoredResult
from .output import require_free_file, write_file
from .record_options import Columns, Hold, RecordOptions, Sign
from .session import Session, as_flags, shown, use_compilation_cache

if TYPE_CHECKING:
    from ..export import Verification
    from ..model.window import Window
    from ..results import Result

# Across machines and versions the refined error agrees this closely, relative.
SAME_RMSE = 1e-9
FINDINGS = 1
START = ("start_time_s", "start_after_step", "initial_soc", "initial_direction")
SCORING = ("score_steps", "score_from_s", "score_to_s", "score_soc")


def load(path: Path) -> "Result":
    """The result in a file, or in a folder that identify wrote."""
    from ..results import Result

    return Result.from_json(path / "result.json" if path.is_dir() else path)


def show(result: StoredResult) -> None:
    """Print a result in full."""
    from ..reporting import identification_document
    from ..reporting.first_screen import first_screen
    from ..reporting.terminal import to_terminal

    stored = load(result)
    session = Session(is_quiet=False)
    session.show(to_terminal(identification_document(stored).spelled(as_flags)))
    session.show(first_screen(stored, as_flags))


@grouped
def validate(
    result: StoredResult,
    record: Annotated[Path, typer.Argument(metavar="RECORD", help="Record to validate on.")],
    of_records: RecordOptions,
    current_sign: Sign = "auto",
    current_hold: Hold = "auto",
    columns: Columns = "",
    whole_record: Annotated[
        bool,
        flag(
            WINDOW,
            "--whole-record",
            "Simulate and score the whole record, ignoring the stored window.",
        ),
    ] = False,
    as_json: Annotated[bool, flag(OUTPUT, "--json", "Print the errors as JSON.")] = False,
    quiet: Quiet = False,
) -> None:
    """Simulate an identified circuit on another record, and print its errors.

    The window of the identification applies, unless options change it.
    With another start, the stored state of charge is not used.
    """
    session = Session(is_quiet=quiet or as_json)
    with session.watch("Loading JAX"):
        use_compilation_cache()
        from ..pipeline import validate_stored
        from ..reporting.identification import metrics_table
        from ..reporting.temperature import prediction_sentence
        from ..reporting.terminal import terminal_table
        from ..run import metrics_part

    stored = load(result)
    window = stored_window(stored, record, of_records, whole_record)
    with session.watch("Simulating"):
        evaluation, warnings = validate_stored(
            stored, record, window,
            current_sign=current_sign, current_hold=current_hold, columns=columns,
        )  # fmt: skip
    metrics = metrics_part(evaluation)
    if as_json:
        typer.echo(metrics.model_dump_json(by_alias=True, indent=1))
    session.show([terminal_table(metrics_table([(metrics, "validation")]))])
    if stored.tables is not None:
        degc = evaluation.prepared.temperature_degc
        told = prediction_sentence(stored.tables, record.name, degc)
        session.show([shown(told)] if told else [])
    session.warn(warnings)


def stored_window(
    stored: "Result", record: Path, of_records: RecordOptions, is_whole: bool
) -> "Window":
    """The window in which a stored circuit meets a record, with the options that change it.

    Raises `InputError` for an option that is given for another record.
    """

    chosen = of_records.chosen()
    unknown = sorted(chosen.keys() - {"", record.name})
    if unknown:
        raise InputError(f"an option is given for {unknown[0]!r}; the record is {record.name}")
    given = {**chosen.get("", {}), **chosen.get(record.name, {})}
    # What was given for one record alone is not another's.
    own = {each.name: each.window for each in stored.inputs if each.window}
    return _window(own.get(record.name) or stored.common_window, given, is_whole)


def _window(stored: "Window", given: dict[str, Any], is_whole: bool) -> "Window":
    """The stored window with the given parts in place, without what they make void."""
    void: tuple[str, ...] = ()
    if is_whole:
        void = START + SCORING
    elif given.keys() & {"start_time_s", "start_after_step"}:
        void = START
    return replace(stored, **(dict.fromkeys(void) | given))


def rerun(
    result: StoredResult,
    data: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FOLDER",
            help="Folder of the measured files (default: here and beside the result); repeatable.",
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Run the stored command of a result again, and say whether the result is the same.

    Exit status: 0 if it is, bit for bit or to 1e-9 of the RMSE; 1 if not.
    """
    session = Session(is_quiet=quiet)
    stored = load(result)
    place = result if result.is_dir() else result.parent
    command = _with_files(result, stored, [*(data or []), Path(), place, place.parent])
    with session.watch("Repeating"), tempfile.TemporaryDirectory() as folder:
        repeated = _run(command, Path(folder, "repeated"))
    if repeated.to_json() == stored.to_json():
        session.show(["The result is the same, byte for byte."])
        return
    old_v, new_v = (each.metrics.identification.rmse_v for each in (stored, repeated))
    session.show(_differences(stored, repeated))
    if abs(new_v / old_v - 1) <= SAME_RMSE:
        session.show([f"The error agrees to {abs(new_v / old_v - 1):.1e}."])
        return
    session.show([f"[bold]The error differs by {100 * (new_v / old_v - 1):+.2g} %.[/bold]"])
    raise typer.Exit(FINDINGS)


def _with_files(result: Path, stored: "Result", folders: list[Path]) -> list[str]:
    """The stored command with every file's name replaced by where it lies."""
    if len(stored.command) < 2 or stored.command[1] not in ("identify", "hppc"):
        raise InputError(
            f"{result}: has no stored command (it was made from Python); repeat it in Python"
        )
    # A part of a file is named by its number.
    hashes = {re.sub(r"#\d+$", "", each.name): each.sha256 for each in stored.inputs}
    words = []
    for before, word in itertools.pairwise(stored.command):
        option, equals, name = word.partition("=") if word.startswith("--") else ("", "", word)
        if (option if equals else before) == "--bounds":
            name = str(_places(name, folders)[0])
        elif name in hashes:
            name = str(_find(result, name, hashes[name], folders))
        words.append(f"{option}{equals}{name}")
    return words


def _places(name: str, folders: list[Path]) -> list[Path]:
    """Where in the folders there is a file of that name, at least one."""
    places = [folder / name for folder in folders if (folder / name).is_file()]
    if not places:
        raise InputError(
            f"{name}: not found in {', '.join(str(folder) for folder in folders)}; give its "
            "folder with `data`"
        )
    return places


def _find(result: Path, name: str, sha256: str, folders: list[Path]) -> Path:
    """The file of that name and content in one of the folders."""
    places = _places(name, folders)
    for place in places:
        if sha256 == hashlib.sha256(place.read_bytes()).hexdigest():
            return place
    raise InputError(
        f"{places[0]}: not the file that {result} was made from (its SHA-256 differs); give "
        "the folder of the original with `data`"
    )


def _run(command: list[str], folder: Path) -> "Result":
    done = subprocess.run(
        # Without -P a file in the working folder could pass for one of our libraries.
        [sys.executable, "-P", "-m", "barnax", *command, "--out", str(folder), "--quiet"],
        stderr=subprocess.PIPE,
        text=True,
    )
    if done.returncode:
        raise InputError(f"the stored command fails now: {done.stderr.strip()}")
    return load(folder)


def _differences(stored: "Result", repeated: "Result") -> list[str]:
    """What is not the same, in words."""
    lines = [
        f"{name} was {old}, is {repeated.versions.get(name)}."
        for name, old in stored.versions.items()
        if repeated.versions.get(name) != old
    ]
    entries = [set(_entries(json.loads(each.to_json()))) for each in (stored, repeated)]
    names = list(dict.fromkeys(place for place, _ in sorted(entries[0] ^ entries[1])))
    first = ", ".join(names[:3])
    return [*lines, f"{len(names)} entries differ from the stored ones, such as {shown(first)}."]


def _entries(value: Any, place: str = "") -> Iterator[tuple[str, str]]:
    """Every number and text of a file with the path that leads to it."""
    parts = value.items() if isinstance(value, dict) else enumerate(value)
    for name, part in parts:
        path = f"{place}.{name}" if place else str(name)
        if isinstance(part, dict | list):
            yield from _entries(part, path)
        else:
            yield path, repr(part)


@grouped
def export(result: StoredResult, chosen: ExportChoices, quiet: Quiet = False) -> None:
    """Export an identified circuit to another tool.

    What the tool cannot represent is named on stderr and, if the format has
    comments, in the file.
    """
    session = Session(is_quiet=quiet)
    # PyBaMM would ask, and then report, what it is used for.
    os.environ.setdefault("PYBAMM_DISABLE_TELEMETRY", "true")
    with session.watch("Loading JAX"):
        use_compilation_cache()
        from ..export import get_exporter, require_package
        from ..export import verify as simulate_both

    exporter = get_exporter(chosen.to)
    if chosen.verify:
        require_package(exporter)
    path = chosen.out or Path(exporter.file_name)
    # Names that are no files are refused elsewhere, with the reason.
    with suppress(OSError):
        if path.samefile(result / "result.json" if result.is_dir() else result):
            raise InputError(f"{path}: this is the result itself; choose another file with `out`")
    require_free_file(path, chosen.force)
    stored = load(result)
    content, caveats = exporter.write(stored)
    found = None
    if chosen.verify:
        with session.watch(f"Simulating in {exporter.package}"):
            found = simulate_both(stored, exporter, content)
    write_file(path, content)
    session.warn(caveats)
    session.show([f"{exporter.description}: [bold]{shown(path)}[/bold]"])
    if found is not None:
        session.show([_verification(found)])


def _verification(found: "Verification") -> str:
    degc = ", ".join(f"{each:.3g}" for each in found.temperatures_degc)
    at = f" at each of {degc} degC" if degc else ""
    text = (
        f"Largest difference from barnax in {found.package} {found.version}, over {found.samples} "
        f"samples of a pulse test{at}: {found.largest_v:.3g} V (RMS {found.rms_v:.3g} V)"
    )
    remainders = {
        "without the hysteresis voltage": found.without_hysteresis_v,
        "without the samples at which the current changes sign": found.without_turns_v,
    }
    reason, remainder_v = min(remainders.items(), key=lambda item: item[1])
    if remainder_v < found.largest_v / 2:
        text += f"; {reason} {remainder_v:.3g} V"
    return text + "."
