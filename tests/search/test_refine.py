"""Every seed refined: never worse, the same to the bit, inside its box, gathered into optima."""

from dataclasses import replace

import jax
import pytest

from barnax import CircuitParameters, make_optimizer, refine, search_seeds
from barnax.search.answers import SAME_RMSE, AtBound, RefinedSeed, distinct_optima
from helpers.problems import other_problem

CIRCUIT = CircuitParameters.constant(r0=0.05, r=(0.01, 0.02), c=(500.0, 4000.0))


def refined_at(rmse_v, circuit=CIRCUIT):
    return RefinedSeed(rmse_v, circuit, 0.0, True)


def test_no_seed_is_made_worse(searched, refinement):
    for before, after in zip(searched.seeds, refinement.seeds, strict=True):
        assert after.rmse_v <= before.rmse_v * (1 + 1e-12)
        assert refinement.rmse_v <= after.rmse_v * (1 + 1e-12)


def test_every_seed_is_counted_in_one_optimum_or_was_still_moving(refinement):
    def is_in(seed, optimum):
        return optimum.rmse_v <= seed.rmse_v * (1 + 1e-12) <= optimum.rmse_v * (1 + SAME_RMSE)

    outside = [
        seed for seed in refinement.seeds if not any(is_in(seed, o) for o in refinement.optima)
    ]
    unsettled = sum(not seed.has_converged for seed in outside)
    assert sum(optimum.seeds for optimum in refinement.optima) + unsettled == 8


def test_the_best_optimum_comes_first_with_its_faster_pair_first_and_touches_no_bound(refinement):
    errors_v = [optimum.rmse_v for optimum in refinement.optima]
    assert errors_v == sorted(errors_v)
    assert refinement.parameters == refinement.optima[0].parameters
    tau_s = [seed.parameters.tau_s for seed in refinement.seeds]
    assert tau_s == [tuple(sorted(each)) for each in tau_s]
    assert refinement.at_bound == ()


def test_a_seed_is_refined_the_same_among_any_number_of_seeds(searched, refinement):
    fewer = refine(replace(searched, seeds=searched.seeds[:3]))
    assert fewer.seeds == refinement.seeds[:3]


@pytest.mark.parametrize("is_double", [False, True])
def test_a_search_is_refined_to_the_same_bits_in_any_callers_precision(
    searched, refinement, is_double
):
    with jax.enable_x64(is_double):
        again = refine(searched)
        assert jax.config.jax_enable_x64 is is_double
    assert again.seeds == refinement.seeds
    assert (again.optima, again.at_bound) == (refinement.optima, refinement.at_bound)
    assert again.evaluations == refinement.evaluations


@pytest.mark.parametrize(("factors", "end"), [((0.5, 0.95), "upper"), ((1.05, 2.0), "lower")])
def test_a_box_that_excludes_the_optimum_is_reported(
    short_problem, searched, refinement, factors, end
):
    low, high = (factor * refinement.parameters.r0 for factor in factors)
    problem = other_problem(short_problem, "iso-rc", bounds={"R0 [Ohm]": (low, high)})
    narrow = refine(search_seeds(problem, searched.optimizer, key=jax.random.key(0), seeds=8))
    assert AtBound("R0 [Ohm]", end) in narrow.at_bound
    assert narrow.parameters.r0 == pytest.approx(high if end == "upper" else low, rel=1e-2)
    assert low * (1 - 1e-12) <= narrow.parameters.r0 <= high * (1 + 1e-12)
    assert narrow.rmse_v > refinement.rmse_v


@pytest.mark.slow
def test_fixed_parameters_hold_through_search_and_refinement(short_problem):
    fixed = {"C1 [F]": 500.0, "R0 [Ohm]": 0.05}
    problem = other_problem(short_problem, fixed=fixed, objective="compressed")
    searched = search_seeds(problem, make_optimizer("pso", 8, 20), key=jax.random.key(0), seeds=8)
    refined = refine(searched)
    for seed in (*searched.seeds, *refined.seeds):
        assert seed.parameters.to_dict() == pytest.approx(seed.parameters.to_dict() | fixed)
    assert not {each.name for each in refined.at_bound} & {"C1 [F]", "R0 [Ohm]", "tau1 [s]"}


def test_equal_errors_are_one_optimum_and_a_family_where_circuits_differ():
    seeds = [refined_at(0.012), refined_at(0.010), refined_at(0.010 * (1 + 1e-7))]
    other = refined_at(0.012, CIRCUIT.with_tables({"R0 [Ohm]": [0.06]}))
    optima = [
        (each.rmse_v, each.seeds, each.is_family) for each in distinct_optima([*seeds, other])
    ]
    assert optima == [(0.010, 2, False), (0.012, 2, True)]
