"""Files in and out: `barnax check` and `convert` for measured files, and `export` of a result."""

import io
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

import barnax

from .. import reporting
from ..errors import InputError, attempt, printable, require_positive
from ..settings import Reading
from .options import Given, options_of
from .output import add_file, report_unfinished, require_free_file, write_file
from .session import Session, shown

if TYPE_CHECKING:
    import polars as pl

    from ..records import Record

SCHEMA_VERSION = 1
# The exit status of a command with findings.
FINDINGS = 1


def check(
    *,
    files: list[Path],
    capacity: float | None = None,
    rest_current: float | None = None,
    read: Annotated[Given, options_of("reading")],
    as_json: bool = False,
    quiet: bool = False,
) -> None:
    """List the problems in measured files, and how to fix them.

    Exit status: 0 for notes only, 1 for errors or warnings, 2 for a file that is not a table.

    Arguments:
        files (FILE): Files from a cycler, or folders of them; - is standard input.

    Files:
        capacity (AH): Capacity of the cell, to check the ampere-hours against.
        rest_current (A): Current below which the cell is at rest (default: C/100, more if it is
            noisy).

    Output:
        as_json (--json): Print the findings as JSON.
        quiet (--quiet -q): Print no tables and no notes; findings go to stderr, one per line.
    """
    session = Session(is_quiet=quiet or as_json)
    with session.watch("Loading"):
        from ..inputs import require_records
        from ..records import read_source
        from ..records.source import files_of, name_of

    for name, value, unit in ("capacity", capacity, "Ah"), ("rest_current", rest_current, "A"):
        require_positive(name, value, unit)
    how, wording = Reading(**read), reporting.wording.wording
    chosen = {"capacity_ah": capacity, "rest_current_a": rest_current}
    outcomes: dict[Path, Any] = {}
    for given in files:
        paths = attempt(files_of, [given])
        outcomes |= {given: paths} if isinstance(paths, InputError) else dict.fromkeys(paths)
    require_records(how.lags_s, {name_of(path) for path in (*files, *outcomes)})

    def look(file: Path) -> "barnax.FileCheck":
        source = read_source(file, **how.of_tables)
        return barnax.check_file(source, **chosen, **how.of_record(source.name))

    refusals, checks, listed = list[str](), [], list[dict[str, Any]]()
    for file, check in outcomes.items():
        if check is None:
            with session.watch(f"Looking at {file.name}"):
                check = attempt(look, file)
        if isinstance(check, InputError):
            refusals.append(str(check))
            listed.append({"file": printable(file.name), "unreadable": printable(str(check))})
            continue
        checks.append(check)
        listed.append(check.to_dict())
        session.show_document(reporting.wording.document("check", check=check))
        if quiet:
            findings = (finding for finding in check.findings if finding.counts)
            session.warn(wording("decisions.finding", check.file, one) for one in findings)
    if as_json:
        document = {"schema_version": SCHEMA_VERSION, "files": listed}
        typer.echo(json.dumps(document, indent=1, ensure_ascii=False))
    session.show([wording("decisions.counts", checks, len(refusals))])
    if refusals:
        raise InputError("\n".join(refusals))
    if not all(check.is_clean for check in checks):
        raise typer.Exit(FINDINGS)


def convert(
    *,
    files: list[Path],
    to: Literal["bdf"] = "bdf",
    out: Path | None = None,
    read: Annotated[Given, options_of("reading")],
    force: bool = False,
    quiet: bool = False,
) -> None:
    """Convert a cycler file to SI units, one clock, charge positive.

    Several files are joined into one record, in the order given.

    Its origin, and what was decided and changed, is stored in the metadata of the
    Parquet file, or in a JSON file next to the CSV.

    Arguments:
        files (FILE...): File from a cycler, or the parts of one log in order; - is standard input.

    Output:
        to (bdf): Format to write: the Battery Data Format.
        out (FILE): File to write, .parquet or .csv (default: the name of FILE with .bdf.parquet).
    """
    session, file = Session(is_quiet=quiet), files[0]
    with session.watch("Loading"):
        from ..inputs import require_records
        from ..records import read_source
        from ..records.log import joined

    stem = file.name.split(".")[0] if file.name != "-" else "record"
    path = out or Path(f"{stem}.{to}.parquet")
    require_free_file(path, force, files)
    if path.name.lower().endswith(".csv"):
        # The place of its provenance.
        origin = path.with_name(f"{path.name[:-4]}.json")
        require_free_file(origin, force)
        if origin.exists() and b'"written by": "barnax ' not in origin.read_bytes():
            raise InputError(
                f"{origin}: would be replaced by the origin of {path.name}, and is another file; "
                "give `out` another name"
            )
    report_unfinished(session, path.parent)
    with session.watch(f"Reading {file.name}"):
        how = Reading(**read)
        sources = [read_source(path, **how.of_tables) for path in files]
        source = joined(sources)
        require_records(how.lags_s, {source.name})
        # A current moved to the times of the voltage is no longer the file's.
        how = replace(how, voltage_lag=how.voltage_lag or 0.0)
        record = barnax.read_record(source, **how.of_record(source.name))
        findings = barnax.check_file(source, **how.of_record(source.name)).findings
    for name, content in bdf_files(record, path.name).items():
        write_file(path.with_name(name), content)
    warnings = [finding.about(record.name) for finding in findings if finding.counts]
    session.warn(dict.fromkeys([*record.warnings, *warnings]))
    for finding in findings:
        if not finding.counts:
            session.note(str(finding.about(record.name)))
    session.show([f"Battery Data Format, {record.samples:,} samples: [bold]{shown(path)}[/bold]"])


