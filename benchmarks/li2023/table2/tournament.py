"""All optimizers on all functions, two optimizers at a time."""

import time
from concurrent.futures import ThreadPoolExecutor

import jax

from benchmarks.li2023.test_functions import FUNCTIONS

from .runs import OPTIMIZERS, RUNS, Runs, run_table

# The longest first, so that the workers end together.
BY_COST = sorted(OPTIMIZERS, key=["igwo", "sfo", "gwo"].__contains__, reverse=True)

Tournament = dict[tuple[str, str], Runs]


def play(key: int, runs: int = RUNS, workers: int = 2) -> tuple[Tournament, dict[str, float]]:
    """The runs of every (function, optimizer), and the seconds of each optimizer and in all.

    The seconds include compilation; `workers` optimizers run at once.
    """

    def play_one(optimizer: str) -> tuple[Tournament, float]:
        begin = time.perf_counter()
        # The setting of precision is the thread's own.
        with jax.enable_x64(True):
            results = {
                (function, optimizer): run_table(optimizer, function, jax.random.key(key), runs)
                for function in FUNCTIONS
            }
        return results, time.perf_counter() - begin

    begin = time.perf_counter()
    with ThreadPoolExecutor(workers) as pool:
        played = dict(zip(BY_COST, pool.map(play_one, BY_COST), strict=True))
    seconds = {optimizer: played[optimizer][1] for optimizer in OPTIMIZERS}
    seconds["all"] = time.perf_counter() - begin
    results = {name: runs for part, _ in played.values() for name, runs in part.items()}
    return results, seconds
