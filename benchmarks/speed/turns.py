"""Wall times of several runs, taken in turn: a machine that slows down is slow for all of them."""

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Run:
    """Something to time. One call makes `each` of what is counted; a turn calls it `calls` times.

    A run of less than a millisecond needs several calls for a clock to see it.
    """

    call: Callable[[], object]
    calls: int = 1
    each: int = 1


class Taken:
    """Seconds of every run in every turn."""

    def __init__(self, seconds: Mapping[str, list[float]]):
        self._seconds = dict(seconds)

    def __getitem__(self, name: str) -> float:
        """The median over the turns."""
        return statistics.median(self._seconds[name])

    def __contains__(self, name: str) -> bool:
        return name in self._seconds

    def ratio(self, above: str, below: str) -> float:
        """The median of the turns' own ratios, each from neighbors in time."""
        pairs = zip(self._seconds[above], self._seconds[below], strict=True)
        return statistics.median(one / other for one, other in pairs)


def take_turns(runs: Mapping[str, Run], turns: int) -> Taken:
    """Time all runs `turns` times over, after one call of each that compiles and warms up."""
    for run in runs.values():
        run.call()
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(turns):
        for name, run in runs.items():
            begin = time.perf_counter()
            for _ in range(run.calls):
                run.call()
            seconds[name].append((time.perf_counter() - begin) / (run.calls * run.each))
    return Taken(seconds)
