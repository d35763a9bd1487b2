"""Curves over SOC as tables that are read linearly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

import barnax.export.tables
from barnax.cell import SegmentedHysteresis
from barnax.cell.circuits import Circuit
from barnax.export.tables import TOLERANCE_V, linear_table, segment_table, tables_of
from helpers.results import make_cell, make_result

FINE = np.linspace(0.0, 1.0, 40001)


@given(st.lists(st.floats(2.5, 4.3), min_size=3, max_size=12), st.integers(0, 2**32 - 1))
def test_a_table_follows_any_monotone_cubic_within_the_tolerance(voltages_v, seed):
    inner = np.random.default_rng(seed).uniform(0.01, 0.99, len(voltages_v) - 2)
    soc = np.sort(np.concatenate([[0.0, 1.0], inner]))
    soc = np.maximum.accumulate(soc + 1e-3 * np.arange(len(soc))) / (1 + 1e-3 * len(soc))
    curve = PchipInterpolator(soc, voltages_v, extrapolate=True)

    def clipped(at):
        return curve(np.clip(at, soc[0], soc[-1]))

    table = linear_table(clipped, soc)
    assert np.all(np.diff(table.soc) > 0)
    assert (table.soc[0], table.soc[-1]) == (0.0, 1.0)
    # Between the three places that are checked, a cubic bends little more.
    assert np.abs(table(FINE) - clipped(FINE)).max() < 1.1 * TOLERANCE_V


def test_a_straight_curve_needs_its_break_points_only():
    table = linear_table(lambda soc: np.maximum(soc, 0.25), np.array([0.25]))
    np.testing.assert_array_equal(table.soc, [0.0, 0.25, 1.0])


def test_points_outside_zero_to_one_are_none_of_the_table():
    table = linear_table(lambda soc: 3 + soc, np.array([-0.02, 1.03]))
    np.testing.assert_array_equal(table.soc, [0.0, 1.0])


def test_the_ocv_of_a_result_is_the_mean_of_both_branches():
    cell, ocv = make_cell(), tables_of(make_result()).ocv
    mean_v = (cell.charge(FINE) + cell.discharge(FINE)) / 2
    assert np.abs(ocv(FINE) - mean_v).max() < 1.1 * TOLERANCE_V


@pytest.mark.parametrize("fit", ["continuous", "independent"])
def test_the_hysteresis_table_reads_as_its_segments(fit):
    rng = np.random.default_rng(1)
    w = SegmentedHysteresis.fit(np.linspace(0, 1, 40), 0.02 * rng.random(40), fit)
    table = segment_table(w)
    assert np.all(np.diff(table.soc) > 0)
    # A step takes a billionth of SOC.
    np.testing.assert_allclose(table(FINE), w(FINE), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("circuit", "kind"),
    [("so-rc", "none"), ("3rc", "none"), ("iso-rc", "instant"), ("esc", "dynamic")],
)
def test_the_kind_of_hysteresis_follows_the_circuit(circuit, kind):
    tables = tables_of(make_result(circuit))
    assert tables.kind == kind
    assert (tables.hysteresis is None) == (kind == "none")


def test_a_result_that_stores_no_rest_current_has_a_hundredth_of_the_capacity():
    assert tables_of(make_result(rest_current_a=None)).rest_current_a == pytest.approx(0.02)


@pytest.mark.parametrize("direction", [1, -1])
def test_the_hysteresis_starts_where_the_last_current_left_it(direction):
    tables = tables_of(make_result(initial_direction=direction))
    w_v = make_cell().hysteresis(np.array(0.9))
    assert tables.initial_hysteresis_v == pytest.approx(direction * w_v / 2, abs=1e-12)


def test_a_circuit_of_ones_own_is_exported_with_its_own_source(monkeypatch):
    own = Circuit("own", "the discharge branch", lambda cell, soc, direction: cell.discharge(soc))
    monkeypatch.setattr(barnax.export.tables, "get_circuit", lambda name: own)
    tables = tables_of(make_result())
    assert np.abs(tables.ocv(FINE) - make_cell().discharge(FINE)).max() < 1.1 * TOLERANCE_V
    assert tables.hysteresis is None


def test_a_hysteresis_of_ones_own_is_exported_too(monkeypatch):
    own = Circuit("own", "", lambda cell, soc, direction: 3.5 + direction * 0.01 * soc**2)
    monkeypatch.setattr(barnax.export.tables, "get_circuit", lambda name: own)
    tables = tables_of(make_result())
    assert tables.kind == "instant"
    assert np.abs(tables.ocv(FINE) - 3.5).max() < 1.1 * TOLERANCE_V
    assert np.abs(tables.hysteresis(FINE) - 0.02 * FINE**2).max() < 1.1 * TOLERANCE_V
