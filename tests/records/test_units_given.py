"""Units that the user gives, cells in series, and columns that hold one quantity twice."""

import re

import numpy as np
import polars as pl
import pytest

from barnax import InputError, Reading, check_file
from barnax.cell import read_ocv_test
from barnax.inputs import source_of
from barnax.records import read_record, record_from_frame, source_from_frame
from helpers.records import CURRENT, TIME, VOLTAGE, logged, pulse_frame, remarks, scaled

FRAME = pulse_frame(300)


# A column whose values look like another unit's, and by how much they are out.
DOUBTED = {"time": (TIME, 1 / 3600, "s"), "current": (CURRENT, 1e3, "A")}


@pytest.mark.parametrize("quantity", DOUBTED)
def test_a_unit_that_is_given_is_not_doubted(quantity):
    column, factor, unit = DOUBTED[quantity]
    for given, is_doubted in (({}, True), ({quantity: f"{column}:{unit}"}, False)):
        source = source_from_frame(scaled(FRAME, column, factor), "cell", columns=given)
        assert ("unit" in {e.check for e in check_file(source).findings}) == is_doubted


def test_a_pack_of_cells_in_series_is_read_as_one_of_them(tmp_path):
    pack, cell = scaled(FRAME, VOLTAGE, 96.0), record_from_frame(FRAME)
    record = record_from_frame(pack, series=96)
    np.testing.assert_allclose(record.voltage_v, cell.voltage_v)
    assert "is divided by 96" in " ".join(remarks(record))
    pack.write_csv(tmp_path / "pack.csv")
    FRAME.write_csv(tmp_path / "cell.csv")
    reading = Reading(series=96)
    for name in ("pack.csv", "cell.csv"):
        source = source_of(tmp_path / name, {}, reading)
        np.testing.assert_allclose(read_record(source).voltage_v, cell.voltage_v)
    # A test of one cell beside it is one already.
    assert "is divided" not in " ".join(map(str, read_record(source).warnings))
    (tmp_path / "ocv.csv").write_text("SOC [-],OCV [V]\n0,288\n0.3,345.6\n0.6,360\n1,403.2\n")
    table = read_ocv_test(source_of(tmp_path / "ocv.csv", {}, reading))
    assert table.branches[0][-1].voltage_v == pytest.approx(4.2)


# The middle of a voltage and how many cells in series are given; what they would be.
CELLS = {(3.7, 2): "one", (3.7, 3): "one", (355.0, 48): "several", (355.0, 300): "several",
         (4.3, 2): "one", (4.56, 2): "one", (4.7, 2): None, (355.0, 96): None}  # fmt: skip


@pytest.mark.parametrize(("middle_v", "series"), CELLS)
def test_a_number_of_cells_that_makes_no_usual_cell_is_reported(middle_v, series):
    """Up to the highest voltage of one cell, half of it is one cell or two of LTO."""
    voltage_v = middle_v - 0.02 + 0.005 * pl.col(CURRENT)
    record = record_from_frame(FRAME.with_columns(voltage_v.alias(VOLTAGE)), series=series)
    fits = [one.values["fits"] for one in record.warnings if one.code == "series.unlikely"]
    assert fits == ([CELLS[middle_v, series]] if CELLS[middle_v, series] else [])


def bare(time_unit_s, current_a, voltage_v, frame=FRAME):
    """The frame with names that have no unit, and values in units of so many s, A and V."""
    named = {TIME: ("Time", time_unit_s), CURRENT: ("Current", current_a)}
    named[VOLTAGE] = ("Voltage", voltage_v)
    return frame.select((pl.col(own) / unit).alias(new) for own, (new, unit) in named.items())


UNITS = {"s": 1, "min": 60, "h": 3600, "A": 1, "mA": 1e-3, "V": 1, "mV": 1e-3}
ALL_BARE = "`columns='time=Time:UNIT,current=Current:UNIT,voltage=Voltage:UNIT'`"


@pytest.mark.parametrize("given", ["min mA V", "h mA V", "s mA mV", "min A mV", "min mA mV"])
def test_several_units_that_are_missing_are_one_question(given):
    # Twenty amperes, so that they are no cell's where they are milliamperes.
    large = scaled(FRAME, CURRENT, 10)
    table = bare(*map(UNITS.get, given.split()), large)
    with pytest.raises(InputError, match=re.escape(ALL_BARE)):
        record_from_frame(table)
    named = zip(table.columns, given.split(), strict=True)
    columns = {name.lower(): f"{name}:{unit}" for name, unit in named}
    record, true = record_from_frame(table, columns=columns), record_from_frame(large)
    for name in ("time_s", "current_a", "voltage_v"):
        np.testing.assert_allclose(getattr(record, name), getattr(true, name), atol=1e-9)


def test_a_slow_sweep_in_minutes_and_milliamperes_is_no_large_cell_without_a_word():
    """A C/20 sweep of 3 Ah, sampled each minute: 150 for 20 hours is a cell of 50 Ah at 3C."""
    minutes = np.arange(1200.0)
    table = pl.DataFrame({"Time": minutes, "Current": np.full(1200, -150.0)})
    table = table.with_columns(pl.Series("Voltage", 4.15 - 1.2 * minutes / 1200))
    (warning,) = record_from_frame(table).warnings
    assert (warning.code, "150 A" in str(warning)) == ("columns.units", True)
    given = {"time": "Time:min", "current": "Current:mA"}
    record = record_from_frame(table, columns=given)
    assert not record.warnings
    assert record.discharged_ah[-1] == pytest.approx(0.15 * 1199 / 60)


