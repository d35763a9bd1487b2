"""Traced programs kept on disk: what one process has traced no later one needs to.

Tracing and lowering a search takes longer than running it. Beside the programs that JAX keeps in
its compilation cache, their traces are kept too, in a folder `barnax-traces` of it, as
`jax.export` writes them. A trace is found by all that it depends on: the function, everything
about its arguments but the numbers in their arrays, this package's sources, the versions of what
they are built on, and JAX's settings. What cannot be described so, such as an optimizer of the
user's own, is traced every time.
"""

import dataclasses
import enum
import hashlib
import importlib.metadata
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from types import FunctionType
from typing import Any

import equinox as eqx
import jax
import jax.export
import numpy as np

FOLDER = "barnax-traces"
SUFFIX = ".trace"
# Of these the code is known: ours by its text, the others' by their version.
KNOWN = ("barnax", "equinox", "jax", "jaxlib", "lineax", "numpy", "optimistix")
# Settings that say where and how much is stored do not change a program.
UNRELATED = ("cache", "dump", "log")
DIGEST_BYTES = 32


class NotDescribedError(Exception):
    """Something whose code or content is not known well enough to be found again."""


def traced(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Callable[..., Any]:
    """`function` of the arrays in `arguments`, for `jax.jit`; the rest stays as it is.

    With JAX's compilation cache switched on it comes from disk, or is put there.
    """
    plain = partial(_of_arrays, function, *_taken_apart(arguments))
    settings: Any = jax.config
    folder = settings.jax_compilation_cache_dir
    if folder is None or not settings.jax_enable_compilation_cache:
        return plain
    try:
        name = _digest(_description(function, arguments))
    except NotDescribedError:
        return plain
    path = Path(folder, FOLDER, name.hex() + SUFFIX)
    exported = _read(path)
    if exported is None:
        try:
            exported = jax.export.export(jax.jit(plain))(*arrays_in(arguments))
            trace = bytes(exported.serialize())
        except (ValueError, NotImplementedError):
            # Not everything that runs may be kept: on some devices, routines of their own may not.
            return plain
        with suppress(OSError):
            _write(path, trace)
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


def _read(path: Path) -> jax.export.Exported | None:
    """A trace that was written whole, None without one."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    digest, trace = content[:DIGEST_BYTES], content[DIGEST_BYTES:]
    if _digest([trace]) != digest:
        return None
    return jax.export.deserialize(bytearray(trace))


def _write(path: Path, trace: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    # Another process may write the same; a reader must find one of them whole.
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        part = Path(folder, path.name)
        part.write_bytes(_digest([trace]) + trace)
        part.replace(path)


def _digest(parts: Iterable[bytes]) -> bytes:
    digest = hashlib.blake2b(digest_size=DIGEST_BYTES)
    for part in parts:
        digest.update(len(part).to_bytes(8, "big") + part)
    return digest.digest()


def _description(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Iterator[bytes]:
    yield _code()
    yield jax.default_backend().encode()
    yield repr(_settings()).encode()
    for part in _parts((function, *arguments)):
        yield part.encode()


def _settings() -> list[tuple[str, Any]]:
    """What JAX is told, by this process and by this thread."""
    return [
        (name, getattr(jax.config, name, value))
        for name, value in sorted(jax.config.values.items())
        if not any(word in name for word in UNRELATED)
    ]


@cache
def _code() -> bytes:
    """What the code of `KNOWN` is, as one digest."""
    here = Path(__file__).parent
    ours = [path.read_bytes() for path in sorted(here.rglob("*.py"))]
    versions = [f"{name} {importlib.metadata.version(name)}".encode() for name in KNOWN]
    return _digest([*ours, *versions])


def _parts(value: Any) -> Iterator[str]:
    """A value in words that no other has, but for the numbers in JAX's arrays."""
    if isinstance(value, jax.Array):
        kind = jax.typeof(value)
        yield f"array {kind} {getattr(kind, 'weak_type', False)}"
    elif isinstance(value, enum.Enum):
        yield f"{_known(type(value))}.{value.name}"
    elif value is None or isinstance(value, bool | int | float | complex | str | bytes | np.dtype):
        yield f"{type(value).__name__} {value!r}"
    elif isinstance(value, np.ndarray | np.generic):
        yield f"numbers {value.dtype} {value.shape} {_digest([value.tobytes()]).hex()}"
    elif isinstance(value, tuple | list | dict):
        yield f"{_known(type(value))} of {len(value)}"
        for part in value.items() if isinstance(value, dict) else value:
            yield from _parts(part)
    elif isinstance(value, FunctionType | type):
        yield _known(value)
    elif dataclasses.is_dataclass(value):
        yield _known(type(value))
        for field in dataclasses.fields(value):
            yield field.name
            yield from _parts(getattr(value, field.name, None))
    else:
        raise NotDescribedError(f"a {type(value).__name__}")


def _known(named: Any) -> str:
    """A function or class by its name, where that says what it does."""
    home, name = named.__module__, named.__qualname__
    if home.partition(".")[0] not in (*KNOWN, "builtins") or "<" in name:
        raise NotDescribedError(f"{home}.{name}")
    return f"{home}.{name}"
