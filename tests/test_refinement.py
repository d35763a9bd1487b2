from dataclasses import replace

import jax
import numpy as np
import pytest

from barnax.cell import CircuitParameters
from barnax.model.inputs import Window
from barnax.model.problem import make_problem
from barnax.optimizers import make_optimizer
from barnax.search.evaluate import evaluate_course
from barnax.search.identify import identify
from barnax.search.refine import SAME_RMSE, RefinedSeed, distinct_optima, refine

CIRCUIT = CircuitParameters(r0=0.05, r=(0.01, 0.02), c=(500.0, 4000.0))


@pytest.fixture(scope="module")
def refined_in(short_problem, found):
    """The cross-check on the short problem in another box; its compiled program is shared."""

    def run(bounds=None, seeds=8):
        problem = make_problem(
            short_problem.course.record,
            short_problem.cell,
            window=short_problem.window,
            bounds=bounds,
        )
        return refine(identify(problem, found.optimizer, key=jax.random.key(0), seeds=seeds))

    return run


def refined_at(rmse_v, circuit=CIRCUIT):
    return RefinedSeed(rmse_v, circuit, 0.0, True)


def test_no_seed_is_made_worse(found, checked):
    for before, after in zip(found.seeds, checked.refined, strict=True):
        assert after.rmse_v <= before.rmse_v * (1 + 1e-12)
        assert checked.rmse_v <= after.rmse_v * (1 + 1e-12)


def test_the_refined_error_is_that_of_the_refined_circuit(short_problem, checked):
    metrics = evaluate_course(short_problem.course, checked.parameters).metrics
    assert checked.rmse_v == pytest.approx(metrics.rmse_v, rel=1e-9)


def test_an_optimum_already_reached_is_not_left(found, checked):
    at_the_end = replace(found.best, parameters=checked.parameters, rmse_v=checked.rmse_v)
    again = refine(replace(found, seeds=(at_the_end,) * 8))
    assert again.rmse_v == pytest.approx(checked.rmse_v, rel=1e-9)
    assert max(seed.moved for seed in again.refined) < 1e-3


def test_every_seed_says_how_far_it_moved(found, checked):
    for before, after in zip(found.seeds, checked.refined, strict=True):
        old, new = (np.array(list(each.parameters.to_dict().values())) for each in (before, after))
        assert after.moved == pytest.approx(np.max(np.abs(new / old - 1)), rel=1e-12)


def test_every_seed_is_counted_in_one_optimum_or_was_still_moving(checked):
    def is_in(seed, optimum):
        return optimum.rmse_v <= seed.rmse_v * (1 + 1e-12) <= optimum.rmse_v * (1 + SAME_RMSE)

    outside = [seed for seed in checked.refined if not any(is_in(seed, o) for o in checked.optima)]
    unsettled = sum(not seed.has_converged for seed in outside)
    assert sum(optimum.seeds for optimum in checked.optima) + unsettled == 8


def test_the_best_optimum_comes_first(checked):
    errors_v = [optimum.rmse_v for optimum in checked.optima]
    assert errors_v == sorted(errors_v)
    assert checked.parameters == checked.optima[0].parameters


def test_the_same_search_is_refined_to_the_same_bits(found, checked):
    again = refine(found)
    assert again.refined == checked.refined
    assert (again.optima, again.verdict) == (checked.optima, checked.verdict)


def test_a_seed_is_refined_the_same_among_any_number_of_seeds(found, checked):
    fewer = refine(replace(found, seeds=found.seeds[:3]))
    assert fewer.refined == checked.refined[:3]


@pytest.mark.parametrize("is_double", [False, True])
def test_the_callers_precision_neither_matters_nor_changes(found, checked, is_double):
    with jax.enable_x64(is_double):
        again = refine(found)
        assert jax.config.jax_enable_x64 is is_double
    assert again.refined == checked.refined


def test_progress_sums_to_the_seeds_and_many_blocks_finish(found):
    steps = []
    many = refine(replace(found, seeds=found.seeds * 5), progress=steps.append)
    assert sum(steps) == len(many.refined) == 40


def test_one_seed_cannot_say_whether_others_agree(refined_in):
    verdict = refined_in(seeds=1).verdict
    assert verdict.startswith("One seed was run, so nothing tells whether another would end")


def test_the_verdict_counts_the_seeds_that_agree(checked):
    best = checked.optima[0].seeds
    if best == 8:
        assert checked.verdict.startswith("All 8 seeds end in one optimum, the best found.")
    else:
        assert checked.verdict.startswith(f"{best} of 8 seeds end in the best optimum found; ")


