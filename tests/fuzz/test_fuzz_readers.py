"""Whatever is in a file: it is read, or refused with an InputError in our words, and no more."""

import numpy as np
import polars as pl
import pytest
from hypothesis import strategies as st

from barnax import InputError, Record, check_file, read_record, record_from_frame
from barnax.cell import OcvTable, read_ocv_test
from helpers.hostile import EXAMPLES, LETTERS, damaged, repeated
from helpers.records import CURRENT, TIME, VOLTAGE, good_files, parquet, pulse_frame, sheet

FRAME = pulse_frame(40).with_columns(
    pl.lit(25.0).alias("Temperature / degC"),
    (pl.col(TIME) // 7).alias("Step Index / 1"),
    (pl.col(TIME) / 3600).alias("Charging Capacity / Ah"),
    (pl.col(TIME) / 3600).alias("Discharging Capacity / Ah"),
)
OCV = pl.DataFrame({"SOC [-]": np.linspace(0, 1, 12), "OCV [V]": np.linspace(3, 4.2, 12)})
GOOD = {
    "delimited text": [*good_files()["delimited text"], OCV.write_csv().encode()],
    "Parquet table": [*good_files()["Parquet table"], parquet(OCV)],
    "spreadsheet workbook": [*good_files()["spreadsheet workbook"], sheet(OCV)],
}
# Where one kind of number ends and the next begins, or does not.
NUMBERS = [
    0.0, -0.0, 5e-324, 1e-300, 1e-9, 1.0, 65_535.0, 2.0**31, 2.0**53, 2.0**63, 1e20, 1e155, 1e300,
    1.7976931348623157e308, float("inf"), float("nan"),
]  # fmt: skip
CELLS = [
    "", " ", "nan", "-inf", "1e400", "1e-400", "1_000", "0x10", "1,5", "1.2.3", "--", "+", "٣", "é",
    "true", "2020-01-01", "9" * 5000, "0." + "3" * 5000, '"', "\ufeff1", "\u2028", "=1+1", "..",
]  # fmt: skip


def survive(folder, content):
    """Read and check a file; the reader raises what the check calls an error, and nothing else."""
    path = folder / "cell.csv"
    path.write_bytes(content)
    record, refusal = None, ""
    try:
        record = read_record(path)
    except InputError as problem:
        refusal = str(problem)
        require_words(refusal)
    else:
        require_record(record)
    try:
        outcome = check_file(path)
    except InputError as problem:
        raised = {str(problem)}
    else:
        errors = [each for each in outcome.findings if each.severity == "error"]
        raised = {f"{each.about('cell.csv')}." for each in errors}
    # A table of OCV is no record, and is checked as what it is.
    is_table = "It is a table of OCV over SOC" in refusal
    try:
        test = read_ocv_test(path)
    except InputError as problem:
        require_words(str(problem))
        refusal = str(problem) if is_table else refusal
    else:
        assert record is not None or isinstance(test, OcvTable)
        if is_table:
            assert not raised
            return
    # The whole record shows faults that no sample does.
    assert record is not None or refusal in raised


def require_words(refusal):
    assert refusal.startswith("cell.csv: ")
    assert len(refusal) < 5000
    assert refusal.isprintable()


def require_record(record: Record):
    """What every record promises."""
    assert record.samples >= 5
    assert len(record.time_s) == len(record.current_a) == len(record.voltage_v) == record.samples
    for values in (record.current_a, record.voltage_v, record.discharged_ah):
        assert np.isfinite(values).all()
    assert (np.diff(record.time_s) > 0).all()
    assert np.abs(record.voltage_v).max() <= 100


@st.composite
def absurd_frames(draw: st.DrawFn) -> pl.DataFrame:
    """A record with all columns there are, some of its numbers or whole columns absurd."""
    lines = draw(st.integers(10, 40))
    columns = {name: FRAME[name].to_numpy()[:lines].copy() for name in FRAME.columns}
    numbers = st.sampled_from(NUMBERS + [-each for each in NUMBERS]) | st.floats()
    for _ in range(draw(st.integers(0, 4))):
        column = columns[draw(st.sampled_from(FRAME.columns))]
        change = draw(st.sampled_from(["one", "all", "scale", "shift"]))
        value = draw(numbers | st.floats(-10, 10))
        with np.errstate(all="ignore"):
            if change == "one":
                column[draw(st.integers(0, lines - 1))] = value
            elif change == "all":
                column[:] = value
            elif change == "scale":
                column *= value
            else:
                column += value
    left_out = draw(st.sets(st.sampled_from(FRAME.columns[3:])))
    return pl.DataFrame({name: values for name, values in columns.items() if name not in left_out})


@st.composite
def absurd_texts(draw: st.DrawFn) -> bytes:
    """A delimited file with absurd cells, names, lines or separators."""
    table = draw(absurd_frames() | st.just(OCV))
    lines = [line.split(",") for line in table.write_csv().splitlines()]
    words = st.sampled_from(CELLS) | st.text(LETTERS, max_size=8)
    for _ in range(draw(st.integers(0, 4))):
        line = draw(st.sampled_from(lines))
        change = draw(st.sampled_from(["word", "more", "fewer"]))
        if change == "word":
            line[draw(st.integers(0, len(line) - 1))] = draw(words)
        elif change == "more":
            line.append(draw(words))
        else:
            line[draw(st.integers(0, len(line) - 1)) :] = [""]
    separator = draw(st.sampled_from([",", ";", "\t", "|"]))
    text = draw(st.sampled_from(["\n", "\r\n", "\r", "\n\n"])).join(map(separator.join, lines))
    encoding = draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "latin-1"]))
    return text.encode(encoding, errors="replace")


