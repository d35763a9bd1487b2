"""What sets apart the optimizers that batteries were identified with, against their rules."""

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from barnax.optimizers import (
    AdaptiveGenetic,
    Box,
    CoevolvingSwarm,
    Ecosystem,
    MixedSwarm,
    SunflowerSearch,
    Swarm,
)
from barnax.optimizers.pso import badness

BOX = Box(jnp.array([-4.0, 0.0, 10.0]), jnp.array([4.0, 1.0, 90.0]))
CANDIDATES = 30


@eqx.filter_jit
def prepared(solver, seed=0):
    """A solver's first swarm on the sum of the coordinates, and one generation's numbers."""
    positions = solver.start(jr.key(seed), BOX, BOX.lower.dtype)
    swarm = solver.prepare(Swarm(positions, jnp.sum(positions, axis=1)), BOX)
    return swarm, solver.draw(jr.key(seed + 1), jnp.array(1), BOX)


@eqx.filter_jit
def proposed(solver, drawn, swarm, generation=1):
    """Where the candidates go, and the new memory."""
    return solver.propose(drawn, swarm, jnp.array(generation), BOX)


def test_losses_lie_between_the_least_and_the_mean_of_the_finite():
    losses = jnp.array([3.0, 1.0, 2.0, jnp.inf, 6.0])
    np.testing.assert_allclose(badness(losses), [1, 0, 0.5, 1, 1])
    np.testing.assert_array_equal(badness(jnp.full(3, 2.0)), 1)
    np.testing.assert_array_equal(badness(jnp.full(3, jnp.inf)), 1)


def test_a_coevolving_particle_moves_its_own_coordinates_in_the_context():
    solver = CoevolvingSwarm(CANDIDATES, groups=3)
    swarm, drawn = prepared(solver)
    offspring, species = proposed(solver, drawn, swarm, 1)
    best = np.asarray(swarm.positions[jnp.argmin(swarm.losses)])
    for particle in range(CANDIDATES):
        others = np.arange(3) != particle % 3
        np.testing.assert_array_equal(offspring[particle, others], best[others])
    assert np.all(np.ptp(np.asarray(offspring[:-1]), axis=0) > 0)
    # The one further candidate has every coordinate from the best of those that move it.
    losses = np.asarray(swarm.losses)
    for place in range(3):
        leader = np.argmin(np.where(np.arange(CANDIDATES) % 3 == place, losses, np.inf))
        assert offspring[-1, place] == swarm.positions[leader, place]
    assert species.context.loss == losses.min()


def test_exploring_particles_follow_others_and_exploiting_ones_the_best():
    solver = MixedSwarm(CANDIDATES, velocity_fraction=100.0)
    swarm, drawn = prepared(solver)
    moved, _ = proposed(solver, drawn, swarm, 1)
    best = np.asarray(swarm.positions[jnp.argmin(swarm.losses)])
    for particle, step in enumerate(np.asarray(moved - swarm.positions)):
        goal = best if particle >= 15 else np.asarray(swarm.positions[drawn.followed[particle]])
        # First velocities are zero, and each has been nowhere better than it is.
        pull = np.asarray(drawn.weights[1, particle])
        np.testing.assert_allclose(step, pull * (goal - swarm.positions[particle]), atol=1e-4)
    assert float(jnp.max(drawn.weights[:, :15])) <= 1.5 < float(jnp.max(drawn.weights))


def test_the_best_parent_neither_crosses_nor_mutates():
    solver = AdaptiveGenetic(CANDIDATES)
    swarm, drawn = prepared(solver)
    best = jnp.zeros_like(drawn.rivals)
    children, _ = proposed(solver, drawn._replace(rivals=best), swarm)
    np.testing.assert_array_equal(children, np.tile(swarm.positions[0], (CANDIDATES, 1)))
    worst = jnp.full_like(drawn.rivals, CANDIDATES - 1)
    mutants, _ = proposed(solver, drawn._replace(rivals=worst), swarm)
    share = np.mean(np.asarray(mutants != swarm.positions[-1]))
    # Ninety coordinates at a rate of one half: five deviations.
    assert share == pytest.approx(0.5, abs=5 * 0.5 / np.sqrt(90))


def test_a_plant_steps_a_tenth_of_the_box_at_most_and_the_worst_die():
    solver = SunflowerSearch(CANDIDATES)
    swarm, drawn = prepared(solver)
    moved, _ = proposed(solver, drawn, swarm, 1)
    steps = np.asarray(jnp.abs(moved - swarm.positions) / (BOX.upper - BOX.lower))
    assert steps[:-3].max() == pytest.approx(0.1, rel=1e-4)
    np.testing.assert_array_equal(moved[-3:], drawn.born[-3:])
    toward = (moved - swarm.positions)[2:-3] * (swarm.positions[0] - swarm.positions[2:-3])
    assert np.all(np.asarray(toward) >= 0)


def test_an_ecosystem_eats_and_decays_as_its_equations_read():
    """Zhao, Wang and Zhang (2020), Eq. 1 to 12, in a loop over candidates and their draws."""
    solver = Ecosystem(CANDIDATES, iterations=20)
    swarm, drawn = prepared(solver)
    x, numbers = np.asarray(swarm.positions), {k: np.asarray(v) for k, v in drawn._asdict().items()}
    producer = (1 - (1 - numbers["stay"])) * x[0] + numbers["producer"]
    consumed, _ = proposed(solver, drawn, swarm, 1)
    np.testing.assert_allclose(consumed[-1], producer, rtol=1e-5)
    for i in range(CANDIDATES - 1):
        eaten, other = numbers["from_producer"][i], numbers["other"][i]
        moved = x[i] + eaten * (x[i] - producer) + numbers["from_other"][i] * (x[i] - x[other])
        np.testing.assert_allclose(consumed[i], moved, rtol=1e-4, atol=1e-4)
        assert i < other < CANDIDATES - 1 or i == CANDIDATES - 2
    decayed, _ = proposed(solver, drawn, swarm, 2)
    # Where the coin gives two, Eq. 9 is best + 3 n (2 r - 1) (best - x), else about -best too.
    is_two = np.all(numbers["to_best"] == -numbers["away"], axis=1)
    assert 5 < is_two.sum() < 25
    around = x[0] + numbers["to_best"] * (x[0] - x)
    np.testing.assert_allclose(decayed[is_two], around[is_two], rtol=1e-3, atol=1e-3)


def test_diets_are_equally_likely_and_the_producer_ends_at_the_best():
    solver = Ecosystem(240, iterations=20)
    swarm, drawn = prepared(solver)
    grazes = np.all(drawn.from_other == 0, axis=1).mean()
    hunts = np.all(drawn.from_producer == 0, axis=1).mean()
    # Five deviations of a share of a third among 240.
    assert [grazes, hunts] == pytest.approx([1 / 3, 1 / 3], abs=5 * 0.031)
    last = solver.draw(jr.key(0), jnp.array(19), BOX)
    consumed, _ = proposed(solver, last, swarm, 19)
    np.testing.assert_array_equal(consumed[-1], swarm.positions[0])
