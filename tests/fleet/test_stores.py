"""Fleets in object stores: a real S3 server on this machine, and fsspec's memory."""

import subprocess
import sys
import uuid

import polars as pl
import pytest

from barnax import InputError, identify_fleet, read_manifest
from barnax.execution import AtOnce
from barnax.files import fetched, located
from barnax.fleet.dataset import FACTORS, opened, read_rows, regrouped
from barnax.fleet.rows import identify_rows

from .conftest import require_equal

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")


@pytest.fixture
def memory():
    pytest.importorskip("upath")
    return located(f"memory://{uuid.uuid4().hex}")


def copied(small_fleet, to):
    """The small fleet's first cell and its failures, in a store, with a manifest of their own."""
    rows = pl.read_csv(small_fleet / "manifest.csv")[[0, -1]]
    tests = rows["ocv"][0].split(";")
    for path in [small_fleet / "cell0.parquet", *map(located, tests)]:
        (to / path.name).fs.pipe_file((to / path.name).path, path.read_bytes())
    names = ";".join(located(each).name for each in tests)
    manifest = to / "m.csv"
    manifest.fs.pipe_file(manifest.path, rows.with_columns(ocv=pl.lit(names)).write_csv().encode())
    return manifest


@pytest.mark.slow
def test_a_fleet_in_a_store_is_that_of_a_folder(small_fleet, bucket, tmp_path):
    manifest = copied(small_fleet, bucket / "in")
    cells, carried = read_manifest(str(manifest))
    assert carried == ("age",)
    outs = (str(bucket / "out"), tmp_path)
    local, _ = read_manifest(small_fleet / "manifest.csv")
    kept = {"keep_factors": "constants"}
    for out, given in zip(outs, (cells, [local[0], local[-1]]), strict=True):
        state = identify_fleet(given, out, executor=AtOnce(), settings=kept)
        assert (state.finished, state.failed) == (2, 1)
    assert identify_fleet(cells, outs[0], executor=AtOnce(), settings=kept).skipped == 2
    require_equal(read_rows(bucket / "out"), read_rows(tmp_path))
    name = "cell 0.factors.npz"
    stored = fetched(bucket / "out" / FACTORS / name, 10**6)
    assert stored == (tmp_path / FACTORS / name).read_bytes()
    (group,) = regrouped(str(bucket / "out"), ["age"])
    again, there = (
        identify_rows(each, {"seeds": 0})[0] for each in (group, *regrouped(tmp_path, ["age"]))
    )
    assert again["error"] is None
    assert again["R0 [Ohm]"] == there["R0 [Ohm]"]


@pytest.mark.slow
def test_the_command_reads_and_writes_a_store(small_fleet, bucket, tmp_path):
    manifest = tmp_path / "m.csv"
    manifest.write_text(f"id,records\na,{bucket / 'none.csv'}\n")
    words = [sys.executable, "-m", "barnax", "fleet", manifest, "--workers", "1"]
    to = ["--out", str(bucket / "out")]
    refused, done = (
        subprocess.run([*words, *to, *more], capture_output=True, text=True, check=False)
        for more in ([], ["--addresses", str(bucket)])
    )
    assert (refused.returncode, done.returncode) == (2, 0)
    assert "--addresses" in refused.stderr
    (row,) = pl.read_parquet(opened(bucket / "out" / "cells.parquet")).to_dicts()
    assert "none.csv: cannot be read" in row["error"]
    assert (bucket / "out" / "report.html").exists()


@pytest.mark.parametrize(
    "address",
    [
        "s3://bucket-of-others/a.csv",
        "s3://bucket/logs-of-others/a.csv",
        "s3://bucket/logs/../a.csv",
        "https://host/logs/%2e%2e/a.csv",
        "s3://bucket/logs/a::file:///etc/passwd",
        "simplecache::s3://bucket/logs/a.csv",
        "file:///etc/passwd",
        "http://169.254.169.254/latest",
    ],
)
def test_a_manifest_reads_no_address_that_was_not_allowed(tmp_path, address):
    (tmp_path / "m.csv").write_text(f"id,records\na,{address}\n")
    with pytest.raises(InputError, match="allow it with `addresses`"):
        read_manifest(tmp_path / "m.csv", addresses=["s3://bucket/logs", "https://host/logs/"])


@pytest.mark.parametrize("name", ["/etc/passwd", "../other/a.csv", "~/a.csv", "file:///etc/passwd"])
def test_a_manifest_in_a_store_reads_no_file_of_this_machine(memory, name):
    manifest = memory / "in" / "m.csv"
    manifest.fs.pipe_file(manifest.path, f"id,records\na,{name}\n".encode())
    with pytest.raises(InputError, match=r"own folder|allow it"):
        read_manifest(str(manifest))


def test_a_store_that_is_not_there_is_reported(memory):
    with pytest.raises(InputError, match=r"none.csv: cannot be read"):
        fetched(memory / "none.csv", 10)
    (memory / "a").fs.pipe_file((memory / "a").path, b"12345")
    with pytest.raises(InputError, match="longer than 4 bytes"):
        fetched(memory / "a", 4)
    with pytest.raises(InputError, match="no address of a kind"):
        located("nonsense://bucket/a")


def test_without_the_packages_an_address_names_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "upath", None)
    with pytest.raises(InputError, match=r"barnax\[cloud\]"):
        identify_fleet([], "s3://bucket/fleet")
