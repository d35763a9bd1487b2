"""What was assumed of a record's hold: tried the other way, decided by the voltage, told."""

import numpy as np
import polars as pl
import pytest

import barnax
from barnax import Window, evaluate, make_problem, read_record, record_from_frame
from barnax.bundled import BUNDLED
from barnax.cell import CircuitParameters, characterize
from barnax.global_optimum.assumptions import with_better_hold
from barnax.global_optimum.search import find_global_optimum
from barnax.model.prepared import prepare_record
from helpers.records import CURRENT, TIME, VOLTAGE

WINDOW = Window(initial_soc=0.9)
TRUTH = CircuitParameters.constant(0.05, (0.03, 0.02), (25 / 0.03, 200 / 0.02))


@pytest.fixture(scope="module")
def pchip_cell():
    return characterize([read_record(path) for path in BUNDLED.ocv], ocv_fit="interpolated")


def simulated(cell, time_s, hold, truth=TRUTH):
    """A record of the true circuit whose current flowed as said, from nearly full."""
    rng = np.random.default_rng(3)
    pieces = rng.uniform(-1.0, 2.0, len(time_s))
    current_a = np.repeat(pieces, rng.integers(1, 8, len(pieces)))[: len(time_s)]
    table = pl.DataFrame({TIME: time_s, CURRENT: -current_a, VOLTAGE: 3.7 - 0.05 * current_a})
    drawn = record_from_frame(table, current_hold=hold, current_sign="charge-positive")
    prepared = prepare_record(drawn, cell, "so-rc", WINDOW)
    noise_v = 1e-4 * rng.standard_normal(len(time_s))
    volts = evaluate(prepared, truth).simulated_v + noise_v[: len(prepared.soc)]
    return table[: len(volts)].with_columns(pl.Series(VOLTAGE, volts))


def problem_of(cell, table):
    return make_problem(record_from_frame(table), cell, "so-rc", window=WINDOW)


def test_on_an_even_clock_the_other_hold_moves_the_resistances_by_its_closed_form(pchip_cell):
    table = simulated(pchip_cell, 10.0 * np.arange(700), "backward")
    actual = find_global_optimum(problem_of(pchip_cell, table))
    decay = np.exp(-10 / np.array(TRUTH.tau_s))
    passed = np.array(TRUTH.r) * (1 - decay)
    # The sample's own charge moves the OCV by its slope, which is some 0.9 V but changes with SOC.
    own = 0.9 * 10 / 3600 / pchip_cell.capacity_ah
    assert actual.parameters.r == pytest.approx(tuple(decay * TRUTH.r), rel=0.08)
    assert actual.parameters.r0 == pytest.approx(TRUTH.r0 + passed.sum() + own, rel=0.02)


@pytest.mark.parametrize("hold", ["forward", "backward"])
def test_an_uneven_clock_tells_the_hold(pchip_cell, hold):
    uneven_s = np.cumsum(np.random.default_rng(1).choice([1.0, 4.0, 15.0], 900))
    problem = problem_of(pchip_cell, simulated(pchip_cell, uneven_s, hold))
    assert problem.prepared.record.hold.strength == "assumed"
    settled = with_better_hold(problem)
    assert settled.prepared.record.hold.strength == "weak"
    assert settled.prepared.record.hold.value == hold
    assert find_global_optimum(settled, prove=False).parameters.r0 == pytest.approx(0.05, rel=0.02)


def test_an_even_clock_leaves_the_hold_open(pchip_cell):
    problem = problem_of(pchip_cell, simulated(pchip_cell, 1.0 * np.arange(900), "backward"))
    assert with_better_hold(problem) is problem


@pytest.mark.parametrize("over", [None, "soc"])
def test_r0_is_at_most_its_value_where_a_pair_may_be_over_within_a_sample(pchip_cell, over):
    """A pair of 2 s answers in samples of 10 s as R0 does: two cells, one record."""
    fast, none = (
        CircuitParameters.constant(r0, (r1, 0.02), (2 / r1, 200 / 0.02))
        for r0, r1 in ((0.03, 0.02), (0.05, 1e-6))
    )
    slow_s = 10.0 * np.arange(700)
    table, alike = (simulated(pchip_cell, slow_s, "backward", truth) for truth in (fast, none))
    assert np.max(np.abs((table[VOLTAGE] - alike[VOLTAGE]).to_numpy()[1:])) < 5e-4

    def r0_of(record, hold):
        given = {"cell": pchip_cell, "model": "so-rc", "seeds": 0, "window": WINDOW, "over": over}
        given |= {"max_boxes": 0, "folds": 0} if over else {}
        result = barnax.identify(record, current_hold=hold, **given)
        means = [fact for fact in result.fit.facts if fact.is_mean or over is None]
        return next(fact for fact in means if fact.name == "R0 [Ohm]")

    r0 = r0_of(table, "backward")
    assert 0.0 < r0.low < 0.03 < 0.045 < r0.value < r0.high
    # Where it answers before the pair, or the samples show the pair, they tell R0.
    first = r0_of(simulated(pchip_cell, slow_s, "forward", fast), "forward")
    shown = r0_of(simulated(pchip_cell, slow_s / 10, "backward", fast), "backward")
    assert min(one.low / one.value for one in (first, shown)) > 0.9


@pytest.mark.slow
def test_an_interval_of_r0_reaches_up_to_what_comes_a_sample_late(pchip_cell):
    table = simulated(pchip_cell, 1.0 * np.arange(3000), "forward")
    late = table[VOLTAGE].to_numpy().copy()
    late[1:] -= 0.4 * np.diff(late)
    given = {"cell": pchip_cell, "model": "so-rc", "seeds": 0, "window": WINDOW}
    table = table.with_columns(pl.Series(VOLTAGE, late))
    result = barnax.identify(table, voltage_lag=0.0, **given)
    assert result.constant.assessment
    r0 = result.constant.assessment.uncertainty["R0 [Ohm]"]
    assert r0.value < 0.8 * 0.05
    assert r0.high
    # What comes in the second sample: of the pairs, a sample and a half of their own.
    passed = np.sum(-np.array(TRUTH.r) * np.expm1(-1.5 / np.array(TRUTH.tau_s)))
    assert 0.05 < r0.high < 1.05 * (0.05 + passed)
