"""Where JAX computes for the command line and a fleet's processes, and what memory it keeps."""

import ctypes
import os
import sys
from collections.abc import Mapping
from typing import Any

import platformdirs

# glibc's malloc.h. What one thread frees another takes, of one pool of memory instead of eight a
# core.
ONE_POOL = {-8: 1}  # M_ARENA_MAX

VARIABLES = ("JAX_PLATFORMS", "JAX_PLATFORM_NAME")


def given_platforms() -> dict[str, str]:
    """The environment's words on where JAX computes; empty ones leave it to JAX."""
    return {name: os.environ[name] for name in VARIABLES if name in os.environ}


def prefer_cpu() -> None:
    """Have JAX compute on the CPU unless the environment says where, or JAX is loaded already.

    On a GPU an identification takes longer, for its populations are small and its proofs run on
    the CPU (benchmarks/results/devices.md), and
    each process of a fleet would claim most of its memory.
    """
    if not given_platforms() and "jax" not in sys.modules:
        os.environ["JAX_PLATFORMS"] = "cpu"


def set_malloc(options: Mapping[int, int]) -> None:
    """Set options of glibc's `mallopt`, before there are threads; other systems have their own."""
    mallopt: Any = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    for option, value in options.items() if mallopt else ():
        mallopt(option, value)


def keep_compiled() -> None:
    """Have JAX keep compiled programs from run to run in the user's cache folder, before it loads.

    `JAX_COMPILATION_CACHE_DIR` names another folder, `JAX_ENABLE_COMPILATION_CACHE=false` switches
    it off.
    """
    folder = platformdirs.user_cache_path("barnax") / "jax"
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(folder))
    # Some fifty small ones are made too, and compiling them takes longer than reading them.
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
