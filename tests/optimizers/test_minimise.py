"""Searches in one call and step by step: stops, guesses, pytrees, NumPy, restarts, progress."""

import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx
import pytest

from barnax import InputError
from barnax.optimizers import (
    BarnacleMating,
    ParticleSwarm,
    Stop,
    from_numpy,
    make_optimizer,
    minimise,
)

KEY = jr.key(4)
CENTER = jnp.array([1.0, -2.0])
LOWER, UPPER = jnp.full(2, -4.0), jnp.full(2, 3.0)

SMALL = {"population": 8, "iterations": 20}


def bowl(y, args):
    return jnp.sum((y - CENTER) ** 2)


def lost(y, args):
    return jnp.nan * y[0]


def run(stop=None, fn=bowl, key=KEY, **settings):
    optimizer = ParticleSwarm(**SMALL, stop=stop or Stop())
    return minimise(fn, optimizer, LOWER, UPPER, key=key, **settings)


@pytest.fixture(scope="module")
def whole():
    return run(key=jr.split(KEY, 4))


def history_of(solution):
    return np.asarray(solution.stats["history"])


def test_a_search_by_ask_and_tell_is_that_of_one_call(whole):
    """The losses come from NumPy; what JAX is asked for are positions alone."""
    optimizer = ParticleSwarm(**SMALL)
    ask, tell = jax.jit(optimizer.ask), jax.jit(optimizer.tell)
    state = optimizer.begin(jr.split(KEY, 4)[0], LOWER, UPPER)
    history = []
    while not optimizer.is_over(state):
        positions, state = ask(state)
        losses = np.sum((np.asarray(positions) - np.asarray(CENTER)) ** 2, axis=1)
        state = tell(state, positions, losses)
        history.append(float(state.best_loss))
    np.testing.assert_allclose(history, history_of(whole)[0], rtol=1e-4)
    np.testing.assert_array_equal(state.history, np.float32(history))
    assert state.evaluations == 8 * 21


def test_a_swarm_with_a_memory_is_the_same_step_by_step():
    """Velocities are those of the generation before, and no later ones."""
    key, optimizer = jr.key(1), ParticleSwarm(population=12, iterations=5)
    options = {"key": key, "lower": -4.0, "upper": 3.0, "use_y0": False}
    stepwise = optx.minimise(bowl, optimizer, jnp.zeros(2), options=options, throw=False)
    at_once = minimise(bowl, optimizer, LOWER, UPPER, key=key)
    assert len(set(history_of(at_once).tolist())) > 2
    np.testing.assert_allclose(history_of(stepwise), history_of(at_once), rtol=1e-4)


def test_no_search_that_is_over_reports_beside_others():
    reported, keys = [], jr.split(KEY, 3)
    solution = run(Stop(target=0.5), key=keys, callback=lambda *spent: reported.append(spent))
    jax.effects_barrier()
    evaluations = np.asarray(solution.stats["evaluations"])
    assert len(set(evaluations.tolist())) > 1
    assert len(reported) == np.sum(evaluations) / 8


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"key": jr.split(KEY, 4).reshape(2, 2)}, "a row of keys"),
        ({"key": 3}, r"give `jax.random.key\(3\)`"),
        ({"lower": jnp.array([-jnp.inf, 0.0])}, "are not finite"),
        ({"upper": jnp.nan}, "are not finite"),
        ({"optimizer": "pso"}, r"`optimizer` 'pso' is no optimizer; .*make_optimizer\('pso', "),
        ({"optimizer": BarnacleMating}, "`optimizer` <class .*Mating'> is no optimizer"),
        (
            {"lower": [-4.0, -4.0], "upper": [3.0, 3.0]},
            r"`fn` fails on a list, as `lower` \[-4.0, -4.0\] is .* give .*jnp.array\(\[-4",
        ),
        ({"fn": lost}, r"`fn` is NaN or infinite at all 168 candidates .*between \[-4. -4.\] and"),
        ({"fn": lost, "restarts": 1}, "at all 336 candidates"),
        ({"lower": jnp.zeros(2), "upper": jnp.ones(3)}, r"shapes \(2,\) and \(3,\)"),
        ({"lower": {"a": 0.0}, "upper": {"b": 1.0}}, "`lower` is a .*'a'.* `upper` a .*'b'"),
        ({"y0": {"a": 0.0}}, "`lower` is|`y0` a .*'a'|`y0` has arrays"),
        ({"y0": "best"}, "`y0` 'best' is of no numbers"),
    ],
    ids=[
        "keys", "number", "infinite", "nan", "name", "class", "list", "nowhere", "nowhere again",
        "shapes", "names", "other names", "text",
    ],
)  # fmt: skip
def test_what_no_search_can_be_made_of_is_refused(changes, match):
    given = {"fn": bowl, "optimizer": ParticleSwarm(**SMALL), "lower": LOWER, "upper": UPPER}
    with pytest.raises(InputError, match=match):
        minimise(**given | {"key": KEY} | changes)


def test_an_error_of_the_function_is_not_laid_to_the_lists_of_its_bounds():
    with pytest.raises(TypeError, match="positional argument"):
        minimise(lambda y: y[0] ** 2, ParticleSwarm(**SMALL), [0.0, 0.0], [1.0, 1.0], key=KEY)


def test_lists_serve_functions_of_lists_and_a_traced_search_raises_too():
    def of_list(y, args):
        return bowl(jnp.stack(y), args)

    ends = [-4.0, -4.0], [3.0, 3.0]
    solution = minimise(of_list, ParticleSwarm(**SMALL), *ends, key=KEY)
    assert isinstance(solution.value, list)
    assert minimise(lost, ParticleSwarm(**SMALL), *ends, key=KEY, throw=False).value
    with pytest.raises(eqx.EquinoxRuntimeError):
        eqx.filter_jit(lambda key: run(fn=lost, key=key).value)(KEY)


