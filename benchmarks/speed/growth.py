"""How times and memory grow with the record, the seeds and the cells."""

import gc
import math
import resource
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from barnax.model.compressed import compress
from barnax.model.prepared import BLOCK
from barnax.model.problem import Objective

from .case import bundled_problem, drive_of, points_of
from .searches import generations, identify, one_search
from .sizes import POPULATION, Sizes
from .turns import Run, take_turns

# Enough work for a clock, little enough for the longest record.
ABOUT_S = 0.5


@dataclass(frozen=True)
class Length:
    """Times of one record length; `scan_s` is one generation's and None where it was left out.

    `numpy_mib` is the most that the reduction held beside the record in NumPy's arrays,
    `process_mib` by how much it raised the most that the process ever held.
    """

    samples: int
    reduction_s: float
    search_s: float
    scan_s: float | None
    numpy_mib: float
    process_mib: float


def grow_record(sizes: Sizes) -> Iterator[Length]:
    """The bundled record repeated or cut, in the box of the whole."""
    problem = bundled_problem("compressed")
    box = problem.coordinates
    points = points_of(problem, POPULATION)
    for samples in sizes.lengths:
        prepared = drive_of(problem, samples)
        # Once to compile, with the longest program's memory.
        compress([drive_of(problem, min(samples, 3 * BLOCK))], box)
        gc.collect()
        before_mib = peak_mib()
        tracemalloc.start()
        short = compress([prepared], box)
        _, numpy_bytes = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        process_mib = peak_mib() - before_mib
        objective = Objective(short, box)
        search = one_search(objective, sizes)
        scan_s = None
        if samples <= sizes.longest_scan:
            inputs = prepared.simulation_input(box.spans[0][0])
            call = generations(Objective(inputs, box), points, 1)
            scan_s = _typical_s(call, sizes)
        yield Length(
            samples=samples,
            reduction_s=_typical_s(lambda prepared=prepared: compress([prepared], box), sizes),
            search_s=_typical_s(search, sizes),
            scan_s=scan_s,
            numpy_mib=numpy_bytes / 2**20,
            process_mib=process_mib,
        )


def grow_seeds(sizes: Sizes) -> Iterator[tuple[int, float]]:
    """Seconds of `identify` with more and more seeds, after the reduction."""
    problem = bundled_problem("compressed")
    for seeds in sizes.seeds_shown:
        yield seeds, _typical_s(lambda seeds=seeds: identify(problem, sizes, seeds), sizes)


def peak_mib() -> float:
    """The most memory this process ever held."""
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (2**20 if sys.platform == "darwin" else 2**10)


def slope(sizes: list[float], seconds: list[float]) -> float:
    """The exponent of growth between the last two sizes."""
    return math.log(seconds[-1] / seconds[-2]) / math.log(sizes[-1] / sizes[-2])


def _typical_s(call: Callable[[], object], sizes: Sizes) -> float:
    """The median of as many calls as fit in a moment, one at least, after one that compiles."""
    begin = time.perf_counter()
    call()
    first_s = time.perf_counter() - begin
    begin = time.perf_counter()
    call()
    second_s = time.perf_counter() - begin
    if min(first_s, second_s) > ABOUT_S:
        return second_s
    turns = min(3 * sizes.turns, max(1, int(ABOUT_S / second_s)))
    return take_turns({"call": Run(call)}, turns)["call"]