SWEPT = np.arange(1000)
SWEEP = logged(
    SWEPT * 72.0,
    np.where(SWEPT < 5, 0.0, -0.1),
    4.15 - 1.2 * SWEPT / 1000 - 0.01 * (SWEPT >= 5),
)


@pytest.mark.parametrize(
    ("table", "factor", "words"),
    [
        # A drive of five minutes at 60 Hz, one that steps 200 times a second, and one whose charge
        # moves no voltage for hours.
        (FRAME, 1 / 60, "may be in minutes: samples lie 0.016667 s apart"),
        (FRAME, 1e-3, "the load steps 127 times a second"),
        (FRAME, 3600.0, "so high that all charge could pass in"),
        # A sweep of 20 hours with one step of the current.
        (SWEEP, 1 / 3600, "so low that all charge could pass in"),
    ],
)
def test_a_name_with_another_unit_than_its_values_is_detected_without_counters(
    table, factor, words
):
    try:
        said = " ".join(remarks(record_from_frame(scaled(table, TIME, factor))))
    except InputError as refused:
        said = str(refused)
    assert words in said


def test_units_that_nothing_decides_are_noted_where_they_make_an_unusual_record():
    """Amperes under milliamperes are a coin cell's; a sweep of 55 days is a slow one."""
    small = remarks(record_from_frame(FRAME.rename({CURRENT: "Current [mA]"})))
    assert any("is read in mA: up to 2 mA through 49.5 ohm" in each for each in small)
    time_s = np.arange(8000) * 600.0
    slow = remarks(record_from_frame(logged(time_s, 0 * time_s - 1e-3, 4.1 - time_s / 5e6)))
    assert any(
        "is read in s: the record lasts 1333 h, at 0.00075 C or less" in each for each in slow
    )
    fast = remarks(record_from_frame(SWEEP[5:].with_columns(pl.col(TIME) / 40)))
    assert any("is read in s: the record lasts 0.497 h, at 2 C or less" in each for each in fast)
    assert not any(" is read in " in each for each in remarks(record_from_frame(SWEEP)))


@pytest.mark.parametrize("other", ["VALUE", "value ", "va_lue", "value [mA]"])
def test_the_column_of_exactly_the_given_name_is_taken_before_one_spelled_nearly_so(other):
    given = "va lue" if other == "va_lue" else "value"
    table = FRAME.rename({CURRENT: given}).with_columns((-pl.col(given)).alias(other))
    table = table.select(TIME, other, given, VOLTAGE)
    record = record_from_frame(table, columns=f"current={given}:A")
    np.testing.assert_allclose(record.current_a, -FRAME[CURRENT].to_numpy(), atol=1e-12)
    assert not [one for one in record.warnings if one.code == "columns.fits-several"]


def test_a_given_name_that_two_columns_fit_as_well_takes_the_first_and_says_so():
    milli = (1e3 * pl.col(CURRENT)).alias("value [mA]")
    table = FRAME.select(TIME, milli, pl.col(CURRENT).alias("value [A]"), VOLTAGE)
    record = record_from_frame(table, columns="current=value")
    np.testing.assert_allclose(record.current_a, -FRAME[CURRENT].to_numpy(), atol=1e-12)
    (told_of,) = [one for one in record.warnings if one.code == "columns.fits-several"]
    assert told_of.values == {"name": "value", "columns": 2, "taken": "value [mA]"}


SECONDS = np.arange(160) * 4.0


@pytest.mark.parametrize(
    ("unit_s", "unit_a", "option"), [(1e-3, 1.0, "time=Time:ms"), (1.0, 1e-3, "current=current:mA")]
)
def test_a_counter_without_a_unit_does_not_vouch_for_the_others(unit_s, unit_a, option):
    """Ten samples a second in ms, or a load in mA, beside a counter in mAh: the product agrees."""
    seconds = np.arange(2000) * 0.1
    current_a = np.where(np.arange(2000) // 100 % 2, -2.0, 0.0)
    counted_mah = np.append(0, np.cumsum(current_a[:-1])) * 0.1 / 3.6
    table = {"Time": seconds / unit_s, "current": current_a / unit_a}
    table |= {"voltage": 3.9 + 0.05 * current_a, "capacity": counted_mah}
    findings = check_file(source_from_frame(table, "log")).findings
    assert option in " ".join(map(str, findings))
    record = record_from_frame(table, columns=option)
    assert record.time_s[-1] == pytest.approx(seconds[-1])
    assert record.current_a.max() == pytest.approx(2.0)
    assert np.ptp(record.charge_ah) == pytest.approx(np.ptp(counted_mah) / 1e3)


CHARGE_A = np.where(np.arange(160) < 150, 1.0, 0.0)


@pytest.mark.parametrize("current_a", [CHARGE_A, 5 * np.where(np.arange(160) // 20 % 2, -1, 0.5)])
def test_exchanged_columns_are_reported_and_what_is_advised_reads_them(current_a):
    voltage_v = 3.5 + SECONDS / 1e3 + 0.05 * current_a
    table = {"time [s]": SECONDS, "Current [A]": voltage_v, "Voltage [V]": current_a}
    with pytest.raises(InputError, match="they look swapped") as caught:
        record_from_frame(table)
    (option,) = re.findall(r"columns='(.*)'`", str(caught.value))
    np.testing.assert_allclose(record_from_frame(table, columns=option).voltage_v, voltage_v)
