"""Adaptive barnacle mating against its rules, written out in NumPy one offspring at a time."""

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from barnax.optimizers import AdaptiveMating, Box, Swarm

POPULATION, DIMS = 20, 3


def a_generation(solver, seed, generation):
    """The swarm, its draws, and the offspring, with a history that is not the first."""
    generator = np.random.default_rng(seed)
    box = Box(jnp.full(DIMS, -1.0), jnp.full(DIMS, 1.0))
    positions = jnp.asarray(generator.uniform(-1, 1, (POPULATION, DIMS)))
    swarm = solver.prepare(Swarm(positions, jnp.sum(positions**2, axis=1)), box)
    history = swarm.memory._replace(
        scales=jnp.asarray(generator.uniform(0.2, 0.9, solver.memory)),
        rates=jnp.asarray(generator.uniform(0.2, 0.9, solver.memory)),
        shells=jnp.asarray(generator.uniform(-1, 1, (POPULATION, DIMS))),
    )
    swarm = Swarm(swarm.positions, swarm.losses, history)
    drawn = solver.draw(jr.key(seed), jnp.array(generation), box)
    propose = jax.jit(solver.propose)
    offspring, history = propose(drawn, swarm, jnp.array(generation), box)
    return swarm, jax.tree.map(np.asarray, drawn), np.asarray(offspring), history


def living_of(solver, generation):
    if not solver.is_shrinking:
        return POPULATION
    share = (generation / solver.iterations) ** solver.reduction_power
    return round(POPULATION + (4 - POPULATION) * share)


