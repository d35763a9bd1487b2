"""A table of OCV over SOC stands for an OCV test."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax.cell import OcvTable, characterize, read_ocv_table, read_ocv_test
from barnax.records import Record, source_from_frame
from helpers.ocv_tests import ONE, SOC, TWO, average_v, branch_v, charge_only, discharge_only
from helpers.records import parquet, pulse_frame, sheet

GRID = np.linspace(0, 1, 21)


def written(folder, table, name="ocv.csv"):
    kinds = {"csv": lambda: table.write_csv().encode(), "parquet": lambda: parquet(table)}
    kinds["xlsx"] = lambda: sheet(table)
    (folder / name).write_bytes(kinds[name.rpartition(".")[2]]())
    return folder / name


@pytest.mark.parametrize("suffix", ["csv", "parquet", "xlsx"])
def test_two_branches_give_average_and_hysteresis_back(tmp_path, suffix):
    table = read_ocv_table(written(tmp_path, TWO, f"ocv.{suffix}"))
    cell = characterize([table], capacity_ah=2.0, ocv_fit="interpolated")
    np.testing.assert_allclose(cell.charge(GRID), branch_v(GRID, 1), atol=1e-9)
    np.testing.assert_allclose(cell.discharge(GRID), branch_v(GRID, -1), atol=1e-9)
    assert (cell.capacity_ah, cell.capacity_origin, cell.warnings) == (2.0, "given", ())
    assert [point.row for point in cell.charge_points] == list(range(2, 43))


def test_exchanged_branches_are_reported():
    charge, discharge = TWO.columns[1:]
    exchanged = TWO.rename({charge: discharge, discharge: charge})
    table = read_ocv_table(source_from_frame(exchanged, "ocv"))
    cell = characterize([table], capacity_ah=2.0, ocv_fit="interpolated")
    told = " ".join(map(str, cell.warnings))
    gap_mv = 1e3 * np.mean(branch_v(SOC, 1) - branch_v(SOC, -1))
    assert f"lies below that of the discharge, by {gap_mv:.3g} mV" in told


@pytest.mark.parametrize(
    "names",
    [
        ("SOC", "OCV"),
        ("soc", "ocv"),
        ("SOC / %", "OCV / V"),
        ("SOC [%]", "Voltage / V"),
        ("SOC/1", "U"),
        ("State of Charge (%)", "Open Circuit Voltage (mV)"),
        ("soc_percent", "ocv_volt"),
    ],
)
def test_usual_names_and_units_are_understood(names):
    percent = 100 if "%" in names[0] or "percent" in names[0] else 1
    milli = 1000 if "mV" in names[1] else 1
    frame = pl.DataFrame({names[0]: percent * SOC, names[1]: milli * average_v(SOC)})
    (points,) = read_ocv_table(source_from_frame(frame, "ocv")).branches.values()
    np.testing.assert_allclose([point.soc for point in points], SOC, rtol=1e-12)
    np.testing.assert_allclose([point.voltage_v for point in points], average_v(SOC), rtol=1e-12)


@given(order=st.permutations(range(41)), empty=st.sets(st.integers(0, 40), max_size=30))
def test_rows_may_stand_in_any_order_and_a_branch_may_have_gaps(order, empty):
    charge_v = [None if k in empty else branch_v(SOC, 1)[k] for k in range(41)]
    frame = TWO.with_columns(pl.Series("charge OCV [V]", charge_v))[order]
    branches = read_ocv_table(source_from_frame(frame, "ocv")).branches
    assert [point.soc for point in branches[-1]] == SOC.tolist()
    assert [point.soc for point in branches[1]] == np.delete(SOC, list(empty)).tolist()


def test_a_branch_of_a_table_and_a_record_of_the_other_make_one_cell():
    table = read_ocv_table(source_from_frame(TWO.drop("discharge OCV [V]"), "ocv"))
    cell = characterize([table, discharge_only()], ocv_fit="interpolated")
    both = characterize([charge_only(), discharge_only()], ocv_fit="interpolated")
    assert cell.capacity_ah == both.capacity_ah
    np.testing.assert_allclose(cell.average_ocv_v(GRID), both.average_ocv_v(GRID), atol=1e-9)


def test_what_a_file_is_decides_how_it_is_read(tmp_path):
    assert isinstance(read_ocv_test(written(tmp_path, ONE)), OcvTable)
    assert isinstance(read_ocv_test(written(tmp_path, pulse_frame())), Record)
    with_soc = pulse_frame().with_columns(pl.lit(0.5).alias("SOC [-]"))
    assert isinstance(read_ocv_test(written(tmp_path, with_soc)), Record)
