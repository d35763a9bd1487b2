"""Where JAX computes for the command line and a fleet's processes, and what it keeps compiled."""

import hashlib
import os
import sys
from importlib import metadata, util
from pathlib import Path

import platformdirs

VARIABLES = ("JAX_PLATFORMS", "JAX_PLATFORM_NAME")
# Packages whose functions are traced, and Python's debugger, in which they can be changed.
TRACED = ("equinox", "jax", "jaxlib", "lineax", "numpy", "optimistix")
CHANGING = {*TRACED, "bdb"}
# What a process has of barnax when its command begins.
BEGUN = {f"barnax.{name}" for name in ("__main__", "devices", "display")}

# The source that this process runs; None where it is not known what runs.
source: str | None = None


def begin_command() -> None:
    """Know the source that runs, in a process where nothing was loaded that could have changed."""
    global source
    loaded = {name for name in sys.modules if name.startswith("barnax.")}
    if loaded <= BEGUN and not CHANGING & sys.modules.keys() and sys.platform == "linux":
        source = hash_source()


def hash_source() -> str:
    """A hash of the source on the disk: barnax's own, and place and version of what it traces."""
    digest, package = hashlib.sha256(), Path(__file__).parent
    for path in sorted(package.rglob("*.py")):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(package)} {len(content)} ".encode() + content)
    for name in TRACED:
        spec = util.find_spec(name)
        digest.update(f"{spec and spec.origin} {metadata.version(name)} ".encode())
    return digest.hexdigest()


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


def keep_compiled() -> None:
    """Have JAX keep compiled programs from run to run in the user's cache folder, before it loads.

    `JAX_COMPILATION_CACHE_DIR` names another folder, `JAX_ENABLE_COMPILATION_CACHE=false` switches
    it off.
    """
    folder = platformdirs.user_cache_path("barnax") / "jax"
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(folder))
    # Some fifty small ones are made too, and compiling them takes longer than reading them.
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
