"""Where JAX computes for the command line and a fleet's processes."""

import os
import sys

VARIABLES = ("JAX_PLATFORMS", "JAX_PLATFORM_NAME")


def told() -> dict[str, str]:
    """The environment's words on where JAX computes; empty ones leave it to JAX."""
    return {name: os.environ[name] for name in VARIABLES if name in os.environ}


def prefer_cpu() -> None:
    """Have JAX compute on the CPU unless the environment says where, or JAX is loaded already.

    On a GPU an identification takes longer, for its populations are small and its proofs run on
    the CPU (benchmarks/results/devices.md), and
    each process of a fleet would claim most of its memory.
    """
    if not told() and "jax" not in sys.modules:
        os.environ["JAX_PLATFORMS"] = "cpu"
