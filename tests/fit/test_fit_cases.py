"""What a fit may claim: by an OCV test, records of few steps tell their resistances too."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest

from barnax import TableSettings, Window, identify
from barnax.fit.intervals import _held_level
from barnax.fit.table_fit import _bound_warning
from barnax.search.answers import AtBound
from helpers.made_cell import SMALL
from helpers.reference import filtered_response
from helpers.shared import CASES, SHARED, needs_cases, needs_data

CELLS = CASES / "cells"
QUICK: dict[str, Any] = {"seeds": 0, "model": "1rc"}
RESISTANCES = {"R0 [Ohm]": 0.030, "R1 [Ohm]": 0.020}


def unfit(result):
    return [str(one) for one in result.warnings if one.code == "role.unfit"]


def interval(result, name):
    estimate = result.constant.assessment.uncertainty[name]
    return estimate.low, estimate.high


@pytest.mark.parametrize(
    ("bound", "values", "said"),
    [
        (AtBound("tau2 [s]", "upper"), {"value_s": 500.0, "side": "upper"}, "bound of 500 s"),
        (AtBound("gamma [1]", "lower"), {"value": 500.0}, "bound of 500: the data do not set it"),
    ],
)
def test_the_bound_of_a_time_constant_is_in_seconds(bound, values, said):
    notice = _bound_warning(bound, 500.0, TableSettings(ocv_correction=False))
    assert notice.values == {"name": bound.name, **values}
    assert said in notice.what


COLUMNS = "current=It:A,voltage=Experimental_Voltage(v):V,time=Experimental_Time(s):s"


@needs_cases
@pytest.mark.slow
@pytest.mark.parametrize(
    ("record", "options", "soc", "ohm"),
    [
        ("07_single_resistor/raw_data.parquet", {"capacity": 1.0}, 0.0, {}),
        ("08_cc_known_ocv/Data.xlsx", {"capacity": 2.5, "columns": COLUMNS}, 1.0, RESISTANCES),
    ],
)
def test_a_load_without_steps_is_answered_by_its_ocv(record, options, soc, ohm):
    path, window = CELLS / record, Window(initial_soc=soc)
    identified = identify(path, ocv=path.parent / "ocv.csv", window=window, **options, **QUICK)
    if not ohm:
        r0_ohm = identified.constant.parameters.tables["R0 [Ohm]"][0]
        assert r0_ohm == pytest.approx(0.1, rel=0.02)
    for name, value in ohm.items():
        low, high = interval(identified, name)
        assert low < value < high
    assert not unfit(identified)


@pytest.fixture(scope="module")
def charged(tmp_path_factory):
    """A charge of a 2 Ah cell with one pause, in mA and minutes: R0 40, R1 25 mOhm, tau 40 s."""
    folder = tmp_path_factory.mktemp("charge")
    time_s = np.arange(0.0, 2700.0, 2.0)
    current_a = np.where((time_s > 1500) & (time_s <= 1800), 0.0, 1.5)
    soc = 0.2 + np.append(0.0, np.cumsum(current_a[1:])) * 2.0 / 3600 / 2
    slow_a = filtered_response(2.0, current_a, 40.0, "backward")
    noise_v = np.random.default_rng(2).normal(0, 1e-3, len(time_s))
    table = {
        "Time / min": time_s / 60,
        "Current / mA": 1e3 * current_a,
        "Voltage / V": 3.2 + 0.9 * soc + 0.040 * current_a + 0.025 * slow_a + noise_v,
    }
    pl.DataFrame(table).write_csv(folder / "charge.csv")
    soc = np.linspace(0, 1, 5)
    pl.DataFrame({"SOC [-]": soc, "OCV [V]": 3.2 + 0.9 * soc}).write_csv(folder / "ocv.csv")
    return folder


def test_a_charge_with_one_pause_is_answered_by_its_ocv(charged):
    actual = identify(
        charged / "charge.csv",
        ocv=charged / "ocv.csv",
        capacity=2.0,
        window=Window(initial_soc=0.2),
        current_sign="charge-positive",
        current_hold="backward",
        **QUICK,
    )
    for name, ohm in (("R0 [Ohm]", 0.040), ("R1 [Ohm]", 0.025)):
        low, high = interval(actual, name)
        assert low < ohm < high
        assert high < 1.2 * low
    assert not unfit(actual)


CALCE = SHARED / "calce-inr18650-20r"


@needs_data
@pytest.mark.slow
@pytest.mark.parametrize("has_test", [False, True])
def test_an_ocv_that_loads_alone_visit_is_not_determined_near_empty(has_test):
    """A test of the same cell rests at 3.298 V where a drive ends; the drive is fitted with more
    than 3.4 V there, for no OCV may fall with rising SOC."""
    test = CALCE / "ocv-incremental_25degC_SP20-3.parquet"
    drive = CALCE / "dst_25degC_80soc_SP20-2.parquet"
    actual = identify(drive, ocv=test if has_test else (), folds=0, **SMALL)
    name = "OCV correction [V]" if has_test else "OCV [V]"
    low = [node for node in actual.fit.of_table(name) if (node.soc or 0.0) <= 0.05]
    assert {node.low for node in low} == {None}
    assert all(
        node.low is not None for node in actual.fit.of_table(name) if 0.1 < (node.soc or 0.0) < 0.9
    )
    notices = [one for one in actual.warnings if one.code == "ocv-test.overruled"]
    assert len(notices) == has_test
    if notices:
        assert notices[0].values["soc"] == 0.0
        assert notices[0].values["moved_v"] > 3.4 - 3.298


@pytest.mark.parametrize(
    ("active_set", "rows"),
    [
        # Of the level at the first node and the steps from node to node, those at their bound.
        ([0, 0, 0, 0, 0], []),
        ([0, 0, -1, 0, 0], [12, 13]),
        ([0, 0, -1, -1, -1], [12, 13, 14]),
        ([0, 0, 0, -1, -1], []),
        ([0, -1, 0, -1, 0], []),
    ],
)
def test_nodes_that_only_a_bound_joins_to_the_lowest_one_are_held(active_set, rows):
    nodes = np.array([-0.02, 0.0, 0.05, 0.08, 0.3])
    objective: Any = SimpleNamespace(
        pairs=2,
        settings=SimpleNamespace(rising_ocv=True),
        reduced=SimpleNamespace(layout=SimpleNamespace(has_correction=True)),
        block=lambda table: slice(11, 16),
        nodes_of=[None, None, None, nodes],
        visited_of=lambda table: nodes >= 0,
    )
    best: Any = SimpleNamespace(active_set=np.array([0] * 11 + active_set))
    assert [*_held_level(objective, best)] == rows
    objective.settings.rising_ocv = False
    assert not [*_held_level(objective, best)]
