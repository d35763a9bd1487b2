"""One thread for NumPy's and SciPy's linear algebra, where Python's threads share the cores."""

import functools
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

# Loaded before threads are counted: what is loaded later would not be seen.
import scipy.linalg  # noqa: F401
import threadpoolctl
from threadpoolctl import ThreadpoolController


class _Libraries(NamedTuple):
    """One number of threads for the process, or one for every thread of Python."""

    shared: ThreadpoolController
    own: ThreadpoolController


class _Guard:
    """A count of those inside `one_blas_thread`, and what the last of them restores."""

    def __init__(self):
        self.lock = threading.Lock()
        self.inside = 0
        self.limiter: Any = None


_GUARD = _Guard()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """A context in which NumPy's and SciPy's linear algebra uses one thread.

    Where the number is the process's, the last to leave of several threads of Python restores it,
    so that none computes on more.
    """
    libraries = _libraries()
    with libraries.own.limit(limits=1):
        with _GUARD.lock:
            if not _GUARD.inside:
                _take_control()
                _GUARD.limiter = libraries.shared.limit(limits=1)
            _GUARD.inside += 1
        try:
            yield
        finally:
            with _GUARD.lock:
                _GUARD.inside -= 1
                if not _GUARD.inside:
                    _take_control()
                    _GUARD.limiter.restore_original_limits()
                    _take_control()


@functools.cache
def _libraries() -> _Libraries:
    # Looking for them takes longer than a small problem's algebra.
    every = ThreadpoolController().select(user_api="blas")
    paths: dict[bool, list[str]] = {True: [], False: []}
    for one in every.info():
        is_own = (one["internal_api"], one.get("threading_layer")) == ("openblas", "openmp")
        paths[is_own].append(one["filepath"])
    return _Libraries(every.select(filepath=paths[False]), every.select(filepath=paths[True]))


def _take_control() -> None:
    """Let this thread set OpenBLAS's number of threads, and the next one that wants to.

    Newer versions of threadpoolctl silently ignore all threads but the first that did.
    """
    controller: Any = getattr(threadpoolctl, "OpenBLASController", None)
    if hasattr(controller, "clear_controlling_thread"):
        controller.clear_controlling_thread(force=True)
