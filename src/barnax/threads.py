"""Linear algebra on one thread: with several, its last bits would depend on how many."""

import functools
from contextlib import AbstractContextManager

# Loaded before threads are counted: what is loaded later would not be seen.
import numpy as np  # noqa: F401
import scipy.linalg  # noqa: F401
from threadpoolctl import ThreadpoolController


def one_blas_thread() -> AbstractContextManager:
    """A context in which NumPy's and SciPy's linear algebra uses one thread."""
    return _controller().limit(limits=1, user_api="blas")


@functools.cache
def _controller() -> ThreadpoolController:
    # Looking for the libraries takes longer than a small problem's algebra.
    return ThreadpoolController()
