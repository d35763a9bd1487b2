"""What every export starts from: curves over SOC as tables that are read linearly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

import barnax.export.tables
from barnax.cell import SegmentedHysteresis
from barnax.cell.circuits import Circuit, Hysteresis
from barnax.errors import InputError
from barnax.export.tables import TOLERANCE_V, linear_table, segment_table, tables_of
from barnax.over_soc.node_interval import NodeInterval
from barnax.search.answers import AtBound
from helpers.results import (
    CORRECTION_V,
    NODES,
    TABLE_OHM,
    make_cell,
    make_result,
    make_table_result,
    with_constant,
    with_fit,
)

from .conftest import DEGC, r0_ohm

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


def test_a_time_constant_at_a_bound_is_a_caveat():
    told = "tau2 ended at the upper bound of its search: the data do not set it."
    (bound,) = bounds = (AtBound("tau2 [s]", "upper"),)
    result = make_table_result()
    over_soc = with_fit(result, at_bound=(bound,))
    for bounded in (over_soc, with_constant(make_result(), at_bound=bounds)):
        assert told in tables_of(bounded).caveats
    # The constant circuit beside tables is not what is exported.
    assert told not in tables_of(with_constant(result, at_bound=bounds)).caveats


@pytest.mark.parametrize("direction", [1, -1])
def test_the_hysteresis_starts_where_the_last_current_left_it(direction):
    tables = tables_of(make_result(initial_direction=direction))
    w_v = make_cell().hysteresis(np.array(0.9))
    assert tables.initial_hysteresis_v == pytest.approx(direction * w_v / 2, abs=1e-12)


@pytest.mark.parametrize(
    ("source", "ocv_v", "w_v"),
    [
        ({"ocv_v": lambda cell, soc: cell.discharge(soc)}, make_cell().discharge(FINE), None),
        (
            {
                "ocv_v": lambda cell, soc: 3.5 + 0 * soc,
                "hysteresis": Hysteresis("instant", lambda cell: lambda soc: 0.02 * soc**2),
            },
            3.5,
            0.02 * FINE**2,
        ),
    ],
    ids=["without hysteresis", "with one"],
)
def test_a_circuit_of_ones_own_is_exported_with_its_own_source(monkeypatch, source, ocv_v, w_v):
    circuit = Circuit("with a source", "", **source)
    monkeypatch.setattr(barnax.export.tables, "get_circuit", lambda name: circuit)
    tables = tables_of(make_result())
    assert np.abs(tables.ocv(FINE) - ocv_v).max() < 1.1 * TOLERANCE_V
    assert tables.kind == ("none" if w_v is None else "instant")
    if w_v is None:
        assert tables.hysteresis is None
    else:
        assert np.abs(tables.hysteresis(FINE) - w_v).max() < 1.1 * TOLERANCE_V


def test_a_circuit_that_remembers_its_turns_is_refused():
    with pytest.raises(InputError, match="which no table over SOC holds"):
        tables_of(make_result("so-rc").model_copy(update={"model": "takacs"}))


def test_the_ocv_holds_the_correction_exactly():
    table, soc = tables_of(make_table_result()).ocv, np.linspace(0, 1, 401)
    expected_v = make_cell().average_ocv_v(soc) + np.interp(soc, NODES, CORRECTION_V)
    assert np.abs(table(soc) - expected_v).max() < 1.1 * TOLERANCE_V
    assert table.soc[0] == NODES[0]


def test_every_temperature_has_its_own_ocv(over_temperature):
    tables, soc = tables_of(over_temperature), np.array([0.33])
    for degc, row in zip(tables.degc, tables.ocv_v, strict=True):
        between = over_temperature.fits.tables.at(degc)
        lift_v = np.interp(degc, DEGC, (-4e-3, 0.0, 4e-3))
        mean_v = over_temperature.cell.average_ocv_v(soc) + lift_v
        expected_v = mean_v + between.at("OCV correction [V]", soc)
        assert np.interp(soc, tables.ocv.soc, row) == pytest.approx(expected_v, abs=6e-5)


def test_a_linear_look_up_follows_what_lies_between_temperatures(over_temperature):
    tables = tables_of(over_temperature)
    assert set(DEGC) <= set(tables.degc)
    rows = [np.interp(0.5, NODES, row) for row in tables.resistances["R0"]]
    assert rows[tables.degc.index(25.0)] == pytest.approx(TABLE_OHM[0][4])
    for degc in (7.3, 33.0):
        assert np.interp(degc, tables.degc, rows) == pytest.approx(r0_ohm(degc, 0.5), rel=5e-3)


def test_where_the_samples_do_not_determine_a_table_is_a_caveat():
    result = make_table_result()
    open_nodes = [NodeInterval("OCV [V]", soc, 3.2, 0.0, 0.0, None, None) for soc in (0.0, 0.05)]
    open_nodes.append(NodeInterval("R1 [Ohm]", 0.1, 0.0, 0.0, 0.0, None, 2e-3))
    undetermined = with_fit(result, intervals=(*result.fit.intervals, *open_nodes))
    told = " ".join(tables_of(undetermined).caveats)
    assert "OCV at SOC 0, 0.05." in told
    assert "a capacitance derived from it means nothing on its own: R1 at SOC 0.1." in told
    assert " at SOC 0" not in " ".join(tables_of(result).caveats[1:])
