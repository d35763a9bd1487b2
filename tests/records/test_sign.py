"""The sign of a file's current is found from the data, and its names are believed last."""

import numpy as np
import polars as pl
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from barnax.records import Decision, read_record, record_from_frame
from barnax.records.sign import _weighed
from helpers.records import (
    CURRENT,
    TIME,
    VOLTAGE,
    logged,
    pulses_a,
    scaled,
    simulated_cell,
    with_counters,
)

SIGNS = ["charge-positive", "discharge-positive"]
# A format that promises the sign, and names that are usual for the other one.
NAMES = {
    "charge-positive": {},
    "discharge-positive": {
        TIME: "Time [s]",
        CURRENT: "Current [A]",
        VOLTAGE: "Terminal voltage [V]",
    },
}


def written(folder, current_a, voltage_v, sign, *, interval_s=1.0, names=None, counters=False):
    """A file of a discharge-positive current under the given sign."""
    table = logged(np.arange(len(current_a)) * interval_s, -current_a, voltage_v)
    table = with_counters(table) if counters else table
    table = table if sign == "charge-positive" else scaled(table, CURRENT, -1.0)
    path = folder / "cell.parquet"
    table.rename(names or {}).write_parquet(path)
    return path


@given(
    seed=st.integers(0, 2**32 - 1),
    sign=st.sampled_from(SIGNS),
    r0=st.floats(0.01, 0.2),
    amplitude_a=st.floats(0.2, 20),
    noise_v=st.floats(0, 1e-3),
)
def test_pulses_of_a_cell_give_their_sign_away(
    tmp_path_factory, seed, sign, r0, amplitude_a, noise_v
):
    # A jump of a fifth of the amplitude must stand out of the noise for anyone to see it.
    assume(r0 * amplitude_a > 20 * noise_v)
    current = pulses_a(300, amplitude_a, seed=seed)
    noise = noise_v * np.random.default_rng(seed).standard_normal(300)
    voltage = simulated_cell(current, r0=r0, capacity_ah=amplitude_a) + noise
    decision = read_record(written(tmp_path_factory.mktemp("sign"), current, voltage, sign)).sign
    assert (decision.value, decision.strength) == (sign, "strong")


@pytest.mark.parametrize("sign", SIGNS)
@pytest.mark.parametrize("direction", [1, -1])
def test_a_slow_sweep_gives_its_sign_away_by_its_trend(tmp_path, sign, direction):
    current = np.full(1000, direction * 2.0 / 30)
    voltage = simulated_cell(current, 100.0, soc=0.5 + 0.45 * direction)
    decision = read_record(written(tmp_path, current, voltage, sign, interval_s=100.0)).sign
    assert (decision.value, decision.strength) == (sign, "strong")
    assert "sustained" in decision.reason


@pytest.mark.parametrize("sign", SIGNS)
def test_counters_give_the_sign_away_where_the_voltage_does_not(tmp_path, sign):
    current = pulses_a(300)
    path = written(tmp_path, current, np.full(300, 3.3), sign, counters=True)
    decision = read_record(path).sign
    assert (decision.value, decision.strength) == (sign, "strong")
    assert "counters" in decision.reason


@pytest.mark.parametrize("sign", SIGNS)
def test_of_evidence_that_weighs_the_same_the_first_look_decides(sign):
    """The voltage is physics, the counters are names."""
    (other,) = set(SIGNS) - {sign}
    looks = Decision(sign, "strong", "the voltage"), Decision(other, "strong", "the counters")
    decision = _weighed(looks)
    assert (decision.value, decision.strength) == (sign, "weak")
    assert decision.reason == "the voltage; against it: the counters"


@pytest.mark.parametrize("promised", SIGNS)
def test_names_decide_only_where_the_data_say_nothing_and_with_a_warning(tmp_path, promised):
    path = written(
        tmp_path, pulses_a(300), np.full(300, 3.3), "charge-positive", names=NAMES[promised]
    )
    record = read_record(path)
    assert (record.sign.value, record.sign.strength) == (promised, "assumed")
    assert "sign.doubtful" in {each.code for each in record.warnings}


def test_a_sign_given_against_weak_evidence_is_taken_with_a_warning(tmp_path):
    current = np.zeros(100)
    current[50:54] = 1.0
    voltage = np.full(100, 3.7)
    voltage[50:] -= 0.05
    path = written(tmp_path, current, voltage, "charge-positive")
    assert read_record(path).sign.strength == "weak"
    record = read_record(path, current_sign="discharge-positive")
    assert (record.sign.value, record.sign.strength) == ("discharge-positive", "given")
    assert "sign.against-data" in {each.code for each in record.warnings}


def test_a_rest_of_pure_noise_is_never_strong_evidence(tmp_path):
    for seed in range(40):
        rng = np.random.default_rng(seed)
        voltage = 3.7 + 2e-4 * rng.standard_normal(100) + 1e-5 * np.arange(100)
        path = written(tmp_path, 2e-3 * rng.standard_normal(100), voltage, "charge-positive")
        assert read_record(path).sign.strength != "strong"


@pytest.mark.parametrize("sign", SIGNS)
@pytest.mark.parametrize("late", [0, 1])
def test_the_record_as_a_whole_tells_the_sign_where_rows_are_late_and_uneven(tmp_path, sign, late):
    rng = np.random.default_rng(late)
    # Spikes of one row: a voltage that is a row late rises at every step down that it is clear at.
    current = np.where(rng.random(2000) < 0.1, 3.0, 0.5)
    voltage = simulated_cell(current, capacity_ah=0.6, soc=0.95)
    voltage = np.pad(voltage, (late, 0), "edge")[: len(current)]
    path = written(tmp_path, current, voltage, sign)
    uneven = pl.Series("Test Time / s", np.cumsum(rng.uniform(0.6, 1.4, len(current))))
    pl.read_parquet(path).with_columns(uneven).write_parquet(path)
    assert read_record(path).sign.value == sign


SAYING = {
    "Current (charge positive) [A]": "charge-positive",
    "Current (A), discharge positive": "discharge-positive",
    "Current [mA] (+ = charge)": "charge-positive",
    "current_a_discharge_negative": "charge-positive",
    "I / A (positive for charging)": "charge-positive",
}


@pytest.mark.parametrize("is_silent", [True, False], ids=["silent", "contrary"])
@pytest.mark.parametrize("name", SAYING)
def test_a_name_that_says_its_sign_holds_unless_the_data_deny_it(name, is_silent):
    ampere = 1e-3 if "mA" in name else 1.0
    out_a = np.ones(300) if is_silent else pulses_a(300, 2.0, seed=0)
    voltage_v = 3.7 + 1e-3 * (np.arange(300) % 2) if is_silent else simulated_cell(out_a)
    # The data have the other sign than the name.
    way = 1 if is_silent or SAYING[name] == "charge-positive" else -1
    table = {"Time (s)": np.arange(300.0), name: way * out_a / ampere, "Voltage (V)": voltage_v}
    record = record_from_frame(table)
    assert (record.sign.value == SAYING[name]) is is_silent
    np.testing.assert_allclose(np.abs(record.current_a), np.abs(out_a))
    said = [one.values["column"] for one in record.warnings if one.code == "sign.unusual"]
    assert said == ([] if is_silent else [name])
