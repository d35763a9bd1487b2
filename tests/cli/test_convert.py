"""A cycler's file leaves as a clean table, with where it comes from."""

import itertools
import json

import numpy as np
import polars as pl
import pytest

from barnax.cli.files import bdf_files
from barnax.records import read_record
from helpers.dialects import WRITERS, maccor_text, pulse_table
from helpers.made_cell import made
from helpers.records import CURRENT, VOLTAGE, logged


@pytest.fixture
def cycler_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "cell.062"
    path.write_bytes(maccor_text(pulse_table()))
    return path


def test_a_file_is_written_as_parquet_with_its_provenance(run, refuse, cycler_file, tmp_path):
    written = tmp_path / "cell.bdf.parquet"
    written.write_text("mine")
    assert "--force" in refuse("convert", cycler_file)
    assert run("convert", cycler_file, "--to", "bdf", "--force").status == 0
    before, after = read_record(cycler_file), read_record(written)
    for name in ("time_s", "current_a", "voltage_v", "step", "cycle"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    np.testing.assert_allclose(after.charge_ah, before.charge_ah, atol=1e-12)
    assert after.hold.value == before.hold.value
    origin = json.loads(pl.read_parquet_metadata(written)["provenance"])
    assert origin["source sha256"] == before.sha256
    assert "'State' shows what discharges" in " ".join(origin["warnings"])


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("suffix", ["csv", pytest.param("parquet", marks=pytest.mark.slow)])
def test_the_hold_is_the_same_after_a_conversion(name, suffix, tmp_path):
    # Arbin's has no counters, BioLogic's has none that prove anything, and others prove theirs.
    (tmp_path / "cell").write_bytes(WRITERS[name](pulse_table()))
    before = read_record(tmp_path / "cell")
    file = f"cell.bdf.{suffix}"
    (tmp_path / file).write_bytes(bdf_files(before, file)[file])
    assert read_record(tmp_path / file).hold.value == before.hold.value
    assert before.hold.value == "backward" or "Arbin" not in name


def test_csv_has_its_provenance_beside_it(run, cycler_file, tmp_path):
    assert run("convert", cycler_file, "--out", tmp_path / "out.csv", "-q").status == 0
    before, after = read_record(cycler_file), read_record(tmp_path / "out.csv")
    np.testing.assert_array_equal(after.current_a, before.current_a)
    assert json.loads((tmp_path / "out.json").read_text())["source"] == "cell.062"


def test_neither_another_file_nor_the_measured_one_is_written_over(refuse, cycler_file, tmp_path):
    (tmp_path / "out.json").write_text("mine")
    assert "out.json: exists already" in refuse("convert", cycler_file, "--out", "out.csv")
    words = ("convert", cycler_file, "--out", cycler_file, "--force")
    assert "this is the file to read" in refuse(*words)


def test_a_users_json_is_not_replaced_by_the_origin_of_a_record(refuse, run, tmp_path):
    (tmp_path / "cell.csv").write_text(pulse_table().write_csv())
    words = ("convert", tmp_path / "cell.csv", "--out", tmp_path / "out.csv", "--force")
    for _ in range(2):
        assert run(*words).status == 0
    for mine in ("{}", "mine"):
        (tmp_path / "out.json").write_text(mine)
        assert "is another file; give --out another name" in refuse(*words)
        assert (tmp_path / "out.json").read_text() == mine


def test_a_log_that_was_cut_into_files_is_joined(run, refuse, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    record, _ = made(1, hours=0.6)
    table = logged(record.time_s, -record.current_a, record.voltage_v)
    table = table.with_columns(pl.all().round(6))
    table.write_csv("whole.csv")
    parts = [f"part{number}.csv" for number in (1, 2, 3)]
    cuts = itertools.pairwise((0, 1500, 4000, len(table)))
    for part, (first, after) in zip(parts, cuts, strict=True):
        table[first:after].write_csv(part)
    assert run("convert", *parts, "--out", "joined.csv", "-q").status == 0
    joined, whole = read_record("joined.csv"), read_record("whole.csv")
    for name in ("time_s", "current_a", "voltage_v"):
        np.testing.assert_array_equal(getattr(joined, name), getattr(whole, name))
    told = refuse("convert", "part2.csv", "part1.csv", "--out", "again.csv")
    assert "give the files in the order of the log" in told
    # A clock of its own in each file tells no pauses.
    table[:1500].write_csv("part3.csv")
    told = refuse("convert", "part1.csv", "part3.csv", "--out", "again.csv")
    assert "if each file has its own clock, name a column that continues" in told
    table[1500:4000].rename({VOLTAGE: "U / V"}).write_csv("part2.csv")
    assert "other columns than part1.csv" in refuse("convert", *parts, "--out", "again.csv")


def test_files_of_one_log_may_hold_their_columns_as_different_types(run, tmp_path):
    """As where one of them has whole currents alone."""
    record, _ = made(1, hours=0.6)
    whole = np.round(record.current_a[:1500])
    current_a = np.append(whole, record.current_a[1500:])
    table = logged(record.time_s, -current_a, record.voltage_v)
    first, second = table[:1500], table[1500:]
    # A second file of another format than its name says.
    names = [tmp_path / "a.parquet", tmp_path / "b.csv"]
    first.with_columns(pl.col(CURRENT).cast(pl.Int64)).write_parquet(names[0])
    second.write_parquet(names[1])
    run("convert", *names, "--out", tmp_path / "o.csv")
    read = read_record(tmp_path / "o.csv")
    np.testing.assert_allclose(read.current_a, current_a, rtol=1e-12)
