"""`barnax identify` on the bundled cell, thirty seeds, in fresh processes, beside the imports."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from .sizes import Sizes

# What any answer needs to load; the processor time of a warm run is at most so many times its.
IMPORTS = "import jax, optimistix, matplotlib.pyplot, polars, scipy.optimize"
AIM = 2.0


@dataclass(frozen=True)
class Start:
    """Wall and processor time of one process, and that in processor times of the imports."""

    cache: str
    wall_s: float
    cpu_s: float
    ratio: float

    @property
    def verdict(self) -> str:
        if self.cache == "cold":
            return "stated"
        met = "met" if self.ratio <= AIM else f"missed by a factor of {self.ratio / AIM:.2g}"
        return f"at most {AIM:g}: {met}"


def time_starts(sizes: Sizes) -> Iterator[Start]:
    """A first process with an empty cache of compiled programs, and the median of the next ones;
    the imports run before each, for other work on the machine slows both."""
    with tempfile.TemporaryDirectory() as folder:
        starts = [_start(Path(folder), number) for number in range(1 + sizes.warm_starts)]
    yield starts[0]
    yield sorted(starts[1:], key=lambda start: start.ratio)[len(starts[1:]) // 2]


def _start(folder: Path, number: int) -> Start:
    _, imports_s = _taken_s(folder, "-c", IMPORTS)
    command = ("-m", "barnax", "identify", "--quiet", "--out", str(folder / f"out{number}"))
    wall_s, cpu_s = _taken_s(folder, *command)
    return Start("warm" if number else "cold", wall_s, cpu_s, cpu_s / imports_s)


def _taken_s(folder: Path, *arguments: str) -> tuple[float, float]:
    """Wall and processor time of Python with some arguments."""
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(folder / "jax")}
    # Installed packages have bytecode.
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before, begin = os.times(), time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, env=environment, capture_output=True)
    after = os.times()
    cpu_s = after.children_user + after.children_system
    return time.perf_counter() - begin, cpu_s - before.children_user - before.children_system
