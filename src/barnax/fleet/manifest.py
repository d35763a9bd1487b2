"""Cells of a fleet, as sent to a worker (paths and options, no data), and their manifest.

A manifest is a table with one row per cell or test, with globs, defaults and copied columns.
"""

import glob
import hashlib
import io
import json
import os
import pickle
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import polars as pl

from .. import __version__
from ..errors import LONGEST_NAME, InputError, cut, listed, naming, toml_reason
from ..files import is_address, located
from ..records.readers import unzipped
from ..records.readers.binary import PARQUET
from ..records.readers.content import require_room
from ..settings import WINDOW_OPTIONS, CellSettings, Reading

if TYPE_CHECKING:
    from ..model.problem import Problem

# Memory taken by a row of a manifest, and by every value in it.
ROW_BYTES, VALUE_BYTES = 200, 100

# Values of columns and options, by name.
Options = Mapping[str, Any]
# Options in a row of a manifest for reading its files and for the identification.
OPTIONS = ("model", "pack_cells", *vars(CellSettings()), *vars(Reading()))


@dataclass(frozen=True, eq=False)
class FleetCell:
    """A cell, or one test of it: its files, options, and the columns copied to its row.

    Args:
        id: Its name.
        records: Files to identify on.
        ocv: OCV tests.
        validate: Files to validate on.
        cell: A result.json whose cell model is used instead of OCV tests.
        bounds: A TOML file of bounds.
        window: Fields of a `Window`.
        validate_window: Fields that differ for validation records.
        options: Arguments of `identify`.
        carried: Columns copied to its row.
        missing: Problems with file names: a missing file, or a pipe instead of a file.
        problem: A problem that replaces all files.
    """

    id: str
    records: tuple[str, ...] = ()
    ocv: tuple[str, ...] = ()
    validate: tuple[str, ...] = ()
    cell: str | None = None
    bounds: str | None = None
    window: Options = field(default_factory=dict)
    validate_window: Options = field(default_factory=dict)
    options: Options = field(default_factory=dict)
    carried: Options = field(default_factory=dict)
    missing: tuple[str, ...] = ()
    problem: "Problem | None" = None

    @property
    def files(self) -> tuple[str, ...]:
        """Every file that its row depends on."""
        more = [path for path in (self.cell, self.bounds) if path]
        return (*self.records, *self.ocv, *self.validate, *more)

    def fingerprint(self, settings: Mapping[str, Any]) -> str:
        """A digest of all inputs and settings: files by path, size and time of change."""
        inputs = [
            *(__version__, self.id, _plain(settings), self.records, self.ocv, self.validate),
            *(self.cell, self.bounds, self.missing, [stamp(path) for path in self.files]),
            *map(_plain, (self.window, self.validate_window, self.options, self.carried)),
        ]
        content = json.dumps(inputs, default=str).encode()
        if self.problem is not None:
            content += pickle.dumps(self.problem)
        return hashlib.sha256(content).hexdigest()


def _plain(values: Mapping[str, Any]) -> list[tuple[str, str]]:
    return sorted((name, repr(value)) for name, value in values.items())


def stamp(path: str) -> tuple[int, int] | None:
    """Size and time of change; None if the file does not exist here, or is not in a file system."""
    if is_address(path):
        return None
    try:
        stamped = os.stat(path)
    except OSError:
        return None
    return stamped.st_size, stamped.st_mtime_ns


def short_name(path: str) -> str:
    """A file's name without folders."""
    return path.rpartition("/")[2] if is_address(path) else Path(path).name