def offspring_of(solver, swarm, drawn, generation, number):
    """One offspring, with its mother, scale and rate."""
    positions, history = np.asarray(swarm.positions), jax.tree.map(np.asarray, swarm.memory)
    living, count = living_of(solver, generation), drawn.uniform.shape[1]
    u = drawn.uniform[:, number]
    mother = int((number + u[0]) / count * living)
    father = (mother + 1 + int(u[1] * (living - 1))) % living
    elites = int(0.25 * (1 - generation / solver.iterations / 2) * living)
    elite = int(u[2] * max(2, elites))
    one = int(u[3] ** 1.5 * living)
    one = (one + 1) % living if one == mother else one
    other = [*history.shells, *positions[:living]][int(u[4] * (POPULATION + living))]
    slot = int(u[6] * solver.memory)
    scale = history.scales[slot] + 0.1 * np.tan(np.pi * (u[7] - 0.5))
    scale = 0.1 + 0.4 * u[8] if scale <= 0 else min(scale, 1)
    rate = min(max(history.rates[slot] + 0.1 * drawn.normal[number, 0], 0), 1)
    if abs(mother - father) <= solver.pl:
        p = scale * (1 + solver.factor_spread * drawn.normal[number, 1:])
        whole = p * positions[father] + (1 - p) * positions[mother]
    else:
        whole = positions[mother] + scale * (positions[elite] - positions[mother])
        whole = whole + scale * (positions[one] - other)
    axes = np.eye(DIMS)
    if u[10] < solver.eigen_share:
        better = positions[: living // 2]
        axes = np.linalg.eigh(np.cov(better.T, bias=True))[1]
    child, grown = axes.T @ positions[mother], axes.T @ whole
    for axis in range(DIMS):
        if drawn.kept[number, axis] < rate or axis == int(u[9] * DIMS):
            child[axis] = grown[axis]
    child = axes @ child
    for axis in range(DIMS):
        if not -1 <= child[axis] <= 1:
            child[axis] = (np.sign(child[axis]) + positions[mother, axis]) / 2
    return child, mother, scale, rate


@pytest.mark.parametrize("options", [{}, {"pl": -1, "eigen_share": 0.0}, {"is_shrinking": False}])
@pytest.mark.parametrize("generation", [3, 9])
def test_offspring_are_those_of_the_rules(options, generation):
    with jax.enable_x64(True):
        solver = AdaptiveMating(POPULATION, 10, **options)
        swarm, drawn, offspring, history = a_generation(solver, generation, generation)
        assert len(offspring) == POPULATION // 2
        for number, child in enumerate(offspring):
            expected, mother, scale, rate = offspring_of(solver, swarm, drawn, generation, number)
            np.testing.assert_allclose(child, expected, rtol=1e-9, atol=1e-12)
            assert history.brood.mother[number] == mother
            np.testing.assert_allclose(history.brood.scale[number], scale)
            np.testing.assert_allclose(history.brood.rate[number], rate)


def test_survivors_and_means_are_those_of_the_rules():
    """Few live, so that most mothers have several offspring."""
    with jax.enable_x64(True):
        solver = AdaptiveMating(POPULATION, 10)
        swarm, _, offspring, history = a_generation(solver, 1, 9)
        losses = np.random.default_rng(2).uniform(0, 1, len(offspring))
        losses[3] = np.inf
        new = solver.survive(
            swarm, Swarm(jnp.asarray(offspring), jnp.asarray(losses), history), jnp.array(9)
        )
    brood, living = jax.tree.map(np.asarray, history.brood), living_of(solver, 9)
    parents, positions = np.asarray(swarm.losses), np.asarray(swarm.positions)
    survivors = dict(enumerate(zip(parents, positions, strict=True)))
    shells, gains = np.array(swarm.memory.shells), np.zeros(len(losses))
    for number, (loss, position) in enumerate(zip(losses, offspring, strict=True)):
        mother = brood.mother[number]
        if loss < parents[mother]:
            gains[number] = parents[mother] - loss
            shells[brood.shell[number]] = positions[mother]
        if loss <= survivors[mother][0]:
            survivors[mother] = loss, position
    assert 0 < np.count_nonzero(gains) < len(gains)
    ordered = sorted((survivors[row] for row in range(living)), key=lambda one: one[0])
    np.testing.assert_array_equal(new.losses[:living], [loss for loss, _ in ordered])
    np.testing.assert_array_equal(new.positions[:living], [position for _, position in ordered])
    np.testing.assert_array_equal(new.memory.shells, shells)
    for means, before, values in (
        (new.memory.scales, swarm.memory.scales, brood.scale),
        (new.memory.rates, swarm.memory.rates, brood.rate),
    ):
        lehmer = np.sum(gains * values**2) / np.sum(gains * values)
        np.testing.assert_allclose(means, [*before[1:], lehmer])


def test_without_success_nothing_is_learned():
    solver = AdaptiveMating(POPULATION, 10)
    swarm, _, offspring, history = a_generation(solver, 1, 5)
    lost = Swarm(jnp.asarray(offspring), jnp.full(len(offspring), jnp.inf), history)
    new = solver.survive(swarm, lost, jnp.array(5))
    np.testing.assert_array_equal(new.memory.scales, swarm.memory.scales)
    np.testing.assert_array_equal(new.positions, swarm.positions)
    fixed = AdaptiveMating(POPULATION, 10, is_adaptive=False)
    swarm, _, offspring, history = a_generation(fixed, 1, 5)
    won = Swarm(jnp.asarray(offspring), jnp.zeros(len(offspring)), history)
    new = fixed.survive(swarm, won, jnp.array(5))
    np.testing.assert_array_equal(new.memory.scales, swarm.memory.scales)


def test_each_part_of_the_ranking_has_a_mother_and_the_last_four_all_are():
    solver = AdaptiveMating(POPULATION, 10)
    for generation in (1, 10):
        living = living_of(solver, generation)
        mothers = a_generation(solver, 4, generation)[3].brood.mother
        assert set(np.asarray(mothers) * 4 // living) == {0, 1, 2, 3}
    assert living == 4


def test_a_population_that_stagnates_gives_way_to_a_fresh_one_that_is_evaluated_whole():
    """The best has not fallen since the first population: six generations are too many."""
    with jax.enable_x64(True):
        solver = AdaptiveMating(POPULATION, 40, patience=5)
        swarm, drawn, offspring, history = a_generation(solver, 3, 6)
        assert a_generation(solver, 3, 5)[3].restart == 0
        assert history.restart == history.latest == 6
        losses = np.random.default_rng(2).uniform(1, 9, POPULATION)
        # In the seventh generation two of the twenty live no more, those that come last.
        for generation, part, living in ((6, slice(10), 10), (7, slice(10, 20), 18)):
            np.testing.assert_array_equal(offspring, drawn.fresh[part])
            born = Swarm(jnp.asarray(offspring), jnp.asarray(losses[part]), history)
            swarm = solver.survive(swarm, born, jnp.array(generation))
            later = jnp.array(generation + 1)
            offspring, history = solver.propose(
                solver.draw(jr.key(9), later, Box(-jnp.ones(DIMS), jnp.ones(DIMS))),
                swarm, later, Box(-jnp.ones(DIMS), jnp.ones(DIMS)),
            )  # fmt: skip
            order = np.argsort(losses[:living])
            np.testing.assert_array_equal(swarm.losses[:living], losses[order])
            np.testing.assert_array_equal(swarm.positions[:living], drawn.fresh[order])
        assert solver._living(later, history) == round(20 - 16 * (2 / 34) ** 0.6)
    np.testing.assert_array_equal(swarm.memory.scales, solver.scale)
    np.testing.assert_array_equal(swarm.memory.rates, solver.rate)
    assert int(swarm.memory.latest) == (7 if losses[:10].min() > losses[10:].min() else 6)
    assert not (np.asarray(offspring)[:, None] == drawn.fresh).all(axis=-1).any()