def test_a_guess_is_the_first_candidate_and_has_to_lie_inside():
    guessed = run(y0=CENTER)
    assert guessed.stats["best_loss"] == guessed.stats["history"][0] == 0
    np.testing.assert_array_equal(guessed.value, CENTER)
    with pytest.raises(ValueError, match=r"`y0` \[9. 9.\] is not between"):
        run(y0=jnp.full(2, 9.0))
    with pytest.raises(InputError, match=r"`y0` has arrays of the shapes \[\(3,\)\], and"):
        run(y0=jnp.zeros(3))


@pytest.mark.parametrize(
    ("stop", "is_reached"),
    [
        (Stop(target=0.3), lambda history, at: history[at] <= 0.3),
        (Stop(max_evaluations=75), lambda history, at: 8 * (at + 2) > 75),
        (
            Stop(ftol=0.2, patience=4),
            lambda history, at: at >= 4 and history[at - 4] - history[at] <= 0.2 * history[at],
        ),
    ],
    ids=["target", "max_evaluations", "ftol"],
)
def test_each_search_ends_in_the_first_generation_where_its_stop_is_reached(
    whole, stop, is_reached
):
    stopped = run(stop, key=jr.split(KEY, 4))
    ends = []
    for histories in zip(history_of(whole), history_of(stopped), strict=True):
        complete, cut = histories
        end = next((at for at in range(20) if is_reached(complete, at)), 20)
        np.testing.assert_array_equal(cut, np.append(complete[:end], [complete[end]] * (21 - end)))
        ends.append(end)
    assert min(ends) < 20
    np.testing.assert_array_equal(stopped.stats["evaluations"], 8 * (np.array(ends) + 1))
    alone = run(stop, key=jr.split(KEY, 4)[1])
    np.testing.assert_array_equal(history_of(alone), history_of(stopped)[1])


@pytest.mark.parametrize(
    ("limit", "value"),
    [
        ("target", "a"), ("max_evaluations", 2.5), ("ftol", True), ("patience", "50"),
        ("target", float("nan")), ("ftol", float("inf")), ("patience", None), ("patience", 0),
        ("max_evaluations", 0), ("max_evaluations", -5),
    ],
)  # fmt: skip
def test_a_stop_that_would_never_end_is_refused_with_its_value(limit, value):
    with pytest.raises(InputError, match=rf"^`{limit}` {value!r}"):
        Stop(**{limit: value})


def test_a_numpy_function_is_refused_bare_and_searched_wrapped(whole):
    def of_numpy(y, args):
        return float(np.linalg.norm(np.asarray(y) - args) ** 2)

    with pytest.raises(ValueError, match=r"write it with jax\.numpy, or give `from_numpy"):
        run(fn=of_numpy, args=np.asarray(CENTER))
    with pytest.raises(ValueError, match="has to take `y` and `args`"):
        from_numpy(lambda y: 0.0)
    wrapped = run(fn=from_numpy(of_numpy), args=np.asarray(CENTER), key=jr.split(KEY, 4)[0])
    np.testing.assert_allclose(history_of(wrapped), history_of(whole)[0], rtol=1e-4)


def test_restarts_go_on_from_fresh_keys_until_the_target_or_the_budget():
    stop = Stop(target=1e-9, max_evaluations=300)
    plain, again = run(Stop(target=1e-9)), run(stop, restarts=5)
    # A search takes 168; what is left holds 132, that is 16 generations with the first.
    assert again.stats["evaluations"] == 168 + 8 * 16
    second = run(Stop(max_evaluations=132), key=jr.fold_in(KEY, 1))
    best = min(plain.stats["best_loss"], second.stats["best_loss"])
    assert again.stats["best_loss"] == pytest.approx(float(best), rel=1e-4)
    easy = run(Stop(target=100.0), restarts=5)
    assert easy.stats["evaluations"] == 8


def test_progress_is_called_after_every_generation():
    calls = []
    solution = run(callback=lambda *spent: calls.append([float(number) for number in spent]))
    jax.effects_barrier()
    generations, evaluations, losses = np.array(sorted(calls)).T
    np.testing.assert_array_equal(generations, np.arange(21))
    np.testing.assert_array_equal(evaluations, 8 * np.arange(1, 22))
    np.testing.assert_array_equal(np.float32(losses), history_of(solution))


def test_the_optimizers_load_no_tables_figures_schemas_or_batteries():
    code = "import sys, barnax.optimizers; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert not loaded & {"polars", "matplotlib", "pydantic", "pandas", "scipy.optimize"}
    ours = {name.split(".")[1] for name in loaded if name.startswith("barnax.")}
    assert ours == {"optimizers", "errors", "display"}


def test_losses_of_another_number_than_positions_are_refused():
    search = make_optimizer("pso", population=8, iterations=3)
    positions, state = search.ask(search.begin(jax.random.key(0), [0.0, 0.0], [1.0, 1.0]))
    with pytest.raises(InputError, match=r"`losses` has the shape \(3,\); .* the 8 positions"):
        search.tell(state, positions, np.zeros(3))
    assert search.tell(state, positions, [1.0] * 8).best_loss == 1.0
    with pytest.raises(InputError, match=r"`population` 30\.5 is not a whole number"):
        make_optimizer("pso", population=30.5, iterations=3)
