"""What a record can serve as, and the options it then needs."""

import numpy as np
import polars as pl
import pytest

import barnax
from barnax import InputError, bundled_file, check_file
from barnax.checks.check_input import _half_width
from helpers.records import CURRENT, VOLTAGE, checked, frame, logged


def roles(outcome):
    return {role.name: role for role in outcome.roles}


@pytest.mark.parametrize(
    ("name", "capacity_ah", "usable", "role", "words"),
    [
        ("ocv_discharge", 1.0, "identification, validation", "OCV test", "capacity 1 Ah was given"),
        ("identification", 100.0, "", "identification", "1.9 % of the capacity"),
    ],
)
def test_a_record_serves_by_the_capacity_that_is_given(name, capacity_ah, usable, role, words):
    """What the bundled records serve as without one stands in check-clean.txt."""
    outcome = check_file(bundled_file(name), capacity_ah=capacity_ah)
    assert ", ".join(role.name for role in outcome.roles if role.is_usable) == usable
    assert words in roles(outcome)[role].reason


@pytest.mark.parametrize(
    ("name", "noise_v"), [("identification", 0.0), ("identification", 1e-4), ("ocv_charge", 0.0)]
)
def test_a_voltage_that_never_moves_is_named_and_not_the_current(tmp_path, name, noise_v):
    """Nor one that stands still but for a digit of noise."""
    stuck = 3.7 + noise_v * (pl.int_range(pl.len()) % 2)
    table = frame(name).with_columns(stuck.alias(VOLTAGE))
    outcome = checked(tmp_path, table)
    assert "voltage-unit.constant" in {finding.code for finding in outcome.findings}
    for role in outcome.roles[name == "identification" :]:
        assert (role.is_usable, role.half_width) == (False, None)
        assert "every voltage is 3.7 V" in role.reason
    assert outcome.traits.kind(2.0) == outcome.traits.kind(None) == "no test"
    # It is no pulse test either.
    with pytest.raises(InputError, match=r"every voltage in .* is 3\.7"):
        barnax.hppc(table)


def test_a_slow_sweep_is_an_ocv_test_and_nothing_else(tmp_path):
    hours = np.arange(0, 20, 0.01)
    table = logged(hours * 3600, 0 * hours - 0.1, 4.1 - 0.05 * hours)
    outcome = checked(tmp_path, table)
    assert [role.is_usable for role in outcome.roles] == [True, False, False]
    assert "slow discharge, 1.999 Ah" in roles(outcome)["OCV test"].reason
    short = roles(checked(tmp_path, table[:30]))["identification"].reason
    assert "to determine R0; 33 % is needed" in short


@pytest.mark.parametrize(("pulses", "serves"), [(1, False), (6, True)])
def test_steps_serve_by_how_closely_they_tell_the_resistance(tmp_path, pulses, serves):
    """Twelve steps spread over the charge leave less of it between them than two at its ends."""
    time_s = 1.0 * np.arange(3600)
    current_a = np.where(np.mod(pulses * time_s / 3600, 1.0) < 0.9, -1.0, 0.0)
    current_a[0] = current_a[-1] = 0.0
    passed = np.cumsum(current_a) / 3600
    noise_v = np.random.default_rng(0).normal(0, 2e-4, len(time_s))
    table = logged(time_s, current_a, 4.1 + 0.6 * passed + 0.03 * current_a + noise_v)
    actual = roles(checked(tmp_path, table))["identification"]
    assert actual.is_usable == serves, actual.reason


def test_the_predicted_interval_is_that_of_repeated_draws():
    rng = np.random.default_rng(1)
    step_a = np.resize([1.0, -2.0, 3.0], 12)
    draws_v = 0.03 * step_a + rng.normal(0, 5e-3, (2000, 12))
    estimates = draws_v @ step_a / (step_a @ step_a)
    halves = [_half_width(step_a, step_v) for step_v in draws_v]
    held = np.abs(estimates - 0.03) < np.array(halves) * estimates
    # 2,000 draws miss 95 % by less than 2 % nearly always; the scatter of each step is its own.
    assert 0.92 < held.mean() < 0.97


