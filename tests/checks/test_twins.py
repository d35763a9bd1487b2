"""Two columns of one quantity that disagree as only a wrong one does."""

import numpy as np
import polars as pl
import pytest

from barnax.errors import InputError
from barnax.records import record_from_frame
from helpers.records import (
    CURRENT,
    VOLTAGE,
    checked,
    counting,
    finding,
    frame,
    pulse_frame,
    remarks,
)


@pytest.mark.parametrize("name", ["Sense Voltage / V", "Aux_Voltage_1(V)"])
def test_a_voltage_at_the_leads_is_told_from_one_at_the_cell(tmp_path, name):
    drop_v = 0.02 * pl.col(CURRENT)
    outcome = checked(tmp_path, frame().with_columns((pl.col(VOLTAGE) + drop_v).alias(name)))
    assert counting(outcome) == {"twin columns": "warning"}
    twin = finding(outcome, "twin columns")
    assert f"'Voltage / V' and '{name}' differ by 20 mohm" in twin.what


@pytest.mark.parametrize("factor", [1.0, 1000.0, 0.5])
def test_currents_that_disagree_are_told(tmp_path, factor):
    """A column in mA beside one in A agrees with it where its values are a thousand times it."""
    table = frame().with_columns((pl.col(CURRENT) * factor).alias("I / mA"))
    outcome = checked(tmp_path, table)
    ratio = factor / 1000
    expected = {} if ratio == 1 else {"twin columns": "warning"}
    assert counting(outcome) == expected
    if expected:
        assert f"{ratio:.4g} times the first" in finding(outcome, "twin columns").what


def test_other_columns_are_no_twins(tmp_path):
    rng = np.random.default_rng(0)
    table = frame().with_columns(
        pl.col(VOLTAGE).cum_max().alias("Maximum Voltage / V"),
        pl.Series("Voltage noise / V", rng.normal(3.7, 1e-3, frame().height)),
        pl.lit(4.2).alias("Voltage limit / V"),
        pl.col(CURRENT).sign().alias("Current direction"),
        (pl.col(VOLTAGE) * 96).alias("Pack Voltage / V"),
        (pl.col(VOLTAGE) * 1.02).alias("Set Voltage / V"),
        (pl.col(VOLTAGE) + 0.001).alias("Cell Voltage 2 / V"),
    )
    assert counting(checked(tmp_path, table)) == {}


@pytest.mark.parametrize("apart_v", [0.03, -1.0])
def test_two_voltages_that_differ_are_to_be_chosen_from(apart_v):
    other = (pl.col(VOLTAGE) + apart_v).alias("Cell Voltage / V")
    table = pulse_frame().with_columns(other).rename({VOLTAGE: "voltage"})
    with pytest.raises(InputError, match=r"'Cell Voltage / V' and 'voltage' differ by .* mV, and"):
        record_from_frame(table)
    for name, extra_v in (("voltage", 0.0), ("Cell Voltage / V", apart_v)):
        record = record_from_frame(table, columns={"voltage": name})
        np.testing.assert_allclose(record.voltage_v, table["voltage"].to_numpy() + extra_v)


def test_a_second_voltage_beside_the_one_that_a_tester_names_is_told_where_it_reads_alike():
    aux = (pl.col(VOLTAGE) + 0.03).alias("Aux_Voltage_1(V)")
    table = pulse_frame().with_columns(aux, pl.lit(1).alias("Step_Index"))
    table.columns = ["Test_Time(s)", "Current(A)", "Voltage(V)", *table.columns[3:]]
    assert "'Aux_Voltage_1(V)' differ by 30 mV" in " ".join(remarks(record_from_frame(table)))
