"""Workbooks of the old kind are read in a process of their own, whose end is an InputError."""

import subprocess
import sys

import numpy as np
import pytest

from barnax.errors import InputError
from barnax.records import read_record
from barnax.records.readers import old_workbook as reader
from barnax.records.readers import read_table

from .hostile import FRAME, damaged
from .old_workbooks import old_workbook
from .repeated import repeated
from .test_fuzz_readers import survive

GOOD = old_workbook(FRAME)


def test_an_old_workbook_is_read_as_the_same_record_as_text(tmp_path):
    (tmp_path / "cell.xls").write_bytes(GOOD)
    FRAME.write_csv(tmp_path / "cell.csv")
    old, text = (read_record(tmp_path / name) for name in ("cell.xls", "cell.csv"))
    for name in ("time_s", "current_a", "voltage_v", "row"):
        np.testing.assert_array_equal(getattr(old, name), getattr(text, name))


# A process each.
@pytest.mark.parametrize("examples", [3, pytest.param(100, marks=pytest.mark.slow)])
def test_damaged_old_workbooks(tmp_path, examples):
    repeated(examples, lambda content: survive(tmp_path, content), damaged([GOOD]))


def test_a_process_that_takes_too_long_is_given_up(monkeypatch):
    monkeypatch.setattr(reader, "MOST_SECONDS", 0.01)
    with pytest.raises(
        InputError, match=r"cell: the workbook is damaged .*not read within 0\.01 s"
    ):
        read_table(GOOD, "cell")


def test_no_process_is_an_error_that_says_so(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with pytest.raises(InputError, match="no process to read it in"):
        read_table(GOOD, "cell")


def test_a_file_beside_the_data_does_not_pass_for_a_library(tmp_path, monkeypatch):
    (tmp_path / "polars.py").write_text("raise SystemExit('not the library')")
    monkeypatch.chdir(tmp_path)
    assert len(read_table(GOOD, "cell").row) == FRAME.height


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited on Linux alone")
def test_the_process_has_no_more_memory_than_it_may_take():
    code = (
        "from barnax.records.readers.old_workbook import MOST_MEMORY, _limit_memory\n"
        "_limit_memory()\n"
        "bytearray(MOST_MEMORY)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "MemoryError" in done.stderr
