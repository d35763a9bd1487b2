"""The command for fleets, without identifications."""

import re
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import polars as pl
import pytest

from barnax.bundled import BUNDLED
from barnax.cli.session import Session


@pytest.fixture(autouse=True)
def one_thread(monkeypatch):
    """A fleet's cells are computed in this process."""
    pool = "barnax.fleet.engine.ProcessPoolExecutor"
    monkeypatch.setattr(pool, lambda *_, **__: ThreadPoolExecutor(1))


def test_the_report_is_of_the_cells_of_the_manifest(run, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "barnax.fleet.rows.identify_rows", lambda cell, *_: [{"id": cell.id, "error": "no"}]
    )
    manifest, out = tmp_path / "m.csv", tmp_path / "out"
    for names, told in (("ab", "0 of 2 cells identified"), ("b", "0 of 1 cell identified")):
        rows = "".join(f"{name},nowhere.csv\n" for name in names)
        manifest.write_text(f"id,records\n{rows}")
        actual = run("fleet", manifest, "--out", out)
        assert actual.status == 0, actual.err
        assert told in actual.out
        assert told in (out / "report.html").read_text()
    assert pl.read_parquet(out / "cells.parquet")["id"].to_list() == ["a", "b"]
    assert "left by a command" not in actual.err
    # A worker that was killed while it wrote.
    left = out / "factors" / f".barnax-{0:032x}"
    left.parent.mkdir()
    left.touch()
    assert f"{left}: left by a command" in run("fleet", manifest, "--out", out).err


def test_a_failure_names_its_file_and_the_manifests_columns(run, tmp_path):
    (tmp_path / "b.csv").touch()
    manifest = tmp_path / "m.csv"
    manifest.write_text("id,records,ocv,initial_soc\na,nowhere.csv,b.csv,\nb,b.csv,b.csv,95\n")
    actual = run("fleet", manifest, "--out", tmp_path / "out")
    assert "a: nowhere.csv does not exist: correct the name in the manifest" in " ".join(
        actual.out.split()
    )
    report = (tmp_path / "out" / "report.html").read_text()
    assert "initial_soc 95.0 is not a fraction" in report
    dry = run("fleet", manifest, "--dry-run")
    assert (dry.status, dry.out.count("initial_soc 95.0")) == (2, 1)


def test_a_dry_run_reads_the_files_and_lists_the_cells_of_folders_in_folders(
    run, tmp_path, monkeypatch
):
    rng = np.random.default_rng(0)
    for cell in ("one", "two"):
        folder = tmp_path / "fleet" / "batch" / cell
        folder.mkdir(parents=True)
        for path in (BUNDLED.record, *BUNDLED.ocv):
            table = pl.read_parquet(path).head(100_000 if path in BUNDLED.ocv else 2000)
            noise_v = pl.Series(rng.normal(0, 1e-4, len(table)))
            table = table.with_columns(pl.col("Voltage / V") + noise_v)
            table.write_parquet(folder / path.name)
    stuck = tmp_path / "fleet" / "stuck" / "drive.csv"
    stuck.parent.mkdir()
    pl.read_parquet(BUNDLED.record).with_columns(pl.lit(3.7).alias("Voltage / V")).write_csv(stuck)
    steps, watch = [], Session.watch

    @contextmanager
    def counted(session, title, total=0):
        with watch(session, title, total):
            yield lambda gained: steps.append((title, gained, total))

    monkeypatch.setattr(Session, "watch", counted)
    dry = run("fleet", tmp_path / "fleet", "--dry-run")
    # A large folder takes minutes, and says how far it is.
    assert steps == 2 * [("Checking", 1, 2)]
    lines = " ".join(dry.out.split())
    assert "batch: these are files of 2 cells" in lines
    assert "stuck: no record can be identified on" in lines
    assert "every voltage is 3.7 V" in lines
    manifest = tmp_path / "m.csv"
    tests = ";".join(map(str, BUNDLED.ocv))
    manifest.write_text(f"id,records,ocv\na,{stuck},{tests}\nb,{BUNDLED.record},{tests}\n")
    dry = run("fleet", manifest, "--dry-run")
    assert (dry.status, dry.out.count("every voltage in 'Voltage / V' is 3.7 V")) == (2, 1)
    assert "1 problem to correct" in dry.err


def test_shards_and_the_whole_share_a_folder_of_kept_results(run, tmp_path, monkeypatch):
    def row_of(cell, settings, folder):
        (folder / "results" / cell.id).mkdir(parents=True, exist_ok=True)
        return [{"id": cell.id, "error": "no"}]

    monkeypatch.setattr("barnax.fleet.rows.identify_rows", row_of)
    (tmp_path / "m.csv").write_text("id,records\na,nowhere.csv\nb,nowhere.csv\n")
    words = ("fleet", tmp_path / "m.csv", "--out", tmp_path / "out", "--keep-results")
    for shard in (("--shard", "1/2"), ("--shard", "2/2"), ("--shard", "2/2"), ()):
        ended = run(*words, *shard)
        assert ended.status == 0, ended.err
        last = f"{tmp_path / 'out'}/report.html cells.parquet"
        if shard:
            told = "once all are done, the same command without it writes the report."
            last = f"Shard {shard[1]}: {told} {tmp_path / 'out'}"
        # The console breaks a long path anywhere.
        assert "".join(ended.out.split()).endswith("".join(last.split()))
    assert pl.read_parquet(tmp_path / "out" / "cells.parquet")["id"].sort().to_list() == ["a", "b"]


NO_FLEET = "is of no fleet; give --out another folder"


@pytest.mark.parametrize(
    ("name", "options", "refusal"),
    [
        ("report.html", [], NO_FLEET),
        ("results/a/result.json", ["--keep-results"], NO_FLEET),
        ("factors/a.factors.npz", ["--keep-factors", "tables"], NO_FLEET),
        ("cells.parquet", [], "if barnax wrote it, delete it, .*; else give --out another folder"),
    ],
)
def test_what_lies_in_a_folder_of_no_fleet_is_not_written_over(
    run, tmp_path, name, options, refusal
):
    (tmp_path / "m.csv").write_text("id,records\na,nowhere.csv\n")
    mine = tmp_path / "out" / name
    mine.parent.mkdir(parents=True)
    pl.DataFrame({"mine": [1]}).write_parquet(mine)
    before = mine.read_bytes()
    ended = run("fleet", tmp_path / "m.csv", "--out", tmp_path / "out", *options)
    assert ended.status == 2
    assert re.search(f"{refusal}$", ended.err)
    assert mine.read_bytes() == before
