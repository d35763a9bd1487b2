"""Files that are one log, cut under load, are one record; those that do not continue are apart."""

from dataclasses import replace
from datetime import date

import numpy as np
import polars as pl
import pytest

import barnax
from barnax import InputError, Result
from barnax.bundled import BUNDLED
from barnax.plan import plan, plan_from_toml, plan_to_toml
from barnax.plan.running import planned
from barnax.records import Source, read_record, read_source
from barnax.records.cell_values import numbers
from barnax.records.log import joined
from barnax.records.table import Table
from helpers.records import CURRENT, TIME, VOLTAGE

SMALL = {"model": "so-rc", "seeds": 0, "trust": "none"}
WHOLE = pl.read_parquet(BUNDLED.record)
# Rows under load; names say nothing of the order.
CUTS, NAMES = (0, 5000, 9045, len(WHOLE)), ("c.parquet", "a.parquet", "b.parquet")
LOG = "c.parquet + a.parquet + b.parquet"


@pytest.fixture
def cut(tmp_path):
    """A folder with a log in three files, in the units of the whole one."""
    for name, first, after in zip(NAMES, CUTS, CUTS[1:], strict=False):
        assert abs(WHOLE[CURRENT][first]) > 0.5 or not first
        WHOLE[first:after].write_parquet(tmp_path / name)
    return tmp_path


def records(folder, **options):
    """The names of all but the OCV tests."""
    parts = plan(folder, ocv=list(BUNDLED.ocv), **options).parts
    return sorted(part.name for part in parts if part.role != "OCV test")


def test_a_log_in_three_files_has_the_answer_of_the_whole_one(cut, tmp_path):
    whole = barnax.identify(BUNDLED.record, ocv=list(BUNDLED.ocv), **SMALL)
    result = barnax.identify([cut / name for name in sorted(NAMES)], ocv=BUNDLED.ocv, **SMALL)
    assert result.parameters == pytest.approx(whole.parameters, rel=1e-9)
    (part,) = result.of_role("identification")
    digests = [read_record(cut / name).sha256 for name in NAMES]
    assert (part.name, part.sha256.split()) == (LOG, digests)
    (told,) = [file.reason for file in result.plan if file.name == LOG]
    assert "a.parquet continues the log under load: its clock is 1 s later" in told
    # The stored result finds its files again, and the plan reads the same record.
    (tmp_path / "result.json").write_text(result.to_json())
    (again,) = Result.load(tmp_path).evaluations.identification
    assert again.metrics == result.evaluations.identification[0].metrics
    path = tmp_path / "plan.toml"
    path.write_text(plan_to_toml(plan(cut, ocv=list(BUNDLED.ocv))))
    (source,) = planned(plan_from_toml(path), barnax.Job()).records
    assert (source.name, source.sha256.split()) == (LOG, digests)
    assert read_record(source).samples == len(WHOLE)


def test_a_log_without_an_ocv_test_is_one_record_too(cut):
    names = [[part.name for part in plan(each).parts] for each in (cut, BUNDLED.record)]
    assert names == [[LOG], [BUNDLED.record.name]]


@pytest.mark.parametrize(
    "change",
    [pl.col(VOLTAGE) + 0.02, pl.col(TIME) + 5.0, pl.col(TIME) - 5.0, pl.col(TIME) * 2 - 9046.0],
    ids=["another voltage", "a gap", "an overlap", "other intervals"],
)
def test_what_does_not_continue_stays_apart(cut, change):
    last = WHOLE[CUTS[2] :].with_columns(change)
    last.write_parquet(cut / "b.parquet")
    assert records(cut) == ["b.parquet", "c.parquet + a.parquet"]


def test_files_stay_apart_that_two_may_continue_or_that_have_separate_options(cut):
    window = {"b.parquet": barnax.Window(initial_soc=0.5)}
    assert records(cut, window=window) == ["b.parquet", "c.parquet + a.parquet"]
    noisy = WHOLE[CUTS[2] :].with_columns(
        pl.col(VOLTAGE) + pl.Series(np.resize([1e-4, -1e-4], 10635))
    )
    noisy.write_parquet(cut / "d.parquet")
    assert "c.parquet + a.parquet" in records(cut)


