"""PySwarms's particles; run by the Python of an environment that has it."""

# The library draws from NumPy's global state.
# ruff: noqa: NPY002

import numpy as np
from pyswarms.single import GlobalBestPSO
from sizes import ITERATIONS, POPULATION
from work import work


def search_with(velocity_limit, is_bounded):
    """Falling inertia; a velocity limit as a share of the width, or for all functions the same."""

    def search(loss, half_width, dims, seed):
        np.random.seed(seed)
        limit = velocity_limit(half_width)
        bounds = (np.full(dims, -half_width), np.full(dims, half_width))
        swarm = GlobalBestPSO(
            POPULATION,
            dims,
            {"c1": 2.0, "c2": 2.0, "w": 0.9},
            bounds=bounds if is_bounded else None,
            oh_strategy={"w": "lin_variation"},
            bh_strategy="nearest",
            velocity_clamp=(-limit, limit),
            init_pos=np.random.uniform(*bounds, (POPULATION, dims)),
        )
        swarm.swarm.velocity = np.zeros((POPULATION, dims))
        losses_of = lambda points: np.array([loss(x) for x in points])  # noqa: E731
        return swarm.optimize(losses_of, ITERATIONS, verbose=False)[0]

    return search


work(
    {
        "pso": search_with(lambda half_width: 0.12 * half_width, is_bounded=True),
        "pso-unbounded": search_with(lambda half_width: 6.0, is_bounded=False),
    },
    {},
)
