"""Every registered reader keeps the same promises."""

import doctest
import importlib
import io

import pytest

from barnax.errors import InputError
from barnax.records.readers import READERS, read_table

from .synthetic_records import pulse_frame, workbook


def contents():
    """One good file for each reader, by its name."""
    frame = pulse_frame(40)
    parquet = io.BytesIO()
    frame.write_parquet(parquet)
    return {
        "Parquet table": parquet.getvalue(),
        "spreadsheet workbook": workbook({"data": [frame.columns, *map(list, frame.rows())]}),
        "delimited text": frame.write_csv().encode(),
    }


def test_every_reader_is_tried_here():
    assert {reader.name for reader in READERS} == set(contents())


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_a_reader_is_the_first_to_recognize_its_own_content(reader):
    content = contents()[reader.name]
    assert next(other for other in READERS if other.recognizes(content)) is reader


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_a_reader_gives_header_cells_and_rows(reader):
    table = reader.read(contents()[reader.name], "cell")
    assert table.header == ("Test Time / s", "Current / A", "Voltage / V")
    assert [len(column) for column in table.columns] == [40, 40, 40]
    assert list(table.row) == list(range(2, 42))


@pytest.mark.parametrize("name", ["Parquet table", "spreadsheet workbook"])
def test_a_file_cut_anywhere_is_refused_and_never_crashes(name):
    content = contents()[name]
    for length in range(8, len(content) - 1, 97):
        with pytest.raises(InputError):
            read_table(content[:length], "cell")


@pytest.mark.parametrize(
    "module", ["read", "rests", "limits", "readers.thrift", "readers.workbook_xml"]
)
def test_the_examples_run(module):
    assert doctest.testmod(importlib.import_module(f"barnax.records.{module}")).failed == 0
