"""The benchmark that compares with other libraries: what of it needs none of them."""

import dataclasses
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest
import scipy.stats
from benchmarks.li2023.rule_check import agreement, comparisons, functions, published, sizes
from benchmarks.li2023.test_functions import DIMS, QUIET_FUNCTIONS
from hypothesis import given, settings
from hypothesis import strategies as st

from barnax.optimizers import Box, SeagullSearch, Swarm
from barnax.optimizers.pso import Flight
from benchmarks import environments

# What the paper's comparison rests on; nothing that is shipped.
pytestmark = pytest.mark.slow

samples = st.lists(st.integers(0, 6).map(float), min_size=3, max_size=12).map(np.array)


@pytest.mark.parametrize("name", QUIET_FUNCTIONS)
def test_workers_minimize_the_functions_ours_minimize(name):
    theirs = functions.FUNCTIONS[name]
    points = np.random.default_rng(0).uniform(-1, 1, (10, DIMS)) * QUIET_FUNCTIONS[name].half_width
    with jax.enable_x64(True):
        ours = [QUIET_FUNCTIONS[name].loss(jnp.asarray(x), jr.key(0)) for x in points]
    np.testing.assert_allclose([theirs(x) for x in points], ours, rtol=1e-12)


@given(samples, samples)
@settings(max_examples=50)
def test_a_difference_is_that_of_scipys_mann_whitney_test(first, second):
    found = agreement.difference(first, second)
    expected = scipy.stats.mannwhitneyu(first, second, method="asymptotic", use_continuity=False)
    assert found.larger_share == pytest.approx(expected.statistic / (len(first) * len(second)))
    # Where all are equal SciPy has no variance to divide by; there is no difference then.
    assert found.p == pytest.approx(1 if np.isnan(expected.pvalue) else expected.pvalue)


def test_differences_of_the_same_direction_add_up_and_opposite_ones_cancel():
    low, high = np.arange(8.0), np.arange(8.0) + 2.5
    single = agreement.difference(low, high)
    both = agreement.joint_difference([(low, high), (low, high)])
    assert both.larger_share == pytest.approx(single.larger_share)
    score, joint_score = (scipy.stats.norm.isf(test.p / 2) for test in (single, both))
    assert joint_score == pytest.approx(np.sqrt(2) * score)
    assert agreement.joint_difference([(low, high), (high, low)]) == pytest.approx((0.5, 1))


def test_failed_runs_count_toward_the_expected_running_time_but_not_the_successes():
    evaluations = np.array([40, 100, 50])
    time = agreement.expected_running_time(np.array([10, np.nan, 30]), evaluations)
    assert time == (10 + 100 + 30) / 2
    assert agreement.expected_running_time(np.full(3, np.nan), evaluations) == np.inf


def test_equal_runs_leave_nothing_to_chance_and_no_run_everything():
    evaluations = np.full(5, 90)
    assert agreement.ratio_interval(np.full(5, 70.0), evaluations) == (1, 1)
    assert agreement.ratio_interval(np.full(5, np.nan), evaluations) == (0, np.inf)


@pytest.mark.parametrize("inertia_end", [0.2, 0.4])
@pytest.mark.parametrize("generation", [1, 2, sizes.ITERATIONS])
def test_particles_have_the_inertia_the_libraries_give_them(inertia_end, generation):
    """EvoloPy and PySwarms: 0.9 in the first generation, and a step less in each after it."""
    solver = dataclasses.replace(
        comparisons.particles(inertia_end, velocity_limit=np.inf), own_pull=0.0, swarm_pull=0.0
    )
    velocities = jnp.full((solver.population, 3), 2.0)
    places, losses = jnp.zeros_like(velocities), jnp.zeros(solver.population)
    swarm = Swarm(places, losses, Flight(velocities, places, losses))
    box = Box(jnp.full(3, -4.0), jnp.full(3, 4.0))
    drawn = solver.draw(jr.key(0), jnp.array(generation), box)
    moved, _ = solver.propose(drawn, swarm, jnp.array(generation), box)
    step = (0.9 - inertia_end) / sizes.ITERATIONS
    np.testing.assert_allclose(moved / 2, 0.9 - (generation - 1) * step, rtol=1e-6)


@pytest.mark.parametrize("generation", [1, 7, sizes.ITERATIONS])
def test_gulls_have_the_control_mealpy_gives_them(generation):
    """Eq. 6 as mealpy computes it, fc - t fc / T, with the fc and T the worker hands it."""
    epochs = sizes.ITERATIONS + 1
    fc = 2 * epochs / sizes.ITERATIONS
    solver = SeagullSearch(sizes.POPULATION, sizes.ITERATIONS, spiral_attack=True)
    box = Box(jnp.full(3, -4.0), jnp.full(3, 4.0))
    control = solver.draw(jr.key(0), jnp.array(generation), box).control
    assert control == pytest.approx(fc - generation * fc / epochs, rel=1e-5)


@pytest.mark.parametrize("row", published.PUBLISHED, ids=lambda row: row.name)
def test_published_times_are_whole_numbers_of_evaluations_over_fifteen_runs(row):
    """A digit copied wrongly would break that, on the sphere, whose best time of 2009 is exact."""
    totals = np.array(row.running_times(1)) * sizes.COCO_RUNS
    np.testing.assert_allclose(totals, np.round(totals), atol=1e-3)
    for function in sizes.COCO_FUNCTIONS:
        times = row.running_times(function)
        assert len(times) == len(sizes.COCO_TARGETS)
        assert times == sorted(times)


def test_a_worker_answers_by_its_last_line(tmp_path):
    worker = tmp_path / "worker.py"
    worker.write_text("import sys; print('noise'); print('[1, ' + sys.argv[1] + ']')")
    assert environments.run_worker(Path(sys.executable), worker, "2") == [1, 2]


def test_a_worker_that_fails_says_why(tmp_path):
    worker = tmp_path / "worker.py"
    worker.write_text("import no_such_library")
    with pytest.raises(environments.WorkerError, match="No module named 'no_such_library'"):
        environments.run_worker(Path(sys.executable), worker)
