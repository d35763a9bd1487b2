"""Packs: every cell from one reduction, and the planted odd ones found."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from barnax import CircuitParameters, InputError, TableSettings, Window, identify_pack
from barnax.fit.pack import fit_pack
from barnax.fit.record_factors import Grid, factors_of_cells, fit_factors
from barnax.fleet.manifest import fleet_cell_from_row
from barnax.fleet.rows import identify_rows
from barnax.model.prepared import prepare_record
from barnax.records import record_from_frame, source_from_frame
from barnax.records.read import read_pack
from barnax.reporting.fleet import pack_document
from barnax.reporting.render import to_markdown
from helpers.packs import PackedCell, alike, drive_a, frame, ocv_table, simulated

SAMPLES = 4500
START = PackedCell().soc
# The cells' resistances are the same at every SOC.
QUICK = {
    "capacity": 5.0,
    "window": Window(initial_soc=START),
    "max_boxes": 0,
    "folds": 0,
    "nodes": (0.2, 0.4, 0.6, 0.8, 1.0),
}


@pytest.fixture(scope="module")
def cells():
    """Twelve cells, of which one has a high R0, one a low capacity, and one started emptier."""
    actual = alike(12)
    actual[2] = replace(actual[2], r0_ohm=1.2 * actual[2].r0_ohm)
    actual[6] = replace(actual[6], capacity_ah=0.94 * actual[6].capacity_ah)
    actual[9] = replace(actual[9], soc=actual[9].soc - 0.04)
    return actual


@pytest.fixture(scope="module")
def voltages(cells):
    current_a = drive_a(SAMPLES)
    return simulated(cells, current_a), current_a


@pytest.fixture(scope="module")
def pack(voltages):
    return identify_pack(frame(*voltages), **QUICK)


def test_the_planted_cells_are_odd_and_no_others(pack):
    assert {(each.cell, each.quantity) for each in pack.odd} == {
        ("V3", "R0 [Ohm]"), ("V3", "total R [Ohm]"), ("V7", "capacity ratio"), ("V10", "SOC shift"),
    }  # fmt: skip
    # Its end of discharge comes first.
    assert pack.weakest == "V7"


def test_every_cell_has_its_resistance_capacity_and_start(cells, pack):
    capacity_ah = np.mean([each.capacity_ah for each in cells])
    soc = np.mean([each.soc for each in cells])
    for cell, row in zip(cells, pack.rows(), strict=True):
        assert row["R0 [Ohm]"] == pytest.approx(cell.r0_ohm, rel=2e-3)
        assert row["total R [Ohm]"] == pytest.approx(cell.total_ohm, rel=1e-2)
        assert row["SOC shift"] == pytest.approx(cell.soc - soc, abs=2e-3)
        assert row["capacity ratio"] == pytest.approx(cell.capacity_ah / capacity_ah, abs=5e-3)
        assert row["R0 [Ohm] low"] < row["R0 [Ohm]"] < row["R0 [Ohm] high"]


def test_intervals_hold_what_is_true_where_the_current_flowed_before_each_sample():
    cells, current_a = alike(3), drive_a(2000)
    before_a = np.append(0.0, current_a[:-1])
    ohm = np.array([cell.r0_ohm for cell in cells])
    # At the end of an interval, its pairs and OCV are what they are at the next sample's start.
    ends_v = simulated(cells, current_a) + np.outer(current_a - before_a, ohm)
    rows = identify_pack(frame(ends_v, before_a), **QUICK).rows()
    for cell, row in zip(cells, rows, strict=True):
        assert row["R0 [Ohm]"] == pytest.approx(1.033 * cell.r0_ohm, rel=0.01)
        assert row["R0 [Ohm] low"] < cell.r0_ohm < row["R0 [Ohm] high"]
        assert row["R0 [Ohm] low"] > 0.97 * cell.r0_ohm
        assert row["total R [Ohm] low"] < cell.total_ohm < row["total R [Ohm] high"]


@pytest.mark.parametrize("is_alone", [False, True])
def test_cells_of_one_reduction_are_those_fitted_one_by_one(bundled_cell, voltages, is_alone):
    voltages_v, current_a = voltages[0][:1500, :2], voltages[1][:1500]
    table = frame(voltages_v, current_a)
    mean = table.select("Time [s]", "Current [A]", pl.mean_horizontal("V1", "V2").alias("V"))
    window = Window(initial_soc=START, capacity_ah=5.0)
    settings = TableSettings(
        nodes=(0.5, 0.7, 0.85, 1.0), bounds={"tau1 [s]": (5.0, 40.0), "tau2 [s]": (60.0, 400.0)}
    )

    def fitted(frame_of_one, voltage_offsets_v, names):
        record = record_from_frame(frame_of_one, name="pack")
        prepared = prepare_record(record, bundled_cell, "so-rc", window)
        return fit_pack(prepared, tables, voltage_offsets_v, names, settings, is_alone)

    tables = CircuitParameters.over_soc(
        settings.nodes, (15.0, 150.0), (0.02,) * 4, ((0.01,) * 4,) * 2
    )
    voltage_offsets_v = voltages_v - voltages_v.mean(axis=1)[:, None]
    both = fitted(mean, voltage_offsets_v, ["V1", "V2"])
    for index, together in enumerate(both.cells):
        one = table.select("Time [s]", "Current [A]", pl.col(f"V{index + 1}").alias("V"))
        alone = fitted(mean, voltage_offsets_v[:, [index]], ["alone"]).cells[0]
        itself = fitted(one, np.zeros((1500, 1)), ["itself"]).cells[0]
        for other in (alone, itself):
            assert together.rmse_v == pytest.approx(other.rmse_v, rel=1e-9)
            rel = 1e-5 if is_alone else 1e-9
            assert together.tables.ohm[0] == pytest.approx(other.tables.ohm[0], rel=rel)


def test_factors_of_cells_are_those_of_their_records(bundled_cell, voltages):
    voltages_v, current_a = voltages[0][:1500, :2], voltages[1][:1500]
    table = frame(voltages_v, current_a)
    window = Window(initial_soc=START, capacity_ah=5.0)
    grid = Grid(low_s=5.0, high_s=300.0, nodes=(0.5, 0.7, 0.85, 1.0))

    def prepared(name):
        one = table.select("Time [s]", "Current [A]", pl.col(name).alias("V"))
        record = record_from_frame(one, name="pack")
        return prepare_record(record, bundled_cell, "so-rc", window)

    voltage_offsets_v = voltages_v - voltages_v[:, [0]]
    factors = factors_of_cells(prepared("V1"), grid, voltage_offsets_v, ["V1", "V2"])
    (alone,) = factors_of_cells(prepared("V2"), grid)
    one, other = fit_factors(factors[1:]), fit_factors([alone])
    assert one.objective_v == pytest.approx(other.objective_v, rel=1e-9)


def test_a_fleet_has_a_row_for_every_cell_and_one_for_the_pack(voltages, tmp_path):
    frame(voltages[0][:3000, :3], voltages[1][:3000]).write_csv(tmp_path / "pack.csv")
    ocv_table().write_csv(tmp_path / "ocv.csv")
    given = {"id": "P1", "records": "pack.csv", "ocv": "ocv.csv", "pack_cells": "V*"}
    cell = fleet_cell_from_row({**given, "capacity": 5.0, "initial_soc": START, "car": 7}, tmp_path)
    settings = {"seeds": 0, "keep_factors": "constants", "max_boxes": 0, "folds": 0}
    rows = identify_rows(cell, settings, tmp_path / "out")
    assert [row["error"] for row in rows] == [None] * 4
    assert [row["id"] for row in rows] == ["P1", "P1 V1", "P1 V2", "P1 V3"]
    assert {row["car"] for row in rows} == {7}
    assert all(row["factor bytes"] > 0 for row in rows)


def of(table, cells=None):
    return read_pack(source_from_frame(table, "pack"), cells)


def test_cells_are_those_of_their_numbers_or_named_and_one_without_a_value_is_left_out(voltages):
    table = frame(voltages[0][:300], voltages[1][:300], name="Cell {} voltage [mV]")
    millivolts = table.with_columns(pl.col("^Cell.*$") * 1000, pl.lit(23.0).alias("T1"))
    names = [f"Cell {k} voltage [mV]" for k in range(1, 13)]
    whole = of(millivolts)
    assert (whole.cells, of(millivolts, "Cell 1*").cells) == ((*names,), (names[0], *names[9:]))
    assert whole.record.voltage_v == pytest.approx(voltages[0][:300].mean(axis=1))
    gap = pl.when(pl.int_range(pl.len()) != 17).then(pl.col(names[3])).alias(names[3])
    part = of(millivolts.with_columns(gap, pl.lit(10.0).alias(names[4])), "Cell*")
    assert part.left_out.keys() == {*names[3:5]}
    assert "row 19" in part.left_out[names[3]]
    assert len(part.cells) == part.voltage_offsets_v.shape[1] == 10


@pytest.mark.parametrize("names", [("Zeit [s]", "Strom [A]"), ("Time [s]", "Pack current [A]")])
def test_a_pack_has_the_names_of_a_record_and_one_is_named_where_a_cell_is_wanted(voltages, names):
    table = frame(*voltages).rename(dict(zip(("Time [s]", "Current [A]"), names, strict=True)))
    assert len(read_pack(source_from_frame(table, "pack")).cells) == 12
    with pytest.raises(InputError, match=r"'V1', 'V2', .* pack's cells; give it to barnax pack"):
        record_from_frame(table)


@pytest.mark.parametrize(
    "other", ["Aux T {} (C)", "Aux_Temperature(C)_{}", "Flag{}", "Cell {} temp", "Cell {} [mOhm]"]
)
def test_columns_of_something_else_are_no_cells_of_a_pack(voltages, other):
    table = frame(voltages[0][:300, :1], voltages[1][:300], name="Klemme")
    beside = table.with_columns(pl.lit(3.0 + 0.1 * k).alias(other.format(k)) for k in (1, 2, 3))
    with pytest.raises(InputError, match="no column for the voltage") as error:
        record_from_frame(beside)
    assert error.value.code.startswith("columns.missing")
    with pytest.raises(InputError, match="no columns of cell voltages found"):
        of(beside)


@pytest.mark.slow
def test_findings_in_the_record_of_a_pack_are_reported_with_what_is_assumed(voltages):
    table = frame(*voltages).with_columns(pl.col("^V.*$").shift(2)).drop_nulls()
    options = {"capacity": 5.0, "window": Window(initial_soc=START), "max_boxes": 0}
    late = identify_pack(table, **options)
    assert "late-voltage.apart" in {notice.code for notice in late.result.warnings}
    assert late.result.inputs[0].voltage_lag_s == pytest.approx(2.0, abs=0.05)
    told = to_markdown(pack_document(late))
    assert "Assumed: each sample's current flows until the next sample" in " ".join(told.split())