# A spreadsheet takes values with these first characters for formulas.
FORMULA = ("=", "+", "-", "@")
# Columns that name files; `record` and `circuit` are aliases.
FILES = ("records", "ocv", "validate")
ALIKE = {"record": "records", "circuit": "model"}
# Between several files in one cell of a table.
SEPARATOR = ";"
# Prefix of columns for validation records only.
OF_VALIDATION = "validate_"
OF_WINDOWS = {*WINDOW_OPTIONS, *(OF_VALIDATION + name for name in WINDOW_OPTIONS)}
COLUMNS = {"id", "cell", "bounds", *FILES, *OPTIONS, *OF_WINDOWS}
# Columns of the dataset itself, by their whole names.
RESERVED = re.compile(
    r"error( code)?|samples|answer|certified|proved gap|at bound|warnings|warning codes|seconds"
    r"|factor bytes|pack|odd|weakest|SOC shift.*|capacity ratio.*|loaded voltage.*|total R.*"
    r"|voltage lag.*|sampling( evidence)?|aged .*|record throughput \[A\.h\]"
    r"|inputs sha256|fingerprint|duration \[s\]|capacity \[A\.h\]|temperature \[degC\]|initial SOC"
    r"|(validation |tables |held-out )?(RMSE|max error).* \[V\]|tables at SOC"
    r"|((tables )?(R|C|tau)\d \[\w+\]|gamma)( low| high)?"
)


def read_manifest(
    path: str | Path,
    defaults: Options | None = None,
    addresses: Iterable[str] = (),
    problems: list[str] | None = None,
) -> tuple[list[FleetCell], tuple[str, ...]]:
    """The cells of a manifest, and the names of the columns that are copied to their rows.

    A `.csv` or `.parquet` table has one row per cell; a `.toml` file has a table `[[cell]]` for
    each, and `[defaults]` for all. For a folder, each folder in it is a cell, and the roles of its
    files are determined from them, as in a row without OCV tests and cell.

    Args:
        path: The manifest. Paths in it are relative to it and may be patterns.
        defaults: Values for empty entries of a row.
        addresses: Sources that its rows may read besides files: everything below these addresses,
            such as `s3://bucket/logs`. A manifest in a store reads below its own folder there, and
            no files of this machine.
        problems: Collects the problems of rows, one per line; without it the first is raised.

    Raises `InputError` if the manifest cannot be used; unusable files are in each cell's `missing`.
    """
    source = located(path)
    if source.is_dir():
        names = sorted(item.name for item in source.iterdir() if item.is_dir())
        rows = [{"id": name, "records": [f"{glob.escape(name)}/*"]} for name in names]
        cells = [fleet_cell_from_row({**(defaults or {}), **row}, source) for row in rows]
        if not cells:
            raise InputError(
                f"{source}: has no subfolders; make one for each cell, or give a manifest"
            )
        return cells, ()
    rows, manifest_defaults = _rows(source)
    given = _filled({**(defaults or {}), **manifest_defaults})
    allowed = [*addresses, *([] if isinstance(source, Path) else [str(source.parent)])]
    faults = [] if problems is None else problems
    cells, row_of = [], dict[str, int]()
    for number, row in enumerate(rows, 2 if source.suffix.lower() != ".toml" else 1):
        where = f"{source.name}: row {number}"
        cell = fleet_cell_from_row(given | _filled(row), source.parent, where, faults)
        faults += _unconfined(cell, allowed, source.name)
        if row_of.setdefault(cell.id, number) == number:
            cells.append(cell)
        elif cell.id:
            first = f"{cut(cell.id, LONGEST_NAME)!r} occurs twice, first in row {row_of[cell.id]}"
            faults.append(f"{where}: the id {first}; give each row its own")
    if faults and problems is None:
        more = f"; `dry_run` lists {len(faults) - 1} more" if len(faults) > 1 else ""
        raise InputError(faults[0] + more)
    if not cells:
        raise InputError(f"{source}: has no cells; add a row for each")
    return cells, tuple(dict.fromkeys(name for cell in cells for name in cell.carried))


