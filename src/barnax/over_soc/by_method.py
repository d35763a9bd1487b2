"""The time constants of tables searched by the methods of a comparison.

Whatever the method proposes, the tables are the exact optimum there (variable projection: Golub
and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413), so that a few logarithms are all it searches.
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Float
from scipy.optimize import least_squares

from ..baselines.method import Budget, generator_of, latin_hypercube
from ..baselines.searches import DE, FEWEST, LM, PSO_LM, STARTS, evolve_in_box
from ..blas import one_blas_thread
from ..execution import in_float64
from ..optimizers import OPTIMIZERS, evaluations_per_iteration, make_optimizer
from .objective import Objective, Solution
from .search import Place, in_order

SEARCHES = (*OPTIMIZERS, LM.name, PSO_LM.name, DE.name)
# Few coordinates need few candidates, and each costs the exact solution of all tables.
MOST_CANDIDATES, MOST_ITERATIONS, MOST_SEEDS = 10, 30, 5
# Of the errors: what a descent may still gain, and the accuracy of its slopes.
TOLERANCE = 1e-10

Places = Float[np.ndarray, "seeds axes"]


def capped(budget: Budget) -> Budget:
    """What a method may spend on tables: at most the numbers above."""
    return Budget(
        min(budget.population, MOST_CANDIDATES),
        min(budget.iterations, MOST_ITERATIONS),
        min(budget.seeds, MOST_SEEDS),
        budget.key,
    )


def search_by(objective: Objective, method: str, budget: Budget) -> list[tuple[Solution, int]]:
    """What each seed of a method of `SEARCHES` ends with, and how many places it tried."""
    with one_blas_thread():
        if method in OPTIMIZERS:
            found = _swarm(objective, method, budget, budget.evaluations)
        elif method == PSO_LM.name:
            spared = max(budget.evaluations // 2, 2 * budget.population)
            starts = _swarm(objective, "pso", budget, spared)
            found = [_descents(objective, [place], spent) for place, spent in starts]
        else:
            one = _evolution if method == DE.name else _multistart
            found = [one(objective, budget, seed) for seed in range(budget.seeds)]
        ends = [(in_order(objective, place), spent) for place, spent in found]
        return [(objective.solve(place, exact=True), spent) for place, spent in ends]


def roots_at(objective: Objective, places: Float[np.ndarray, "... axes"]) -> np.ndarray:
    """sqrt(J) of every place with the best tables there, in V."""
    flat = places.reshape(-1, places.shape[-1])
    found = [objective.solve(tuple(place.tolist())).root for place in flat]
    return np.array(found).reshape(places.shape[:-1])


@in_float64
def _swarm(
    objective: Objective, name: str, budget: Budget, evaluations: int
) -> list[tuple[Place, int]]:
    """A population optimizer's best places; all its seeds and candidates are one batch."""
    cost = evaluations_per_iteration(make_optimizer(name, budget.population, 1))
    iterations = max(1, (evaluations - budget.population) // cost)
    optimizer = make_optimizer(name, budget.population, iterations)
    low, high = map(jnp.asarray, box_of_axes(objective))

    def batch(bits: np.ndarray) -> np.ndarray:
        places = np.ascontiguousarray(bits).view(np.float64)[..., 0]
        return roots_at(objective, places)[..., None].view(np.uint32)

    # As bits: a callback runs in a thread of its own, where JAX may not be in float64.
    def loss(place, _):
        bits = jax.lax.bitcast_convert_type(place, jnp.uint32)
        answer = jax.ShapeDtypeStruct((2,), jnp.uint32)
        root = jax.pure_callback(batch, answer, bits, vmap_method="expand_dims")
        return jax.lax.bitcast_convert_type(root, jnp.float64)

    def one(key):
        options = {"key": key, "lower": low, "upper": high}
        return optx.minimise(loss, optimizer, low, options=options, max_steps=None, throw=False)

    keys = jax.vmap(lambda seed: jax.random.fold_in(jax.random.key(budget.key), seed))(
        jnp.arange(budget.seeds)
    )
    found = jax.jit(jax.vmap(one))(keys)
    spent = np.asarray(found.stats["evaluations"]).tolist()
    return [
        (tuple(place.tolist()), each)
        for place, each in zip(np.asarray(found.value), spent, strict=True)
    ]


def _multistart(objective: Objective, budget: Budget, seed: int) -> tuple[Place, int]:
    """The best of some descents."""
    low, high = box_of_axes(objective)
    fractions = latin_hypercube(generator_of(budget.key, seed), STARTS, len(low))
    starts = low + fractions * (high - low)
    return _descents(objective, [tuple(each.tolist()) for each in starts])


def _descents(objective: Objective, starts: Sequence[Place], spent: int = 0) -> tuple[Place, int]:
    """Levenberg-Marquardt within the box (SciPy's trust region), by Kaufman's slopes (BIT 15
    (1975) 49): the errors' own ones less what the free unknowns make up for."""
    held = [axis.high > axis.low for axis in objective.axes]
    low, high = (limits[held] for limits in box_of_axes(objective))
    ends: list[tuple[float, Place]] = []

    def whole(free: np.ndarray) -> Place:
        place = np.array([axis.low for axis in objective.axes])
        place[held] = free
        return tuple(place.tolist())

    def errors(free: np.ndarray) -> np.ndarray:
        found = objective.solve(whole(free))
        return np.append(found.error, objective.penalty @ found.unknowns)

    def slopes(free: np.ndarray) -> np.ndarray:
        found = objective.solve(whole(free))
        columns, _ = objective.columns(found.place)
        moving = np.concatenate([columns, objective.penalty])[:, found.sides == 0]
        moved = np.stack(objective.moved(found), axis=1)[:, held]
        moved = np.concatenate([moved, np.zeros((len(objective.penalty), moved.shape[1]))])
        basis, _ = np.linalg.qr(moving)
        return moved - basis @ (basis.T @ moved)

    for start in starts:
        if not any(held):
            return start, spent + 1
        inside = np.clip(np.array(start)[held], low, high)
        jacobian: Any = slopes  # SciPy's types know of names only
        end = least_squares(
            errors, inside, jacobian, (low, high), ftol=TOLERANCE, xtol=TOLERANCE, gtol=TOLERANCE
        )
        # As elsewhere, slopes count as one evaluation a coordinate.
        spent += end.nfev + end.njev * int(np.sum(held))
        ends.append((end.cost, whole(end.x)))
    return min(ends)[1], spent


def _evolution(objective: Objective, budget: Budget, seed: int) -> tuple[Place, int]:
    """SciPy's differential evolution, as of constant circuits."""
    spent = 0

    def errors(points: np.ndarray) -> np.ndarray:
        nonlocal spent
        spent += points.shape[1]
        return roots_at(objective, points.T)

    low, high = box_of_axes(objective)
    generator, population = generator_of(budget.key, seed), max(budget.population, FEWEST)
    end = evolve_in_box(errors, low, high, generator, population, budget.iterations)
    return tuple(end.tolist()), spent


def box_of_axes(objective: Objective) -> tuple[Float[np.ndarray, "axes"], ...]:
    """The lowest and the highest place."""
    axes = objective.axes
    return np.array([axis.low for axis in axes]), np.array([axis.high for axis in axes])
