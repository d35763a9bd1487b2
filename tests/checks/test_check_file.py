"""The check as a whole: nothing hides behind anything, and it agrees with the reader."""

import json

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

import barnax.records.source
from barnax.bundled import BUNDLED_NAMES, bundled_file
from barnax.checks import check_file
from barnax.errors import InputError
from barnax.records import read_record, read_source, source_from_frame
from helpers.records import CURRENT, TIME, VOLTAGE, changed, checked, counting, frame


@pytest.mark.parametrize("name", BUNDLED_NAMES)
@pytest.mark.parametrize("capacity_ah", [None, 2.0])
def test_the_bundled_records_are_clean(name, capacity_ah):
    assert check_file(bundled_file(name), capacity_ah=capacity_ah).is_clean


def test_one_read_of_a_file_gives_its_record_and_its_check(tmp_path, monkeypatch):
    path = tmp_path / "cell.csv"
    frame().write_csv(path)
    source = read_source(path)
    expected = check_file(path), read_record(path).sha256
    monkeypatch.setattr(barnax.records.source, "read_table", None)
    path.unlink()
    assert (check_file(source), read_record(source).sha256) == expected


def test_many_faults_are_all_found_at_once(tmp_path):
    table = frame()
    table = changed(table, VOLTAGE, np.nan, [77])
    table = changed(table, TIME, 12.5, [500])
    table = changed(table, CURRENT, -1000 * table[CURRENT].to_numpy())
    table = changed(table, VOLTAGE, table[VOLTAGE].to_numpy() * 1000)
    table = changed(table, VOLTAGE, 4500.0, [3001])
    outcome = checked(tmp_path, pl.concat([table[:9000], table[9600:]]))
    assert counting(outcome) == {
        "cells": "error",
        "clock": "error",
        "voltage unit": "error",
        "unit": "error",
        "sign": "warning",
        "spikes": "warning",
        "gaps": "warning",
    }
    severities = [finding.severity for finding in outcome.findings]
    assert severities == sorted(severities, key=["error", "warning", "note"].index)


@pytest.mark.parametrize("capacity_ah", [0.0, float("nan")])
def test_a_capacity_that_is_none_is_refused(capacity_ah):
    with pytest.raises(InputError, match="`capacity` must be positive"):
        check_file(bundled_file("validation"), capacity_ah=capacity_ah)


@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(10, 300))
def test_a_rough_record_of_any_shape_is_checked_without_a_crash(tmp_path_factory, seed, rows):
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.integers(-6, 7, 3)
    levels = rng.choice([0.0, 1.0, -1.0, 0.02, rng.normal()], rows // 3 + 1)
    table = pl.DataFrame(
        {
            TIME: np.cumsum(rng.choice([0.0, 1.0, 1.0, 10.0, -5.0], rows)) * scale[0],
            CURRENT: np.repeat(levels, 3)[:rows] * scale[1],
            VOLTAGE: rng.choice([3.7, 4.2, rng.uniform(2, 4)], rows) * scale[2],
            "Step Index / 1": rng.integers(0, 4, rows),
        }
    )
    assert json.dumps(checked(tmp_path_factory.mktemp("rough"), table).to_dict())


def test_rows_of_a_testers_own_file_are_deleted_in_an_export():
    voltage_v = frame()[VOLTAGE].to_numpy()
    source = source_from_frame(changed(frame(), VOLTAGE, voltage_v[700] + 0.3, 700), "cell.nda")
    remedies = [each.remedy for each in check_file(source).findings]
    assert "export it as CSV, and delete these rows, or correct them" in remedies
