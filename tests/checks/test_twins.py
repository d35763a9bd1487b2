"""Two columns of one quantity that disagree as only a wrong one does."""

import numpy as np
import polars as pl
import pytest

from helpers.records import CURRENT, VOLTAGE, checked, counting, found, frame


@pytest.mark.parametrize("name", ["Sense Voltage / V", "Aux_Voltage_1(V)"])
def test_a_voltage_at_the_leads_is_told_from_one_at_the_cell(tmp_path, name):
    drop_v = 0.02 * pl.col(CURRENT)
    outcome = checked(tmp_path, frame().with_columns((pl.col(VOLTAGE) + drop_v).alias(name)))
    assert counting(outcome) == {"twin columns": "warning"}
    twin = found(outcome, "twin columns")
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
        assert f"{ratio:.4g} times the first" in found(outcome, "twin columns").what


def test_other_columns_are_no_twins(tmp_path):
    rng = np.random.default_rng(0)
    table = frame().with_columns(
        pl.col(VOLTAGE).cum_max().alias("Maximum Voltage / V"),
        pl.Series("Voltage noise / V", rng.normal(3.7, 1e-3, frame().height)),
        pl.lit(4.2).alias("Voltage limit / V"),
        pl.col(CURRENT).sign().alias("Current direction"),
    )
    assert counting(checked(tmp_path, table)) == {}