def test_the_verdict_says_how_far_above_the_optimum_the_search_was(found, checked):
    gap_percent = 100 * (found.best.rmse_v / checked.rmse_v - 1)
    expected = f"Before refinement the best seed was {gap_percent:.2g} % above it."
    assert expected in checked.verdict


def test_a_search_that_was_already_there_is_said_to_be(found, checked):
    at_the_end = replace(found.best, parameters=checked.parameters, rmse_v=checked.rmse_v)
    again = refine(replace(found, seeds=(at_the_end,) * 8))
    assert "All 8 seeds end in one optimum, the best found." in again.verdict
    assert "the best seed was already there, to 1e-6 %." in again.verdict


def test_an_optimum_inside_the_box_touches_no_bound(checked):
    assert checked.at_bound == ()
    assert "No parameter is at a bound." in checked.verdict


@pytest.mark.parametrize(("factors", "end"), [((0.5, 0.95), "upper"), ((1.05, 2.0), "lower")])
def test_a_box_that_excludes_the_optimum_is_reported(refined_in, checked, factors, end):
    low, high = (factor * checked.parameters.r0 for factor in factors)
    narrow = refined_in({"R0 [Ohm]": (low, high)})
    assert f"R0 [Ohm] at its {end} bound" in narrow.at_bound
    assert narrow.parameters.r0 == pytest.approx(high if end == "upper" else low, rel=1e-2)
    assert low * (1 - 1e-12) <= narrow.parameters.r0 <= high * (1 + 1e-12)
    assert narrow.rmse_v > checked.rmse_v
    sentence = f"{'; '.join(narrow.at_bound)}: the box, not the data, decides there. Widen it with"
    assert sentence in narrow.verdict


def test_every_refined_circuit_has_its_faster_pair_first(checked):
    assert all(
        seed.parameters.tau_s == tuple(sorted(seed.parameters.tau_s)) for seed in checked.refined
    )


def test_pairs_with_boxes_of_their_own_keep_their_labels(refined_in, checked):
    # The faster pair has the smaller resistance; these boxes make it the second one.
    best = checked.parameters
    middle = np.sqrt(best.r[0] * best.r[1])
    assert best.r[0] < best.r[1]
    labelled = refined_in({"R1 [Ohm]": (middle, 0.2), "R2 [Ohm]": (1e-4, middle)})
    expected = replace(best, r=best.r[::-1], c=best.c[::-1])
    assert labelled.rmse_v == pytest.approx(checked.rmse_v, rel=1e-7)
    assert labelled.parameters.to_dict() == pytest.approx(expected.to_dict(), rel=1e-3)


def test_fixed_parameters_hold_through_search_and_cross_check(
    short_problem, checked, bundled_record, bundled_cell
):
    fixed = {"C1 [F]": 500.0, "R0 [Ohm]": 0.05}
    window = Window(score_to_s=300.0)
    problem = make_problem(
        bundled_record, bundled_cell, window=window, fixed=fixed, coordinates="log"
    )
    searched = identify(problem, make_optimizer("pso", 8, 20), key=jax.random.key(0), seeds=8)
    refined = refine(searched)
    for seed in (*searched.seeds, *refined.refined):
        assert seed.parameters.to_dict() == pytest.approx(seed.parameters.to_dict() | fixed)
    assert not any("C1" in name or "R0" in name for name in refined.at_bound)


def test_equal_errors_are_one_optimum():
    first, second = distinct_optima(
        [refined_at(0.012), refined_at(0.010), refined_at(0.010 * (1 + 1e-7))]
    )
    assert (first.rmse_v, first.seeds) == (0.010, 2)
    assert (second.rmse_v, second.seeds) == (0.012, 1)
    assert not first.is_family


def test_a_seed_still_moving_is_no_optimum_of_its_own():
    moving = replace(refined_at(0.011), has_converged=False)
    first, second = distinct_optima([refined_at(0.010), moving, refined_at(0.012)])
    assert (first.seeds, second.rmse_v) == (1, 0.012)


def test_a_seed_still_moving_counts_where_it_reached_an_optimum():
    (only,) = distinct_optima(
        [refined_at(0.010), replace(refined_at(0.010 * (1 + 1e-7)), has_converged=False)]
    )
    assert only.seeds == 2


def test_different_circuits_of_equal_error_are_a_family():
    (only,) = distinct_optima([refined_at(0.010), refined_at(0.010, replace(CIRCUIT, r0=0.06))])
    assert only.is_family
