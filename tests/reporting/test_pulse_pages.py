"""The pulses of a test in words, tables and CSV."""

import csv
from types import SimpleNamespace

from barnax.pulses import Pulse
from barnax.reporting import wording
from barnax.reporting.pulses import middle_facts, pulses_csv
from helpers.results import make_cell


def pulse(soc, current_a, resistance_ohm, **given):
    values = {
        "record": "hppc.csv", "row": 7, "duration_s": 10.0, "rest_s": 3600.0, "is_limited": False,
        "temperature_degc": 25.0, "delay_s": 0.1,
    }  # fmt: skip
    return Pulse(**(values | given), soc=soc, current_a=current_a, resistance_ohm=resistance_ohm)


PULSES = (
    pulse(0.8, 2.0, (0.05, 0.06, 0.07, None, None)),
    pulse(0.4, 2.0, (0.07, 0.08, 0.09, None, None)),
    pulse(0.79, -1.5, (0.04, 0.05, None, None, None), is_limited=True, rest_s=40.0),
)
RESULT = SimpleNamespace(pulses=PULSES, cell_at=lambda degc: make_cell())


def test_the_first_screen_has_each_rate_in_the_middle_of_soc():
    table = wording.table("pulses.middle", *middle_facts(RESULT))
    assert [column.head for column in table.columns] == [
        "at 50 % SOC [mOhm]", "at once", "2 s", "10 s"
    ]  # fmt: skip
    # No charge pulse lies below 50 %, so that a line of them would be empty.
    assert table.rows == (("discharge at 1C (2 A)", "65.0", "75.0", "85.0"),)


def test_a_resistance_between_pulses_far_apart_is_not_made_up():
    far = (
        pulse(0.86, 2.0, (0.031, None, None, None, None)),
        pulse(0.04, 2.0, PULSES[1].resistance_ohm),
    )
    assert middle_facts(SimpleNamespace(pulses=far, cell_at=RESULT.cell_at)) is None


def test_the_csv_has_every_pulse_and_leaves_empty_what_was_not_measured():
    rows = list(csv.DictReader(pulses_csv(PULSES).decode().splitlines()))
    assert [float(row["SOC"]) for row in rows] == [0.8, 0.4, 0.79]
    assert rows[0]["R(10 s) [Ohm]"] == "0.07"
    assert rows[0]["R(30 s) [Ohm]"] == ""
    assert [row["met a limit"] for row in rows] == ["0", "0", "1"]
