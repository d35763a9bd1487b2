"""What sets each optimizer apart, checked against its rule written out plainly."""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax.optimizers import (
    AdaptiveGenetic,
    Box,
    CoevolvingSwarm,
    Ecosystem,
    GreyWolf,
    ImprovedGreyWolf,
    MixedSwarm,
    ParticleSwarm,
    SailfishSearch,
    SeagullSearch,
    SunflowerSearch,
    Swarm,
    WhaleSearch,
    minimise,
)
from barnax.optimizers.leaders import (
    learn_from_neighbors,
    random_subset,
    replace_leaders,
    three_best,
)
from barnax.optimizers.pso import badness
from barnax.optimizers.swarm import best_of, better_of_each

BOX = Box(jnp.array([-4.0, 0.0, 10.0]), jnp.array([4.0, 1.0, 90.0]))
CANDIDATES = 30


@eqx.filter_jit
def prepared(solver, seed=0, generation=1):
    """A solver's first swarm on the sum of the coordinates, and a generation's numbers."""
    positions = solver.start(jr.key(seed), BOX, BOX.lower.dtype)
    swarm = solver.prepare(Swarm(positions, jnp.sum(positions, axis=1)), BOX)
    return swarm, solver.draw(jr.key(seed + 1), jnp.array(generation), BOX)


@eqx.filter_jit
def proposed(solver, drawn, swarm, generation=1):
    """Where the candidates go, and the new memory."""
    return solver.propose(drawn, swarm, jnp.array(generation), BOX)


@eqx.filter_jit
def survived(solver, swarm, offspring):
    """Who lives on."""
    return solver.survive(swarm, offspring, jnp.array(1))


def test_losses_lie_between_the_least_and_the_mean_of_the_finite():
    losses = jnp.array([3.0, 1.0, 2.0, jnp.inf, 6.0])
    np.testing.assert_allclose(badness(losses), [1, 0, 0.5, 1, 1])
    np.testing.assert_array_equal(badness(jnp.full(3, 2.0)), 1)
    np.testing.assert_array_equal(badness(jnp.full(3, jnp.inf)), 1)


def test_a_coevolving_particle_moves_its_coordinates_in_the_context():
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
    for axis in range(3):
        leader = np.argmin(np.where(np.arange(CANDIDATES) % 3 == axis, losses, np.inf))
        assert offspring[-1, axis] == swarm.positions[leader, axis]
    assert species.context.losses == losses.min()


def test_exploring_particles_follow_others_and_exploiting_ones_the_best():
    solver = MixedSwarm(CANDIDATES, velocity_fraction=100.0)
    swarm, drawn = prepared(solver)
    weights, followed = drawn
    moved, _ = proposed(solver, drawn, swarm, 1)
    best = np.asarray(swarm.positions[jnp.argmin(swarm.losses)])
    for particle, step in enumerate(np.asarray(moved - swarm.positions)):
        goal = best if particle >= 15 else np.asarray(swarm.positions[followed[particle]])
        # First velocities are zero, and each has been nowhere better than it is.
        pull = np.asarray(weights[1, particle])
        np.testing.assert_allclose(step, pull * (goal - swarm.positions[particle]), atol=1e-4)
    assert float(jnp.max(weights[:, :15])) <= 1.5 < float(jnp.max(weights))


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
    np.testing.assert_array_equal(moved[-3:], drawn[1][-3:])
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
    grazes, hunts = (
        np.all(np.asarray(each) == 0, axis=1).mean()
        for each in (drawn.from_other, drawn.from_producer)
    )
    # Five deviations of a share of a third among 240.
    assert [grazes, hunts] == pytest.approx([1 / 3, 1 / 3], abs=5 * 0.031)
    _, last = prepared(solver, generation=19)
    consumed, _ = proposed(solver, last, swarm, 19)
    np.testing.assert_array_equal(consumed[-1], swarm.positions[0])


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
def test_grey_wolf_leaders_change_as_in_a_loop_over_the_wolves(wolf_losses, leader_losses):
    # With a position that names its wolf, the leaders' positions say who was chosen.
    wolves = jnp.arange(len(wolf_losses), dtype=float)[:, None]
    old = Swarm(jnp.array([[-1.0], [-2.0], [-3.0]]), jnp.array(leader_losses))
    leaders = jax.jit(replace_leaders)(old, Swarm(wolves, jnp.array(wolf_losses)))
    who, new_losses = loop_over_wolves(leader_losses, wolf_losses)
    np.testing.assert_array_equal(leaders.losses, new_losses)
    np.testing.assert_array_equal(leaders.positions[:, 0], who)


