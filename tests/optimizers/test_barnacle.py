"""The barnacle optimizers: the switches, and what moving the origin does to them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx
import pytest

from barnax.optimizers import BarnacleMating, bmo, ibmo, ibmo_centered, ibmo_printed

WIDTH = 8.0


def valley(x, center):
    return jnp.sum(jnp.arange(1.0, 6.0) * (x - center) ** 2)


@eqx.filter_jit
def search(optimizer, key, origin):
    return optx.minimise(
        valley,
        optimizer,
        jnp.zeros(5),
        origin + 3.0,
        options={"key": key, "lower": origin, "upper": origin + WIDTH},
        max_steps=None,
    )


def test_with_every_improvement_off_the_class_is_bmo():
    assert BarnacleMating() == bmo()


def test_the_three_readings_of_ibmo_differ_from_bmo_and_each_other():
    readings = [bmo(), ibmo(), ibmo_printed(), ibmo_centered()]
    assert len(set(readings)) == len(readings)


def test_mating_without_any_factor_is_refused():
    with pytest.raises(ValueError, match="cosine_factor or gaussian_factor"):
        BarnacleMating(gaussian_factor=False)


def test_moving_the_origin_moves_the_whole_run_of_ibmo_centered():
    with jax.enable_x64(True):
        solver = ibmo_centered(population=10, iterations=40)
        here, there = (search(solver, jr.key(1), jnp.float64(origin)) for origin in (0.0, 512.0))
        # 512 costs ten bits of every coordinate; the rest must agree until rounding grows.
        np.testing.assert_allclose(
            here.stats["history"][:15], there.stats["history"][:15], rtol=1e-6
        )
        np.testing.assert_allclose(here.value, there.value - 512, atol=0.05)


@pytest.mark.parametrize("make", [bmo, ibmo])
def test_moving_the_origin_changes_what_the_published_barnacles_find(make):
    solver = make(population=10, iterations=40)
    here, there = (search(solver, jr.key(1), origin) for origin in (0.0, 512.0))
    assert not np.allclose(here.stats["history"], there.stats["history"], rtol=1e-2)


def test_every_cast_of_bmo_contracts_toward_the_origin():
    """On a flat function with no mating nothing but the cast moves, and it only shrinks."""
    solver = BarnacleMating(population=8, iterations=30, pl=-1)
    shrinks = optx.minimise(
        lambda x, _: jnp.max(jnp.abs(x)),
        solver,
        jnp.zeros(3),
        options={"key": jr.key(0), "lower": -1.0, "upper": 1.0},
        max_steps=None,
    )
    assert shrinks.stats["best_loss"] < 1e-6


def test_reevaluating_the_parents_doubles_the_cost():
    once, twice = (
        search(BarnacleMating(population=8, iterations=5, reevaluate_parents=again), jr.key(0), 0.0)
        for again in (False, True)
    )
    assert once.stats["evaluations"] == 8 + 5 * 8
    assert twice.stats["evaluations"] == 8 + 5 * 16
    np.testing.assert_allclose(once.stats["history"], twice.stats["history"], rtol=1e-5)
