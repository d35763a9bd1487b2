"""A record that is not of the cell of the OCV test, or not in the units it says, is found."""

from dataclasses import replace

import pytest

from barnax.bundled import BUNDLED
from barnax.cell import characterize
from barnax.checks.against_cell import (
    compare_resistances,
    compare_with_cell,
)
from barnax.records import read_record


@pytest.fixture(scope="module")
def validation_record():
    return read_record(BUNDLED.validation)


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
    bundled_record, validation_record, bundled_cell, quantity, factor, meaning
):
    for record in (bundled_record, validation_record):
        wrong = replace(record, **{quantity: factor * getattr(record, quantity)})
        (text,) = said(wrong, bundled_cell)
        assert meaning in text


@pytest.mark.parametrize("factor", [1.3, 0.75])
def test_a_wrong_capacity_is_measured(bundled_record, bundled_cell, factor):
    (text,) = said(bundled_record, bundled_cell, capacity_ah=2.0 * factor)
    held_ah = float(text.partition("as if the cell held ")[2].split()[0])
    assert held_ah == pytest.approx(2.0, rel=0.06)


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


def test_an_ocv_test_of_another_chemistry_is_found(real_data, bundled_record):
    tests = [read_record(path) for path in real_data.glob("plett*/ocv-s[13]*")]
    (text,) = said(bundled_record, characterize(tests, ocv_fit="interpolated"))
    assert "whatever its unit" in text


@pytest.mark.parametrize("degc", ["25degC", "_0degC"])
def test_measured_records_of_one_cell_have_resistances_alike(real_data, degc):
    for folder, names in (("lg-hg2-18650", "[hlmu]*"), ("calce-inr18650-20r", "[du]*")):
        paths = [each for each in (real_data / folder).glob(names) if degc in each.name]
        assert len(paths) >= 2
        assert compare_resistances([(read_record(each), None) for each in paths]) == []
