"""A worker's task: the row of a cell, of a pack a row for each of its cells too.

Nothing here loads JAX before a worker has set how it is to run.
"""

import functools
import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Mapping
from typing import Any

from ..devices import keep_compiled, prefer_cpu
from ..files import located
from .manifest import FleetCell

# glibc gives freed memory back to the system at once above these sizes, and takes it again for the
# next cell: with Dask's own setting that took two fifths of all CPU time.
MALLOC_OPTIONS = {-1: 1 << 29, -3: 1 << 29}  # M_TRIM_THRESHOLD, M_MMAP_THRESHOLD
# One program at a time, on one thread: cores are shared among processes. The bits are the same.
XLA_FLAGS = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
# How many threads XLA keeps for itself; with one a core, they wake each other all the time.
XLA_THREADS = {"NPROC": "1"}
WATCH_S = 0.5

Rows = list[dict[str, Any]]


def run_cell(print_: str, cell: FleetCell, settings: Mapping[str, Any], out: str) -> Rows:
    """The rows of a cell with its fingerprint; its files are kept below the folder `out`."""
    prepare_process()
    from .rows import identify_rows

    found = identify_rows(cell, settings, located(out))
    return [row | {"fingerprint": print_} for row in found]


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
        keep_compiled()


def start_worker(driver: int) -> None:
    """Begin a process of a pool: it ends with its driver, and leaves Ctrl-C to that."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == driver:
            time.sleep(WATCH_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    prepare_process()
