"""The command for fleets, without identifications."""

from concurrent.futures import ThreadPoolExecutor

import polars as pl


def test_the_report_is_of_the_cells_of_the_manifest(run, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "barnax.fleet.engine.ProcessPoolExecutor", lambda *_, **__: ThreadPoolExecutor(1)
    )
    monkeypatch.setattr(
        "barnax.fleet.rows.identify_cell", lambda cell, *_: {"id": cell.id, "error": "no"}
    )
    manifest, out = tmp_path / "m.csv", tmp_path / "out"
    for names, told in (("ab", "0 of 2 cells identified"), ("b", "0 of 1 cell identified")):
        rows = "".join(f"{name},nowhere.csv\n" for name in names)
        manifest.write_text(f"id,records\n{rows}")
        found = run("fleet", manifest, "--out", out)
        assert found.status == 0, found.err
        assert told in found.out
        assert told in (out / "report.html").read_text()
    assert pl.read_parquet(out / "cells.parquet")["id"].to_list() == ["a", "b"]