def _unconfined(cell: FleetCell, allowed: list[str], where: str) -> Iterator[str]:
    """Faults for addresses of a cell that are not allowed: another person's manifest could query
    servers that only this machine reaches."""
    roots = tuple(address.rstrip("/") + "/" for address in allowed)
    for address in filter(is_address, cell.files):
        # fsspec chains addresses with ::, and servers resolve escaped characters.
        is_plain = "::" not in address and ".." not in re.split(r"[/\\]", unquote(address))
        if not (is_plain and address.startswith(roots)):
            yield (
                f"{where}: {cut(cell.id, LONGEST_NAME)} reads {cut(address, LONGEST_NAME)}, "
                "which is not below an address that you allowed; if you trust the manifest, "
                "allow it with `addresses`, as in s3://bucket/logs"
            )


def distinct(cells: Iterable[FleetCell]) -> Iterator[FleetCell]:
    """The cells; raises `InputError` if two have the same id, because their rows could not be
    distinguished."""
    seen: set[str] = set()
    for cell in cells:
        if cell.id in seen:
            raise InputError(f"the id {cell.id!r} occurs twice; give each row its own")
        seen.add(cell.id)
        yield cell


def _rows(path: Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """The rows of a manifest as written, and its own defaults."""
    suffix = path.suffix.lower()
    if isinstance(path, Path) and path.exists() and not path.is_file():
        raise InputError(f"{path}: is a pipe or a device; write the manifest to a file")
    try:
        if suffix == ".toml":
            document = tomllib.loads(path.read_text(encoding="utf-8"))
            defaults, rows = document.pop("defaults", {}), document.pop("cell", [])
            tables = [defaults, *rows] if isinstance(rows, list) else [None]
            if document or not all(isinstance(table, dict) for table in tables):
                raise InputError(
                    f"{path}: must contain [[cell]] tables and [defaults]; it contains "
                    f"{listed(document) or 'them in another form'}"
                )
            return rows, defaults
        content = path.read_bytes()
        with naming(str(path)):
            if suffix in (".parquet", ".pq"):
                frame = pl.DataFrame(PARQUET.read(content, {}).columns)
            else:
                frame = pl.read_csv(
                    # As text: Polars would unpack a doubly compressed file without a limit.
                    io.StringIO(unzipped(content).decode("utf-8")),
                    infer_schema_length=None,
                    schema_overrides={"id": pl.String},
                    try_parse_dates=True,
                )
            require_room(frame.height * (ROW_BYTES + VALUE_BYTES * frame.width), content)
        return frame.to_dicts(), {}
    except (OSError, ValueError, pl.exceptions.PolarsError) as problem:
        if isinstance(problem, InputError):
            raise
        reason = cut(getattr(problem, "strerror", None) or toml_reason(problem), LONGEST_NAME)
        raise InputError(
            f"{path}: cannot be read ({reason}); give a table in CSV, Parquet or TOML with a row "
            "for each cell"
        ) from problem


def _filled(row: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a row by the names of columns, without those it leaves empty."""
    renamed = {ALIKE.get(name, name): value for name, value in row.items()}
    return {
        name: value
        for name, value in renamed.items()
        if value is not None and not (isinstance(value, str | list) and not value)
    }


def fleet_cell_from_row(
    row: Options, folder: Path = Path(), where: str = "row", problems: list[str] | None = None
) -> FleetCell:
    """A cell from a row's values by their names; unknown columns are copied.

    Paths are relative to `folder`. `where` names the row in messages; `problems` collects them, one
    per line. Without it, raises `InputError` if a value cannot be used.
    """
    row, faults = _filled(row), [] if problems is None else problems
    name = str(row.get("id", ""))
    if not name.strip():
        faults.append(f"{where}: no id; give each cell its own")
    else:
        where = f"{where} ({cut(name, LONGEST_NAME)})"
    if name in (".", "..") or "/" in name or "\\" in name:
        faults.append(
            f"{where}: an id is the name of a folder too; write one without / and \\, not . or .."
        )
    if name.startswith(FORMULA):
        faults.append(
            f"{where}: spreadsheets take this id for a formula; begin it with a letter or a digit"
        )
    carried = {name: row[name] for name in row if name not in COLUMNS and name != "problem"}
    taken = listed([name for name in carried if RESERVED.fullmatch(name)])
    if taken:
        faults.append(f"{where}: the dataset has its own {taken}; rename the column")
    missing: list[str] = []
    records, ocv, validate, models, bounds = (
        tuple(_files_of(row.get(column), folder, missing, faults, f"{where}: `{column}`"))
        for column in (*FILES, "cell", "bounds")
    )
    if not row.get("records") and "problem" not in row:
        faults.append(f"{where}: no record; give files in the column records")
    windows = [_window(row, where, faults, whose) for whose in ("", OF_VALIDATION)]
    if faults and problems is None:
        raise InputError("\n".join(faults))
    return FleetCell(
        id=name,
        records=records,
        ocv=ocv,
        validate=validate,
        cell=next(iter(models), None),
        bounds=next(iter(bounds), None),
        window=windows[0],
        validate_window=windows[1],
        options={option: row[option] for option in OPTIONS if option in row},
        carried=carried,
        missing=tuple(missing),
        problem=row.get("problem"),
    )


def _window(row: Mapping[str, Any], where: str, faults: list[str], whose: str) -> dict[str, Any]:
    values = {}
    for option, (name, parse, example) in WINDOW_OPTIONS.items():
        asked = whose + option
        if asked not in row:
            continue
        value = row[asked]
        text = ",".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
        try:
            values[name] = parse(text.removesuffix(".0") if parse is int else text)
        except ValueError:
            shown = cut(text, LONGEST_NAME)
            faults.append(f"{where}: `{asked}` {shown!r}: write it like {example}")
    return values


def _files_of(
    value: Any, folder: Path, missing: list[str], faults: list[str], where: str
) -> Iterator[str]:
    """The files named by a column, those of a pattern in order of name; missing ones are noted."""
    if value is None:
        return
    texts = value.split(SEPARATOR) if isinstance(value, str) else value
    texts = [texts] if isinstance(texts, Path) else texts
    if not isinstance(texts, list | tuple) or not all(isinstance(t, str | Path) for t in texts):
        faults.append(f"{where} {cut(str(value), LONGEST_NAME)!r}: write names of files")
        return
    for text in texts:
        pattern = str(text).strip()
        if is_address(pattern):
            yield pattern
            continue
        if not isinstance(folder, Path):
            yield from _stored(pattern, folder, missing, faults, where)
            continue
        paths = [str(folder / pattern)]
        if not (folder / pattern).exists():
            # The folder's own name is not a pattern.
            inside = glob.glob(pattern, root_dir=folder, recursive=True)
            paths = sorted(str(folder / name) for name in inside)
        # Reading from a pipe may never end; folders are rejected by their reader.
        odd = [path for path in paths if not (os.path.isfile(path) or os.path.isdir(path))]
        missing += [f"{path} is a pipe or a device" for path in odd]
        missing += [] if paths else [f"{pattern} does not exist"]
        yield from (path for path in paths if path not in odd)


def _stored(
    pattern: str, folder: Any, missing: list[str], faults: list[str], where: str
) -> Iterator[str]:
    """Files matching a pattern beside a manifest in a store; whether a single file exists is left
    to its reader.
    """
    if pattern.startswith(("/", "~")) or ".." in re.split(r"[/\\]", pattern):
        faults.append(
            f"{where} {cut(pattern, LONGEST_NAME)!r}: a manifest in a store names what is below "
            "its own folder; write it without .. and a leading /"
        )
        return
    paths = [folder / pattern]
    if glob.has_magic(pattern):
        paths = sorted(folder.glob(pattern), key=str)
        missing += [] if paths else [f"{pattern} does not exist"]
    yield from map(str, paths)
