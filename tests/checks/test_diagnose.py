"""The diagnosis as a whole: nothing hides behind anything, and it agrees with the reader."""

import contextlib
import doctest
import importlib
import json
import time

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barnax.bundled import BUNDLED_NAMES, bundled_file
from barnax.checks import CHECKS, check_file
from barnax.errors import InputError
from barnax.records import read_record
from helpers.records import CURRENT, TIME, VOLTAGE, changed, checked, counting, frame

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
    diagnosis = check_file(bundled_file(name), capacity_ah=capacity_ah)
    assert diagnosis.is_clean
    assert not counting(diagnosis)


@pytest.mark.parametrize("fault", FAULTS)
def test_what_the_reader_refuses_is_an_error_and_what_is_none_it_reads(tmp_path, fault):
    diagnosis = checked(tmp_path, FAULTS[fault](frame()))
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
    diagnosis = checked(tmp_path, pl.concat([table[:9000], table[9600:]]))
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
        for finding in checked(tmp_path, fault(frame())).findings:
            # What only the reader says carries its remedy in its words.
            assert finding.remedy or not finding.counts or finding.check == "reading"


def test_rows_are_the_file_s_own_below_a_preamble(tmp_path):
    text = "Tester 7\nChannel 3\n\n" + changed(frame(), TIME, 12.5, [500]).write_csv()
    (tmp_path / "cell.csv").write_text(text)
    (clock,) = [finding for finding in check_file(tmp_path / "cell.csv").findings if finding.counts]
    assert clock.row == 505
    assert text.splitlines()[clock.row - 1].startswith("12.5,")


def test_a_diagnosis_is_plain_values():
    diagnosis = check_file(bundled_file("ocv_charge"))
    document = json.loads(json.dumps(diagnosis.to_dict()))
    assert document["clean"] is True
    assert document["facts"]["samples"] == 17_594
    assert document["roles"]["OCV test"]["usable"] is True


@pytest.mark.parametrize("capacity_ah", [0.0, -2.0, float("nan")])
def test_a_capacity_that_is_none_is_refused(capacity_ah):
    with pytest.raises(InputError, match="must be positive"):
        check_file(bundled_file("validation"), capacity_ah=capacity_ah)


def test_every_check_has_a_name_of_its_own():
    assert len(set(CHECKS.values())) == len(CHECKS)


def test_the_example_runs():
    assert doctest.testmod(importlib.import_module("barnax.checks.check_file")).failed == 0


@pytest.mark.slow
def test_a_million_rows_take_seconds(tmp_path):
    table = pl.concat([frame().with_columns(pl.col(TIME) + 19_680.0 * k) for k in range(51)])
    table.write_parquet(tmp_path / "long.parquet")
    assert table.height > 1_000_000
    # Processor seconds: the machine may be busy with other things.
    start = time.process_time()
    check_file(tmp_path / "long.parquet")
    assert time.process_time() - start < 10


CELLS = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(-10, 10),
    st.sampled_from([0.0, 1.0, 3.7, 1e300, -1e300, 1e-300]),
)


@settings(max_examples=200, deadline=None)
@given(
    columns=st.integers(1, 40).flatmap(
        lambda rows: st.tuples(*[st.lists(CELLS, min_size=rows, max_size=rows)] * 5)
    ),
    capacity_ah=st.sampled_from([None, 1e-300, 2.0, 1e300]),
)
def test_a_table_of_any_numbers_is_diagnosed_without_a_crash(
    tmp_path_factory, columns, capacity_ah
):
    names = (TIME, CURRENT, VOLTAGE, "Charging Capacity / Ah", "Discharging Capacity / Ah")
    table = pl.DataFrame(dict(zip(names, columns, strict=True)))
    diagnosis = checked(tmp_path_factory.mktemp("any"), table, capacity_ah=capacity_ah)
    assert json.dumps(diagnosis.to_dict())


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(10, 300))
def test_a_rough_record_of_any_shape_is_diagnosed_without_a_crash(tmp_path_factory, seed, rows):
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


@settings(max_examples=100, deadline=None)
@given(content=st.binary(max_size=400) | st.text(max_size=400).map(str.encode))
def test_any_bytes_are_diagnosed_or_refused(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("bytes") / "cell.csv"
    path.write_bytes(content)
    with contextlib.suppress(InputError):
        check_file(path)
