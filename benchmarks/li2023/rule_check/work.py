"""What the workers of all libraries do alike: read the experiment, do one task, print JSON.

Called as `python <library>_worker.py EXPERIMENT TASK RUNS`, where the task is the name of a search
or `values`.
"""

import json
import sys
from pathlib import Path

import numpy as np
from functions import FUNCTIONS


def work(searches, values):
    """Does the task named on the command line.

    `searches`: by name, functions of a loss, the half-width of its box, the dimensions and a
    seed, that give the least loss found. `values`: by name of one of our functions, the
    library's own.
    """
    experiment = json.loads(Path(sys.argv[1]).read_text())
    task = sys.argv[2]
    answer = (
        values_of(values, experiment["points"])
        if task == "values"
        else losses_of(searches[task], experiment, runs=int(sys.argv[3]))
    )
    print()
    print(json.dumps(answer))


def values_of(values, points):
    """The library's value at each of the points."""
    return {
        name: [float(value(np.array(x))) for x in points[name]] for name, value in values.items()
    }


def losses_of(search, experiment, runs):
    """Final losses of all runs on every problem, and the evaluations of one run."""
    final, evaluations = {}, set()
    for place, problem in enumerate(experiment["problems"]):
        offset = np.array(problem["offset"])
        function = FUNCTIONS[problem["function"]]
        calls = 0

        def loss(x, function=function, offset=offset):
            nonlocal calls
            calls += 1
            return float(function(x - offset))

        losses = []
        for run in range(runs):
            calls = 0
            # Equal seeds would tie the runs on one function to those on the next.
            seed = experiment["key"] + 1000 * place + run
            losses.append(float(search(loss, problem["half_width"], len(offset), seed)))
            evaluations.add(calls)
        final[problem["name"]] = losses
    return {"final": final, "evaluations": sorted(evaluations)}