def export(
    *,
    result: Path,
    to: str,
    out: Path | None = None,
    force: bool = False,
    verify: bool = False,
    quiet: bool = False,
) -> None:
    """Export an identified circuit to another tool.

    Anything that the tool cannot represent is reported on stderr and, if the
    format has comments, in the file.

    Output:
        to (pybamm|thevenin|simscape|c-header|csv|xlsx|json|c-filter): The tool or format to export
            to.
        out (FILE): File to write (default: beside the result, barnax_pybamm.py, barnax_thevenin.py,
            barnax_simscape.mat, barnax_cell.h, barnax_parameters.csv or .xlsx, barnax_cell.json or
            barnax_filter.h).
        verify: Simulate the exported circuit in PyBaMM or thevenin, and print the largest
            difference from barnax.
    """
    session = Session(is_quiet=quiet)
    # PyBaMM would ask for permission to report usage, and do so.
    os.environ.setdefault("PYBAMM_DISABLE_TELEMETRY", "true")
    session.load_jax()
    exporter = barnax.export.get_exporter(to)
    if verify:
        barnax.export.require_package(exporter)
    file = result / "result.json" if result.is_dir() else result
    path = out or file.with_name(exporter.file_name)
    require_free_file(path, force, [file])
    if not path.suffix:
        ending = Path(exporter.file_name).suffix
        raise InputError(f"{path}: has no ending; give `out` a name that ends in {ending}")
    report_unfinished(session, path.parent)
    stored = barnax.Result.load(result)
    content, caveats = exporter.write(stored)
    lines = [f"{exporter.description}: [bold]{shown(path)}[/bold]"]
    if verify:
        with session.watch(f"Simulating in {exporter.package}"):
            lines.append(barnax.export.verify(stored, exporter, content).text)
    add_file(path, content)
    session.warn(caveats)
    session.show(lines)


def bdf_table(record: "Record") -> "pl.DataFrame":
    """The record's samples as a table of the Battery Data Format, charge positive, under its
    preferred labels (battery-data-alliance/battery-data-format).

    The format cannot express when a sample's current flowed. If it flowed before the sample and no
    counters prove it, the net capacity is the integral that does.

    >>> from barnax.bundled import bundled_file
    >>> from barnax.records import read_record
    >>> bdf_table(read_record(bundled_file("identification"))).columns
    ['Test Time / s', 'Current / A', 'Voltage / V']
    """
    import polars as pl

    net_ah = record.discharged_ah if _is_unproved(record) else record.charge_ah
    columns = {
        "Test Time / s": record.time_s,
        # Adding zero turns the -0.0 of a rest into 0.
        "Current / A": 0.0 - record.current_a,
        "Voltage / V": record.voltage_v,
        "Surface Temperature / degC": record.temperature_degc,
        "Step Index / 1": record.step,
        "Cycle Count / 1": record.cycle,
        "Net Capacity / Ah": None if net_ah is None else 0.0 - net_ah,
    }
    present = {name: values for name, values in columns.items() if values is not None}
    return pl.DataFrame({name: values.copy() for name, values in present.items()})


def _is_unproved(record: "Record") -> bool:
    return record.hold.value != "forward" and record.hold.strength != "strong"


def _provenance(record: "Record") -> dict[str, Any]:
    """The source file of the record, and what was decided and changed."""
    return {
        "written by": f"barnax {barnax.__version__}",
        "source": record.name,
        "source sha256": record.sha256,
        "current sign in the source": record.sign.value,
        "reason": record.sign.reason,
        "current flows": f"{record.hold.value} from a sample ({record.hold.strength})",
        "net capacity": "integrated" if _is_unproved(record) else "the tester's",
        "warnings": [str(notice) for notice in (*record.notes, *record.warnings)],
    }


def bdf_files(record: "Record", name: str) -> dict[str, bytes]:
    """The files by name: Parquet with its provenance, or CSV with a JSON file next to it."""
    table = bdf_table(record)
    origin = json.dumps(_provenance(record), indent=1, ensure_ascii=False)
    if not name.lower().endswith(".csv"):
        parquet = io.BytesIO()
        table.write_parquet(parquet, metadata={"provenance": origin})
        return {name: parquet.getvalue()}
    return {name: table.write_csv().encode(), f"{name[:-4]}.json": f"{origin}\n".encode()}
