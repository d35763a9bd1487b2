"""The diagnosis as a whole: nothing hides behind anything, and it agrees with the reader."""

import doctest
import importlib
import json
import time

import numpy as np
import polars as pl
import pytest

from barnax.bundled import BUNDLED_NAMES, bundled_file
from barnax.doctor import CHECKS, diagnose
from barnax.errors import InputError
from barnax.records import read_record

from .faulty_records import CURRENT, TIME, VOLTAGE, changed, counting, diagnosed, frame

FAULTS = {
    "none": lambda table: table,
    "backward": lambda table: changed(table, TIME, 12.5, [500]),
    "conflict": lambda table: changed(table, TIME, table[TIME][117], [116]),
    "nan": lambda table: changed(table, VOLTAGE, np.nan, [77]),
    "no current": lambda table: table.drop(CURRENT),
    "mA": lambda table: changed(table, CURRENT, table[CURRENT].to_numpy() * 1e3),
    "mV": lambda table: changed(table, VOLTAGE, table[VOLTAGE].to_numpy() * 1e3),
    "module": lambda table: changed(table, VOLTAGE, table[VOLTAGE].to_numpy() * 5),
    "reversed": lambda table: changed(table, VOLTAGE, -table[VOLTAGE].to_numpy()),
    "65535 V": lambda table: changed(table, VOLTAGE, 65_535.0, [77]),
    "no load": lambda table: changed(table, CURRENT, np.zeros(table.height)),
    "few": lambda table: table[:5],
}


@pytest.mark.parametrize("name", BUNDLED_NAMES)
@pytest.mark.parametrize("capacity_ah", [None, 2.0])
def test_the_bundled_records_are_clean(name, capacity_ah):
    diagnosis = diagnose(bundled_file(name), capacity_ah=capacity_ah)
    assert diagnosis.is_clean
    assert not counting(diagnosis)


@pytest.mark.parametrize("fault", FAULTS)
def test_what_the_reader_refuses_is_an_error_and_what_is_none_it_reads(tmp_path, fault):
    diagnosis = diagnosed(tmp_path, FAULTS[fault](frame()))
    try:
        read_record(tmp_path / "cell.csv")
        is_read = True
    except InputError:
        is_read = False
    assert ("error" in counting(diagnosis).values()) == (not is_read)


def test_many_faults_are_all_found_at_once(tmp_path):
    table = frame()
    table = changed(table, VOLTAGE, np.nan, [77])
    table = changed(table, TIME, 12.5, [500])
    table = changed(table, CURRENT, -1000 * table[CURRENT].to_numpy())
    table = changed(table, VOLTAGE, table[VOLTAGE].to_numpy() * 1000)
    table = changed(table, VOLTAGE, 4500.0, [3001])
    diagnosis = diagnosed(tmp_path, pl.concat([table[:9000], table[9600:]]))
    assert counting(diagnosis) == {
        "cells": "error",
        "clock": "error",
        "voltage unit": "error",
        "current unit": "error",
        "sign": "warning",
        "voltage spikes": "warning",
        "gaps": "warning",
    }
    severities = [finding.severity for finding in diagnosis.findings]
    assert severities == sorted(severities, key=["error", "warning", "note"].index)


def test_every_finding_that_counts_has_a_remedy(tmp_path):
    for fault in FAULTS.values():
        for finding in diagnosed(tmp_path, fault(frame())).findings:
            # What only the reader says carries its remedy in its words.
            assert finding.remedy or not finding.counts or finding.check == "reading"


def test_rows_are_the_file_s_own_below_a_preamble(tmp_path):
    text = "Tester 7\nChannel 3\n\n" + changed(frame(), TIME, 12.5, [500]).write_csv()
    (tmp_path / "cell.csv").write_text(text)
    (clock,) = [finding for finding in diagnose(tmp_path / "cell.csv").findings if finding.counts]
    assert clock.row == 505
    assert text.splitlines()[clock.row - 1].startswith("12.5,")


def test_a_diagnosis_is_plain_values():
    diagnosis = diagnose(bundled_file("ocv_charge"))
    document = json.loads(json.dumps(diagnosis.to_dict()))
    assert document["clean"] is True
    assert document["facts"]["samples"] == 17_594
    assert document["roles"]["OCV test"]["usable"] is True


@pytest.mark.parametrize("capacity_ah", [0.0, -2.0, float("nan")])
def test_a_capacity_that_is_none_is_refused(capacity_ah):
    with pytest.raises(InputError, match="must be positive"):
        diagnose(bundled_file("validation"), capacity_ah=capacity_ah)


def test_every_check_has_a_name_of_its_own():
    assert len(set(CHECKS.values())) == len(CHECKS)


def test_the_example_runs():
    assert doctest.testmod(importlib.import_module("barnax.doctor.diagnose")).failed == 0


def test_a_million_rows_take_seconds(tmp_path):
    table = pl.concat([frame().with_columns(pl.col(TIME) + 19_680.0 * k) for k in range(51)])
    table.write_parquet(tmp_path / "long.parquet")
    assert table.height > 1_000_000
    # Processor seconds: the machine may be busy with other things.
    start = time.process_time()
    diagnose(tmp_path / "long.parquet")
    assert time.process_time() - start < 10
