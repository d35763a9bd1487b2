"""Where JAX computes for the command line and a fleet's processes."""

import os
import sys

SETTINGS = ("JAX_PLATFORMS", "JAX_PLATFORM_NAME")


def asked() -> dict[str, str]:
    """The environment's words on where JAX computes."""
    return {name: os.environ[name] for name in SETTINGS if os.environ.get(name)}


def prefer_cpu() -> None:
    """Have JAX compute on the CPU unless the environment says where, or JAX is loaded already.

    A GPU takes 50 times as long for a population of 30 and gains only from thousands on
    (`benchmarks.devices`), and each process of a fleet would claim most of its memory.
    """
    if not asked() and "jax" not in sys.modules:
        os.environ["JAX_PLATFORMS"] = "cpu"
