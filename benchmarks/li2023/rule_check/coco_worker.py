"""CMA-ES and DE on COCO's functions; run by the Python of an environment that has them.

The functions, with their offsets, are those of the `cma` package, by COCO's authors. The searches
are those of `benchmarks.li2023.centre_bias` with the settings of the published runs: CMA-ES from a
point uniform in [-4, 4] with step 2 and without bounds, DE with all of SciPy's defaults in
[-5, 5].
"""

import contextlib
import json
import sys
from functools import partial

import cmaes
import numpy as np
import scipy.optimize
from cma import bbobbenchmarks
from sizes import COCO_DIMS, COCO_FUNCTIONS, COCO_RUNS, COCO_TARGETS

MOST_EVALUATIONS = 200_000


class Solved(Exception):
    """The last target is reached."""


class Watched:
    """A function that keeps its errors, one an evaluation."""

    def __init__(self, function):
        self.function, self.errors = function, []

    def __call__(self, x):
        loss = float(self.function(x))
        self.errors.append(loss - self.function.fopt)
        if self.errors[-1] <= COCO_TARGETS[-1]:
            raise Solved
        return loss

    def evaluations_to_targets(self):
        """After how many evaluations each target was reached first; none where it was not."""
        lowest = np.minimum.accumulate(self.errors)
        hits = [np.flatnonzero(lowest <= target) for target in COCO_TARGETS]
        return [int(hit[0]) + 1 if len(hit) else None for hit in hits]


def cma_es(loss, seed):
    generator = np.random.default_rng(seed)
    search = cmaes.CMA(mean=generator.uniform(-4, 4, COCO_DIMS), sigma=2.0, seed=seed)
    while not search.should_stop() and len(loss.errors) < MOST_EVALUATIONS:
        points = [search.ask() for _ in range(search.population_size)]
        search.tell([(x, loss(x)) for x in points])


def differential_evolution(loss, seed):
    scipy.optimize.differential_evolution(loss, [(-5, 5)] * COCO_DIMS, rng=seed)


def play(search, function, key):
    """Every run's evaluations in all and up to each target; a run an instance, from the first."""
    runs = []
    for instance in range(1, COCO_RUNS + 1):
        loss = Watched(bbobbenchmarks.dictbbob[function](instance))
        with contextlib.suppress(Solved):
            search(loss, key + instance)
        runs.append({"evaluations": len(loss.errors), "hits": loss.evaluations_to_targets()})
    return runs


SEARCHES = {"cma-es": cma_es, "de": differential_evolution}
TASKS = {
    f"{name}-{function}": partial(play, search, function)
    for name, search in SEARCHES.items()
    for function in COCO_FUNCTIONS
}
with open(sys.argv[1]) as file:
    key = json.load(file)["key"]
print(json.dumps(TASKS[sys.argv[2]](key)))
