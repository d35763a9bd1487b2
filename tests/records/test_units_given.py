"""Units that the user gives, cells in series, and columns that hold one quantity twice."""

import numpy as np
import polars as pl
import pytest

from barnax.cell import read_ocv_test
from barnax.checks import check_file
from barnax.errors import InputError
from barnax.inputs import source_of
from barnax.records import read_record, record_from_frame, source_from_frame
from barnax.settings import Reading
from helpers.records import CURRENT, TIME, VOLTAGE, pulse_frame, told

FRAME = pulse_frame(300)


def scaled(column, factor, name=None):
    table = FRAME.with_columns(pl.col(column) * factor)
    return table.rename({column: name or column})


# A column whose values look like another unit's, and by how much they are out.
DOUBTED = {
    "time": (TIME, 1 / 3600, "s"),
    "current": (CURRENT, 1e3, "A"),
}


@pytest.mark.parametrize("quantity", DOUBTED)
def test_a_unit_that_is_given_is_not_doubted(quantity):
    column, factor, unit = DOUBTED[quantity]
    for given, is_doubted in (({}, True), ({quantity: f"{column}:{unit}"}, False)):
        source = source_from_frame(scaled(column, factor), "cell", columns=given)
        assert (f"{quantity} unit" in {e.check for e in check_file(source).findings}) == is_doubted


def test_one_sign_of_another_unit_is_a_warning_and_the_values_stay():
    """59 A through 20 microohm: a large cell with a coarse voltage, or a small one in mA."""
    current_a = FRAME[CURRENT].to_numpy()
    voltage_v = pl.Series(VOLTAGE, 3.7 + 1e-3 * current_a)
    record = record_from_frame(scaled(CURRENT, 29.5).with_columns(voltage_v))
    assert np.abs(record.current_a).max() == pytest.approx(59.0)
    assert "may be in milliamperes" in " ".join(told(record))


def test_a_pack_is_no_cell_in_millivolts_and_is_asked_for_its_cells():
    with pytest.raises(InputError, match=r"about 9\d in series; give how many, such as `series=9"):
        record_from_frame(scaled(VOLTAGE, 92.0))


def test_a_pack_of_cells_in_series_is_read_as_one_of_them(tmp_path):
    pack, cell = scaled(VOLTAGE, 96.0), record_from_frame(FRAME)
    record = record_from_frame(pack, series=96)
    np.testing.assert_allclose(record.voltage_v, cell.voltage_v)
    assert "is divided by 96" in " ".join(told(record))
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


@pytest.mark.parametrize("apart_v", [0.03, -1.0])
def test_two_voltages_that_differ_are_to_be_chosen_from(apart_v):
    other = (pl.col(VOLTAGE) + apart_v).alias("Cell Voltage / V")
    table = FRAME.with_columns(other).rename({VOLTAGE: "voltage"})
    with pytest.raises(InputError, match=r"'Cell Voltage / V' and 'voltage' differ by .* mV, and"):
        record_from_frame(table)
    for name, extra_v in (("voltage", 0.0), ("Cell Voltage / V", apart_v)):
        record = record_from_frame(table, columns={"voltage": name})
        np.testing.assert_allclose(record.voltage_v, FRAME[VOLTAGE].to_numpy() + extra_v)


def bare(time_unit_s, current_a, voltage_v, frame=FRAME):
    """The frame with names that have no unit, and values in units of so many s, A and V."""
    named = {TIME: ("Time", time_unit_s), CURRENT: ("Current", current_a)}
    named[VOLTAGE] = ("Voltage", voltage_v)
    return frame.select((pl.col(own) / unit).alias(new) for own, (new, unit) in named.items())


ALL_BARE = "`columns='time=Time:UNIT,current=Current:UNIT,voltage=Voltage:UNIT'`"


@pytest.mark.parametrize(
    "units",
    [(60, 1e-3, 1), (3600, 1e-3, 1), (1, 1e-3, 1e-3), (60, 1, 1e-3), (60, 1e-3, 1e-3)],
)
def test_several_units_that_are_missing_are_one_question(units):
    # Twenty amperes, so that they are no cell's where they are milliamperes.
    large = FRAME.with_columns(pl.col(CURRENT) * 10)
    table = bare(*units, large)
    with pytest.raises(InputError) as refused:
        record_from_frame(table)
    assert ALL_BARE in str(refused.value)
    symbols = {60: "min", 3600: "h"}, {1e-3: "mA"}, {1e-3: "mV"}
    bases = ("s", "A", "V")
    given = {
        quantity: f"{name}:{known.get(unit, base)}"
        for quantity, name, unit, known, base in zip(
            ("time", "current", "voltage"), table.columns, units, symbols, bases, strict=True
        )
    }
    record, true = record_from_frame(table, columns=given), record_from_frame(large)
    for name in ("time_s", "current_a", "voltage_v"):
        np.testing.assert_allclose(getattr(record, name), getattr(true, name), atol=1e-9)
