"""One thread for NumPy's and SciPy's linear algebra, where Python's threads share the cores."""

import functools
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

# Loaded before threads are counted: a library loaded later would be missed.
import scipy.linalg  # noqa: F401
import threadpoolctl
from threadpoolctl import ThreadpoolController


class _Libraries(NamedTuple):
    """Libraries with one number of threads for the process, and those with one per Python
    thread."""

    per_process: ThreadpoolController
    per_thread: ThreadpoolController


# Restores the process's number, with one entry per thread inside `one_blas_thread`.
_INSIDE: list[Any] = []
_LOCK = threading.Lock()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """A context in which NumPy's and SciPy's linear algebra uses one thread.

    If the number belongs to the process, the last of several Python threads to leave restores it,
    so that none computes on more.
    """
    libraries = _libraries()
    with libraries.per_thread.limit(limits=1):
        with _LOCK:
            if not _INSIDE:
                _take_control()
            _INSIDE.append(_INSIDE[0] if _INSIDE else libraries.per_process.limit(limits=1))
        try:
            yield
        finally:
            with _LOCK:
                limiter = _INSIDE.pop()
                if not _INSIDE:
                    _take_control()
                    limiter.restore_original_limits()
                    _take_control()


@functools.cache
def _libraries() -> _Libraries:
    # Searching for them takes longer than a small problem's algebra.
    every = ThreadpoolController().select(user_api="blas")
    paths: dict[bool, list[str]] = {True: [], False: []}
    for one in every.info():
        is_per_thread = (one["internal_api"], one.get("threading_layer")) == ("openblas", "openmp")
        paths[is_per_thread].append(one["filepath"])
    return _Libraries(every.select(filepath=paths[False]), every.select(filepath=paths[True]))


def _take_control() -> None:
    """Allow this thread, and any later one, to set OpenBLAS's number of threads.

    Newer versions of threadpoolctl silently ignore all threads except the first that did.
    """
    controller: Any = getattr(threadpoolctl, "OpenBLASController", None)
    if hasattr(controller, "clear_controlling_thread"):
        controller.clear_controlling_thread(force=True)
