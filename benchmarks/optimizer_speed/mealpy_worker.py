"""Times mealpy on the sphere; run by the Python of an environment that has it. Prints JSON."""

import json
import time

import numpy as np
from mealpy import BMO, GWO, PSO, SFO, SOA, WOA, FloatVar
from sizes import DIMS, HALF_WIDTH, ITERATIONS, POPULATION, REPEATS

MODELS = {
    "bmo": BMO.OriginalBMO,
    "pso": PSO.OriginalPSO,
    "woa": WOA.OriginalWOA,
    "gwo": GWO.OriginalGWO,
    "igwo": GWO.IGWO,
    "sfo": SFO.OriginalSFO,
    "soa": SOA.OriginalSOA,
}


def time_of(model) -> dict:
    """Seconds and evaluations of one run, and where it ended."""
    calls = 0

    def sphere(x):
        nonlocal calls
        calls += 1
        return float(np.dot(x, x))

    bounds = FloatVar(lb=[-HALF_WIDTH] * DIMS, ub=[HALF_WIDTH] * DIMS)
    problem = {"obj_func": sphere, "bounds": bounds, "minmax": "min", "log_to": None}
    begin = time.perf_counter()
    best = model(epoch=ITERATIONS, pop_size=POPULATION).solve(problem, seed=1)
    seconds = time.perf_counter() - begin
    return {"seconds": seconds, "evaluations": calls, "final": [best.target.fitness]}


def fastest(model) -> dict:
    """The fastest of a few equal runs."""
    return min((time_of(model) for _ in range(REPEATS)), key=lambda run: run["seconds"])


print(json.dumps({name: fastest(model) for name, model in MODELS.items()}))
