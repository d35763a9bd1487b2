"""The mean of a table over SOC and its interval: by its weights, by coverage, and at a bound."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax.execution import in_float64
from barnax.fit.intervals import intervals_of
from barnax.fit.node_interval import node_weights
from barnax.fit.table_problem import reduced_objective
from barnax.model.prepared import prepare_record
from barnax.model.window import Window
from barnax.records.lag import aligned
from helpers.dense import (
    BOX,
    CAPACITY_AH,
    LOG_SCALES,
    SETTINGS,
    TAU_S,
    columns_of,
    prepared_of,
    reaches_of,
)
from helpers.made_cell import cell_with_ocv, ocv_v
from helpers.problems import drive_a
from helpers.reference import banded_response, drop_v, make_record

NAMES = ("R0 [Ohm]", "R1 [Ohm]", "R2 [Ohm]")
HELD = {name: (tau_s, tau_s) for name, tau_s in zip(BOX, TAU_S, strict=True)}


@given(
    st.lists(st.floats(0.0, 1.0), min_size=2, max_size=9, unique_by=lambda soc: round(soc, 3)),
    st.lists(st.floats(1e-3, 1.0), min_size=9, max_size=9),
)
def test_weights_make_the_mean_of_the_lines_above_10_percent(nodes, values):
    nodes = np.sort(np.array(nodes))
    values = np.array(values[: len(nodes)])
    weights = node_weights(nodes, np.ones(len(nodes), bool))
    assert weights.sum() == pytest.approx(1.0)
    low = max(nodes[0], 0.1)
    if nodes[-1] - low > 1e-3:
        soc = low + (nodes[-1] - low) * (np.arange(20000) + 0.5) / 20000
        assert weights @ values == pytest.approx(np.mean(np.interp(soc, nodes, values)), rel=2e-3)


def test_a_gap_that_no_sample_visits_is_not_averaged_over():
    visited = np.array([True, True, False, True, True])
    weights = node_weights(np.array([0.2, 0.4, 0.5, 0.6, 0.8]), visited)
    np.testing.assert_allclose(weights, [0.25, 0.25, 0.0, 0.25, 0.25])
    alone = node_weights(np.array([0.05, 0.2, 0.4]), np.array([True, True, False]))
    np.testing.assert_allclose(alone, [1 / 3, 2 / 3, 0.0])


def simulated(seed, r_ohm, tau_s=TAU_S, noise_v=1e-3, samples=240):
    """A record of a cell of constant resistances, with white noise."""
    time_s = 3.0 * np.arange(samples)
    current_a = drive_a(samples, seed, interval=4)
    current_a[0] = 1.5
    soc = 0.9 - np.append(0.0, np.cumsum(current_a[:-1]) * 3.0) / 3600 / CAPACITY_AH
    drop = drop_v(banded_response, time_s, current_a, (0.05, r_ohm, tau_s))
    noise_v = noise_v * np.random.default_rng(seed).standard_normal(samples)
    return make_record(time_s, current_a, ocv_v(soc) - drop + noise_v)


@in_float64
def test_means_of_95_in_100_cells_are_in_their_intervals():
    """At time constants that are held at the truth, so that a search costs nothing."""
    hits = []
    for seed in range(40):
        objective = reduced_objective([prepared_of(simulated(seed, (0.02, 0.03)))], SETTINGS, HELD)
        actual = intervals_of(objective, objective.solve(LOG_SCALES, exact=True))
        means = [own for own in actual if own.soc is None and own.name in NAMES]
        truth = (0.05, 0.02, 0.03)
        hits.append([m.low <= ohm <= m.high for m, ohm in zip(means, truth, strict=True)])
    # 95 % of 120, give or take, for the three of a cell hang together.
    assert 0.90 <= np.mean(hits) <= 0.98, np.mean(hits, axis=0)


def r0_interval(prepared):
    """The interval of the mean of R0, at time constants held at the truth."""
    objective = reduced_objective([prepared], SETTINGS, HELD)
    actual = intervals_of(objective, objective.solve(LOG_SCALES, exact=True))
    return next(own for own in actual if own.soc is None and own.name == "R0 [Ohm]")


@in_float64
def test_r0_is_in_its_interval_where_the_ocv_test_has_less_hysteresis_than_the_cell():
    """The test has branches 14 mV apart, the cell 16 mV: what switches beyond the test's looks like
    R0, by the regression of the direction on the current."""
    cell = cell_with_ocv(CAPACITY_AH, 0.007)
    window = Window(initial_soc=0.9, initial_direction=-1)
    hits, moved, widths = [], [], []
    for seed in range(12):
        record = simulated(seed, (0.02, 0.03), noise_v=2e-4)
        exact = prepare_record(record, cell, "iso-rc", window)
        switched_v = 0.008 * exact.direction
        record = replace(record, voltage_v=record.voltage_v + switched_v)
        r0 = r0_interval(prepare_record(record, cell, "iso-rc", window))
        hits.append(r0.low <= 0.05 <= r0.high)
        moved.append(r0.value - 0.05)
        widths.append(r0.high - r0.low)
    assert np.mean(hits) >= 0.9
    assert 2e-4 < np.mean(moved) < np.mean(widths) < 2e-3


@in_float64
def test_r0_is_in_its_interval_where_the_lag_of_the_voltage_is_off_by_a_part_of_a_sample():
    """The voltage is 0.4 samples late, and is taken for 0.36: four in a hundred of a step come
    before its current, which lowers R0."""
    hits, moved = [], []
    for seed in range(12):
        record = simulated(seed, (0.02, 0.03), noise_v=5e-5)
        late_v = record.voltage_v.copy()
        late_v[1:] -= 0.4 * np.diff(late_v)
        record = aligned(replace(record, voltage_v=late_v), 0.36 * 3.0)
        r0 = r0_interval(prepared_of(record))
        hits.append(r0.low <= 0.05 <= r0.high)
        moved.append(r0.value - 0.05)
    assert np.mean(hits) >= 0.9
    assert np.mean(moved) < -1e-3


@in_float64
def test_pairs_of_nearly_one_time_constant_have_the_interval_of_their_sum():
    prepared = prepared_of(simulated(3, (0.025, 0.025), (30.0, 30.0), noise_v=5e-4))
    wide = dict.fromkeys(BOX, (2.0, 200.0))
    objective = reduced_objective([prepared], replace(SETTINGS, nodes=(0.5,)), wide)
    best = objective.solve((math.log(29.0), math.log(31.0)), exact=True)
    *_, total = intervals_of(objective, best)
    assert total.name == "R1 + R2 [Ohm]"
    assert total.low < 0.05 < total.high
    assert total.high < 1.05 * total.low
    # Pairs far apart have none.
    apart = objective.solve((math.log(8.0), math.log(31.0)), exact=True)
    assert intervals_of(objective, apart)[-1].name == "R2 [Ohm]"


@in_float64
@pytest.mark.parametrize("seed", range(3))
def test_a_resistance_at_zero_is_at_most_what_the_data_leave(seed):
    """R2 is none: the upper end is Student's t times its error without the bound, and what the
    error is for each of these noises follows by dense algebra."""
    settings = replace(SETTINGS, nodes=(0.5,))
    prepared = prepared_of(simulated(seed, (0.02, 0.0)))
    objective = reduced_objective([prepared], settings, HELD)
    best = objective.solve(LOG_SCALES, exact=True)
    actual = {own.name: own for own in intervals_of(objective, best) if own.soc is None}
    r2 = actual["R2 [Ohm]"]
    columns, base = columns_of(prepared)
    # One node of a table is all of them alike.
    columns = columns @ np.kron(np.eye(3), np.ones((4, 1)))
    error = base + columns @ np.array([best.values[table][0] for table in range(3)])
    penalty = np.zeros((1, 3))
    _, (*_, reach) = reaches_of(np.eye(3), columns, penalty, error, prepared.time_s)
    if best.values[2][0] == 0.0:
        assert r2.low is None
        assert r2.high == pytest.approx(reach, rel=0.05)
    else:
        assert r2.low == pytest.approx(max(r2.value - reach, 0.0), rel=0.05, abs=1e-6)
