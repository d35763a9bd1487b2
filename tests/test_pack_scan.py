"""Cells of a pack that are measured one after another: each has its own lag, found and fitted."""

import numpy as np
import polars as pl
import pytest

import barnax
from barnax.records import record_from_frame
from barnax.records.lag import find_scan
from helpers.packs import PackedCell, alike, frame, ocv_table, ocv_v
from helpers.reference import drop_v, filtered_response
from helpers.shared import CASES, needs_cases

SYSTEMS = CASES / "systems"
# The load is simulated at so many points of a second, and logged every second.
FINE, SECONDS = 20, 4000
LAG = "voltage lag [s]"


def scanned(cells, lag_s, seed=3, noise_v=5e-4):
    """The log of a scan: each cell so much older than the current, whose levels change by ramps of
    whole seconds, so that it is linear between rows."""
    rng = np.random.default_rng(seed)
    at_s = np.cumsum(rng.integers(5, 20, SECONDS))
    time_s = np.arange(SECONDS * FINE) / FINE
    levels_a = np.append(0.0, rng.normal(2.5, 4.0, len(at_s)))
    corners_s = np.column_stack([at_s, at_s + 4.0]).ravel()
    current_a = np.interp(time_s, corners_s, np.column_stack([levels_a[:-1], levels_a[1:]]).ravel())
    passed_ah = np.append(0.0, np.cumsum(current_a[:-1])) / FINE / 3600
    rows = FINE * np.arange(1, SECONDS)
    columns = []
    for cell, late_s in zip(cells, lag_s, strict=True):
        drop = drop_v(filtered_response, 1 / FINE, current_a, cell.circuit)
        voltage_v = ocv_v(cell.soc - passed_ah / cell.capacity_ah) - drop
        read_v = voltage_v[rows - np.round(late_s * FINE).astype(int)]
        columns.append(read_v + noise_v * rng.standard_normal(len(rows)))
    return np.stack(columns, axis=1), current_a[rows]


def test_cells_that_are_scanned_have_separate_lags_and_resistances_that_do_not_fall():
    cells = [PackedCell(r0_ohm=0.02 * (1 + 0.25 * (k == 6))) for k in range(9)]
    lag_s = 0.1 * np.arange(9)
    pack = barnax.identify_pack(
        frame(*scanned(cells, lag_s)),
        ocv=[ocv_table()], capacity=5.0, window=barnax.Window(initial_soc=0.97), max_boxes=0,
        folds=0, nodes=(0.2, 0.4, 0.6, 0.8, 1.0),
    )  # fmt: skip
    rows = pack.rows()
    assert [row[LAG] for row in rows] == pytest.approx(lag_s.tolist(), abs=0.03)
    r0_ohm = np.array([row["R0 [Ohm]"] for row in rows], float)
    assert np.ptp(r0_ohm / [cell.r0_ohm for cell in cells]) < 0.02
    assert {(odd.cell, odd.quantity) for odd in pack.odd} == {
        ("V7", "R0 [Ohm]"), ("V7", "total R [Ohm]"),
    }  # fmt: skip
    (notice,) = [one for one in pack.result.warnings if one.code == "late-voltage.scanned"]
    assert "-0.00 s to 0.80 s older" in str(notice)


@pytest.mark.parametrize("late_s", [0.0, 0.5])
def test_cells_that_are_measured_at_once_are_no_scan(late_s):
    voltages_v, current_a = scanned(alike(6), np.full(6, late_s))
    mean = pl.DataFrame(
        {"Time [s]": np.arange(len(current_a)) * 1.0, "Current [A]": -current_a}
    ).with_columns(pl.Series("Voltage [V]", voltages_v.mean(axis=1)))
    record = record_from_frame(mean, voltage_lag=0.0)
    assert find_scan(record, voltages_v) is None


@pytest.mark.slow
@needs_cases
def test_of_a_scanned_pack_the_planted_cells_are_odd_and_r0_does_not_fall_along_it():
    pack = barnax.identify_pack(
        SYSTEMS / "p24_scan.csv.gz",
        ocv=[SYSTEMS / "pack_ocv.csv.gz"], capacity=5.0,
        window=barnax.Window(initial_soc=0.97), max_boxes=0,
    )  # fmt: skip
    assert {(odd.cell[:7], odd.quantity) for odd in pack.odd} == {
        ("Cell 05", "R0 [Ohm]"), ("Cell 22", "total R [Ohm]"),
        ("Cell 11", "capacity ratio"), ("Cell 17", "SOC shift"),
    }  # fmt: skip
    rows = pack.rows()
    assert [row[LAG] for row in rows] == pytest.approx([0.04 * k for k in range(24)], abs=0.02)
    others = np.array([row["R0 [Ohm]"] for k, row in enumerate(rows, 1) if k != 5])
    slope, middle = np.polyfit(np.linspace(-0.5, 0.5, 23), others, 1)
    assert abs(slope) < 0.02 * middle
    assert np.std(others) < 0.015 * middle
