"""Traced programs kept on disk: what one process has traced no later one needs to.

Tracing and lowering takes longer than a compressed search, and a second or two of every start.
Beside the programs that JAX keeps in its compilation cache, their traces are kept too, in a folder
`barnax-traces` of it, as `jax.export` writes them. A trace is found by all that it depends on: the
function, everything about its arguments but the numbers in JAX's arrays, this package's sources,
the versions of what they are built on, and JAX's settings. What cannot be described so, such as an
optimizer of the user's own, is traced every time. Whoever may write in the cache may say what runs
here, as with the programs that JAX keeps there.
"""

import dataclasses
import enum
import hashlib
import importlib.metadata
import os
import struct
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from types import FunctionType
from typing import Any

import equinox as eqx
import flatbuffers  # noqa: F401  jax.export writes with it, and does not ask for it
import jax
import jax.export
import numpy as np

FOLDER = "barnax-traces"
SUFFIX = ".trace"
# Older than this, unread, they are of code or of records that nobody has any more.
KEPT_S = 90 * 24 * 3600.0
PACKAGE = Path(__file__).parent
# Of these the code is known by its version, and this package's by its text.
BUILT_ON = ("equinox", "jax", "jaxlib", "lineax", "numpy", "optimistix")
KNOWN = ("barnax", "builtins", *BUILT_ON)
# Settings about what is stored or told do not change a program.
UNRELATED = {"cache", "dump", "log", "logging"}
DIGEST_BYTES = 32
# Sources changed after this are not those that run here.
IMPORTED_S = time.time()


class NotDescribedError(Exception):
    """Something whose code or content is not known well enough to be found again."""