@given(losses, losses)
def test_an_improved_grey_wolf_has_the_leaders_of_the_loop(before, after):
    """The loop runs over what every wolf has kept, its best; not the three best of the pack."""
    solver, box = ImprovedGreyWolf(population=9), Box(-jnp.ones(1), jnp.full(1, 99.0))
    first = Swarm(jnp.arange(9.0)[:, None], jnp.array(before))
    swarm = eqx.filter_jit(solver.prepare)(first, box)
    _, leading = loop_over_wolves([np.inf] * 3, before)
    np.testing.assert_array_equal(swarm.memory.losses, leading)
    offspring = Swarm(jnp.arange(10.0, 28.0)[:, None], jnp.array(after + after), swarm.memory)
    pack = survived(solver, swarm, offspring)
    np.testing.assert_array_equal(pack.losses, np.minimum(before, after))
    np.testing.assert_array_equal(
        pack.memory.losses, loop_over_wolves(leading, np.minimum(before, after).tolist())[1]
    )
    numbers = jnp.full((2, 3, 9, 1), 0.5), jnp.zeros((3, 9, 1))
    moved, _ = eqx.filter_jit(solver.propose)(numbers, pack, jnp.array(1), box)
    # Numbers of one half make the step zero: every wolf is taken to the mean of the leaders.
    np.testing.assert_allclose(moved[:9, 0], np.mean(pack.memory.positions), rtol=1e-6)


@pytest.mark.parametrize("is_published", [False, True])
def test_an_improved_grey_wolf_moves_as_in_the_loops_of_its_authors_code(is_published):
    """IGWO.m (Nadimi-Shahraki et al., 2021), its loops and bounds; else ours, in the same loops."""
    solver = ImprovedGreyWolf(9, 20, midpoint_bounds=is_published, one_random_wolf=is_published)
    swarm, (hunt_numbers, learn_numbers) = prepared(solver)
    moved, _ = proposed(solver, (hunt_numbers, learn_numbers), swarm)
    x, leaders, low, high = map(
        np.asarray, (swarm.positions, swarm.memory.positions, BOX.lower, BOX.upper)
    )
    r1, r2 = np.asarray(hunt_numbers)
    chance, wolf_chance, step = np.asarray(learn_numbers)
    wolves = np.floor(wolf_chance * 9).astype(int)
    if is_published:
        assert (wolves == wolves[:, :1]).all()
        np.testing.assert_array_equal(np.sort(wolves[:, 0]), np.arange(9))

    def bounded(moved_to, now):
        below, above = moved_to < low, moved_to > high
        ends = ((now + low) / 2, (now + high) / 2) if is_published else (low, high)
        return np.where(below, ends[0], np.where(above, ends[1], moved_to)), below | above

    outside = 0
    for i in range(9):
        about = [
            leaders[k] - 2 * (2 * r1[k, i] - 1) * np.abs(2 * r2[k, i] * leaders[k] - x[i])
            for k in range(3)
        ]
        hunted, is_out = bounded(np.mean(about, axis=0), x[i])
        np.testing.assert_allclose(moved[i], hunted, rtol=1e-4, atol=1e-5)
        radius = np.linalg.norm(x[i] - hunted)
        near = [j for j in range(9) if np.linalg.norm(x[i] - x[j]) <= radius]
        learned = np.array(
            [
                x[i, d]
                + step[i, d] * (x[near[int(chance[i, d] * len(near))], d] - x[wolves[i, d], d])
                for d in range(3)
            ]
        )
        learned, leaves = bounded(learned, x[i])
        np.testing.assert_allclose(moved[9 + i], learned, rtol=1e-4, atol=1e-4)
        outside += (is_out | leaves).sum()
    assert outside > 0


# Every twentieth of 200 final losses that the authors' IGWO.m, version 1.0, left in GNU Octave 7.3:
# the squared distance from 9.5 in four dimensions of [-10, 10], 8 wolves, 15 of 16 generations.
IGWO_M = (
    0.0291, 0.0354, 0.0465, 0.0520, 0.0621, 0.0659, 0.0721, 0.0833, 0.0919, 0.102,
    0.115, 0.137, 0.162, 0.216, 0.529, 1.48, 4.59, 11.3, 34.9,
)  # fmt: skip


