"""Channels that spike, stick, clip, drift or have lost their sign."""

import numpy as np
import polars as pl
import pytest

from barnax.bundled import BUNDLED_NAMES
from helpers.records import (
    CURRENT,
    TIME,
    VOLTAGE,
    changed,
    checked,
    counting,
    found,
    frame,
    simulated_cell,
)

DRIVES = ("identification", "validation")
ROWS = np.arange(3000, 3400)


def array(table, column):
    return table[column].to_numpy()


@pytest.mark.parametrize("name", BUNDLED_NAMES)
@pytest.mark.parametrize(("column", "height"), [(VOLTAGE, 0.5), (VOLTAGE, -0.4), (CURRENT, 8.0)])
@pytest.mark.parametrize("width", [1, 2, 3])
def test_a_spike_is_found_at_its_row(tmp_path, name, column, height, width):
    table = frame(name)
    line = 3001 if name != "ocv_charge" else 4001
    lines = np.arange(line, line + width)
    diagnosis = checked(
        tmp_path, changed(table, column, array(table, column)[lines] + height, lines)
    )
    channel = "voltage" if column == VOLTAGE else "current"
    assert counting(diagnosis) == {f"{channel} spikes": "warning"}
    assert found(diagnosis, f"{channel} spikes").row == line + 2
    assert f"({width} sample" in found(diagnosis, f"{channel} spikes").what