STARTS = st.sampled_from(
    [b"", b"PAR1", b"PK\3\4xl/", b"\xff\xfe", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"]
)
CONTENTS = {
    "random bytes": st.builds(lambda start, rest: start + rest, STARTS, st.binary(max_size=300)),
    "random text": st.text(LETTERS, max_size=300).map(str.encode),
    **{f"damaged {kind}": damaged(good) for kind, good in GOOD.items()},
    "absurd text": absurd_texts(),
    "absurd Parquet": absurd_frames().map(parquet),
    "absurd workbook": absurd_frames().map(sheet),
}


@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("kind", CONTENTS)
def test_whatever_a_file_holds_is_read_or_refused(tmp_path, kind, examples):
    repeated(examples, lambda content: survive(tmp_path, content), CONTENTS[kind])


def test_a_table_of_ocv_is_recognized_beside_a_column_whose_name_is_a_number(tmp_path):
    survive(tmp_path, OCV.with_columns(pl.lit(1.0).alias("nan")).write_csv().encode())


@pytest.mark.parametrize("kind", ["Parquet table", "spreadsheet workbook"])
def test_a_file_cut_anywhere_is_refused(tmp_path, kind):
    content = GOOD[kind][0]
    for length in range(8, len(content) - 1, 397):
        (tmp_path / "cell.csv").write_bytes(content[:length])
        with pytest.raises(InputError):
            read_record(tmp_path / "cell.csv")


@pytest.mark.parametrize("examples", EXAMPLES)
def test_whatever_a_data_frame_holds_is_read_or_refused(examples):
    def survive_frame(table):
        try:
            require_record(record_from_frame(table, name="cell.csv"))
        except InputError as problem:
            require_words(str(problem))

    repeated(examples, survive_frame, absurd_frames())


def test_a_column_may_be_of_any_kind():
    for values in ([1 + 2j] * 20, [[1]] * 20, [b"x"] * 20, [True] * 20, [None] * 20, [{}] * 20):
        table = {TIME: range(20), CURRENT: [0.0, 1.0] * 10, VOLTAGE: values}
        with pytest.raises(InputError, match="where a number is needed"):
            record_from_frame(table)
