"""A small file that would take all memory is refused before it takes any."""

import gzip
import io
import re
import struct
import sys
import tracemalloc
import zipfile
import zlib

import numpy as np
import polars as pl
import pytest

from barnax import InputError, read_record
from barnax.records.readers import content as bytes_of
from helpers.records import parquet, pulse_frame, refusal, sheet, zipped

# In place of 2 GB, so that a bomb of a test is no bomb.
LIMIT = 20_000_000
CSV = pulse_frame(40).write_csv().encode()


def lying(archive: bytes) -> bytes:
    """The archive of one file, which says in both of its places that it is of 100 bytes."""
    size = struct.pack("<I", len(CSV) + 2 * LIMIT)
    assert archive.count(size) == 2
    return archive.replace(size, struct.pack("<I", 100))


def with_cell(reference: str, content: str = "<v>1</v>", kind: str = "n", times: int = 1) -> bytes:
    """A workbook of a record with cells more, below or beside it."""
    source = zipfile.ZipFile(io.BytesIO(sheet(pulse_frame(40))))
    cells = f'<row><c r="{reference}" t="{kind}">{content}</c></row>' * times
    parts = {name: source.read(name).decode() for name in source.namelist()}
    end = "</sheetData>"
    return zipped({name: text.replace(end, cells + end) for name, text in parts.items()})


def numbers(rows: int) -> pl.DataFrame:
    return pl.DataFrame({name: np.zeros(rows) for name in pulse_frame(10).columns})


TOO_LONG = CSV + b"1" * (2 * LIMIT)


def matlab(numbers: int) -> bytes:
    """A compressed MATLAB file of a vector of zeros."""
    packer, piece = zlib.compressobj(), bytes(1_000_000)
    body = struct.pack("<8I", 6, 8, 6, 0, 5, 8, numbers, 1) + struct.pack("<2I4s4x", 1, 4, b"time")
    whole = struct.pack("<2I", 14, len(body) + 8 + 8 * numbers) + body
    parts = [packer.compress(whole + struct.pack("<2I", 9, 8 * numbers))]
    parts += [packer.compress(piece) for _ in range(8 * numbers // len(piece))]
    packed = b"".join([*parts, packer.flush()])
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM"
    return head + struct.pack("<2I", 15, len(packed)) + packed


BOMBS = {
    "gzip": lambda: gzip.compress(TOO_LONG),
    "gzip of members": lambda: gzip.compress(CSV) + gzip.compress(bytes(LIMIT)) * 2,
    "zip": lambda: zipped({"cell.csv": TOO_LONG}),
    "zip that lies": lambda: lying(zipped({"cell.csv": TOO_LONG})),
    "ndax": lambda: zipped({"VersionInfo.xml": b"<root/>", "data.ndc": bytes(2 * LIMIT)}),
    "rows": lambda: gzip.compress(CSV + b"1,1,1\n" * (LIMIT // 40)),
    "columns": lambda: gzip.compress(b"a," * 1000 + b"\n" + b"1\n" * 2000),
    "Parquet": lambda: parquet(numbers(LIMIT // 40)),
}
TRIED = {
    "MATLAB": lambda: matlab(60_000_000),
    "far cell": lambda: with_cell("XFD1048576"),
    "texts": lambda: parquet(
        pulse_frame(40).with_columns(
            pl.Series("Note", [f"{row}{'x' * (LIMIT // 2)}" for row in range(40)])
        ),
        row_group_size=4,
    ),
}


@pytest.mark.parametrize("kind", BOMBS)
def test_what_unpacks_to_too_much_is_refused_before_it_is_kept(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(bytes_of, "LARGEST_FILE", LIMIT)
    path = tmp_path / "cell.csv"
    path.write_bytes(BOMBS[kind]())
    tracemalloc.start()
    try:
        with pytest.raises(InputError) as caught:
            read_record(path)
        # What stays under the limit, as text, is unpacked before its rows are counted.
        assert tracemalloc.get_traced_memory()[1] < LIMIT
    finally:
        tracemalloc.stop()
    assert re.fullmatch(
        r"cell\.csv: its [\d,]+ bytes need more than the limit of 0\.02 GB of memory; give a part "
        r"of the record, or fewer columns, as CSV\.",
        str(caught.value),
    )


@pytest.mark.skipif(sys.platform != "linux", reason="no other system limits a process's memory")
@pytest.mark.parametrize(
    "kind",
    ["far cell", *(pytest.param(each, marks=pytest.mark.slow) for each in ("MATLAB", "texts"))],
)
def test_what_takes_too_much_in_a_library_is_refused_before_it_does(tmp_path, monkeypatch, kind):
    # The library itself needs some.
    monkeypatch.setattr(bytes_of, "LARGEST_FILE", 10 * LIMIT)
    said = refusal(tmp_path, TRIED[kind]())
    assert "bytes need more than the limit of 0.2 GB of memory, or are dam" in said


def test_a_cell_apart_within_the_limit_is_read(tmp_path):
    assert "row 60: 'Test Time / s' contains nothing" in refusal(
        tmp_path, with_cell("F60"), "cell.xlsx"
    )


def test_a_line_of_a_million_letters_is_no_row(tmp_path):
    assert "row 42 has more than 1,000,000 letters" in refusal(tmp_path, CSV + b"1" * 2_000_000)
