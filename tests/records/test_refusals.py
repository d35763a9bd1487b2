"""Each bad file has a message that names file, place, value and remedy; what is merely odd has
a warning that does. What `checks/test_findings.py` has the words of is not repeated here.

The words stand in `messages.txt`, written anew with BARNAX_WRITE_GOLDEN=1.
"""

import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from barnax import InputError, read_record
from helpers.golden import require_golden
from helpers.records import (
    CURRENT,
    TIME,
    VOLTAGE,
    arbin_rows,
    changed,
    logged,
    parquet,
    pulse_frame,
    read,
    refusal,
    sheet,
    workbook,
)

FRAME = pulse_frame()
ROWS = arbin_rows(FRAME)
SHORT = FRAME[:20]
HOURS = np.linspace(0, 20, 2000)


def csv(table):
    return table.write_csv().encode()


def bad_later_sheet():
    second = [ROWS[0], *ROWS[101:]]
    second[30] = [*second[30][:5], "fault", *second[30][6:]]
    return workbook({"Channel_1-001": ROWS[:101], "Channel_1-001_2": second})


REFUSED = {
    "nothing like a record": b"name,colour\na,red\nb,blue\n",
    "a letter": b"Dear Sir, hello\n\nI write, because, of, things\nYours, me\n",
    "an OCV table": b"SOC [-],OCV [V]\n0,3\n0.3,3.5\n0.6,3.7\n1,4.2\n",
    "an OCV table over the depth of discharge": b"DoD [-],OCV [V]\n0,3\n0.3,3.5\n0.6,3.7\n1,4.2\n",
    "a long header": b"<td>nothing</td> " * 500 + b"\n1\n",
    "nan": csv(changed(FRAME, VOLTAGE, np.nan, [40])),
    "an empty cell": parquet(changed(FRAME, CURRENT, np.nan, [7]).fill_nan(None)),
    "a row with a cell more": csv(FRAME).replace(b"\n4.0,", b"\n4.0,1,"),
    "rows with a cell more": csv(FRAME.select(FRAME[TIME].alias("t"), pl.all())).removeprefix(
        b"t,"
    ),
    "dates": csv(FRAME.with_columns(pl.lit("2020-01-01 00:00:00").alias(TIME))),
    "nothing": b"",
    "blank lines": b"\n\n  \n",
    "bytes": bytes(range(256)) * 20,
    "a picture": b"\x89PNG\r\n\x1a\n" + bytes(100),
    "an archive": b"PK\x03\x04" + bytes(100),
    "no text": b"\x01\x02\x03\x04 without a zero byte\n" * 10,
    "Parquet cut short": parquet(FRAME)[:-40],
    "a workbook cut short": workbook({"Channel_1-001": ROWS})[:-200],
    "an old workbook cut short": b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600),
    "a workbook without a record": workbook({"Info": [["TEST REPORT"], [1.0]], "Notes": []}),
    "a workbook that lacks a column": sheet(SHORT.rename({CURRENT: "Courant (A)"})),
    "a workbook of two channels": workbook({"Channel_1-001": ROWS, "Channel_1-002": ROWS}),
    "a workbook of two records": workbook(dict.fromkeys(("first", "second"), ROWS)),
    "a bad row on a later sheet": bad_later_sheet(),
}

TOLD = {
    "milliamperes of a slow sweep": csv(logged(HOURS * 3600, 0 * HOURS - 100, 4.1 - HOURS / 20)),
    "a row cut off": csv(SHORT) + b"20.0,-0.1",
    "a temperature with a gap": csv(
        SHORT.with_columns(pl.Series("Temperature / degC", [25.0] * 19 + [None]))
    ),
    "steps that are no numbers": csv(SHORT.with_columns(pl.lit(0.5).alias("Step Index / 1"))),
    "a row twice within resolution": csv(
        pl.concat([FRAME[:5], FRAME[4:5].with_columns(pl.col(VOLTAGE) + 0.001), FRAME[5:]])
    ),
    "other sheets": workbook({"Info": [["REPORT"]], "Channel_1-001": ROWS, "Chart": []}),
    "a column twice": csv(SHORT).replace(b"\n", b",1\n").replace(b"V,1", f"V,{VOLTAGE}".encode()),
}


def test_every_message_is_the_one_that_was_written_down(tmp_path):
    said = {name: [refusal(tmp_path, content)] for name, content in REFUSED.items()}
    for name, content in TOLD.items():
        record = read(tmp_path, content)
        said[name] = [str(each) for each in (*record.notes, *record.warnings)]
    text = "".join(
        f"{name}\n" + "".join(f"  {line}\n" for line in lines) for name, lines in said.items()
    )
    # What the library says of a damaged file is its own.
    text = re.sub(r"cut short \(.*\);", "cut short (...);", text)
    assert "--" not in text
    require_golden(Path(__file__).with_name("messages.txt"), text)


@pytest.mark.parametrize("option", ["current_sign", "current_hold"])
def test_an_unknown_option_value_is_refused_with_the_allowed_ones(tmp_path, option):
    message = refusal(tmp_path, csv(FRAME), **{option: "sideways"})
    assert message.startswith(f"`{option}` 'sideways' is not known; there are auto")


def test_what_is_no_file_is_refused(tmp_path):
    for path, words in (
        (tmp_path, "this is a folder; give the files in it"),
        (tmp_path / "nowhere.csv", "there is no such file"),
        (tmp_path / f"{300 * 'x'}.csv", "cannot be read (File name too long)"),
        (tmp_path / "a\0b.csv", "cannot be read (embedded null"),
    ):
        with pytest.raises(InputError) as caught:
            read_record(path)
        assert words in str(caught.value)
        assert "\0" not in str(caught.value)


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ("time=Uhr:s", "no column is called 'Uhr'"),
        ("time=Dauer:fortnight", "unknown unit 'fortnight'"),
        ("time=Dauer:none", "unknown unit 'none' of 'Dauer'"),
    ],
)
def test_a_wrong_column_or_unit_is_named(tmp_path, columns, says):
    assert says in refusal(tmp_path, "Dauer,Klemme\n0,3.7\n", columns=columns)


def test_all_columns_that_are_missing_are_said_at_once(tmp_path):
    text = "a,I2,U3\n" + "0,1,3.7\n" * 30
    with pytest.raises(InputError) as caught:
        read(tmp_path, text, columns="current=Strom:A,voltage=Volt:V")
    lines = str(caught.value).splitlines()
    wanted = ("called 'Strom:A'", "called 'Volt:V'", "no column for time, current, voltage")
    assert [word in line for word, line in zip(wanted, lines, strict=True)] == [True] * 3
    assert caught.value.code == "columns.not-there"
