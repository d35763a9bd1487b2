"""Binary formats that a library reads: Parquet, Neware's, and two with packages of an extra.

Adapters for what these libraries need and must not do: open files, and print. fastnda takes file
names only, so the content goes through a temporary file. galvani is under the GPL: users who need
.mpr files install it, and it is loaded for them only.
"""

import io
import itertools
import logging
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from logging.handlers import BufferingHandler
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Int

from ...errors import InputError, installing, reason_of
from ..table import Reader, Table
from .content import NUMBER_BYTES, refusing, require_room, require_room_to_unzip, require_trial

Columns = Mapping[str, Any]
# This many counts at equal distances are those of records, with this many bytes; the next one may
# be lost.
_IN_A_ROW, _RECORD_BYTES, _NEXT = 5, range(20, 256), (2, 6)
ZIP = b"PK\x03\x04"


@contextmanager
def _as_file(content: bytes, suffix: str) -> Iterator[str]:
    """The path of a temporary file with this content, for libraries that open files themselves."""
    with tempfile.TemporaryDirectory() as folder:
        with tempfile.NamedTemporaryFile(suffix=suffix, dir=folder, delete=False) as file:
            file.write(content)
        yield file.name


@contextmanager
def quieted(library: str) -> Iterator[list[logging.LogRecord]]:
    """Keep messages of a library from the terminal."""
    log = logging.getLogger(library)
    handler = BufferingHandler(10_000)
    was_propagating, log.propagate = log.propagate, False
    log.addHandler(handler)
    try:
        yield handler.buffer
    finally:
        log.removeHandler(handler)
        log.propagate = was_propagating


def _read_parquet(content: bytes, _: Mapping[str, str]) -> Table:
    damaged = "the Parquet file is damaged or cut short"
    try:
        scan = pl.scan_parquet(io.BytesIO(content))
        rows, types = scan.select(pl.len()).collect().item(), scan.collect_schema().dtypes()
        require_room(NUMBER_BYTES * rows * len(types), content)
        if not all(kind.is_numeric() or kind.is_temporal() or kind == pl.Boolean for kind in types):
            # Texts and lists have any length.
            require_trial("import io, polars; polars.read_parquet(io.BytesIO(content))", content)
        return Table.of(pl.read_parquet(io.BytesIO(content)))
    except pl.exceptions.PanicException as error:
        # On some files damaged in the middle, Polars panics with a message for its developers.
        raise InputError(f"{damaged}; copy or export it again.") from error
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InputError(f"{damaged} ({reason_of(error)}); copy or export it again.") from error


PARQUET = Reader("Parquet table", lambda content: content.startswith(b"PAR1"), _read_parquet)


def _is_neware(content: bytes) -> bool:
    """An .nda file begins with the maker's name; an .ndax file is a zip archive of .ndc files."""
    return content.startswith(b"NEWARE") or (content.startswith(ZIP) and b".ndc" in content)


