"""Samples near empty that would set the time constants of all."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator
from scipy.signal import lfilter

from barnax import record_from_frame
from barnax.cell import CircuitParameters, OcvPoint, OcvTable, characterize
from barnax.model.prepared import Window, prepare_record
from barnax.model.reference import simulate_circuit
from barnax.over_soc import TableSettings
from barnax.over_soc.dependence import searched
from barnax.over_soc.further_terms import at_rates
from barnax.over_soc.intervals import intervals_of
from barnax.over_soc.low_end import without_low_end

CAPACITY_AH, NOISE_V, TAU_S = 3.0, 1e-3, (8.0, 180.0)
EVENLY = TableSettings(max_boxes=0, evenly=True)
PLAIN = TableSettings(max_boxes=0)
OCV_SOC = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
OCV_V = (2.9, 3.15, 3.3, 3.42, 3.53, 3.59, 3.63, 3.68, 3.76, 3.86, 3.95, 4.05, 4.1, 4.18)
OCV = PchipInterpolator(OCV_SOC, OCV_V)


def r_ohm(soc):
    """R0, R1 and R2, which rise steeply toward empty."""
    at = (0, 0.1, 0.3, 0.6, 1)
    return (
        np.interp(soc, (0, 0.05, 0.1, 0.2, 0.5, 1), (0.05, 0.042, 0.036, 0.032, 0.03, 0.031)),
        np.interp(soc, at, (0.03, 0.018, 0.012, 0.01, 0.011)),
        np.interp(soc, at, (0.06, 0.035, 0.018, 0.014, 0.016)),
    )


@pytest.fixture(scope="module")
def emptied():
    """A discharge at C/2 with pulses to empty, and its cell with an OCV test every 5 % SOC."""
    steps = [(0, 900), *[(1.5, 240), (4.5, 10), (1.5, 50), (0, 30)] * 24]
    current_a = np.concatenate([np.full(length, level) for level, length in steps])
    soc = 1 - np.append(0, np.cumsum(current_a[:-1])) / 3600 / CAPACITY_AH
    current_a, soc = current_a[soc > 0.002], soc[soc > 0.002]
    r0, *r = r_ohm(soc)
    voltage_v = OCV(soc) - r0 * current_a
    for own_ohm, tau_s in zip(r, TAU_S, strict=True):
        kept = np.exp(-1 / tau_s)
        voltage_v -= lfilter([0, 1 - kept], [1, -kept], own_ohm * current_a)
    voltage_v += NOISE_V * np.random.default_rng(1).standard_normal(len(soc))
    frame = {
        "Time [s]": np.arange(len(soc)),
        "Current [A]": current_a,
        "Voltage [V]": voltage_v,
    }
    record = record_from_frame(
        frame, name="emptied", current_sign="discharge-positive", current_hold="forward"
    )
    fine = np.linspace(0, 1, 21)
    points = tuple(
        OcvPoint(*pair, "ocv", row=0, rest_s=0.0)
        for pair in zip(fine.tolist(), OCV(fine).tolist(), strict=True)
    )
    table = OcvTable("ocv", {0: points}, sha256="")
    cell = characterize([table], capacity_ah=CAPACITY_AH, ocv_fit="interpolated")
    return prepare_record(record, cell, "so-rc", Window(initial_soc=1.0))


@pytest.fixture(scope="module")
def weighed(emptied):
    return searched([emptied], PLAIN)


def off(found):
    """How far off time constants are, and the second pair's resistance from 20 % SOC on."""
    objective, best = found
    tables, soc = objective.tables_at(best), np.linspace(0.2, 1, 9)
    r2 = tables.at("R2 [Ohm]", soc) / r_ohm(soc)[2] - 1
    return np.abs(np.array(tables.tau_s) / TAU_S - 1), np.median(np.abs(r2))


def test_a_steep_end_does_not_set_the_time_constants(emptied, weighed):
    evenly = searched([emptied], EVENLY)
    assert evenly[0].low_end is None
    # What it is there for.
    assert np.all(off(evenly)[0] > (0.1, 0.5))
    assert off(evenly)[1] > 0.3
    assert np.all(off(weighed)[0] < (0.01, 0.1))
    assert off(weighed)[1] < 0.1
    told = weighed[0].low_end
    assert told.other_tau_s == pytest.approx(np.exp(evenly[1].log_scales))
    assert told.weight == pytest.approx(told.times**-2)


@pytest.mark.slow
def test_where_neither_fit_is_plainly_better_intervals_reach_over_both(emptied, monkeypatch):
    monkeypatch.setattr("barnax.over_soc.low_end.ALIKE", -1.0)
    evenly, both = searched([emptied], EVENLY), searched([emptied], PLAIN)
    assert both[1].log_scales == evenly[1].log_scales
    assert both[0].low_end.weight == 1.0

    def held(found):
        own = {node.name: node for node in intervals_of(*found) if node.soc is None}
        return [
            own[f"tau{number} [s]"].low <= tau_s <= own[f"tau{number} [s]"].high
            for number, tau_s in enumerate(TAU_S, 1)
        ]

    assert held(evenly) == [False, False]
    assert held(both) == [True, True]


def test_the_objective_is_of_weighed_errors(emptied, weighed):
    objective, best = weighed
    error_v = emptied.voltage_v - simulate_circuit(emptied, objective.tables_at(best))
    weights = np.where(emptied.soc >= 0.1, 1.0, objective.low_end.weight)
    bent = objective.table_penalty @ np.concatenate(best.values)
    expected_v2 = np.mean((weights * error_v)[emptied.scored] ** 2) + bent @ bent
    assert best.objective_v2 == pytest.approx(expected_v2, rel=1e-6)


@pytest.mark.slow
def test_a_record_whose_low_end_is_fitted_as_well_counts_evenly(emptied):
    # A truth that tables can hold, nodes and all.
    nodes = TableSettings().nodes
    truth = CircuitParameters.over_soc(
        nodes=nodes,
        tau_s=TAU_S,
        r0_ohm=tuple(r_ohm(np.array(nodes))[0].tolist()),
        r_ohm=tuple(tuple(row.tolist()) for row in r_ohm(np.array(nodes))[1:]),
    )
    voltage_v = simulate_circuit(emptied, truth)
    noise_v = NOISE_V * np.random.default_rng(2).standard_normal(len(voltage_v))
    alike = replace(emptied, record=replace(emptied.record, voltage_v=voltage_v + noise_v))
    objective, best = searched([alike], PLAIN)
    assert objective.low_end is None
    assert without_low_end(objective, best) == (objective, best)


def test_a_hysteresis_is_looked_for_with_what_counts_less_below_10_percent(emptied, weighed):
    """With one more table the weighed errors can only fall; counted evenly they are larger."""
    objective, best = weighed
    record = prepare_record(emptied.record, emptied.cell, "esc", emptied.window)
    settings = replace(PLAIN, half_hysteresis=True)
    evenly, less = (
        next(at_rates([record], settings, best.log_scales, low_end)).objective_v2
        for low_end in (None, objective.low_end)
    )
    assert less <= best.objective_v2 * (1 + 1e-6) < evenly
