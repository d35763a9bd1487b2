"""What identify advises ends the matter: followed, it is not advised again, nor its opposite."""

import re

import numpy as np
import polars as pl
import pytest

import barnax
from barnax import InputError, Job, Reading
from barnax.cli.options import windows_of
from barnax.inputs import InputFile, read_inputs, require_voltages, warnings_about
from barnax.records import source_from_frame
from checks.test_findings import CAPACITY_AH, FAULTS
from helpers.records import CURRENT, TIME, VOLTAGE, frame, scaled, with_counters

OPTION = re.compile(r"`([a-z_]+)=([^`]+)`")
HOW_READ = {"current_sign": str, "current_hold": str, "columns": str, "voltage_lag": float}
MORE = {
    "counters that prove the other hold": with_counters(frame()).with_columns(
        pl.col("Charging Capacity / Ah", "Discharging Capacity / Ah").shift(-1, fill_value=0.0)
    ),
    "an offset that hides the rests": frame("ocv_discharge").with_columns(pl.col(CURRENT) - 0.03),
    "a record within a test": frame()[4000:],
}
# What leads to a gap or a break is told with options whose values are the user's.
TABLES = {name: table for name, (table, found) in FAULTS.items() if found} | MORE


def warned(table, cell, capacity_ah, given):
    """What identify says of a record before it searches; an error is the only thing said."""
    how = {
        name: HOW_READ[name](value.strip("'")) for name, value in given.items() if name in HOW_READ
    }
    others = {name: [value] for name, value in given.items() if name not in HOW_READ}
    window = windows_of(others) or None
    source = source_from_frame(table, "cell", columns=how.get("columns", ""))
    try:
        given = {"capacity": capacity_ah, "window": window, "cell": cell}
        inputs = read_inputs(Job(source, **given, **how))
    except InputError as problem:
        return [str(problem)]
    return [str(each) for each in inputs.warnings]


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] if name in FAULTS and index % 3 else [])
        for index, name in enumerate(TABLES)
    ],
)
def test_advice_is_not_given_again_once_it_is_followed(name, bundled_cell):
    table, capacity_ah = TABLES[name], CAPACITY_AH.get(name)
    given: dict[str, str] = {}
    for _ in range(3):
        texts = warned(table, bundled_cell, capacity_ah, given)
        assert not any("barnax check" in text for text in texts)
        advised = dict(OPTION.findall(" ".join(texts)))
        # An option that was given is in nobody's advice any more, whatever its value.
        assert not advised.keys() & given.keys()
        if not advised:
            break
        given |= advised
    assert not advised


def test_what_lies_outside_the_window_is_reported_no_more(bundled_cell):
    gap = FAULTS["a gap under load"][0]
    assert any("a gap of" in text for text in warned(gap, bundled_cell, None, {}))
    for option, value in (("score_to", "2900"), ("start_time", "3700")):
        given = {option: value, "initial_soc": "0.8"}
        assert not any("a gap of" in text for text in warned(gap, bundled_cell, None, given))
    assert np.diff(gap["Test Time / s"].to_numpy()).max() > 600


DRIVE = frame()
# What a record is damaged by, what is said of it, and the option that mends it, if one does.
DAMAGED = {
    "counters prove that the current is half": (
        scaled(with_counters(DRIVE), CURRENT, 0.5),
        "the current is 0.5 times what the tester counted, throughout",
        "",
    ),
    "its time is in minutes": (
        scaled(DRIVE, TIME, 1 / 60),
        "'Test Time / s' looks like minutes",
        "`columns='time=Test Time / s:min'`",
    ),
    "two voltages differ by a lead": (
        DRIVE.with_columns((pl.col(VOLTAGE) + 0.02 * pl.col(CURRENT)).alias("Voltage 2 [V]")),
        "differ by 20 mohm times the current",
        "`columns='voltage=Voltage 2 [V]'`",
    ),
    "a capacity that it does not have": (
        scaled(DRIVE, CURRENT, 0.75),
        "as if the cell held 1.5",
        "`capacity`",
    ),
}


@pytest.mark.parametrize("role", ["identification", "validation"])
@pytest.mark.parametrize("name", DAMAGED)
def test_what_check_reports_is_said_of_every_record_with_what_mends_it(name, role, bundled_cell):
    table, what, remedy = DAMAGED[name]
    if role == "identification":
        texts = warned(table, bundled_cell, None, {})
    else:
        source = source_from_frame(table, "cell")
        try:
            file = InputFile.of(source, "validation", Reading())
            require_voltages([file.content])
            texts = map(str, warnings_about([file], bundled_cell, None, None, Reading()))
        except InputError as problem:
            texts = [str(problem)]
    (text,) = [each for each in texts if what in each]
    assert remedy in text


def test_an_error_that_a_damaged_record_leads_to_stands_before_its_findings(bundled_cell):
    table = scaled(frame("validation"), CURRENT, 2)
    with pytest.raises(InputError) as problem:
        barnax.identify(source_from_frame(table, "cell"), cell=bundled_cell, seeds=0)
    first, *others = str(problem.value).splitlines()
    assert "its charge does not fit its voltage: by it the cell is empty before row" in first
    assert any("the current were twice what flowed" in text for text in others)
