"""A record that is not of the cell of the OCV test, or not in the units it says, is found."""

from dataclasses import replace

import numpy as np
import pytest

from barnax import Notice, characterize, read_record
from barnax.checks.against_cell import (
    compare_resistances,
    compare_temperatures,
    compare_with_cell,
    follow,
)


def said(record, cell, **options):
    return [f"{each.severity}: {each.what}" for each in compare_with_cell(record, cell, **options)]


@pytest.mark.parametrize(
    ("quantity", "factor", "meaning"),
    [
        ("time_s", 1 / 60, "60 times the charge: its time is in minutes"),
        ("time_s", 1 / 3600, "3600 times the charge: its time is in hours"),
        ("current_a", 1000.0, "0.001 times the charge: its current is in mA"),
        ("current_a", 1e-3, "1000 times the charge: its current is a thousand times too small"),
        ("current_a", 0.5, "held 1 Ah, not 2 Ah, or the current were half of what flowed"),
        ("current_a", 2.0, "held 4 Ah, not 2 Ah, or the current were twice what flowed"),
    ],
)
def test_a_wrong_unit_is_named_by_the_voltage_that_its_charge_should_move(
    bundled_record, bundled_validation, bundled_cell, quantity, factor, meaning
):
    for record in (bundled_record, bundled_validation):
        wrong = replace(record, **{quantity: factor * getattr(record, quantity)})
        (told,) = compare_with_cell(wrong, bundled_cell)
        assert meaning in told.what
        # A mistake of unit is none of capacity.
        assert ("capacity_ah" in told.values) == ("held" in meaning)


def test_no_unit_is_blamed_for_a_voltage_that_never_moves(bundled_record, bundled_cell):
    dead = replace(bundled_record, voltage_v=np.full(bundled_record.samples, 3.7))
    assert compare_with_cell(dead, bundled_cell) == []


@pytest.mark.parametrize("factor", [1.3, 0.75])
def test_a_wrong_capacity_is_measured(bundled_record, bundled_cell, factor):
    (text,) = said(bundled_record, bundled_cell, capacity_ah=2.0 * factor)
    held_ah = float(text.partition("as if the cell held ")[2].split()[0])
    assert held_ah == pytest.approx(2.0, rel=0.06)


def partly(cell, lowest_soc):
    """The cell of the same OCV test that stopped above a state of charge."""
    points = {
        branch: tuple(point for point in getattr(cell, branch) if point.soc >= lowest_soc)
        for branch in ("charge_points", "discharge_points")
    }
    return replace(cell, **points)


def test_a_record_that_goes_below_an_ocv_test_is_as_near_to_it_as_to_the_whole(
    bundled_record, bundled_cell
):
    whole_v = follow(bundled_record, bundled_cell, 2.0)(1.0)
    assert follow(bundled_record, partly(bundled_cell, 0.5), 2.0)(1.0) <= whole_v


def test_a_record_of_more_charge_than_a_test_is_reported_with_both_as_the_test_may_be_a_part(
    bundled_record, bundled_cell
):
    axis = replace(partly(bundled_cell, 0.5), capacity_ah=1.0)
    half = {
        branch: tuple(replace(point, soc=2 * point.soc - 1) for point in getattr(axis, branch))
        for branch in ("charge_points", "discharge_points")
    }

    def stretched(curve):
        return lambda soc: curve((soc + 1) / 2)

    curves = {name: stretched(getattr(axis, name)) for name in ("charge", "discharge")}
    cell = replace(axis, **half, **curves)
    (text,) = said(bundled_record, cell)
    assert "another cell: its charge goes beyond full and empty, whatever its unit" in text
    sweep = {"direction": "discharge", "first_v": 4.2, "last_v": 3.7, "passed_ah": 1.0}
    assumed = Notice("ocv-test.capacity-assumed", {**sweep, "ends": "full"}, "ocv.csv")
    (text,) = said(bundled_record, replace(cell, warnings=(assumed,)))
    assert text.startswith("error: it spans 1.88")
    assert "and the OCV test 1 Ah" in text
    assert "covers only a part of the SOC" in text


