"""Records come from files of any name and from data frames of any library, by the same rules."""

import numpy as np
import polars as pl
import pytest

from barnax import InputError
from barnax.records import read_record, record_from_frame, source_from_frame
from barnax.records.readers import READERS
from helpers.records import TIME, VOLTAGE, good_files, pulse_frame, read, refusal
from helpers.reference import make_record

FRAME = pulse_frame().with_columns(pl.Series("Step Index / 1", np.arange(200) // 50))


@pytest.fixture
def record(tmp_path):
    return read(tmp_path, FRAME)


def pandas_frame(table):
    pandas = pytest.importorskip("pandas")
    return pandas.DataFrame({name: table[name].to_list() for name in table.columns})


LIBRARIES = {
    "Polars": lambda table: table,
    "lazy Polars": lambda table: table.lazy(),
    "pandas": pandas_frame,
    "a mapping": lambda table: {name: table[name].to_numpy() for name in table.columns},
}


@pytest.mark.parametrize("made", LIBRARIES.values(), ids=LIBRARIES)
def test_a_data_frame_gives_the_record_of_its_file(record, made):
    framed = record_from_frame(made(FRAME), name="cell.csv")
    for name, values in vars(record).items():
        if isinstance(values, np.ndarray):
            np.testing.assert_array_equal(getattr(framed, name), values)
    assert (framed.sign, framed.hold, framed.warnings) == (record.sign, record.hold, ())


@pytest.mark.parametrize("reading", [{"series": 2}, {"columns": {"time": "Zeit:s"}}])
def test_what_is_read_already_takes_no_columns_and_no_cells_in_series(reading):
    with pytest.raises(InputError, match="has been read already; give `columns` and `series`"):
        read_record(source_from_frame(FRAME, "cell"), **reading)


@pytest.mark.parametrize("made", LIBRARIES.values(), ids=LIBRARIES)
def test_a_fault_of_a_data_frame_is_named_by_its_row(made):
    table = FRAME.with_columns(pl.Series(VOLTAGE, [3.7] * 40 + [None] + [3.7] * 159))
    with pytest.raises(InputError, match=r"^drive: row 42: 'Voltage / V' contains n"):
        record_from_frame(made(table), name="drive")


def test_the_hash_of_a_data_frame_is_of_its_names_and_values():
    first = record_from_frame(FRAME)
    assert first.sha256 == record_from_frame(FRAME.clone(), name="other").sha256
    assert first.sha256 != record_from_frame(FRAME.rename({TIME: "Time [s]"})).sha256
    moved = FRAME.with_columns(pl.col(VOLTAGE) + 1e-9)
    assert first.sha256 != record_from_frame(moved).sha256


@pytest.mark.parametrize("frame", [3, "cell.csv", [1.0, 2.0], None])
def test_what_is_no_data_frame_is_refused(frame):
    with pytest.raises(InputError, match=r"^data frame: not a data frame, but of type"):
        record_from_frame(frame)


@pytest.mark.parametrize("name", ["us06\x1b[2J\x1b[31m.csv", "line\nbreak.csv", "\u202egnp.csv"])
def test_a_name_cannot_command_a_terminal(tmp_path, name):
    shown = read(tmp_path, FRAME, name).name
    assert "\ufffd" in shown
    assert shown.replace("\ufffd", "").isprintable()
    assert refusal(tmp_path, "nothing", name).isprintable()


@pytest.mark.parametrize("name", good_files())
def test_a_reader_is_the_first_to_recognize_its_content(name):
    for content in good_files()[name]:
        reader = next(reader for reader in READERS if reader.recognizes(content))
        assert reader.name == name
        table = reader.read(content, {})
        assert {len(column) for column in table.columns} == {40}
        assert list(table.row) == list(range(2, 42))


def test_writing_to_what_a_record_was_made_from_does_not_change_it():
    time_s, current_a = np.arange(20.0), np.ones(20)
    record = make_record(time_s, current_a)
    current_a[3], time_s[3] = 7.0, -1.0
    assert (record.current_a == 1).all()
    assert (np.diff(record.time_s) > 0).all()
