"""MATLAB files of versions 5 to 7.3: structures of time, current and voltage.

A structure with such fields is a record, wherever it is: Kollmeyer's `meas`, Plett's
`DYNData.script1`, or the workspace itself. The cycles of NASA's Prognostics Center are joined by
the dates at which they began. scipy reads versions 5 to 7; 7.3 is HDF5 and needs h5py, an extra.
"""

import datetime
import io
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl

from ...errors import LONGEST_CELL, InputError, cut, installing, printable
from ...notices import Notice
from ..cell_values import DAY_S
from ..columns import Header
from ..table import Reader, Table
from .content import refusing, require_trial

Struct = dict[str, Any]

_HDF5 = b"\x89HDF\r\n\x1a\n"
_OCTAVE = b"# Created by Octave"
_MARKS = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file", _HDF5, _OCTAVE)
_READS_5 = "import io, scipy.io; scipy.io.loadmat(io.BytesIO(content))"
_READS_73 = """
import io, h5py
def read(name, found):
    if isinstance(found, h5py.Dataset):
        found[()]
h5py.File(io.BytesIO(content)).visititems(read)
"""
_DEEPEST, _MAX_NAMED = 8, 12
# Plett's files have the test at its temperature first, then two calibrations at 25 degC.
_SCRIPTS = re.compile(r"(?:DYNData|OCVData)\.script(\d)")


def _read(content: bytes, given: Mapping[str, str]) -> Table:
    if content.startswith(_OCTAVE):
        raise InputError("Octave's text format; save it with '-v7', or as CSV.")
    if b"pandas_type" in content:
        raise InputError(
            "an HDF5 file of pandas, not of MATLAB; write the frame with to_parquet or "
            "to_csv instead."
        )
    is_hdf5 = content.startswith((_MARKS[1], _HDF5))
    require_trial(_READS_73 if is_hdf5 else _READS_5, content)
    with refusing(
        "the MATLAB file is damaged or cut short; copy or save it again.",
        "this is a MATLAB file of version 7.3; install the package that reads it with "
        f"{installing('matlab')}, or save it with '-v7'.",
    ):
        tree = _of_hdf5(content) if is_hdf5 else _of_matlab_5(content)
    structs = dict(_structs(tree))
    if chosen := _chosen(structs, given):
        return Table.of(_frame(chosen))
    columns = {path: _columns(struct) for path, struct in structs.items()}
    headers = {path: Header(tuple(arrays), given) for path, arrays in columns.items()}
    chosen = [path for path, header in headers.items() if header.is_record]
    chosen = chosen or [path for path, header in headers.items() if header.is_ocv_table]
    records = {path: columns[path] for path in chosen}
    for path in structs:
        is_cycle = re.compile(rf"{re.escape(path)}\.cycle\(.*\)\.data").fullmatch
        if records and all(map(is_cycle, records)) and (table := _joined(structs, records, path)):
            return table
    scripts = [path for path in records if _SCRIPTS.fullmatch(path)]
    if len(records) == 1 or (scripts and len(scripts) == len(records)):
        first, *others = sorted(records)
        table = Table.of(_frame(records[first]))
        unused = ", ".join(others)
        return table.leaving_out("structs", used=first, unused=unused) if others else table
    raise InputError(_refusal(structs, [*records]))


def _of_matlab_5(content: bytes) -> Struct:
    from scipy.io import loadmat

    # Objects of MATLAB's own classes come as bytes, and no code in the file is run.
    tree = loadmat(io.BytesIO(content), simplify_cells=True)
    return {name: value for name, value in tree.items() if not name.startswith("__")}


def _of_hdf5(content: bytes) -> Struct:
    import h5py

    values: dict[Any, Any] = {}

    def value_of(item: Any, depth: int) -> Any:
        # An object with several references is read once; it may refer to itself.
        if item.id not in values:
            values[item.id] = None
            values[item.id] = read(item, depth) if depth <= _DEEPEST else None
        return values[item.id]

    def read(item: Any, depth: int) -> Any:
        if isinstance(item, h5py.Group):
            # Other files are not opened.
            fields = {
                name: value_of(item[name], depth + 1)
                for name in item
                if name != "#refs#" and isinstance(item.get(name, getlink=True), h5py.HardLink)
            }
            held = [member for member in item.values() if isinstance(member, h5py.Dataset)]
            are_links = held and all(h5py.check_ref_dtype(dataset.dtype) for dataset in held)
            if are_links and not any("MATLAB_class" in dataset.attrs for dataset in held):
                # In an array of structures each field is an array.
                return [
                    dict(zip(fields, row, strict=True))
                    for row in zip(*fields.values(), strict=False)
                ]
            return fields
        if item.external or item.is_virtual:
            raise InputError("refers to other files; save it as one file.")
        if h5py.check_ref_dtype(item.dtype):
            links = item[()].ravel()
            return [value_of(item.file[link], depth + 1) for link in links if link]
        if item.attrs.get("MATLAB_class") == b"char":
            return "".join(map(chr, item[()].ravel().tolist()))
        return item[()]

    with h5py.File(io.BytesIO(content), "r") as opened:
        return value_of(opened, 0)