def test_records_of_the_cell_are_in_no_doubt(bundled_record, bundled_validation, bundled_cell):
    for record in (bundled_record, bundled_validation):
        assert said(record, bundled_cell) == []


def test_measured_records_follow_the_ocv_test_of_their_cell(real_data):
    for folder, tests, drives in (
        ("calce-inr18650-20r", "ocv-incremental_25*", "*_25degC_?0soc*"),
        ("plett-a123-26650", "ocv-s[13]*", "dyn-s1*"),
        ("nissan-leaf-lmo-33ah", "hppc*", "hppc*"),
        # A drive in the cold leaves the OCV by far more than its steps show.
        ("lg-hg2-18650", "c20_0degC*", "us06_0degC*"),
        ("lg-hg2-18650", "c20_minus10degC*", "us06_minus10degC*"),
    ):
        records = [read_record(path) for path in (real_data / folder).glob(tests)]
        cell = characterize(records, ocv_fit="interpolated")
        for path in (real_data / folder).glob(drives):
            assert said(read_record(path), cell) == []


def test_an_ocv_test_of_another_chemistry_is_detected(real_data, bundled_record):
    tests = [read_record(path) for path in real_data.glob("plett*/ocv-s[13]*")]
    (text,) = said(bundled_record, characterize(tests, ocv_fit="interpolated"))
    assert "whatever its unit" in text


def test_temperatures_far_from_every_ocv_test_are_reported():
    tests = [("ocv-0.csv", 0.4), ("ocv-45.csv", 45.0), ("ocv.csv", None)]
    records = [("warm.csv", 25.0), ("cold.csv", -10.0), ("near.csv", 2.0), ("unknown.csv", None)]
    warm, cold = compare_temperatures(records, tests)
    assert (warm.subject, warm.values["other"]) == ("warm.csv", "ocv-45.csv")
    assert (cold.subject, cold.values["other_degc"]) == ("cold.csv", 0.4)
    assert str(warm).startswith("warm.csv: was measured at 25 degC, the OCV test ocv-45.csv at 45")
    assert compare_temperatures(records, tests[2:]) == []


def test_a_record_in_fahrenheit_is_reported_beside_a_test_in_celsius_and_a_cold_one_alone():
    warm, cold = compare_temperatures([("drive", 77.0), ("cold", -20.0)], [("ocv", 25.0)])
    assert (warm.code, warm.values["of"], cold.values["of"]) == (
        "cell.temperature", "fahrenheit", "test"
    )  # fmt: skip
    assert warm.values["fahrenheit_degc"] == pytest.approx(25.0)


def test_a_record_of_another_resistance_among_some_is_named(bundled_record, bundled_validation):
    more_v = bundled_validation.voltage_v - 0.06 * bundled_validation.current_a
    other = replace(bundled_validation, name="other.csv", voltage_v=more_v)
    two = [(bundled_record, 25.0), (bundled_validation, None)]
    assert compare_resistances(two) == []
    (told,) = compare_resistances([(other, 25.0), *two])
    assert (told.code, told.subject) == ("answer.other-resistance", "other.csv")
    apart_ohm = float(told.values["own_ohm"]) - float(told.values["other_ohm"])
    assert apart_ohm == pytest.approx(0.06, rel=0.05)
    # Of two none is the usual one.
    assert len(compare_resistances([(other, 25.0), two[0]])) == 1
    # At another temperature it may have it.
    assert compare_resistances([(other, 0.0), (bundled_record, 25.0)]) == []


@pytest.mark.parametrize("degc", ["25degC", "_0degC"])
def test_measured_records_of_one_cell_have_resistances_alike(real_data, degc):
    for folder, names in (("lg-hg2-18650", "[hlmu]*"), ("calce-inr18650-20r", "[du]*")):
        paths = [each for each in (real_data / folder).glob(names) if degc in each.name]
        assert len(paths) >= 2
        assert compare_resistances([(read_record(each), None) for each in paths]) == []
