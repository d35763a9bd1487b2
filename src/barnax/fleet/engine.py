"""Cells of a fleet on a pool of processes or on Dask; a worker's death costs one row at most.

Workers send rows back, and this process alone writes them. If a pool breaks, its cells are
identified once more, each alone: one whose worker dies again has that in its row. Nothing here
loads JAX before a worker has been set up.
"""

import functools
import gc
import itertools
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from concurrent.futures.process import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Any

from ..devices import ONE_POOL, keep_compiled, prefer_cpu, set_malloc
from ..errors import InputError, installing
from ..files import is_factor_file, located, undisturbed
from ..records import read_record
from ..records.logger import Loggers, loggers_of
from ..settings import Reading
from .dataset import Shard, compact, finished, in_shard, write_part, writing
from .manifest import FleetCell, Options, distinct, fleet_cell_from_row

# Rows per part: few enough to lose if this process is killed.
MAX_IN_PART = 50
# This many files of each kind show how their loggers sample, spread evenly over the ids of cells.
SAMPLED = 12
# Cells waiting in addition to those running, so that a lazy iterable is not read far ahead.
WAITING = 2
# Pools that may break in a row before a worker has begun.
FEW = 3
DIED = (
    "the worker died while it identified this cell (killed, or out of memory); try it alone with "
    "`barnax.identify`"
)
# Exceptions by which an engine reports that it gave a task up because workers died.
WORKER_DIED = ("KilledWorker",)
# Periodic work of Dask's processes, every few milliseconds, that is not used here.
QUIET_DASK = {
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
}
# glibc returns freed memory to the system at once above these sizes, and requests it again for the
# next cell: with Dask's own setting that took two fifths of all CPU time.
KEEP_FREED = {-1: 1 << 29, -3: 1 << 29}  # M_TRIM_THRESHOLD, M_MMAP_THRESHOLD
# One program at a time, on one thread: cores are shared among processes. The bits are the same.
XLA_FLAGS = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
# Number of XLA's own threads; with one per core, they wake each other all the time.
XLA_THREADS = {"NPROC": "1"}
WATCH_S = 0.5
# The row of a cell; for a pack also a row for each of its cells.
Rows = list[dict[str, Any]]
# A cell with its fingerprint.
Marked = tuple[str, FleetCell]


@dataclass(frozen=True)
class Progress:
    """The progress of a fleet.

    Attributes:
        finished: Cells with a row now.
        skipped: Cells that had one before.
        failed: Cells without an answer.
        total: Number of cells, if known.
    """

    finished: int = 0
    skipped: int = 0
    failed: int = 0
    total: int | None = None


