"""Fleets that kept factors, grouped and fitted again."""

import pytest

import barnax
from barnax import FleetCell, InputError, identify_fleet
from barnax.cell.parameters import ANYWHERE
from barnax.fit.factor_file import factors_to_bytes
from barnax.fit.record_factors import Grid, factors_of
from barnax.fleet.dataset import (
    dataset_path,
    factors_path,
    keep_file,
    read_rows,
    regrouped,
    write_rows,
)
from barnax.fleet.rows import identify_rows
from barnax.model.prepared import Window, prepare_record
from helpers.made_cell import made


@pytest.fixture(autouse=True)
def untried(monkeypatch):
    """Without the trial in a process of its own, which takes a second: test_dataset.py has it."""
    monkeypatch.setattr("barnax.fleet.dataset.rows_of_others", read_rows)


@pytest.fixture(scope="module")
def fleet(tmp_path_factory, bundled_record, bundled_cell):
    """Two rows of one cell with factors of constants, and one that failed."""
    out = tmp_path_factory.mktemp("fleet")
    rows = []
    for name, first_s in (("a", 0.0), ("b", 2000.0)):
        window = Window(score_from_s=first_s, score_to_s=first_s + 2000.5)
        prepared = prepare_record(bundled_record, bundled_cell, "so-rc", window)
        factors = factors_of(prepared, Grid(low_s=4.0, high_s=250.0, nodes=ANYWHERE))
        size = keep_file(out, factors_path(out, name), factors_to_bytes([factors]))
        rows.append({"id": name, "error": None, "cell_name": "A/1", "factor bytes": size})
    rows.append({"id": "c", "error": "no such file", "cell_name": "B", "factor bytes": None})
    write_rows(dataset_path(out), rows)
    return out


def test_rows_alike_in_a_column_are_one_cell(fleet):
    (cell,) = regrouped(fleet, ["cell_name"])
    assert (cell.id, len(cell.records), cell.carried) == ("A-1", 2, {"cell_name": "A/1"})
    (row,) = identify_rows(cell, {"seeds": 0})
    assert row["error"] is None
    assert row["samples"] == 2000 + 2001
    # That of the bundled cell.
    assert row["R0 [Ohm]"] == pytest.approx(0.05, rel=0.1)


def test_the_mean_cell_of_a_pack_is_none_of_its_cells(fleet, tmp_path):
    factors = (fleet / "factors" / "a.factors.npz").read_bytes()
    for name in ("car", "car V1", "car V2"):
        keep_file(tmp_path, factors_path(tmp_path, name), factors)
    rows = [{"id": "car", "pack": None}, *({"id": f"car V{k}", "pack": "car"} for k in (1, 2))]
    write_rows(dataset_path(tmp_path), [{**each, "error": None, "model": "x"} for each in rows])
    (cell,) = regrouped(tmp_path, ["model"])
    assert [each.rpartition("/")[2] for each in cell.records] == [
        "car V1.factors.npz",
        "car V2.factors.npz",
    ]


def test_a_row_that_names_another_folder_is_refused(tmp_path):
    write_rows(dataset_path(tmp_path), [{"id": "../a", "error": None, "model": "x"}])
    with pytest.raises(InputError, match=r"'../a', which is no name of a file"):
        regrouped(tmp_path, ["model"])


def test_groups_that_would_have_one_name_are_refused_with_both(fleet, tmp_path):
    for name in "ab":
        keep_file(
            tmp_path,
            factors_path(tmp_path, name),
            (fleet / "factors" / "a.factors.npz").read_bytes(),
        )
    rows = [{"id": name, "error": None, "car": car} for name, car in (("a", "A/1"), ("b", "A-1"))]
    write_rows(dataset_path(tmp_path), rows)
    with pytest.raises(InputError, match=r"A/1 and A-1 would both be called 'A-1'; change"):
        regrouped(tmp_path, ["car"])


def test_kept_factors_of_a_chosen_circuit_answer_as_its_record_does(tmp_path):
    """Without an OCV test one value of each resistance, with the OCV of its own."""
    record, _ = made(1)
    window = Window(initial_soc=1.0, capacity_ah=2.0)
    quick = {"seeds": 0, "trust": "none"}
    direct = barnax.identify(record, model="1rc", window=window, **quick)
    (evaluation,) = direct.without_tables().evaluations.identification
    factors = factors_of(evaluation.prepared, Grid(circuit="1rc"))
    cell = FleetCell("a", [keep_at(tmp_path, factors)])
    (row,) = identify_rows(cell, {"seeds": 0, "model": "1rc"})
    assert (row["error"], row["answer"]) == (None, "1rc with a fitted OCV")
    tables = direct.fit.tables
    for name, (value,) in tables.tables.items():
        assert row[f"tables {name}"] == pytest.approx(value, rel=1e-9)
    (whole,) = identify_rows(cell, {"seeds": 0, "over": "soc"})
    assert whole["answer"] == "tables over SOC (1rc)"
    (row,) = identify_rows(cell, {"seeds": 0, "model": "so-rc"})
    assert "the factors are of 1rc, and so-rc was asked for" in row["error"]


@pytest.mark.parametrize("given", [{"settings": "esc"}, {"cell": "esc"}])
def test_a_circuit_whose_factors_cannot_be_kept_is_refused_before_any_cell(tmp_path, given):
    settings = {"keep_factors": "tables", "model": given.get("settings", "so-rc")}
    options = {"model": given["cell"]} if "cell" in given else {}
    cells = [FleetCell("a", ["no.csv"]), FleetCell("b", ["no.csv"], options=options)]
    begun = []
    with pytest.raises(InputError, match=r"dynamic hysteresis.*, or keep none"):
        identify_fleet(cells, tmp_path, settings=settings, workers=1, report=begun.append)
    assert not begun


def keep_at(folder, factors):
    path = folder / "a.factors.npz"
    path.write_bytes(factors_to_bytes([factors]))
    return str(path)
