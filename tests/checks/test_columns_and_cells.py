"""What a table lacks, what it calls otherwise, and cells that hold no number."""

import polars as pl
import pytest

from barnax.checks import check_file
from barnax.errors import InputError
from helpers.records import (
    CURRENT,
    TIME,
    VOLTAGE,
    changed,
    checked,
    counting,
    found,
    frame,
    workbook,
)


def findings(diagnosis, check):
    return [finding for finding in diagnosis.findings if finding.check == check]


@pytest.mark.parametrize("column", [TIME, CURRENT, VOLTAGE])
def test_a_missing_column_is_an_error_with_accepted_names(tmp_path, column):
    columns = found(checked(tmp_path, frame().drop(column)), "columns")
    assert (columns.severity, columns.row) == ("error", 1)
    assert f"'{column}'" in columns.remedy


@pytest.mark.parametrize(
    ("column", "other"),
    [
        (CURRENT, "Strom / A"),
        (VOLTAGE, "Spannung [V]"),
        (TIME, "Zeit(s)"),
        (CURRENT, "电流(A)"),
        (CURRENT, "Curent (A)"),
        (VOLTAGE, "Voltage of the pouch / V"),
    ],
)
def test_the_only_likely_name_is_pointed_to_and_its_values_are_looked_at(tmp_path, column, other):
    table = changed(frame(), VOLTAGE, 6.5, [99]).rename({column: other})
    diagnosis = checked(tmp_path, table)
    assert f"'{other}' is likely it" in found(diagnosis, "columns").what
    assert f"rename '{other}'" in found(diagnosis, "columns").remedy
    assert counting(diagnosis) == {"columns": "error", "voltage unit": "warning"}


def test_several_likely_names_are_listed(tmp_path):
    table = frame().rename({CURRENT: "Current (C-rate)"})
    table = table.with_columns(pl.lit(1.0).alias("Current set"))
    columns = found(checked(tmp_path, table), "columns")
    assert "likely: 'Current (C-rate)', 'Current set'" in columns.what


def test_the_unit_of_a_likely_name_is_used(tmp_path):
    table = frame().with_columns((pl.col(CURRENT) * 1000).alias("Strom [mA]")).drop(CURRENT)
    assert counting(checked(tmp_path, table)) == {"columns": "error"}


def test_a_missing_column_of_a_workbook_is_found_too(tmp_path):
    table = frame()[:50].drop(CURRENT)
    path = tmp_path / "cell.xlsx"
    path.write_bytes(workbook({"data": [table.columns, *map(list, table.rows())]}))
    assert "no column for the current" in found(check_file(path), "columns").what


def test_a_table_without_names_is_said_to_be_one(tmp_path):
    table = frame().rename({TIME: "0.0", CURRENT: "0.1", VOLTAGE: "3.7"})
    missing = findings(checked(tmp_path, table), "columns")
    assert len(missing) == 3
    assert all("holds numbers, not names" in finding.what for finding in missing)


def test_a_table_of_something_else_is_unreadable(tmp_path):
    table = pl.DataFrame({"name": ["a", "b"], "colour": ["red", "blue"]})
    with pytest.raises(InputError, match="no column for time, current, voltage"):
        checked(tmp_path, table)


def test_a_table_of_no_columns_is_unreadable(tmp_path):
    with pytest.raises(InputError):
        checked(tmp_path, pl.DataFrame(), name="cell.parquet")


@pytest.mark.parametrize("content", [b"", b"\x00\x01\x02" * 100, b"PAR1 cut short"])
def test_what_is_no_table_is_unreadable(tmp_path, content):
    (tmp_path / "cell.csv").write_bytes(content)
    with pytest.raises(InputError):
        check_file(tmp_path / "cell.csv")


def test_two_columns_of_one_used_name_are_a_warning(tmp_path):
    lines = frame()[:500].write_csv().splitlines()
    rows = [f"{line},{number}" for number, line in enumerate(lines)]
    rows[0] = f"{TIME},{CURRENT},{VOLTAGE},{VOLTAGE}"
    (tmp_path / "cell.csv").write_text("\n".join(rows))
    columns = found(check_file(tmp_path / "cell.csv"), "columns")
    assert columns.severity == "warning"
    assert f"2 columns are called '{VOLTAGE}'" in columns.what


def test_names_without_units_are_a_note_with_what_is_assumed(tmp_path):
    table = frame().rename({TIME: "time", CURRENT: "current", VOLTAGE: "voltage"})
    diagnosis = checked(tmp_path, table)
    assert diagnosis.is_clean
    assert "A for 'current'" in found(diagnosis, "columns").what


def test_a_row_of_units_is_told_from_other_words(tmp_path):
    units = pl.DataFrame({TIME: ["s"], CURRENT: ["A"], VOLTAGE: ["V"]})
    diagnosis = checked(tmp_path, pl.concat([units, frame().with_columns(pl.all().cast(str))]))
    assert counting(diagnosis) == {"cells": "error"}
    assert "holds no numbers but 's', 'A', 'V'" in found(diagnosis, "cells").what
    assert found(diagnosis, "cells").row == 2
    assert diagnosis.facts.samples == 19_680


@pytest.mark.parametrize(("cell", "quoted"), [("OVERFLOW", "'OVERFLOW'"), ("nan", "'nan'")])
def test_a_cell_without_a_number_is_quoted_with_its_row(tmp_path, cell, quoted):
    words = frame().with_columns(pl.all().cast(str))
    values = words[CURRENT].to_list()
    values[77] = cell
    diagnosis = checked(tmp_path, words.with_columns(pl.Series(CURRENT, values)))
    assert counting(diagnosis) == {"cells": "error"}
    assert found(diagnosis, "cells").row == 79
    assert quoted in found(diagnosis, "cells").what
    assert diagnosis.facts.samples == 19_679


def test_a_column_of_words_is_an_error_and_no_crash(tmp_path):
    diagnosis = checked(tmp_path, frame().with_columns(pl.lit("x").alias(CURRENT)))
    assert "plain numbers in A" in found(diagnosis, "cells").remedy
    assert diagnosis.facts is None


@pytest.mark.parametrize("lines", [0, 5, 9])
def test_too_few_samples_are_an_error_and_no_crash(tmp_path, lines):
    diagnosis = checked(tmp_path, frame()[:lines])
    assert counting(diagnosis) == {"reading": "error"}


@pytest.mark.parametrize("name", ["cell.xls", "cell.parquet"])
def test_a_suffix_that_lies_is_a_note(tmp_path, name):
    (tmp_path / name).write_text(frame().write_csv())
    diagnosis = check_file(tmp_path / name)
    assert diagnosis.is_clean
    assert "the content is text" in found(diagnosis, "format").what