def identify_fleet(
    cells: Iterable[FleetCell | Options],
    out: str | Path,
    *,
    settings: Options | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    executor: Executor | None = None,
    shard: Shard | None = None,
    retry: bool = False,
    batch: int | None = None,
    report: Callable[[Progress], None] = lambda progress: None,
) -> Progress:
    """Identify many cells into a dataset with one row per cell; existing rows are skipped.

    If a cell cannot be identified, its row has the reason.

    Args:
        cells: Cells of a manifest, or mappings with an "id" and either a "problem" or the columns
            of a manifest; their other items are copied to their rows. They are read lazily.
        out: Folder of the dataset, or its address, such as `s3://bucket/fleet`.
        settings: Arguments of `identify` for all cells; by default no seeds are run and the answer
            is the global optimum.
        workers: Number of processes; by default one for every core.
        scheduler: Address of a Dask scheduler to run on instead; "local" starts one.
        executor: Your own executor to run on instead.
        shard: A part of the fleet: its number, and the number of parts.
        retry: Repeat cells that failed.
        batch: Rows per part, which is written once they are complete.
        report: Called with the progress after every cell.

    Raises `InputError` if `out` cannot be written to, an id occurs twice or your executor breaks.
    """
    root, chosen = located(out), {"seeds": 0, **(settings or {})}
    state = Progress()
    made = (cell if isinstance(cell, FleetCell) else fleet_cell_from_row(cell) for cell in cells)
    # Cells of a lazy iterable are not examined before their turn.
    is_whole = isinstance(cells, Sequence)
    every = [*made] if is_whole else []

    def wanted(done: Mapping[str, tuple[str, bool]]) -> Iterator[tuple[str, FleetCell]]:
        """The cells that have no row for these inputs and settings yet; the others are counted."""
        nonlocal state
        for cell in distinct(every or made):
            if not in_shard(cell, shard):
                continue
            fingerprint = cell.fingerprint(chosen)
            finished, has_failed = done.get(cell.id, ("", False))
            if finished == fingerprint and not (has_failed and retry):
                state = replace(state, skipped=state.skipped + 1)
            else:
                yield fingerprint, cell

    with writing(root, shard) as folder:
        # Rows of earlier parts are not computed again, and some of them failed or were replaced
        # since.
        compact(root, shard)
        queue = wanted(finished(root))
        few = list(queue) if is_whole else list(itertools.islice(queue, 1))
        if is_whole:
            state = replace(state, total=len(few) + state.skipped)
        if few:
            from .rows import grid_of, job_of  # loads JAX

            # Checked here, or all cells would fail.
            _ = job_of(chosen)
            for _, cell in few:
                _ = grid_of(cell, chosen)
            report(state)
            queue = itertools.chain(few, queue)
            with _opened(scheduler, executor, workers or os.cpu_count() or 1) as (reopen, count):
                # For few cells, four parts per worker.
                in_part = -(-len(few) // (4 * count)) if is_whole else MAX_IN_PART
                size = batch or min(in_part, MAX_IN_PART)
                how = {**chosen, "loggers": loggers_of_fleet(every, chosen)}
                rows: Rows = []
                try:
                    for completed in _run(queue, reopen, (how, str(root.absolute())), count):
                        rows += itertools.chain(*completed)
                        if len(rows) >= size:
                            write_part(folder, rows)
                            rows = []
                        for each, *_ in completed:
                            failed = state.failed + (each["error"] is not None)
                            state = replace(state, finished=state.finished + 1, failed=failed)
                            report(state)
                finally:
                    write_part(folder, rows)
        compact(root, shard)
    return replace(state, total=state.finished + state.skipped)


def run_cell(fingerprint: str, cell: FleetCell, settings: Options, out: str) -> Rows:
    """The rows of a cell with its fingerprint; its files are kept below the folder `out`."""
    prepare_process()
    from .rows import identify_rows

    rows = identify_rows(cell, settings, located(out))
    return [row | {"fingerprint": fingerprint} for row in rows]


@functools.cache
def prepare_process() -> None:
    """Set a process up for many cells, before JAX is loaded if it is not yet."""
    # As in `barnax` itself: modules and traced programs are many objects and no garbage.
    gc.set_threshold(50_000, 20, 20)
    set_malloc(ONE_POOL | KEEP_FREED)
    prefer_cpu()
    if "jax" not in sys.modules:
        # Once: a process inherits them, and a different text is a different key in the cache.
        flags = os.environ.get("XLA_FLAGS", "").replace(XLA_FLAGS, "")
        os.environ["XLA_FLAGS"] = f"{flags.strip()} {XLA_FLAGS}".strip()
        os.environ.update(XLA_THREADS)
        keep_compiled()


def start_worker(driver: int) -> None:
    """Start a worker of a pool: it ends with its driver, and leaves Ctrl-C to it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == driver:
            time.sleep(WATCH_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    prepare_process()


def _run(
    cells: Iterator[Marked], reopen: Callable[[], Executor], how: tuple[Options, str], workers: int
) -> Iterator[list[Rows]]:
    """The rows of every cell, in batches that have completed together."""
    executor = reopen()
    waiting: dict[Future[Rows], Marked] = {}
    suspects: list[Marked] = []
    while True:
        for marked in itertools.islice(cells, WAITING * (workers + 1) - len(waiting)):
            waiting[_submit(executor, run_cell, *marked, *how)] = marked
        if not waiting:
            break
        done = wait(waiting, return_when=FIRST_COMPLETED).done
        if any(isinstance(future.exception(), BrokenExecutor) for future in done):
            # The others fail as well, but not at once.
            done = wait(waiting).done
        lost = [waiting[future] for future in done if _has_died(future)]
        waiting = {future: marked for future, marked in waiting.items() if future not in done}
        yield [future.result() for future in done if not _has_died(future)]
        if lost:
            suspects += lost
            executor = _reopened(reopen)
    for fingerprint, cell in suspects:
        future = _submit(executor, run_cell, fingerprint, cell, *how)
        if not _has_died(future):
            yield [future.result()]
            continue
        executor = _reopened(reopen)
        row = {"id": cell.id, "error": DIED, "error code": None, **cell.carried}
        yield [[row | {"fingerprint": fingerprint}]]


def _submit(executor: Executor, function: Callable[..., Any], *given: Any) -> "Future[Any]":
    """A submitted task; with an executor that is already broken, it fails like those before it."""
    try:
        # A pool starts its processes here.
        with undisturbed():
            return executor.submit(function, *given)
    except BrokenExecutor as problem:
        failed: Future[Any] = Future()
        failed.set_exception(problem)
        return failed


def _has_died(future: "Future[Any]") -> bool:
    """True if a task was given up because its worker died; waits for its end."""
    error = future.exception()
    return isinstance(error, BrokenExecutor) or type(error).__name__ in WORKER_DIED


def _reopened(reopen: Callable[[], Executor]) -> Executor:
    """Another executor to replace one that may be broken, with at least one running worker."""
    for _ in range(FEW):
        executor = reopen()
        if not _has_died(_submit(executor, prepare_process)):
            return executor
    raise BrokenExecutor(
        "workers die before they begin; in a script, call this from under "
        "`if __name__ == '__main__':`"
    )


@contextmanager
def _opened(
    scheduler: str | None, executor: Executor | None, workers: int
) -> Iterator[tuple[Callable[[], Executor], int]]:
    """A function that returns the executor, or a new one if that is broken; and its number of
    workers."""
    if executor is not None:
        try:
            yield (lambda: executor), workers
        except BrokenExecutor as problem:
            raise InputError(
                "the executor is broken, because a worker of it died; call this again with a new "
                "one, or without, where workers that die are replaced"
            ) from problem
    elif scheduler is not None:
        with _dask(scheduler, workers) as (given, each):
            yield (lambda: given), each
    else:
        # Never forked: JAX and Polars have threads.
        spawning = multiprocessing.get_context("spawn")
        others = set(multiprocessing.active_children())
        pools: list[ProcessPoolExecutor] = []

        def reopen() -> Executor:
            for pool in pools:
                pool.shutdown(wait=False, cancel_futures=True)
            pools[:] = [ProcessPoolExecutor(workers, spawning, start_worker, (os.getpid(),))]
            return pools[0]

        try:
            yield reopen, workers
        except BaseException:
            # Their cells would run on for minutes; whatever is written is whole.
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
            raise
        finally:
            for pool in pools:
                pool.shutdown(cancel_futures=True)


@contextmanager
def _dask(address: str, workers: int) -> Iterator[tuple[Executor, int]]:
    """Dask's own executor, on a running scheduler or on a cluster of this machine's processes, and
    the current number of worker threads."""
    try:
        import dask.config
        from distributed import Client, LocalCluster
    except ImportError as problem:
        raise InputError(
            f"`scheduler` needs Dask; install it with {installing('dask')}"
        ) from problem
    with ExitStack() as stack:
        where: Any = address
        if address == "local":
            stack.enter_context(dask.config.set(QUIET_DASK))
            where = stack.enter_context(
                LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0")
            )
        try:
            client: Any = stack.enter_context(Client(where))
        except (OSError, ValueError) as problem:
            raise InputError(
                f"`scheduler` {address!r}: cannot be reached ({problem}); give the address that "
                "`dask scheduler` printed, or 'local'"
            ) from problem
        try:
            yield client.get_executor(pure=False), max(1, sum(client.nthreads().values()))
        except CancelledError as problem:
            raise InputError(
                f"`scheduler` {address!r} stopped; start it again, and the same command continues "
                "where it stopped"
            ) from problem


def loggers_of_fleet(cells: Sequence[FleetCell], settings: Options) -> Loggers:
    """The loggers by the columns in their files, independent of the cell and worker.

    Files of a kind have one suffix and the same reading options.
    """
    from .rows import job_of, sources_of

    reading_names = vars(Reading())
    kinds: dict[tuple[str, str], list[FleetCell]] = {}
    for cell in sorted(cells, key=lambda cell: cell.id):
        if cell.records and not cell.missing and not is_factor_file(cell.records[0]):
            suffix = PurePath(cell.records[0]).suffix.lower()
            how_to_read = sorted(item for item in cell.options.items() if item[0] in reading_names)
            kinds.setdefault((suffix, repr(how_to_read)), []).append(cell)
    records = []
    for alike in kinds.values():
        count = min(SAMPLED, len(alike))
        for cell in [alike[index * len(alike) // count] for index in range(count)]:
            # A file that cannot be read is reported in its own row.
            with suppress(InputError, OSError):
                reading = job_of({**settings, **cell.options})
                (source,) = sources_of(cell.records[:1], reading, {})
                records.append(read_record(source, **reading.of_record(source.name)))
    return loggers_of(records)