def _stated_length(content: bytes) -> int:
    """The length of an .nda file according to its header: the end of the last of its parts.

    The header has offsets and lengths of the parts, with 64 bits each from version 129 on, and with
    32 before, where each part begins at the end of the previous one. Zero if it has none.
    """
    is_new = content[14:15] >= b"\x81"
    kind, first, last = ("<u8", 82, 226) if is_new else ("<u4", 16, 72)
    size = 2 * np.dtype(kind).itemsize
    head = content[first : last + size]
    parts = np.frombuffer(head[: len(head) // size * size], kind).reshape(-1, 2)
    ends = [(int(begin), int(begin) + int(length)) for begin, length in parts if begin]
    if not is_new and any(one[1] != other[0] for one, other in itertools.pairwise(ends)):
        return 0
    return max((end for _, end in ends), default=0)


def _lost_row(content: bytes, counts: Int[np.ndarray, "rows"]) -> int | None:
    """The first row that is missing according to the file's counter, if any.

    Nothing after an excess or lack of bytes is read, but the counter continues there at equal
    distances.
    """
    steps = np.flatnonzero(np.diff(counts) != 1)
    if len(steps):
        return int(counts[steps[0]]) + 1

    def positions(count: int) -> set[int]:
        return {at.start() for at in re.finditer(re.escape(count.to_bytes(4, "little")), content)}

    def runs(count: int, lengths: Iterable[int]) -> Iterator[tuple[int, int]]:
        """Where this count and the next ones are at equal distances, and the distance."""
        start, *others = (positions(count + k) for k in range(_IN_A_ROW))
        for length, at in itertools.product(lengths, start):
            if all(at + k * length in other for k, other in enumerate(others, 1)):
                yield length, at

    first, last = int(counts[0]), int(counts[-1])
    length, _ = min(runs(max(last + 1 - _IN_A_ROW, first), _RECORD_BYTES), default=(0, 0))
    # A clock in seconds counts too, after the counter in its record.
    _, begin = min(runs(first, [length] if length else []), default=(0, None))
    if begin is None:
        return None
    ends = [at for at in positions(last) if (at - begin) % length == 0]
    end = max(ends, default=begin + (last - first) * length)
    later = itertools.chain.from_iterable(runs(last + k, [length]) for k in _NEXT)
    return last + 1 if any(at > end for _, at in later) else None


def _read_neware(content: bytes, _: Mapping[str, str]) -> Table:
    # Only this format needs it, and it takes long to load.
    import fastnda

    suffix = ".ndax" if content.startswith(ZIP) else ".nda"
    if suffix == ".nda" and (length := _stated_length(content)) > len(content):
        raise InputError(
            f"the .nda file is cut short: it has {len(content):,} bytes of {length:,}; "
            "copy it again from the tester's computer."
        )
    damaged = (
        f"the {suffix} file is damaged, cut short or of an unknown version; export the "
        "record as CSV from BTSDA."
    )
    with refusing(damaged):
        if suffix == ".ndax":
            require_room_to_unzip(content)
        with _as_file(content, suffix) as path, quieted("fastnda") as logged:
            frame = fastnda.read(path, cycle_mode="auto")
    if not frame.height:
        raise InputError("this Neware file has no samples; give another.")
    if lost := _lost_row(content, frame["index"].cast(pl.Int64).to_numpy()):
        raise InputError(
            f"the {suffix} file is damaged: by its own counter of rows, some are missing "
            f"from row {lost} on; copy it again from the tester's computer."
        )
    texts = frame.with_columns(pl.col(pl.Categorical).cast(pl.String))
    table = Table.of(texts, has_fixed_units=True)
    is_damaged = any(record.exc_info for record in logged)
    return table.leaving_out("damaged") if is_damaged else table


NEWARE = Reader("Neware .nda or .ndax", _is_neware, _read_neware)


def _by_package(
    name: str, start: bytes, extra: str, export: str, parse: Callable[[bytes], Columns]
):
    """A reader of content that has `start` near its beginning, by the package of an extra."""

    def read(content: bytes, _: Mapping[str, str]) -> Table:
        article = "an" if name[0] in "AEIOU" else "a"
        with refusing(
            f"the {name} file is damaged, cut short or of an unknown version; export "
            f"the record as {export}.",
            f"this is {article} {name} file; install the package that reads it with "
            f"{installing(extra)}, or export the record as {export}.",
        ):
            columns = {name: np.array(values) for name, values in parse(content).items()}
        return Table.of(pl.DataFrame(columns), has_fixed_units=True)

    return Reader(name, lambda content: start in content[:64], read)


def _parse_mpr(content: bytes) -> Columns:
    from galvani.BioLogic import MPRfile

    data = MPRfile(io.BytesIO(content)).data
    return {name: data[name] for name in data.dtype.names or ()}


def _parse_res(content: bytes) -> Columns:
    from access_parser import AccessParser

    with _as_file(content, ".res") as path:
        table = AccessParser(path).parse_table("Channel_Normal_Table")
    # Rows are not stored in order.
    order = np.argsort(table["Data_Point"], kind="stable")
    return {name: np.array(values)[order] for name, values in table.items()}


BIOLOGIC_MPR = _by_package(
    "BioLogic .mpr",
    b"BIO-LOGIC MODULAR FILE",
    "biologic",
    "text (.mpt) from EC-Lab or BT-Lab",
    _parse_mpr,
)
ARBIN_RES = _by_package(
    "Arbin .res",
    b"Standard Jet DB",
    "arbin",
    "a workbook or CSV from Arbin's Data Watcher",
    _parse_res,
)
