"""What sets each published comparator apart, checked against its rule written out plainly."""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barnax.optimizers import (
    Box,
    GreyWolf,
    ParticleSwarm,
    SailfishSearch,
    SeagullSearch,
    Swarm,
    WhaleSearch,
)
from barnax.optimizers.leaders import (
    learn_from_neighbors,
    random_subset,
    replace_leaders,
    three_best,
)
from barnax.optimizers.swarm import best_of, better_leader

# An infinite loss stands for a wolf that is not there.
losses = st.lists(st.one_of(st.integers(0, 9).map(float), st.just(np.inf)), min_size=9, max_size=9)


def loop_over_wolves(leader_losses, wolf_losses):
    """The update of the leaders one wolf after the other; which wolf (or -1, -2, -3) leads."""
    (alpha, beta, delta), (first, second, third) = leader_losses, (-1, -2, -3)
    for wolf, loss in enumerate(wolf_losses):
        if loss < alpha:
            alpha, first = loss, wolf
        if alpha < loss < beta:
            beta, second = loss, wolf
        if loss > alpha and loss > beta and loss < delta:
            delta, third = loss, wolf
    return [first, second, third], [alpha, beta, delta]


@given(losses, st.lists(st.integers(0, 9).map(float), min_size=3, max_size=3))
@settings(max_examples=60)
def test_grey_wolf_leaders_change_as_in_a_loop_over_the_wolves(wolf_losses, leader_losses):
    # With a position that names its wolf, the leaders' positions say who was chosen.
    wolves = jnp.arange(len(wolf_losses), dtype=float)[:, None]
    old = Swarm(jnp.array([[-1.0], [-2.0], [-3.0]]), jnp.array(leader_losses))
    leaders = jax.jit(replace_leaders)(old, Swarm(wolves, jnp.array(wolf_losses)))
    who, new_losses = loop_over_wolves(leader_losses, wolf_losses)
    np.testing.assert_array_equal(leaders.losses, new_losses)
    np.testing.assert_array_equal(leaders.positions[:, 0], who)


def test_demoted_leaders_are_the_three_best_ever():
    old = Swarm(jnp.array([[-1.0], [-2.0], [-3.0]]), jnp.array([1.0, 4.0, 5.0]))
    swarm = Swarm(jnp.array([[0.0], [1.0], [2.0]]), jnp.array([3.0, 7.0, 0.5]))
    np.testing.assert_array_equal(three_best(old, swarm).positions[:, 0], [2, -1, 0])


def test_a_leader_is_replaced_only_by_a_strictly_better_candidate():
    swarm = Swarm(jnp.array([[1.0], [2.0]]), jnp.array([3.0, 3.0]))
    leader = best_of(swarm)
    assert leader.position[0] == 1
    same = better_leader(leader, Swarm(swarm.positions + 5, swarm.losses))
    assert same.position[0] == 1
    better = better_leader(leader, Swarm(swarm.positions + 5, swarm.losses - 1))
    assert (better.position[0], better.loss) == (6, 2)


def test_an_unbounded_swarm_leaves_the_box():
    """The bounded one does not: that every optimizer promises."""
    solver = ParticleSwarm(population=8, iterations=20, bounded=False)
    options = {"key": jr.key(0), "lower": -4.0, "upper": 4.0}
    solution = optx.minimise(
        lambda x, _: -jnp.sum(x), solver, jnp.zeros(3), options=options, max_steps=None
    )
    assert jnp.max(solution.value) > 4.0


@pytest.mark.parametrize(("limit", "expected"), [(0.25, 0.25), (None, 0.06 * 8)])
def test_no_particle_flies_faster_than_its_limit(limit, expected):
    solver = ParticleSwarm(velocity_limit=limit)
    box = Box(jnp.full(3, -4.0), jnp.full(3, 4.0))
    positions = solver.start(jr.key(0), box, float)
    swarm = solver.prepare(Swarm(positions, jnp.sum(positions, axis=1)), box)
    drawn = solver.draw(jr.key(1), jnp.array(1), box)
    moved, _ = solver.propose(drawn, swarm, jnp.array(1), box)
    assert jnp.max(jnp.abs(moved - positions)) == pytest.approx(expected, rel=1e-5)


def test_neighbors_within_reach_are_chosen_equally_often():
    """A wolf whose reach covers itself and two others steps toward each of the three alike."""
    wolves = jnp.array([[0.0], [1.0], [-1.0], [50.0]])
    hunted = wolves + jnp.array([[1.5], [0.1], [0.1], [0.1]])

    def chosen(key):
        numbers = jr.uniform(key, (3, 4, 8))
        return learn_from_neighbors(numbers, jnp.tile(wolves, (1, 8)), jnp.tile(hunted, (1, 8)))

    keys = jr.split(jr.key(0), 2000)
    learned = np.asarray(jax.jit(jax.vmap(chosen))(keys))
    # The far wolf has no neighbor but itself, so its step is 50 minus one of the four.
    steps = learned[:, 3, :] - 50
    assert steps.min() >= 0
    assert steps.max() <= 51
    # The first wolf: neighbors average 0, random wolves average 12.5, steps average half of it.
    assert learned[:, 0, :].mean() == pytest.approx(-6.25, abs=0.3)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.49, -1.0])
def test_a_random_subset_has_its_share_rounded_down(share):
    numbers = jr.uniform(jr.key(0), (21,))
    assert random_subset(numbers, jnp.array(share)).sum() == max(0, int(21 * share))


def test_a_sailfish_takes_the_place_of_a_fitter_sardine():
    solver = SailfishSearch(population=6, iterations=5, sailfish_share=0.34)
    sailfish, sardines, born = jnp.ones((2, 1)), 2 * jnp.ones((4, 1)), 3 * jnp.ones((2, 1))
    before = solver.prepare(Swarm(jnp.zeros((6, 1)), jnp.full(6, 9.0)), None)
    losses = jnp.array([5.0, 8.0, 6.0, 1.0, 7.0, 9.0, 4.0, 4.0])
    offspring = Swarm(jnp.concatenate([sailfish, sardines, born]), losses, before.memory)
    after = solver.survive(before, offspring, jnp.array(1))
    np.testing.assert_array_equal(after.losses, [1, 6, 4, 4, 7, 9])
    np.testing.assert_array_equal(after.positions[:, 0], [2, 2, 3, 3, 2, 2])
    assert after.memory.loss == 1


@eqx.filter_jit
def one_generation(solver, key):
    """Where a swarm is after one generation on a sphere about 1."""
    box = Box(jnp.full(3, -4.0), jnp.full(3, 4.0))

    def evaluated(positions, memory=None):
        return Swarm(positions, jnp.sum((positions - 1) ** 2, axis=1), memory)

    swarm = solver.prepare(evaluated(solver.start(key, box, box.lower.dtype)), box)
    drawn = solver.draw(key, jnp.array(2), box)
    offspring = evaluated(*solver.propose(drawn, swarm, jnp.array(2), box))
    return solver.survive(swarm, offspring, jnp.array(2))


@pytest.mark.parametrize(
    ("default", "option"),
    [
        (GreyWolf(), GreyWolf(demote_leaders=True)),
        (WhaleSearch(), WhaleSearch(one_random_whale=True)),
        (SeagullSearch(), SeagullSearch(spiral_attack=True)),
        (ParticleSwarm(), ParticleSwarm(velocity_limit=0.1)),
    ],
    ids=lambda solver: type(solver).__name__,
)
def test_each_documented_option_changes_a_generation(default, option):
    swarms = [one_generation(solver, jr.key(0)) for solver in (default, option)]
    assert not eqx.tree_equal(*swarms)