def test_a_record_that_starts_under_load_needs_its_state_of_charge(tmp_path):
    table = frame()
    start = int(np.flatnonzero(np.abs(table[CURRENT].to_numpy()) > 1)[0])
    actual = roles(checked(tmp_path, table[start:]))
    assert actual["identification"].window.options == {}
    assert actual["identification"].window.needs_initial_soc


def whole_test(rest_s=7200, last_a=0.04):
    """A charge to full, a discharge, a rest and the bundled profile, with step numbers."""
    profile = frame()
    taper = last_a ** np.linspace(0, 1, 2000)
    pieces = [
        (1, np.zeros(600), np.full(600, 3.9)),
        (2, np.ones(1000), np.linspace(4.0, 4.2, 1000)),
        (3, taper, np.full(2000, 4.2)),
        (4, np.zeros(3600), np.linspace(4.19, 4.178, 3600)),
        (5, np.full(1440, -1.0), np.linspace(4.1, 3.9, 1440)),
        (6, np.zeros(rest_s), np.linspace(3.93, 3.95, rest_s)),
        (7, profile[CURRENT].to_numpy(), profile[VOLTAGE].to_numpy()),
    ]
    step = np.concatenate([np.full(len(current), number) for number, current, _ in pieces])
    current_a = np.concatenate([current for _, current, _ in pieces])
    voltage_v = np.concatenate([voltage for *_, voltage in pieces])
    table = logged(1.0 * np.arange(len(step)), current_a, voltage_v)
    return table.with_columns(pl.Series("Step Index / 1", step))


@pytest.mark.parametrize(("rest_s", "last_a"), [(60, 0.04), (7200, 0.04), (7200, 0.4)])
def test_a_whole_test_is_cut_to_its_profile_from_the_full_cell_on(tmp_path, rest_s, last_a):
    role = roles(checked(tmp_path, whole_test(rest_s, last_a)))["identification"]
    assert role.window.options == {"start_after_step": 3, "initial_soc": 1, "score_steps": (7,)}
    assert "the cell is full at the end of step 3" in role.reason
    assert ("too short to settle" in role.reason) == (rest_s < 1800)


def test_a_table_of_ocv_over_soc_serves_as_ocv_test_only(tmp_path):
    path = tmp_path / "ocv.csv"
    path.write_text("SOC [-],OCV [V]\n0,3.0\n0.3,3.5\n0.6,3.7\n1,4.2\n")
    outcome = check_file(path)
    assert outcome.is_clean
    assert [role.is_usable for role in outcome.roles] == [True, False, False]
    assert roles(outcome)["OCV test"].reason == (
        "4 points, SOC 0 to 1, 3.000 to 4.200 V, rising throughout; give it with `ocv`"
    )
    path.write_text("SOC [-],OCV [V]\n0,3.0\n0.3,3.5\n0.6,3.4\n1,4.2\n")
    (finding,) = check_file(path).findings
    assert (finding.severity, finding.row) == ("warning", 4)
    assert finding.what == "the OCV falls from 3.5000 V at SOC 0.3 to 3.4000 V at SOC 0.6"


def test_a_slow_sweep_beside_steps_is_to_be_cut(tmp_path):
    sweep_s = np.arange(0, 72_000.0, 36)
    steps_s = sweep_s[-1] + 36 + np.arange(3000.0)
    steps_a = np.where(np.arange(3000) // 30 % 2 == 0, -0.5, 0.5)
    current_a = np.concatenate([0 * sweep_s - 0.1, steps_a])
    time_s = np.concatenate([sweep_s, steps_s])
    soc = 1 + np.cumsum(current_a * np.diff(time_s, prepend=0)) / 3600 / 2
    table = logged(time_s, current_a, 3.1 + soc + 0.05 * current_a)
    reason = roles(checked(tmp_path, table))["identification"].reason
    assert reason.startswith("it holds a slow sweep beside ")
