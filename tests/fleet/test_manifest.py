"""Manifests: three formats, patterns, defaults, what is carried, and what is wrong with them."""

import gzip
import os
import zlib

import polars as pl
import pytest

from barnax.bundled import BUNDLED
from barnax.errors import InputError, as_keys
from barnax.fleet import FleetCell, read_manifest
from barnax.fleet.dataset import in_shard, parse_shard
from barnax.fleet.rows import identify_rows, reasons_against
from barnax.records.readers import content as bytes_of

ROWS = [
    {"id": "007", "record": "a*.csv", "capacity": 2.0, "age": 10, "circuit": "so-rc"},
    {"id": "b", "record": "b.csv", "capacity": None, "age": 20, "circuit": None},
]


@pytest.fixture
def folder(tmp_path):
    for name in ("a1.csv", "a2.csv", "b.csv", "ocv.csv"):
        (tmp_path / name).write_text("time,current\n")
    return tmp_path


TOML = (
    '[[cell]]\nid = "007"\nrecord = "a*.csv"\ncapacity = 2.0\nage = 10\ncircuit = "so-rc"\n'
    '[[cell]]\nid = "b"\nrecord = ["b.csv"]\nage = 20\n'
)
WRITERS = {
    "m.csv": pl.DataFrame(ROWS).write_csv,
    "m.parquet": pl.DataFrame(ROWS).write_parquet,
    "m.toml": lambda path: path.write_text(TOML),
}


def manifest_in(folder, name="m.csv"):
    WRITERS[name](folder / name)
    return folder / name


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_says_the_same(folder, name):
    given = {"ocv": "ocv.csv", "capacity": "3"}
    cells, carried = read_manifest(manifest_in(folder, name), given)
    first, second = cells
    assert first.id == "007"
    assert first.records == (str(folder / "a1.csv"), str(folder / "a2.csv"))
    assert first.ocv == second.ocv == (str(folder / "ocv.csv"),)
    assert (first.window, second.window) == ({"capacity_ah": 2.0}, {"capacity_ah": 3.0})
    assert (first.options, second.options) == ({"model": "so-rc"}, {})
    assert carried == ("age",)
    assert [cell.carried["age"] for cell in cells] == [10, 20]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.parametrize("column", ["records", "ocv", "validate", "cell", "bounds"])
def test_a_pipe_or_a_device_is_refused_with_its_row_and_never_read(folder, column):
    os.mkfifo(folder / "pipe.csv")
    for name in ("pipe.csv", "p*.csv", "/dev/zero"):
        row = {"id": "odd", "records": "b.csv", column: name}
        pl.DataFrame([row]).write_csv(folder / "m.csv")
        (cell,), _ = read_manifest(folder / "m.csv")
        assert "is a pipe or a device" in identify_rows(cell, {})[0]["error"]
    with pytest.raises(
        InputError, match=r"pipe\.csv: is a pipe or a device; write the manifest to"
    ):
        read_manifest(folder / "pipe.csv")


def test_only_what_a_row_says_is_a_pattern_and_one_without_a_file_is_missing(tmp_path):
    folder = tmp_path / "[A1] cells"
    (folder / "c[1];2").mkdir(parents=True)
    drive = folder / "c[1];2" / "drive.csv"
    drive.write_text("time\n")
    (folder / "m.csv").write_text("id,records\nx,nowhere*.csv;*/dri*.csv\n")
    (cell,), _ = read_manifest(folder / "m.csv")
    assert (cell.missing, cell.records) == (("nowhere*.csv does not exist",), (str(drive),))
    assert read_manifest(folder)[0][0].records == (str(drive),)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("id,age\nx,3\n", r"row 2 \(x\): no record"),
        ("id,records\n", "has no cells"),
        ("id,records\n../x,b.csv\n", r"row 2 \(../x\): an id is the name of a folder"),
        ("id,records\nC:\\x,b.csv\n", "an id is the name of a folder"),
        ("id,records\n..,b.csv\n", "an id is the name of a folder"),
        ("id,records,error,age\nx,b.csv,alarm,3\n", "the dataset has its own error; rename"),
        ("cells = [", r"m\.toml: cannot be read"),
        ("cell = [1, 2]", "must contain .* in another form"),
        ('[[cell]]\nid = "a"\nrecords = 5', r"row 1 \(a\): `records` '5': write names of files"),
        ('[[cell]]\nid = "a"\nrecords = "b.csv"\nocv = [5]', r"`ocv` '\[5\]': write names"),
    ],
)
def test_what_is_wrong_is_named_with_its_row(folder, content, message):
    path = folder / ("m.toml" if " = " in content else "m.csv")
    path.write_text(content)
    with pytest.raises(InputError, match=message):
        read_manifest(path)