def test_a_log_that_is_cut_in_a_long_rest_stays_apart_and_one_cut_in_a_pulse_does_not(tmp_path):
    pulses = pl.read_parquet(BUNDLED.hppc[1])
    loaded = (pulses[CURRENT].abs() > 0.02).arg_true()
    time_s = pulses[TIME].gather(loaded)
    # The end of the load before the longest rest, which is cut half an hour later.
    before = int(loaded[time_s.diff().arg_max() - 1])
    in_rest = int((pulses[TIME] < pulses[TIME][before] + 1900).sum())
    in_pulse = int(loaded[len(loaded) // 2])
    assert {in_pulse - 1, in_pulse + 1} <= {*loaded}
    cases = (in_rest, ["a.parquet", "b.parquet"]), (in_pulse, ["a.parquet + b.parquet"])
    for at, names in cases:
        pulses[:at].write_parquet(tmp_path / "a.parquet")
        pulses[at:].write_parquet(tmp_path / "b.parquet")
        assert sorted(part.name for part in plan(tmp_path).parts) == names


def test_a_log_has_one_folder_one_temperature_and_columns_of_one_type(cut):
    last = pl.read_parquet(cut / "b.parquet")
    (cut / "b.parquet").unlink()
    for name in ("b_0degC.parquet", "other/b.parquet"):
        (cut / name).parent.mkdir(exist_ok=True)
        last.write_parquet(cut / name)
        (cut / "a.parquet").rename(cut / "a_25degC.parquet")
        assert "c.parquet + a_25degC.parquet" in records(cut)
        (cut / "a_25degC.parquet").rename(cut / "a.parquet")
        (cut / name).unlink()
    last.with_columns(pl.lit("x").alias("remark")).write_parquet(cut / "b.parquet")
    assert records(cut) == ["b.parquet", "c.parquet + a.parquet"]


def test_a_column_of_two_kinds_is_text_in_which_each_cell_is_what_it_was():
    dates = pl.Series("date", [date(2024, 1, 1)]).cast(pl.Datetime("ms"))
    parts = [Table.of(part.to_frame()) for part in (dates, dates.dt.replace_time_zone("UTC"))]
    whole = Table.stacked(parts)
    stamps = numbers(whole.columns[0], whole.header.columns["date"])
    np.testing.assert_array_equal(stamps, [1704067200.0, 1704067200.0])


def test_names_with_the_mark_between_files_stay_apart(cut):
    (cut / "b.parquet").rename(cut / "b + d.parquet")
    assert records(cut) == ["b + d.parquet", "c.parquet + a.parquet"]


def test_notices_of_joined_workbooks_name_a_sheet():
    sources = [
        Source(name, replace(table, sheets=((f"{name}1", 1), (f"{name}2", 2))), "")
        for name, table in (("a", Table.of(WHOLE[:3])), ("b", Table.of(WHOLE[3:6])))
    ]
    sheets = joined(sources).table.sheets
    assert [name for name, _ in sheets] == ["a1", "a2", "b1", "b2"]
    assert sum(lines for _, lines in sheets) == 6


def parts_of_a_log(folder, *columns):
    for number, column in enumerate(columns):
        time_s = pl.Series(np.arange(50.0) + 50 * number)
        frame = {"Time / s": time_s, "Current / A": -0.1, "Voltage / V": 3.6}
        pl.DataFrame(frame).with_columns(column.alias("Test Time")).write_parquet(
            folder / f"{number}.parquet"
        )
    return [read_source(folder / f"{number}.parquet") for number in range(len(columns))]


def test_columns_that_the_files_of_a_log_have_in_two_kinds_are_one_or_named(tmp_path):
    times_us = pl.duration(microseconds=pl.int_range(50), time_unit="us")
    alike = joined(parts_of_a_log(tmp_path, times_us, times_us.cast(pl.Duration("ms"))))
    assert len(alike.table.row) == 100
    for number, column in enumerate((pl.lit(0.0), pl.lit(b"\xff"))):
        (folder := tmp_path / str(number)).mkdir()
        with pytest.raises(InputError, match=r"0\.parquet \+ 1\.parquet: 'Test Time' has dates"):
            joined(parts_of_a_log(folder, times_us, column))
