"""`barnax identify` on the bundled cell, thirty seeds, in fresh processes."""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from barnax.model.problem import KINDS

from .sizes import Sizes

# In seconds; a cold cache holds no compiled program.
AIMS = {("compressed", "cold"): 12.0, ("compressed", "warm"): 5.0, ("scan", "warm"): 9.0}


@dataclass(frozen=True)
class Start:
    """Wall time of one process, or the median of several."""

    objective: str
    cache: str
    wall_s: float

    @property
    def verdict(self) -> str:
        aim_s = AIMS.get((self.objective, self.cache))
        if aim_s is None:
            return "stated"
        met = "met" if self.wall_s <= aim_s else f"missed by {self.wall_s - aim_s:.1f} s"
        return f"at most {aim_s:g} s: {met}"


def time_starts(sizes: Sizes) -> Iterator[Start]:
    """A first process with an empty cache of compiled programs, then the same again."""
    for objective in KINDS:
        with tempfile.TemporaryDirectory() as folder:
            yield Start(objective, "cold", _one_s(Path(folder), objective, 0))
            warm = [
                _one_s(Path(folder), objective, number)
                for number in range(1, sizes.warm_starts + 1)
            ]
            yield Start(objective, "warm", statistics.median(warm))


def _one_s(folder: Path, objective: str, number: int) -> float:
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(folder / "jax")}
    command = [sys.executable, "-m", "barnax", "identify", "--quiet", "--objective", objective]
    begin = time.perf_counter()
    subprocess.run(
        [*command, "--out", str(folder / f"out{number}")],
        check=True,
        env=environment,
        capture_output=True,
    )
    return time.perf_counter() - begin
