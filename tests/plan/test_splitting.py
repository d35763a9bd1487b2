"""One file that holds a whole schedule is cut into its tests."""

import numpy as np
import polars as pl
import pytest

from barnax.bundled import BUNDLED, bundled_file
from barnax.plan import plan
from barnax.records import read_record
from helpers.made_cell import made
from helpers.records import CURRENT, TIME, VOLTAGE


def charge_to_full():
    """1 A to the cut-off, a taper there, and two hours of rest, every 10 s."""
    amperes = np.concatenate([np.ones(600), np.exp(-np.arange(200) / 60), np.zeros(720)])
    relaxed = 4.18 + 0.02 * np.exp(-np.arange(720) / 60)
    volts = np.concatenate([np.linspace(3.4, 4.2, 600), np.full(200, 4.2), relaxed])
    return pl.DataFrame({TIME: 10.0 * np.arange(1520), CURRENT: amperes, VOLTAGE: volts})


@pytest.fixture(scope="module")
def schedule(tmp_path_factory):
    """An OCV test down and up, a drive cycle, a charge, and another drive cycle, in one file."""
    begin_s, tables = 0.0, []
    files = (BUNDLED.ocv[1], BUNDLED.ocv[0], BUNDLED.record, None, BUNDLED.validation)
    for path in files:
        table = charge_to_full() if path is None else pl.read_parquet(path)
        clock = pl.col(TIME) - table[TIME][0] + begin_s
        tables.append(table.select(clock, CURRENT, VOLTAGE))
        begin_s = tables[-1][TIME][-1] + 10.0
    path = tmp_path_factory.mktemp("schedule") / "schedule.parquet"
    pl.concat(tables).write_parquet(path)
    return path


def test_each_test_of_a_schedule_has_a_separate_role(schedule):
    actual = plan(schedule)
    served = {part.name: part for part in actual.parts if part.role != "not used"}
    assert {name: part.role for name, part in served.items()} == {
        "schedule.parquet#1": "OCV test",
        "schedule.parquet#2": "identification",
        "schedule.parquet#3": "identification",
    }
    # The charge before it ends full, whatever the rest after it was.
    assert served["schedule.parquet#3"].window.initial_soc == 1.0
    begin_s, end_s = served["schedule.parquet#2"].span_s
    assert end_s - begin_s == pytest.approx(5.47 * 3600, rel=0.01)


def test_a_file_of_one_test_stays_whole():
    for path in (bundled_file("hppc_25degC"), BUNDLED.record, *BUNDLED.ocv):
        (part,) = plan(path).parts
        assert part.span_s is None


def test_a_part_keeps_the_sign_and_the_hold_of_its_file(schedule):
    whole = read_record(schedule)
    _, part = plan(schedule).of_role("identification")
    record = read_record(part.source)
    assert (record.sign, record.hold) == (whole.sign, whole.hold)
    assert record.time_s[0] >= part.span_s[0]
    assert record.samples < whole.samples / 3


@pytest.mark.parametrize(
    ("held_v", "last_share", "parts"),
    [(3.9, 0.02, 1), (4.4, 0.02, 2), (4.4, 0.4, 2), (4.4, 0.6, 1)],
)
def test_drives_are_apart_only_where_a_charge_to_full_lies_between(
    held_v, last_share, parts, tmp_path
):
    """By itself the second one would not know where it starts. Near the highest voltage a cell is
    full once its current has fallen to half, at whatever rate that is."""
    first, second = (made(seed, hours=1.2)[0] for seed in (1, 2))
    taper = last_share ** np.linspace(0, 1, 600)
    charge_a = -np.concatenate([np.full(1200, 3.0), 3 * taper, np.zeros(500)])
    current_a = np.concatenate([first.current_a, charge_a, second.current_a])
    held = np.full(len(charge_a), held_v)
    voltage_v = np.concatenate([first.voltage_v, held, second.voltage_v])
    time_s = 0.72 * np.arange(len(current_a))
    path = tmp_path / "log.parquet"
    pl.DataFrame({TIME: time_s, CURRENT: -current_a, VOLTAGE: voltage_v}).write_parquet(path)
    actual = plan(path)
    assert len(actual.of_role("identification")) == parts
