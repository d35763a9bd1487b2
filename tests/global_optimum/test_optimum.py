"""The global optimum: what it finds, what it proves, and what it costs again."""

from dataclasses import replace
from functools import partial

import jax
import pytest

from barnax import find_global_optimum, optimality_gap, refine, search_seeds
from barnax.global_optimum import search
from barnax.global_optimum.objective import ConstantObjective
from barnax.model.descent import lowest_scales
from barnax.model.problem import rmse_by_scan
from barnax.search.answers import AtBound
from helpers.problems import other_problem
from helpers.reference import drop_v, filtered_response, fit_circuit

SAME = 1e-8


@pytest.fixture(scope="module")
def short_optimum(short_problem):
    return find_global_optimum(short_problem)


@pytest.fixture(scope="module")
def problem_of(short_problem):
    """The bundled record's problem with another voltage, circuit or box; one shape for all."""

    return partial(other_problem, short_problem)


def assert_certified(optimum, problem):
    """Certified, and with the scan's own errors."""
    assert optimum.status == "certified"
    assert 0 <= optimum.proved_gap <= 1e-3
    expected_v = rmse_by_scan(problem, [each.parameters for each in optimum.optima])
    assert [each.rmse_v for each in optimum.optima] == pytest.approx(expected_v, rel=1e-12)


def test_the_optimum_is_certified_and_no_seed_is_better(short_problem, short_optimum, refinement):
    assert_certified(short_optimum, short_problem)
    for seed in (*refinement.seeds, *refinement.search.seeds):
        assert optimality_gap(seed.rmse_v, short_optimum.rmse_v) > -SAME
        assert seed.rmse_v >= short_optimum.lower_bound_v
    assert optimality_gap(refinement.rmse_v, short_optimum.rmse_v) < SAME


# The best R0 is 58 mohm: the narrow range puts the optimum on its upper end.
@pytest.mark.parametrize(
    ("circuit", "r0_ohm"),
    [
        ("iso-rc", None),
        ("so-rc", (0.02, 0.05)),
        pytest.param("iso-rc", (0.02, 0.05), marks=pytest.mark.slow),
        pytest.param("so-rc", None, marks=pytest.mark.slow),
    ],
)
def test_scipys_many_starts_find_the_optimum_that_seeds_and_grid_find(
    problem_of, searched, circuit, r0_ohm
):
    problem = problem_of(circuit, bounds={} if r0_ohm is None else {"R0 [Ohm]": r0_ohm})
    prepared = problem.prepared
    low, high = (end * 2.0 / problem.cell.capacity_ah for end in (1e-4, 0.2))
    r0_low, r0_high = r0_ohm or (low, high)
    rmse_v, (r0, r1, r2, tau1, tau2) = fit_circuit(
        lambda *values: drop_v(filtered_response, 1.0, prepared.current_a, values),
        prepared.source_v - prepared.voltage_v,
        prepared.scored,
        [r0_low, low, low, 0.5, 0.5],
        [r0_high, high, high, 1500.0, 1500.0],
        starts=8,
    )
    optimum = find_global_optimum(problem)
    refined = refine(search_seeds(problem, searched.optimizer, key=jax.random.key(0), seeds=8))
    assert_certified(optimum, problem)
    for answer in (optimum, refined):
        assert answer.rmse_v == pytest.approx(rmse_v, rel=1e-6)
        values = [answer.parameters.r0, *answer.parameters.r, *answer.parameters.tau_s]
        assert values == pytest.approx([r0, r1, r2, tau1, tau2], rel=1e-3)
        assert (AtBound("R0 [Ohm]", "upper") in answer.at_bound) == (r0_ohm is not None)


def test_the_proof_finds_the_basin_that_the_grid_missed(short_problem, short_optimum, monkeypatch):
    minima = search.lowest_scales
    monkeypatch.setattr(search, "lowest_scales", lambda *given, **how: minima(*given, **how)[1:])
    # Another one, for a problem keeps what was found.
    problem = replace(short_problem)
    missed = find_global_optimum(problem, prove=False)
    assert missed.rmse_v == pytest.approx(short_optimum.local_optima[0].rmse_v, rel=SAME)
    actual = find_global_optimum(problem)
    assert actual.rmse_v == pytest.approx(short_optimum.rmse_v, rel=SAME)
    assert_certified(actual, short_problem)


def test_without_a_proof_nothing_is_claimed(short_problem, short_optimum):
    optimum = find_global_optimum(short_problem, prove=False)
    assert (optimum.status, optimum.lower_bound_v) == ("grid-verified", 0.0)
    assert optimum.boxes is None
    assert optimum.rmse_v == short_optimum.rmse_v


def test_a_proof_that_ends_early_says_how_far_it_came(short_problem, short_optimum):
    optimum = find_global_optimum(short_problem, max_boxes=60)
    assert optimum.status == "grid-verified"
    assert 0 < optimum.lower_bound_v < short_optimum.lower_bound_v
    assert optimum.boxes >= 60


def test_a_circuit_with_dynamic_hysteresis_is_certified_too(problem_of):
    problem = problem_of("esc")
    optimum = find_global_optimum(problem)
    assert_certified(optimum, problem)
    objective = ConstantObjective.of(problem)
    (lowest, *_) = lowest_scales(objective, search.GRID, apart=False)
    assert optimum.rmse_v <= objective.solve(lowest).rms_v * (1 + SAME)


def test_the_gap_is_a_share_of_the_optimum_but_for_rounding():
    assert optimality_gap(0.0101, 0.01) == pytest.approx(0.01)
    assert optimality_gap(0.01, 0.01) == 0
    assert optimality_gap(5e-13, 1e-13) < 1e-3
