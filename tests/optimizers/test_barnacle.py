"""The barnacle optimizers: the switches, and what moving the origin does to them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from barnax.optimizers import BarnacleMating, Box, Swarm, ibmo_centered, minimise

WIDTH = 8.0


def valley(x, center):
    return jnp.sum(jnp.arange(1.0, 6.0) * (x - center) ** 2)


def search(optimizer, origin):
    lower = jnp.full(5, origin)
    return minimise(valley, optimizer, lower, lower + WIDTH, key=jr.key(1), args=origin + 3.0)


@eqx.filter_jit
def proposed(solver, swarm, key):
    box = Box(swarm.positions.min(axis=0), swarm.positions.max(axis=0))
    drawn = solver.draw(key, jnp.array(1), box)
    return solver.propose(drawn, swarm, jnp.array(1), box)[0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"mating_factor": "one"}, "needs cosine_factor"),
        ({"mating_factor": "gaussian"}, "no mating_factor is called 'gaussian'"),
        ({"reevaluate_parents": True, "brood_share": 0.5}, "brood_share of zero"),
    ],
)
def test_switches_that_do_not_go_together_are_refused(options, words):
    with pytest.raises(ValueError, match=words):
        BarnacleMating(**options)


@pytest.mark.slow
def test_moving_the_origin_moves_the_whole_run_of_ibmo_centered():
    with jax.enable_x64(True):
        solver = ibmo_centered(population=10, iterations=40)
        here, there = (search(solver, jnp.float64(origin)) for origin in (0.0, 512.0))
        # 512 costs ten bits of every coordinate; the rest must agree until rounding grows.
        np.testing.assert_allclose(
            here.stats["history"][:15], there.stats["history"][:15], rtol=1e-6
        )
        np.testing.assert_allclose(here.value, there.value - 512, atol=0.05)


def test_every_cast_of_bmo_contracts_toward_the_origin():
    """With no mating each offspring is its mother times one number below one."""
    solver = BarnacleMating(population=8, pl=-1)
    swarm = Swarm(jr.normal(jr.key(1), (8, 3)), jnp.arange(8.0))
    shrinkage = proposed(solver, swarm, jr.key(0)) / swarm.positions
    assert 0 <= shrinkage.min() < 0.5 < shrinkage.max() < 1
    np.testing.assert_allclose(shrinkage[:, 1:], shrinkage[:, :1].repeat(2, axis=1), rtol=1e-5)


def test_every_barnacle_is_mother_once_and_father_once():
    """Where all mate by p alone, offspring and mothers tell who the fathers were."""
    solver = BarnacleMating(
        population=8, pl=8, mating_factor="one", cosine_factor=True, iterations=1
    )
    swarm = Swarm(jnp.arange(8.0)[:, None], jnp.arange(8.0))
    p = 0.5 * np.cos(1) + 0.5
    orders = set()
    for seed in range(20):
        fathers = (proposed(solver, swarm, jr.key(seed))[:, 0] - (1 - p) * jnp.arange(8.0)) / p
        np.testing.assert_allclose(jnp.sort(fathers), jnp.arange(8.0), atol=1e-4)
        orders.add(tuple(np.round(np.asarray(fathers))))
    assert len(orders) == 20


def test_a_uniform_factor_keeps_offspring_between_their_parents():
    solver = BarnacleMating(population=8, pl=8, mating_factor="uniform", shared_factor=False)
    swarm = Swarm(jnp.arange(8.0)[:, None] * jnp.ones(3), jnp.arange(8.0))
    offspring = jnp.concatenate([proposed(solver, swarm, jr.key(seed)) for seed in range(30)])
    assert offspring.min() >= 0
    assert offspring.max() <= 7
    # Halfway between two random places on the line, on average.
    np.testing.assert_allclose(offspring.mean(axis=0), 3.5, atol=0.4)
    assert np.std(offspring - offspring[:, :1]) > 0.5


def survivors(solver, generation):
    """What lives on when mothers of losses 2, 4, 6, 8 have offspring of losses 9, 1, 0, 9."""
    names = jnp.arange(4.0)[:, None]
    parents = Swarm(names, jnp.array([2.0, 4.0, 6.0, 8.0]))
    offspring = Swarm(10 + names, jnp.array([9.0, 1.0, 0.0, 9.0]))
    return solver.survive(parents, offspring, jnp.array(generation))


def test_early_an_offspring_competes_with_its_mother_alone_and_later_with_everyone():
    solver = BarnacleMating(population=4, iterations=10, brood_share=0.5)
    early, late = survivors(solver, 5), survivors(solver, 6)
    np.testing.assert_array_equal(early.losses, [0, 1, 2, 8])
    np.testing.assert_array_equal(early.positions[:, 0], [12, 11, 0, 3])
    np.testing.assert_array_equal(late.losses, [0, 1, 2, 4])
    np.testing.assert_array_equal(late.positions[:, 0], [12, 11, 0, 1])


def test_the_elite_center_lies_in_the_better_half_and_nearest_to_the_best():
    solver = BarnacleMating(population=6, cast_center="elite", cast_scale=0.0, pl=-1)
    swarm = Swarm(jnp.array([[0.0], [1.0], [2.0], [50.0], [60.0], [70.0]]), jnp.arange(6.0))
    weights = np.log(3.5) - np.log([1, 2, 3])
    center = weights @ [0, 1, 2] / weights.sum()
    np.testing.assert_allclose(proposed(solver, swarm, jr.key(0)), center, rtol=1e-5)
