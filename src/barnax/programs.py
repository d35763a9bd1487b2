"""Compiled programs, kept as executables from run to run.

Where JAX has a program compiled already it still traces and lowers it, which takes a fifth of the
time of `barnax identify`. So what XLA has made is kept in a file, whose name is a hash of all that
it was made from: barnax's own source, the versions beside it, the processor, the settings of JAX
and XLA, the function, the shapes of its arrays and every other value in full. What has no such name
is compiled anew in every process: functions of others, whose source may change, and local ones.

A file is whole or not there, and of one that is damaged nothing is loaded. To load one is to run
what is in it (JAX unpickles it), so it must have been written by this user: none is read, and none
written, unless its folder is the user's alone and so is the file.
"""

import functools
import hashlib
import importlib.metadata
import io
import math
import os
import pickle
import pickletools
import platform
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
from jax.experimental import serialize_executable

from . import LOADED_S
from .files import read_private, remove_oldest, write_private

# In the folder of JAX's own cache.
FOLDER = "barnax-programs"
# The programs of about eighty runs, three megabytes each.
MOST_BYTES = 256 * 2**20
# Packages whose functions are traced.
TRACED = ("jax", "jaxlib", "equinox", "lineax", "optimistix", "numpy")
# Where functions and classes lie whose source is in a program's name, or is Python's own.
NAMED = {"barnax", *TRACED, "builtins", "copyreg", "functools"}
# What says which machine code a processor runs, and which of it compilers choose.
PROCESSOR = ("vendor_id", "cpu family", "model", "stepping", "flags")
PROCESSOR += ("CPU implementer", "CPU architecture", "CPU variant", "CPU part", "Features")
# A file that was changed so long before the package was loaded is the one that was loaded: the file
# system's clock is a coarse one.
SETTLED_S = 2.0
DIGEST_BYTES = hashlib.sha256().digest_size


def path_of(function: Callable[..., Any], arguments: Sequence[Any]) -> Path | None:
    """The file of a function's program for arguments of these shapes and other values; None where
    none is kept: JAX's cache is off, JAX computes elsewhere than on one CPU, or what the program is
    made from is not known."""
    settings: Any = jax.config
    cache = settings.jax_compilation_cache_dir
    is_on = cache and settings.jax_enable_compilation_cache
    if not is_on or jax.default_backend() != "cpu" or jax.device_count() > 1:
        return None
    surroundings = _surroundings()
    if surroundings is None:
        return None
    parts = surroundings, _source(), _settings(), _request(function, arguments)
    if None in parts:
        return None
    # In full: these are texts, bytes and numbers.
    made_from = hashlib.sha256(repr(parts).encode()).hexdigest()
    return Path(cache) / FOLDER / f"{name_of(function)}-{made_from}"


def name_of(function: Callable[..., Any]) -> str:
    """What a function's programs are called."""
    return getattr(function, "__name__", "program")


def _request(function: Callable[..., Any], arguments: Sequence[Any]) -> bytes | None:
    """A function and its arguments, arrays by their shapes, in bytes that differ if they do.

    None where that is not possible, or where something is of a package that has no version here.
    """
    leaves, structure = jax.tree.flatten(arguments)
    is_array = [eqx.is_array(leaf) for leaf in leaves]
    leaves = [
        (leaf.shape, str(leaf.dtype), getattr(leaf, "weak_type", False)) if of else leaf
        for leaf, of in zip(leaves, is_array, strict=True)
    ]
    text = io.BytesIO()
    # Of this protocol, which names what it refers to in one piece.
    pickler = pickle.Pickler(text, protocol=3)
    # Equal values are equal bytes, whether or not they are one object.
    pickler.fast = True
    try:
        pickler.dump((function, is_array, jax.tree.unflatten(structure, leaves)))
    except (pickle.PicklingError, AttributeError, TypeError, ValueError):
        return None
    named = (
        str(argument).split()[0].split(".")[0]
        for code, argument, _ in pickletools.genops(text.getvalue())
        if code.name == "GLOBAL"
    )
    return text.getvalue() if NAMED.issuperset(named) else None


def _settings() -> tuple[Any, ...] | None:
    """The settings of JAX and XLA in this thread; None where XLA's are in a file of their own."""
    environment = {
        name: value
        for name, value in sorted(os.environ.items())
        if name.startswith(("XLA_", "TF_XLA_", "NPROC", "PJRT_"))
    }
    if environment.get("XLA_FLAGS", "-").lstrip()[:1] not in ("-", ""):
        return None
    settings = {
        name: getattr(jax.config, name, value)
        for name, value in sorted(jax.config.values.items())
        if name != "jax_compilation_cache_dir"
    }
    return environment, settings, len(os.sched_getaffinity(0))


def _source() -> bytes | None:
    """A hash of barnax's own source; None where that may not be what runs."""
    package = Path(__file__).parent
    return _hash_of(package) if is_unchanged(package, LOADED_S) else None


def is_unchanged(package: Path, loaded_s: float) -> bool:
    """True where no file of a package has changed since it was loaded at this time, in s."""
    changed_s = [path.stat().st_ctime for path in package.rglob("*.py")]
    return max(changed_s, default=math.inf) < loaded_s - SETTLED_S


@functools.cache
def _hash_of(package: Path) -> bytes:
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(package)} {len(content)} ".encode() + content)
    return digest.digest()


@functools.cache
def _surroundings() -> tuple[Any, ...] | None:
    """The processor, as Linux describes it, and the versions beside barnax; None elsewhere."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    processor = sorted({line for line in lines if line.partition("\t")[0] in PROCESSOR})
    versions = [importlib.metadata.version(name) for name in TRACED]
    return (processor, versions, platform.python_version()) if processor else None


def load(path: Path) -> Any | None:
    """The program in a file; None where there is none that this user has written whole."""
    content = read_private(path)
    if content is None:
        return None
    digest, content = content[:DIGEST_BYTES], content[DIGEST_BYTES:]
    if digest != hashlib.sha256(content).digest():
        return None
    _provide_lapack()
    try:
        return serialize_executable.deserialize_and_load(*pickle.loads(content))
    except Exception:
        # Whatever it is that JAX cannot load is compiled anew.
        return None


@functools.cache
def _provide_lapack() -> None:
    """Have JAX tell its programs where LAPACK is, as lowering does; without, they crash."""
    jax.jit(jax.lax.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), "float32"))


def keep(program: Any, path: Path) -> None:
    """Write a program into its file, where JAX can and there is room."""
    try:
        content = pickle.dumps(serialize_executable.serialize(program))
        write_private(path, hashlib.sha256(content).digest() + content)
    except Exception:
        # It has callbacks, or the disk is full: no reason to end what needs it.
        return
    remove_oldest(path.parent, MOST_BYTES)
