from dataclasses import replace

import jax
import numpy as np
import pytest

from barnax.errors import InputError
from barnax.model.inputs import Window
from barnax.model.problem import make_problem
from barnax.optimizers import OPTIMIZERS, make_optimizer
from barnax.search.evaluate import evaluate
from barnax.search.seeds import key_integer, search_seeds


def bits(answer):
    """All that a seed found, bit for bit."""
    return answer.rmse_v, answer.parameters, answer.history_v.tobytes(), answer.evaluations


@pytest.fixture(scope="module")
def search(short_problem, found):
    """`identify` on the short problem, with the optimizer of `found` and its compiled program."""

    def run(key=0, seeds=8, problem=short_problem, **options):
        return search_seeds(
            problem, found.optimizer, key=jax.random.key(key), seeds=seeds, **options
        )

    return run


def test_the_same_key_gives_the_same_bits(search, found):
    assert [bits(seed) for seed in search().seeds] == [bits(seed) for seed in found.seeds]


def test_a_seed_is_the_same_among_any_number_of_seeds(search, found):
    many = search(seeds=20)
    assert [bits(seed) for seed in many.seeds[:8]] == [bits(seed) for seed in found.seeds]
    assert bits(search(seeds=3).seeds[2]) == bits(found.seeds[2])
    assert bits(search(seeds=13).seeds[12]) == bits(many.seeds[12])


def test_every_seed_searches_on_its_own(search):
    assert len({seed.rmse_v for seed in search(seeds=20).seeds}) == 20


def test_another_key_gives_other_searches(search, found):
    other = search(key=1)
    assert not {seed.rmse_v for seed in other.seeds} & {seed.rmse_v for seed in found.seeds}


def test_every_evaluation_is_counted(found):
    # The first population and one of each generation, 12 candidates each.
    assert [seed.evaluations for seed in found.seeds] == [12 * (40 + 1)] * 8
    assert found.evaluations == 8 * 12 * 41
    assert [seed.failures for seed in found.seeds] == [0] * 8


def test_a_history_has_every_generation_never_rises_and_ends_at_the_answer(found):
    for seed in found.seeds:
        assert len(seed.history_v) == 41
        assert (np.diff(seed.history_v) <= 0).all()
        assert seed.history_v[-1] == seed.rmse_v


def test_the_error_of_a_seed_is_that_of_its_circuit(short_problem, found):
    for seed in found.seeds[:3]:
        metrics = evaluate(short_problem.prepared, seed.parameters).metrics
        assert metrics.rmse_v == pytest.approx(seed.rmse_v, rel=1e-9)


def test_the_best_seed_is_the_one_of_least_error(found):
    assert found.best.rmse_v == min(seed.rmse_v for seed in found.seeds)


def test_every_circuit_has_its_faster_pair_first(found):
    assert all(
        seed.parameters.tau_s == tuple(sorted(seed.parameters.tau_s)) for seed in found.seeds
    )


@pytest.mark.parametrize("is_double", [False, True])
def test_the_callers_precision_neither_matters_nor_changes(search, found, is_double):
    with jax.enable_x64(is_double):
        again = search()
        assert jax.config.jax_enable_x64 is is_double
    assert [bits(seed) for seed in again.seeds] == [bits(seed) for seed in found.seeds]


@pytest.mark.parametrize("seeds", [1, 8, 20])
def test_progress_sums_to_the_seeds(search, seeds):
    steps = []
    search(seeds=seeds, progress=steps.append)
    assert sum(steps) == seeds


def test_many_blocks_finish_in_the_order_of_the_seeds(search, found):
    # More blocks than cores, so that some wait while others run.
    many = search(seeds=80)
    assert len(many.seeds) == 80
    assert [bits(seed) for seed in many.seeds[:8]] == [bits(seed) for seed in found.seeds]


@pytest.mark.parametrize("key", [0, 7, 2**31 - 1])
def test_the_key_is_stored_as_the_integer_it_was_made_from(key):
    assert key_integer(jax.random.key(key)) == key


def test_no_seed_is_refused(search):
    with pytest.raises(InputError, match="`seeds` 0: at least one"):
        search(seeds=0)


def test_a_record_that_no_candidate_can_meet_is_refused_by_name(
    search, bundled_record, bundled_cell
):
    voltage_v = bundled_record.voltage_v.copy()
    voltage_v[700] = np.nan
    blank = replace(bundled_record, voltage_v=voltage_v)
    problem = make_problem(blank, bundled_cell, window=Window(score_to_s=1500.5))
    with pytest.raises(InputError, match=r"identification\.parquet: no candidate gave a finite"):
        search(problem=problem)


@pytest.mark.slow
@pytest.mark.parametrize("name", OPTIMIZERS)
def test_every_optimizer_stays_in_the_box(name, bundled_record, bundled_cell):
    window = Window(score_to_s=60.0, initial_soc=1.0)
    problem = make_problem(bundled_record, bundled_cell, window=window)
    ranges = problem.bounds.ranges
    found = search_seeds(problem, make_optimizer(name, 6, 10), key=jax.random.key(3), seeds=8)
    for seed in found.seeds:
        values = seed.parameters.to_dict()
        values |= dict(zip(("tau1 [s]", "tau2 [s]"), seed.parameters.tau_s, strict=True))
        for bound, (low, high) in ranges.items():
            assert low * (1 - 1e-12) <= values[bound] <= high * (1 + 1e-12)
