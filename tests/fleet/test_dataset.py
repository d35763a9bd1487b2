"""The dataset: nothing is lost while others write to it, and values of different types."""

import itertools
import re
import sys
from datetime import UTC, date, datetime
from pathlib import Path

import polars as pl
import pytest

from barnax.errors import InputError
from barnax.fleet import dataset
from barnax.fleet.dataset import (
    compact,
    dataset_path,
    finished,
    keep_file,
    parts_folder,
    read_rows,
    result_path,
    rows_of_others,
    write_rows,
    writing,
)

ERROR = "error", "error code"
# Values of a carried column, and what they are where others have another type.
KINDS = (
    (3, "3"),
    ("x", "x"),
    (True, "True"),
    (date(2026, 1, 2), "2026-01-02"),
    (datetime(2026, 1, 2, 3, tzinfo=UTC), "2026-01-02 03:00:00+00:00"),
    ([1, 2], "[1, 2]"),
    ({"a": 1}, "{'a': 1}"),
    (Path("a.csv"), "a.csv"),
)


@pytest.mark.parametrize("more", [(), (None,)], ids=["alone", "and the whole"])
def test_what_another_shard_takes_in_meanwhile_is_read_once(tmp_path, monkeypatch, more):
    rows = [{"id": name, "error": None, "fingerprint": "0"} for name in "abc"]
    folder = parts_folder(tmp_path, (2, 2))
    folder.mkdir()
    for place, row in enumerate(rows):
        write_rows(folder / f"{place:032x}.parquet", [row])
    read, taken_in = pl.read_parquet, [(2, 2), *more]

    def read_late(path, **options):
        while taken_in:
            compact(tmp_path, taken_in.pop(0))
        return read(path, **options)

    monkeypatch.setattr("barnax.fleet.dataset.pl.read_parquet", read_late)
    assert finished(tmp_path) == dict.fromkeys("abc", ("0", False))
    assert not list(folder.glob("*.parquet"))


def test_what_a_user_put_beside_the_dataset_is_neither_read_nor_deleted(tmp_path):
    folder = parts_folder(tmp_path)
    folder.mkdir()
    row = {"id": "a", "error": None, "fingerprint": "0"}
    write_rows(folder / f"{1:032x}.parquet", [row])
    mine = [folder / "notes.parquet", folder / ".thesis", tmp_path / "cells_2024.parquet"]
    for path in mine:
        write_rows(path, [row | {"id": "mine"}])
    with writing(tmp_path):
        compact(tmp_path)
    assert finished(tmp_path) == {"a": ("0", False)}
    assert all(path.exists() for path in mine)


@pytest.mark.parametrize("link", ["results", "results/a"])
def test_a_result_is_not_written_through_a_link(tmp_path, link):
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    elsewhere.mkdir()
    (out / link).parent.mkdir(parents=True)
    (out / link).symlink_to(elsewhere)
    with pytest.raises(InputError, match=r"is a link.*delete the link"):
        keep_file(out, result_path(out, "a"), b"{}")
    assert not [path for path in elsewhere.rglob("*") if path.is_file()]


def carried(out, is_one_part, *values):
    """A column after rows with these values are written, beside each other or one by one."""
    rows = [
        {"id": str(place), "error": None, "fingerprint": "0", "carried": value}
        for place, value in enumerate(values)
    ]
    folder = parts_folder(out)
    folder.mkdir(parents=True)
    for place, part in enumerate([rows] if is_one_part else [[row] for row in rows]):
        write_rows(folder / f"{place:032x}.parquet", part)
    actual = read_rows(out)["carried"].to_list()
    compact(out)
    assert read_rows(out)["carried"].to_list() == actual
    return actual


@pytest.mark.parametrize("is_one_part", [pytest.param(True, marks=pytest.mark.slow), False])
def test_carried_values_of_two_kinds_are_kept_as_text(tmp_path, is_one_part):
    for number, pair in enumerate(itertools.combinations(KINDS, 2)):
        values, texts = zip(*pair, strict=True)
        assert carried(tmp_path / str(number), is_one_part, *values) == list(texts)


def test_the_questions_of_the_page_are_answered_from_the_files_of_two_shards(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "many-cells.md").read_text(encoding="utf-8")
    questions = re.findall(r"^```sql\n(.*?)^```", page, re.M | re.S)
    names = ("id", "age_days", "R0 [Ohm]", "RMSE [V]", "at bound", "certified", *ERROR)
    for shard in (1, 2):
        ohm, volts = 0.01 * shard, 1.5 * shard
        rows = [
            (f"{shard}0", 0, ohm, volts, "R1 [Ohm] low", True, None, None),
            (f"{shard}1", 100, ohm + 0.001, volts + 1, "", False, None, None),
            (f"{shard}2", 100, ohm + 0.002, volts + 2, "", None, "no", "file.damaged"),
        ]
        path = dataset_path(tmp_path, (shard, 2))
        write_rows(path, [dict(zip(names, row, strict=True)) for row in rows])
    context = pl.SQLContext(cells=pl.scan_parquet(tmp_path / "cells*.parquet"))
    means, worst = (context.execute(question).collect().rows() for question in questions)
    assert means == [(0, 2, pytest.approx(0.015)), (100, 2, pytest.approx(0.016))]
    assert [row[0] for row in worst] == ["21", "20", "11", "10"]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="no other system limits a process's memory")
def test_a_dataset_of_others_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(dataset, "LARGEST_FILE", 300_000_000)
    rows = pl.DataFrame({"id": ["a"], "error": [None]})
    rows.write_parquet(dataset_path(tmp_path))
    assert len(rows_of_others(tmp_path)) == 1
    zeros = pl.Series("warnings", [pl.repeat(0, 60_000_000, dtype=pl.Int8, eager=True)])
    rows.with_columns(zeros).write_parquet(dataset_path(tmp_path), compression="zstd")
    assert dataset_path(tmp_path).stat().st_size < 100_000
    with pytest.raises(InputError, match="unpack to more than a fleet's dataset does"):
        rows_of_others(tmp_path)