def test_a_short_pulse_that_the_voltage_answers_is_no_spike(tmp_path):
    current_a = np.where(np.arange(3000) % 100 == 50, 4.0, 0.5 * (np.arange(3000) // 500 % 2))
    voltage_v = simulated_cell(current_a)
    table = pl.DataFrame({TIME: np.arange(3000.0), CURRENT: -current_a, VOLTAGE: voltage_v})
    assert checked(tmp_path, table).is_clean


@pytest.mark.parametrize("name", DRIVES)
def test_a_voltage_that_stands_still_under_load_is_found(tmp_path, name):
    table = frame(name)
    diagnosis = checked(tmp_path, changed(table, VOLTAGE, array(table, VOLTAGE)[3000], ROWS))
    assert counting(diagnosis) == {"stuck voltage": "error"}
    assert found(diagnosis, "stuck voltage").row == pytest.approx(3003, abs=2)
    assert "`score_from`" in found(diagnosis, "stuck voltage").remedy


@pytest.mark.parametrize("stuck_a", [0.0, 0.5538])
@pytest.mark.parametrize("name", DRIVES)
def test_a_current_that_stands_still_while_the_voltage_jumps_is_found(tmp_path, name, stuck_a):
    diagnosis = checked(tmp_path, changed(frame(name), CURRENT, stuck_a, ROWS))
    assert counting(diagnosis) == {"stuck current": "error"}
    assert found(diagnosis, "stuck current").row == pytest.approx(3002, abs=2)


@pytest.mark.parametrize("name", BUNDLED_NAMES)
def test_a_clipped_voltage_is_found(tmp_path, name):
    table = frame(name)
    diagnosis = checked(tmp_path, changed(table, VOLTAGE, np.clip(array(table, VOLTAGE), 3.3, 3.9)))
    assert "stops at" in found(diagnosis, "stuck voltage").what
    assert "wider range" in found(diagnosis, "stuck voltage").remedy


@pytest.mark.parametrize("name", DRIVES)
def test_a_clipped_current_is_found_at_both_ends(tmp_path, name):
    table = frame(name)
    table = changed(table, CURRENT, np.clip(array(table, CURRENT), -1.5, 1.5))
    clipped = [
        finding.what
        for finding in checked(tmp_path, table).findings
        if finding.check == "clipped current"
    ]
    assert [what.split(":")[0] for what in clipped] == [
        "the current stops at -1.5 A",
        "the current stops at 1.5 A",
    ]


def test_a_held_voltage_is_not_stuck(tmp_path):
    # 4.2 V held to the last digit while the charging current tapers, then rest.
    seconds = np.arange(9000.0)
    current_a = np.where(seconds < 3000, 1.0, np.exp(-(seconds - 3000) / 900))
    current_a[seconds >= 7000] = 0.0
    voltage_v = np.where(seconds < 3000, 3.9 + 0.3 * seconds / 3000, 4.2)
    voltage_v[seconds >= 7000] = 4.19
    for start in range(0, 2000, 200):
        current_a[start : start + 20] = 0.0
        voltage_v[start : start + 20] -= 0.06
    table = pl.DataFrame({TIME: seconds, CURRENT: np.round(current_a, 3), VOLTAGE: voltage_v})
    assert not counting(checked(tmp_path, table)).keys() & {"stuck voltage", "stuck current"}


@pytest.mark.parametrize("name", BUNDLED_NAMES)
@pytest.mark.parametrize("offset_a", [0.05, -0.05, 0.005])
def test_a_current_offset_at_rest_is_found_with_its_size(tmp_path, name, offset_a):
    table = frame(name)
    diagnosis = checked(tmp_path, changed(table, CURRENT, array(table, CURRENT) + offset_a))
    rests = found(diagnosis, "rests")
    assert rests.severity == "warning"
    size_ma = float(rests.what.removeprefix("the current is ").split(" mA")[0])
    assert size_ma == pytest.approx(1e3 * offset_a, abs=1.0)
    # Past C/100 barnax would not see the rests.
    assert ("`rest_current" in rests.remedy) == (abs(offset_a) > 0.02)


def test_a_noisy_rest_is_a_note_with_the_limit(tmp_path):
    table = frame("ocv_discharge")
    noise_a = np.random.default_rng(0).normal(0, 0.012, table.height)
    diagnosis = checked(
        tmp_path, changed(table, CURRENT, array(table, CURRENT) + noise_a), capacity_ah=2.0
    )
    assert "`rest_current" in found(diagnosis, "rests").remedy
    assert found(diagnosis, "rests").severity == "note"


@pytest.mark.parametrize("name", DRIVES)
def test_a_current_without_a_sign_is_an_error(tmp_path, name):
    table = frame(name)
    diagnosis = checked(tmp_path, changed(table, CURRENT, np.abs(array(table, CURRENT))))
    assert counting(diagnosis) == {"sign": "error"}
    assert "the column has no sign" in found(diagnosis, "sign").what


@pytest.mark.parametrize("name", BUNDLED_NAMES)
def test_a_sign_that_turns_is_found_where_it_does(tmp_path, name):
    table = frame(name)
    half = table.height // 2
    turned = np.where(np.arange(table.height) < half, 1.0, -1.0) * array(table, CURRENT)
    diagnosis = checked(tmp_path, changed(table, CURRENT, turned))
    assert counting(diagnosis) == {"sign": "error"}
    # The first clear step after the turn, or the turn's own.
    assert 0 <= found(diagnosis, "sign").row - half < 500
    assert "split the file here" in found(diagnosis, "sign").remedy


def test_a_sign_against_the_names_is_a_warning_with_the_option(tmp_path):
    table = frame()
    sign = found(checked(tmp_path, changed(table, CURRENT, -array(table, CURRENT))), "sign")
    assert sign.severity == "warning"
    assert "--current-sign discharge-positive" in sign.remedy


def test_a_sign_that_names_promise_nothing_of_is_a_note(tmp_path):
    table = frame().rename({TIME: "time", CURRENT: "current", VOLTAGE: "voltage"})
    diagnosis = checked(tmp_path, changed(table, "current", -array(table, "current")))
    assert diagnosis.is_clean
    assert "discharge-positive" in found(diagnosis, "sign").what


def test_a_sign_that_the_data_do_not_tell_is_a_warning(tmp_path):
    current_a = np.tile([0.0, 1.0], 50)
    table = pl.DataFrame({TIME: np.arange(100.0), CURRENT: current_a, VOLTAGE: 0 * current_a + 3.7})
    sign = found(checked(tmp_path, table), "sign")
    assert (sign.severity, sign.remedy) == ("warning", "say so: --current-sign charge-positive")


def test_a_temperature_no_cell_has_is_a_warning(tmp_path):
    table = frame().with_columns(pl.lit(-273.15).alias("Surface Temperature / degC"))
    assert counting(checked(tmp_path, table)) == {"temperature": "warning"}


def test_coarse_readings_are_a_note(tmp_path):
    table = frame().with_columns(pl.col(VOLTAGE).round(2), pl.col(CURRENT).round(2))
    diagnosis = checked(tmp_path, table)
    assert diagnosis.is_clean
    assert "voltage in steps of 10 mV" in found(diagnosis, "resolution").what