@pytest.mark.parametrize("is_published", [False, True])
def test_an_improved_grey_wolf_ends_where_its_authors_code_does(is_published):
    """With both switches; with the defaults it can be seen to be another search."""
    solver = ImprovedGreyWolf(8, 16, midpoint_bounds=is_published, one_random_wolf=is_published)
    ends, keys = (jnp.full(4, -10.0), jnp.full(4, 10.0)), jr.split(jr.key(0), 1000)
    solution = minimise(lambda y, _: jnp.sum((y - 9.5) ** 2), solver, *ends, key=keys)
    losses = np.asarray(solution.stats["history"])[:, 15]
    shares = np.mean(losses[:, None] <= np.array(IGWO_M), axis=0)
    distance = np.abs(shares - np.arange(1, 20) / 20).max()
    # Kolmogorov and Smirnov's critical distance at one percent.
    assert (distance < 1.63 * np.sqrt(1 / 200 + 1 / 1000)) == is_published


def test_demoted_leaders_are_the_three_best_ever():
    old = Swarm(jnp.array([[-1.0], [-2.0], [-3.0]]), jnp.array([1.0, 4.0, 5.0]))
    swarm = Swarm(jnp.array([[0.0], [1.0], [2.0]]), jnp.array([3.0, 7.0, 0.5]))
    np.testing.assert_array_equal(three_best(old, swarm).positions[:, 0], [2, -1, 0])


def test_a_leader_is_replaced_only_by_a_strictly_better_candidate():
    swarm = Swarm(jnp.array([[1.0], [2.0]]), jnp.array([3.0, 3.0]))
    leader = best_of(swarm)
    assert leader.positions[0] == 1
    same = better_of_each(leader, best_of(Swarm(swarm.positions + 5, swarm.losses)))
    assert same.positions[0] == 1
    better = better_of_each(leader, best_of(Swarm(swarm.positions + 5, swarm.losses - 1)))
    assert (better.positions[0], better.losses) == (6, 2)


@pytest.mark.parametrize(("limit", "expected"), [(0.25, 0.25), (None, 0.06)])
def test_no_particle_flies_faster_than_its_limit(limit, expected):
    solver = ParticleSwarm(velocity_limit=limit)
    swarm, drawn = prepared(solver)
    moved, _ = proposed(solver, drawn, swarm)
    steps = jnp.abs(moved - swarm.positions)
    assert jnp.max(steps if limit else steps / BOX.width) == pytest.approx(expected, rel=1e-5)


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


def test_a_sailfish_replaces_a_fitter_sardine():
    solver = SailfishSearch(population=6, iterations=5, sailfish_share=0.34)
    sailfish, sardines, born = jnp.ones((2, 1)), 2 * jnp.ones((4, 1)), 3 * jnp.ones((2, 1))
    before = solver.prepare(Swarm(jnp.zeros((6, 1)), jnp.full(6, 9.0)), None)
    losses = jnp.array([5.0, 8.0, 6.0, 1.0, 7.0, 9.0, 4.0, 4.0])
    offspring = Swarm(jnp.concatenate([sailfish, sardines, born]), losses, before.memory)
    after = survived(solver, before, offspring)
    np.testing.assert_array_equal(after.losses, [1, 6, 4, 4, 7, 9])
    np.testing.assert_array_equal(after.positions[:, 0], [2, 2, 3, 3, 2, 2])
    assert after.memory.losses == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("default", "option"),
    [
        (GreyWolf(), GreyWolf(demote_leaders=True)),
        (WhaleSearch(), WhaleSearch(one_random_whale=True)),
        (SeagullSearch(), SeagullSearch(spiral_attack=True)),
    ],
    ids=lambda solver: type(solver).__name__,
)
def test_each_documented_option_changes_a_generation(default, option):
    swarms = []
    for solver in (default, option):
        swarm, drawn = prepared(solver)
        positions, memory = proposed(solver, drawn, swarm)
        offspring = Swarm(positions, np.sum(positions, axis=1), memory)
        swarms.append(survived(solver, swarm, offspring))
    assert not eqx.tree_equal(*swarms)
