"""The device and memory settings of JAX for the command line and a fleet's processes."""

import ctypes
import os
import sys
from collections.abc import Mapping
from typing import Any

import platformdirs

# From glibc's malloc.h. Memory that one thread frees is reused by another, from one pool instead of
# eight per core.
ONE_POOL = {-8: 1}  # M_ARENA_MAX

VARIABLES = ("JAX_PLATFORMS", "JAX_PLATFORM_NAME")


def given_platforms() -> dict[str, str]:
    """Environment variables that select where JAX computes; empty ones leave the choice to JAX."""
    return {name: os.environ[name] for name in VARIABLES if name in os.environ}


def prefer_cpu() -> None:
    """Have JAX compute on the CPU unless the environment selects a device, or JAX is already
    loaded.

    On a GPU an identification takes longer, because its populations are small and its proofs run on
    the CPU (benchmarks/results/devices.md), and each process of a fleet would claim most of its
    memory.
    """
    if not given_platforms() and "jax" not in sys.modules:
        os.environ["JAX_PLATFORMS"] = "cpu"


def set_malloc(options: Mapping[int, int]) -> None:
    """Set options of glibc's `mallopt`, before any threads start; other systems have different
    options."""
    mallopt: Any = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    for option, value in options.items() if mallopt else ():
        mallopt(option, value)


def keep_compiled() -> None:
    """Have JAX keep compiled programs between runs in the user's cache folder, before it loads.

    `JAX_COMPILATION_CACHE_DIR` names another folder, `JAX_ENABLE_COMPILATION_CACHE=false` switches
    it off.
    """
    folder = platformdirs.user_cache_path("barnax") / "jax"
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(folder))
    # Includes some fifty small programs, which take longer to compile than to read.
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