def _structs(
    tree: Any, path: str = "", depth: int = 0, seen: set[int] | None = None
) -> Iterator[tuple[str, Struct]]:
    """Every structure, once, with its path in MATLAB's notation: `B0005.cycle(3).data`."""
    seen = set() if seen is None else seen
    if depth > _DEEPEST or id(tree) in seen:
        return
    seen.add(id(tree))
    if isinstance(tree, dict):
        yield path, tree
        for name, value in tree.items():
            yield from _structs(value, f"{path}.{name}".lstrip("."), depth + 1, seen)
    elif isinstance(tree, list) or (isinstance(tree, np.ndarray) and tree.dtype == object):
        for number, part in enumerate(np.ravel(tree) if isinstance(tree, np.ndarray) else tree, 1):
            yield from _structs(part, f"{path}({number})", depth + 1, seen)


def _is_column(value: Any) -> bool:
    is_array = isinstance(value, np.ndarray) and value.dtype.kind in "iufb"
    return is_array and value.size > 1 and value.size == max(value.shape)


def _columns(struct: Struct) -> dict[str, np.ndarray]:
    """A structure's columns of numbers that have its most common length."""
    columns = {name: np.ravel(value) for name, value in struct.items() if _is_column(value)}
    usual = Counter(map(len, columns.values())).most_common(1)
    return {name: value for name, value in columns.items() if len(value) == usual[0][0]}


def _chosen(structs: Mapping[str, Struct], given: Mapping[str, str]) -> dict[str, np.ndarray]:
    """The columns that the user names by their paths, and those next to the first of them."""
    chosen, beside = {}, {}
    for text in given.values():
        for name in (text, text.rpartition(":")[0]):
            path, _, field = name.rpartition(".")
            value: Any = structs.get(path, {}).get(field)
            if path and _is_column(value):
                chosen[name] = np.ravel(value)
                beside = beside or _columns(structs[path])
                break
    taken = {name.rpartition(".")[2] for name in chosen}
    length = len(next(iter(chosen.values()), ()))
    if any(len(value) != length for value in chosen.values()):
        return {}
    others = {name: value for name, value in beside.items() if name not in taken}
    return chosen | {name: value for name, value in others.items() if len(value) == length}


def _frame(columns: Mapping[str, np.ndarray]) -> pl.DataFrame:
    return pl.DataFrame({name: np.asarray(value, float) for name, value in columns.items()})


def _start_s(cycle: Struct) -> float:
    """The start of one of NASA's cycles, by its date of six numbers; zero without one."""
    date = np.ravel(cycle.get("time", ()))
    if len(date) != 6 or date.dtype.kind not in "iuf" or not np.isfinite(date).all():
        return 0.0
    try:
        day = datetime.date(*map(int, date[:3])).toordinal()
    except ValueError:
        return 0.0
    return day * DAY_S + float(date[3] * 3600 + date[4] * 60 + date[5])


def _joined(
    structs: Mapping[str, Struct], records: Mapping[str, dict[str, np.ndarray]], path: str
) -> Table | None:
    """NASA's cycles one after another, each at its own start; None if one has no date."""
    cycles = {name: structs[name.removesuffix(".data")] for name in records}
    starts_s = {name: _start_s(cycle) for name, cycle in cycles.items()}
    if not all(starts_s.values()):
        return None
    shared = [name for name in next(iter(records.values())) if name != "Time"]
    frames = []
    for name in sorted(records, key=lambda name: starts_s[name]):
        begun_s = starts_s[name] - min(starts_s.values())
        number = float(re.findall(r"\((\d+)\)", name)[-1])
        word = str(cycles[name].get("type", ""))
        added = {"cycle": pl.lit(number), "state": pl.lit(word)}
        frames.append(_frame(records[name]).with_columns(pl.col("Time") + begun_s, **added))
    shared = [name for name in shared if all(name in frame.columns for frame in frames)]
    whole = pl.concat([frame.select("Time", "cycle", *shared, "state") for frame in frames])
    note = Notice("columns.joined-cycles", {"cycles": len(records), "path": f"{path}.cycle"})
    return Table.of(whole, notes=(note,))


def _refusal(structs: Mapping[str, Struct], records: Sequence[str]) -> str:
    """Why no record is read, and what the file contains."""
    option = "`columns='time={0}NAME:s,current={0}NAME:A,voltage={0}NAME:V'`"
    if records:
        names = ", ".join(
            printable(cut(path or "the workspace", LONGEST_CELL)) for path in records[:_MAX_NAMED]
        )
        choose = option.format(f"{records[-1]}.") if records[-1] else "save one of them alone"
        return (
            f"a MATLAB file of {len(records)} records ({names}), but a record is of one "
            f"test; choose one by where its columns stand, {choose}."
        )
    held = [
        f"{path}.{name}".lstrip(".") + f" ({' x '.join(map(str, np.shape(value)))})"
        for path, struct in structs.items()
        for name, value in struct.items()
        if isinstance(value, np.ndarray) and value.size > 1
    ]
    named = printable(cut(", ".join(held[:_MAX_NAMED]), 1000)) or "no arrays of numbers"
    more = " ..." if len(held) > _MAX_NAMED else ""
    structure = "STRUCTURE." if any("." in name for name in held) else ""
    return (
        f"a MATLAB file without a structure of columns of one length for time, current and "
        f"voltage; it holds {named}{more}. Give the columns as {option.format(structure)}, or "
        "save them as vectors time, current and voltage, or a table of MATLAB's own by writetable."
    )


MATLAB = Reader("MATLAB .mat", lambda content: content.startswith(_MARKS), _read)