def test_a_fingerprint_follows_inputs_and_settings(folder):
    (cell, _), _ = read_manifest(manifest_in(folder))
    (same, _), _ = read_manifest(manifest_in(folder))
    assert cell.fingerprint({"seeds": 0}) == same.fingerprint({"seeds": 0})
    assert cell.fingerprint({"seeds": 1}) != cell.fingerprint({"seeds": 0})
    before = cell.fingerprint({})
    (folder / "a1.csv").write_text("time,current\n1,2\n")
    assert cell.fingerprint({}) != before


def test_shards_share_the_cells_out(folder):
    cells, _ = read_manifest(manifest_in(folder))
    shards = [{cell.id for cell in cells if in_shard(cell, (k, 3))} for k in (1, 2, 3)]
    assert set().union(*shards) == {"007", "b"}
    assert sum(map(len, shards)) == 2
    with pytest.raises(InputError, match="such as 3/10"):
        parse_shard("4/3")


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_manifest_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch, suffix):
    monkeypatch.setattr(bytes_of, "LARGEST_FILE", 1_000_000)
    path = tmp_path / f"m.{suffix}"
    if suffix == "csv":
        path.write_bytes(gzip.compress(b"id,records\na," + b"a" * 2_000_000))
    else:
        pl.DataFrame({"id": pl.repeat(1, 100_000, eager=True)}).write_parquet(path)
    with pytest.raises(InputError, match=r"bytes need more than the limit of 0\.001 GB"):
        read_manifest(path)


def test_a_manifest_that_is_packed_twice_or_has_too_many_rows_is_refused(tmp_path, monkeypatch):
    text = b"id,records\n" + b"a,b.csv\n" * 1000
    path = tmp_path / "m.csv"
    for packed in (gzip.compress(gzip.compress(text)), zlib.compress(text)):
        path.write_bytes(packed)
        with pytest.raises(InputError, match=r"m\.csv: cannot be read"):
            read_manifest(path)
    monkeypatch.setattr(bytes_of, "LARGEST_FILE", 100_000)
    path.write_bytes(text)
    with pytest.raises(InputError, match="need more than the limit"):
        read_manifest(path)


WORSE = """id,records,ocv,capacity,initial_soc,age_days
c00,{0},{1},2.0,0.8,0
m1,none.parquet,{1},2.0,0.8,1
c00,{0},{1},2.0,0.8,1
a/b,{0},{1},2.0,eight,1
n1,{0},{1},-2,0.8,1
n2,{0},{1},zwei,0.8,1
=cmd,{0},{1},2,0.8,1
,{0},{1},2,0.8,1
"""
PROBLEMS = [
    "m1: none.parquet does not exist",
    "row 4: the id 'c00' occurs twice, first in row 2",
    "row 5 (a/b): an id is the name of a folder too",
    "row 5 (a/b): initial_soc 'eight': write it like",
    "n1: capacity -2 must be positive",
    "row 7 (n2): capacity 'zwei': write it like",
    "row 8 (=cmd): spreadsheets take this id for a formula",
    "row 9: no id",
]


def reasons_in(cells):
    """The mistakes in cells' files and options, as a dry run lists them."""
    pairs = ((cell, reason) for cell in cells for reason in reasons_against(cell, {}))
    return [f"{cell.id}: {as_keys(reason)}" for cell, reason in pairs]


def test_a_dry_run_lists_all_that_is_wrong_and_a_run_names_the_first(tmp_path):
    path = tmp_path / "worse.csv"
    path.write_text(WORSE.format(BUNDLED.record, BUNDLED.ocv[0]))
    problems = []
    cells, _ = read_manifest(path, problems=problems)
    lines = [*map(as_keys, problems), *reasons_in(cells)]
    assert len(lines) == len(PROBLEMS)
    for text in PROBLEMS:
        assert sum(text in line for line in lines) == 1, text
    with pytest.raises(InputError, match=r"row 4: the id 'c00'.*`dry_run` lists 5 more"):
        read_manifest(path)


def test_a_validation_window_that_cannot_be_is_named_with_its_cell():
    cells = [FleetCell("a", validate_window={"initial_soc": 95.0})]
    (line,) = reasons_in(cells)
    assert line.startswith("a: initial_soc 95.0 is not a fraction")
