"""Small files that ask for much are refused in bounded time and memory, by name."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from barnax.errors import InputError
from barnax.records import read, read_record
from barnax.records.readers import read_table, workbook_parts
from barnax.records.readers.parquet_claims import check_claims
from barnax.records.readers.thrift import Broken, read_struct

from .bombs import BOMBS, with_rows, with_texts
from .hostile import CURRENT, TIME, VOLTAGE
from .tiny_parquet import Claims, compact, tiny_parquet

READER = Path(__file__).with_name("read_under_limits.py")
# A crowded machine takes its time; without limits some of these took minutes.
MOST_SECONDS, MOST_MEMORY = 20, 1_500_000_000
LONG_ROWS, LONG_SECONDS, LONG_MEMORY = 10_000_000, 120, 4_000_000_000


def read_apart(folder: Path) -> dict[str, dict]:
    """What one process of little memory makes of every file in a folder, by its name."""
    if sys.platform != "linux":
        pytest.skip("a process's memory is limited on Linux alone")
    done = subprocess.run([sys.executable, READER, folder], capture_output=True, text=True)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, f"{lines[-1]['file']}: {done.stderr[-2000:]}"
    return {line["file"]: line for line in lines if "outcome" in line}


def test_a_bomb_is_refused_in_bounded_time_and_memory(tmp_path):
    for name, make in BOMBS.items():
        (tmp_path / name).write_bytes(make())
    outcomes = read_apart(tmp_path)
    assert set(outcomes) == set(BOMBS)
    for name, outcome in outcomes.items():
        assert outcome["outcome"].startswith(f"{name}: ")
        assert len(outcome["outcome"]) < 2000
        assert outcome["seconds"] < MOST_SECONDS, name
        assert outcome["memory"] < MOST_MEMORY, name


@pytest.mark.slow
def test_ten_million_rows_are_read(tmp_path):
    seconds = np.arange(float(LONG_ROWS))
    current_a = 2.0 * (seconds % 20 < 10) - 1.0
    voltage_v = np.round(3.7 + 0.05 * current_a, 4)
    frame = pl.DataFrame({TIME: seconds, CURRENT: current_a, VOLTAGE: voltage_v})
    frame.write_csv(tmp_path / "long.csv")
    frame.write_parquet(tmp_path / "long.parquet")
    for outcome in read_apart(tmp_path).values():
        assert outcome["outcome"] == "read"
        assert outcome["seconds"] < LONG_SECONDS
        assert outcome["memory"] < LONG_MEMORY


def test_true_claims_are_believed():
    table = read_table(tiny_parquet(Claims(rows=20, columns=4)), "cell")
    assert table.header == ("Test Time / s", "Current / A", "Voltage / V", "column 3")
    assert [column.to_list() for column in table.columns] == [[float(k)] * 20 for k in range(4)]


@pytest.mark.parametrize(
    "claims",
    [
        Claims(group_rows=19),
        Claims(group_rows=21),
        Claims(group_rows=-20),
        Claims(chunk_values=21),
        Claims(chunk_values=-1),
        Claims(page_values=19),
        Claims(page_values=2**31 - 1),
        Claims(page_values=-20),
        Claims(page_bytes=-1),
        Claims(page_kind=4),
        Claims(page_kind=3),
        Claims(page_kind=-1),
        Claims(page_offset=-1),
        Claims(page_offset=1_000_000),
        Claims(chunk_bytes=-1),
        Claims(chunk_bytes=1_000_000),
        Claims(chunk_bytes=1),
        Claims(type_length=-8),
        Claims(nesting=25),
    ],
)
def test_a_file_that_contradicts_itself_is_seen_through_before_it_is_read(claims):
    with pytest.raises(Broken):
        check_claims(tiny_parquet(claims), "cell")


@pytest.mark.parametrize(
    "claims", [Claims(), Claims(rows=1), Claims(columns=30), Claims(nesting=5)]
)
def test_a_file_that_does_not_is_not(claims):
    check_claims(tiny_parquet(claims), "cell")


def test_too_many_cells_are_refused_as_such():
    with pytest.raises(InputError, match="60000000 rows of 4 columns, more than the 200000000"):
        check_claims(tiny_parquet(Claims(rows=60_000_000, columns=4)), "cell")


@pytest.mark.parametrize("length", range(1, 60))
def test_a_structure_cut_anywhere_is_seen_through(length):
    content = compact({1: 7, 2: [b"ab", b"c"], 3: {1: -1, 4: [{1: 2**40}]}, 9: b"x" * 40})[1]
    assert read_struct(content, 0, len(content)) == (
        {1: 7, 2: [b"ab", b"c"], 3: {1: -1, 4: [{1: 2**40}]}, 9: b"x" * 40},
        len(content),
    )
    with pytest.raises(Broken):
        read_struct(content[:length], 0, min(length, len(content) - 1))


def test_a_part_that_unpacks_to_too_much_is_refused(monkeypatch):
    monkeypatch.setattr(workbook_parts, "LARGEST_UNPACKED", 1_000_000)
    with pytest.raises(InputError, match=r"cell: unpacks to more than 0\.001 GB"):
        read_table(with_rows(b" " * 1_000_000), "cell")


def test_texts_that_would_fill_the_memory_are_refused(monkeypatch):
    monkeypatch.setattr(workbook_parts, "MOST_TEXT", 100)
    with pytest.raises(InputError, match="cell: has 20 cells of text and texts of 10 letters"):
        read_table(with_texts(20, 10, claimed=1), "cell")


def test_a_device_without_end_is_refused(monkeypatch):
    zero = Path("/dev/zero")
    if not zero.exists():
        pytest.skip("no device gives zeros here")
    monkeypatch.setattr(read, "LARGEST_FILE", 1_000_000)
    with pytest.raises(InputError, match=r"zero: is larger than the 0\.001 GB that are read"):
        read_record(zero)