def traced(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Callable[..., Any]:
    """`function` of the arrays in `arguments`, for `jax.jit`; the rest stays as it is.

    With JAX's compilation cache switched on it comes from disk, or is put there.
    """
    plain = partial(_of_arrays, function, *_taken_apart(arguments))
    settings: Any = jax.config
    folder = settings.jax_compilation_cache_dir
    # JAX's may also be in a cloud.
    if not folder or "://" in folder or not settings.jax_enable_compilation_cache:
        return plain
    arrays = arrays_in(arguments)
    try:
        platform = _platform(arrays)
        name = _digest(_description(function, arguments)).hex()
    except NotDescribedError:
        return plain
    path = Path(folder, FOLDER, name + SUFFIX)
    exported = _read(path)
    if exported is None:
        try:
            trace = jax.export.export(jax.jit(plain), platforms=[platform])(*arrays).serialize()
        except (KeyError, NotImplementedError, ValueError):
            # Not everything that runs may be kept: on some devices, routines of their own may not.
            return plain
        with suppress(OSError):
            _write(path, bytes(trace))
        # As a later process will read it, so that this one runs the same.
        exported = jax.export.deserialize(trace)
    return exported.call


def arrays_in(arguments: tuple[Any, ...]) -> list[jax.Array]:
    """The arrays among the arguments, in the order in which a traced function takes them."""
    return [leaf for leaf in jax.tree.leaves(arguments) if eqx.is_array(leaf)]


def _taken_apart(arguments: tuple[Any, ...]) -> tuple[Any, list[Any]]:
    """The structure of the arguments, and their leaves with None for the arrays."""
    leaves, structure = jax.tree.flatten(arguments)
    return structure, [None if eqx.is_array(leaf) else leaf for leaf in leaves]


def _of_arrays(function: Callable[..., Any], structure: Any, others: list[Any], *arrays: Any):
    given = iter(arrays)
    leaves = [next(given) if leaf is None else leaf for leaf in others]
    return function(*jax.tree.unflatten(structure, leaves))


def _platform(arrays: Iterable[Any]) -> str:
    """Where the program will run: a trace is for one device, JAX's first choice."""
    settings: Any = jax.config
    first = jax.devices()[0]
    places = {
        place for array in arrays if isinstance(array, jax.Array) for place in array.devices()
    }
    if places - {first} or settings.jax_default_device is not None:
        raise NotDescribedError("arrays on other devices")
    return first.platform


def _read(path: Path) -> jax.export.Exported | None:
    """A trace that was written whole under this name, None without one."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    digest, trace = content[:DIGEST_BYTES], content[DIGEST_BYTES:]
    if _digest([path.name.encode(), trace]) != digest:
        return None
    with suppress(OSError):
        os.utime(path)
    try:
        return jax.export.deserialize(bytearray(trace))
    except (AttributeError, TypeError, ValueError, struct.error):
        return None


def _write(path: Path, trace: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    for old in path.parent.glob("*" + SUFFIX):
        if old.stat().st_mtime < time.time() - KEPT_S:
            old.unlink(missing_ok=True)
    # Another process may write the same; a reader must find one of them whole.
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        part = Path(folder, path.name)
        part.write_bytes(_digest([path.name.encode(), trace]) + trace)
        part.replace(path)


def _digest(parts: Iterable[bytes]) -> bytes:
    digest = hashlib.blake2b(digest_size=DIGEST_BYTES)
    for part in parts:
        digest.update(len(part).to_bytes(8, "big") + part)
    return digest.digest()


def _description(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Iterator[bytes]:
    yield _sources(PACKAGE, IMPORTED_S)
    yield _versions(BUILT_ON)
    yield jax.default_backend().encode()
    yield repr(_settings()).encode()
    for part in _parts((function, *arguments)):
        yield part.encode()


def _settings() -> list[tuple[str, Any]]:
    """What JAX is told, by this process and by this thread, and Equinox by the environment."""
    values = jax.config.values.items()
    told = [(name, value) for name, value in sorted(values) if not UNRELATED & {*name.split("_")}]
    return [*told, ("EQX_ON_ERROR", os.environ.get("EQX_ON_ERROR"))]


def _sources(package: Path, imported_s: float) -> bytes:
    """The text of a package as one digest, if it is still the one that was imported."""
    try:
        paths = sorted(package.rglob("*.py"))
        if not paths or max(path.stat().st_mtime for path in paths) > imported_s:
            raise NotDescribedError(f"{package} has changed")
        return _texts(tuple(paths))
    except OSError as problem:
        raise NotDescribedError(f"{package} cannot be read") from problem


@cache
def _texts(paths: tuple[Path, ...]) -> bytes:
    return _digest(part for path in paths for part in (str(path).encode(), path.read_bytes()))


@cache
def _versions(names: tuple[str, ...]) -> bytes:
    try:
        return _digest(f"{name} {importlib.metadata.version(name)}".encode() for name in names)
    except importlib.metadata.PackageNotFoundError as problem:
        raise NotDescribedError(f"{problem}") from problem


def _parts(value: Any) -> Iterator[str]:
    """A value in words that no other has, but for the numbers in JAX's arrays."""
    if value is None:
        yield "nothing"
    elif isinstance(value, jax.Array):
        kind = jax.typeof(value)
        yield f"array {kind} {getattr(kind, 'weak_type', False)}"
    elif isinstance(value, np.ndarray | np.generic):
        if value.dtype.hasobject:
            raise NotDescribedError("an array of objects")
        # These may be constants of the trace, so the numbers count.
        yield f"numbers {value.dtype} {value.shape} {_digest([value.tobytes()]).hex()}"
    elif isinstance(value, FunctionType | type):
        yield _known(value)
    elif isinstance(value, enum.Enum):
        yield f"{_known(type(value))}.{value.name}"
    elif isinstance(value, bool | int | float | complex | str | bytes | np.dtype):
        yield f"{_known(type(value))} {value!r}"
    elif isinstance(value, tuple | list | dict):
        yield f"{_known(type(value))} of {len(value)}"
        for part in value.items() if isinstance(value, dict) else value:
            yield from _parts(part)
    elif dataclasses.is_dataclass(value):
        yield _known(type(value))
        for field in dataclasses.fields(value):
            yield field.name
            yield from _parts(getattr(value, field.name, None))
    else:
        raise NotDescribedError(f"a {type(value).__name__}")


def _known(named: Any) -> str:
    """A function or class by its name, if that name leads to it and its code is known."""
    home, name = named.__module__, named.__qualname__
    found: Any = sys.modules.get(home)
    for part in name.split("."):
        found = getattr(found, part, None)
    # A wrapper bears the name of what it wraps, and does something else.
    if found is not named or home.partition(".")[0] not in KNOWN:
        raise NotDescribedError(f"{home}.{name}")
    return f"{home}.{name}"
