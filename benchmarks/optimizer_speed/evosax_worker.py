"""Times evosax on the sphere; run by the Python of an environment that has it. Prints JSON."""

import json
import time
from functools import partial

import jax
import jax.numpy as jnp
import jax.random as jr
from evosax.algorithms import PSO
from sizes import DIMS, HALF_WIDTH, ITERATIONS, POPULATION, REPEATS, RUNS


@partial(jax.jit, static_argnums=0)
def search(algorithm, keys):
    """All runs in one compiled call, as ours."""

    def one(key):
        start_key, run_key = jr.split(key)
        shape = (POPULATION, DIMS)
        positions = jr.uniform(start_key, shape, minval=-HALF_WIDTH, maxval=HALF_WIDTH)
        params = algorithm.default_params
        state = algorithm.init(run_key, positions, jnp.sum(positions**2, axis=1), params)

        def generation(state, key):
            ask_key, tell_key = jr.split(key)
            positions, state = algorithm.ask(ask_key, state, params)
            losses = jnp.sum(positions**2, axis=1)
            state, _ = algorithm.tell(tell_key, positions, losses, state, params)
            return state, None

        state, _ = jax.lax.scan(generation, state, jr.split(run_key, ITERATIONS))
        return state.best_fitness

    return jax.vmap(one)(keys)


jax.config.update("jax_enable_x64", True)
algorithm = PSO(population_size=POPULATION, solution=jnp.zeros(DIMS))
keys = jr.split(jr.key(1), RUNS)
jax.block_until_ready(search(algorithm, keys))
seconds = []
for _ in range(REPEATS):
    begin = time.perf_counter()
    final = jax.block_until_ready(search(algorithm, keys))
    seconds.append(time.perf_counter() - begin)
evaluations = RUNS * POPULATION * (ITERATIONS + 1)
print(
    json.dumps(
        {"pso": {"seconds": min(seconds), "evaluations": evaluations, "final": final.tolist()}}
    )
)
