"""A worker's task: a batch of cells, a row each, and one file of them.

Nothing here loads JAX before a worker has set how it is to run.
"""

import functools
import gc
import hashlib
import os
import signal
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any

import platformdirs

from ..devices import prefer_cpu
from ..files import located
from .dataset import count_rows, marking, write_rows
from .manifest import FleetCell

# glibc gives freed memory back to the system at once above these sizes, and takes it again for the
# next cell: with Dask's own setting that took two fifths of all CPU time.
MALLOC_OPTIONS = {-1: 1 << 29, -3: 1 << 29}  # M_TRIM_THRESHOLD, M_MMAP_THRESHOLD
# One program at a time, on one thread: cores are shared among processes. The bits are the same.
XLA_FLAGS = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
# How many threads XLA keeps for itself; with one a core, they wake each other all the time.
XLA_THREADS = {"NPROC": "1"}
WATCH_S = 0.5


# Rows that a batch gave, and how many of them are errors.
Counts = tuple[int, int]


def batch_name(prints: Sequence[str]) -> str:
    """The name of a batch's files, by the fingerprints of its cells."""
    return hashlib.sha256("".join(prints).encode()).hexdigest()[:32]


def run_batch(
    folder: str, out: str, prints: Sequence[str], cells: Sequence[FleetCell], settings: Mapping
) -> Counts:
    """The rows of some cells, written as one part; a part that stands already is not computed."""
    name = batch_name(prints)
    place = located(folder)
    part = place / f"{name}.parquet"
    known = count_rows(part)
    if known is not None:
        return known
    prepare_process()
    from .rows import identify_rows

    rows = []
    with marking(place, name) as mark:
        for place, (cell, print_) in enumerate(zip(cells, prints, strict=True)):
            mark(place)
            found = identify_rows(cell, settings, located(out))
            rows += [row | {"fingerprint": print_} for row in found]
        write_rows(part, rows)
    return len(cells), sum(row["error"] is not None and row.get("pack") is None for row in rows)


@functools.cache
def prepare_process() -> None:
    """Set a process up for many cells, before JAX is loaded where it is not yet."""
    # As in `barnax` itself: modules and traced programs are many objects and no garbage.
    gc.set_threshold(50_000, 20, 20)
    if sys.platform == "linux":
        import ctypes

        mallopt: Any = getattr(ctypes.CDLL(None), "mallopt", None)
        for option, size in MALLOC_OPTIONS.items() if mallopt else ():
            mallopt(option, size)
    prefer_cpu()
    if "jax" not in sys.modules:
        # Once: a process inherits them, and another text is another key in the cache.
        own = os.environ.get("XLA_FLAGS", "").replace(XLA_FLAGS, "")
        os.environ["XLA_FLAGS"] = f"{own.strip()} {XLA_FLAGS}".strip()
        os.environ.update(XLA_THREADS)
        cache = platformdirs.user_cache_path("barnax") / "jax"
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache))
        os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")


def start_worker(driver: int) -> None:
    """Begin a process of a pool: it ends with its driver, and leaves Ctrl-C to that."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == driver:
            time.sleep(WATCH_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    prepare_process()
