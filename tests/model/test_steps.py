"""What rare steps of the current show of R0, against the closed form of RC pairs."""

import numpy as np
import pytest

from barnax.model.prepared import prepare_record
from barnax.model.steps import shown_r0_ohm, steps_of
from barnax.model.window import Window
from barnax.over_soc.fit import fit_tables
from barnax.over_soc.settings import TableSettings
from helpers.known_cell import FEW_NODES, cell_with_branches, ocv_v
from helpers.reference import filtered_response, make_record

R0_OHM, R_OHM, TAU_S = 0.1, (0.01, 0.015, 0.02), (4.0, 60.0, 700.0)
# A second after the one in which the current changed, of a current that flows after its sample.
SHOWN_OHM = R0_OHM + sum(r * -np.expm1(-1 / tau) for r, tau in zip(R_OHM, TAU_S, strict=True))
NODES = np.array(FEW_NODES)
QUICK = TableSettings(nodes=FEW_NODES, max_boxes=0, folds=0)


def titrated(noise_v=0.0, seed=0, rest_s=2400):
    """Pulses of six minutes, each with a rest, from full down to 20 % SOC."""
    current_a = np.tile(np.repeat([0.0, 1.0], [rest_s, 360]), 16)
    time_s = np.arange(float(len(current_a)))
    soc = 1.0 - np.append(0.0, np.cumsum(current_a[:-1])) / 7200
    voltage_v = ocv_v(soc) - R0_OHM * current_a
    for r_ohm, tau_s in zip(R_OHM, TAU_S, strict=True):
        voltage_v -= r_ohm * filtered_response(1.0, current_a, tau_s, "forward")
    voltage_v += noise_v * np.random.default_rng(seed).standard_normal(len(soc))
    record = make_record(time_s, current_a, voltage_v)
    window = Window(initial_soc=1.0, capacity_ah=2.0)
    return prepare_record(record, cell_with_branches(0.0), "so-rc", window)


@pytest.mark.parametrize("seed", range(5))
def test_the_most_that_r0_can_be_is_what_steps_show_and_the_error_of_that(seed):
    prepared = titrated(1e-3, seed)
    before, after = steps_of(prepared)
    assert len(before) == 31
    assert set(after - before) == {2}
    shown_ohm, reach_ohm = shown_r0_ohm([prepared], NODES)
    shown = np.isfinite(reach_ohm)
    assert shown.tolist() == [False, True, True, True, True, False]
    # Five in a hundred are farther, and 1 mV of noise in some six steps is 0.6 mOhm.
    assert np.sum(np.abs(shown_ohm - SHOWN_OHM)[shown] > reach_ohm[shown]) <= 1
    assert np.all(reach_ohm[shown] < 2e-3)


def test_a_load_that_steps_all_the_time_tells_r0_by_its_samples():
    assert np.all(np.isinf(shown_r0_ohm([titrated(rest_s=100)], NODES)[1]))


def test_slow_pairs_buy_no_r0_beyond_what_steps_show():
    """Of a circuit with a pair less than the cell, least squares put the fast one into R0."""
    prepared = titrated(2e-4)
    bounds = {"R0 [Ohm]": (0.0, 1.0)}
    free, own = (
        fit_tables([prepared], TableSettings(**{**vars(QUICK), "bounds": given}))
        for given in (bounds, {})
    )
    nodes = NODES[1:5]
    assert np.all(free.tables.at("R0 [Ohm]", nodes) > SHOWN_OHM + 1e-3)
    most_ohm = sum(shown_r0_ohm([prepared], NODES))[1:5]
    assert np.all(own.tables.at("R0 [Ohm]", nodes) <= most_ohm)
    inside = [one for one in own.of_table("R0 [Ohm]") if one.soc in nodes]
    assert len(inside) == 4
    assert all(one.low is not None and one.low <= SHOWN_OHM <= one.high for one in inside)


def test_no_interval_of_r0_excludes_what_rare_steps_show():
    """Of a circuit with a fast pair that is wrong, R0 makes up for it."""
    fixed = {"tau1 [s]": 2.0, "R1 [Ohm]": 0.03}
    settings = TableSettings(**{**vars(QUICK), "fixed": fixed})
    fit = fit_tables([titrated(2e-4)], settings)
    inside = [one for one in fit.of_table("R0 [Ohm]") if one.soc in NODES[1:5]]
    assert max(one.value for one in inside) < SHOWN_OHM - 5e-3
    assert all(one.high is not None and one.high >= SHOWN_OHM - 1e-3 for one in inside)
