"""Compiled programs of a command, kept as executables from run to run.

Where JAX has a program compiled already it still traces and lowers it, a fifth of the time of
`barnax identify`. So what XLA has made is kept in a file, whose name is a hash of all that it was
made from: the source, versions, the processor, settings, the function, the shapes of its arrays
and all other values. That is known only in a process that barnax's command began, in which nothing
else has run. Any other has JAX's own cache alone, and so has one whose folder others can write to.

To load a program is to run what is in its file, so that must be this user's. The folder is opened
once and all goes through it: no link is followed, whatever is exchanged meanwhile.
"""

import functools
import hashlib
import math
import os
import pickle
import re
import stat
import sys
import uuid
from collections.abc import Callable, Sequence
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jaxlib
import numpy as np
from jax.experimental import serialize_executable
from jaxlib import lapack

from . import devices

# In the folder of JAX's own cache.
FOLDER = "barnax-programs"
# The programs of about eighty runs, three megabytes each.
MOST_BYTES = 256 * 2**20
# Of a program, or of one that is being written.
NAME = re.compile(r"[0-9a-f]{32,64}\.program")
# What says which machine code a processor runs, and which of it compilers choose.
PROCESSOR = re.compile(
    r"^(?:vendor_id|cpu family|model|stepping|flags|CPU \w+|Features)\s*:.*", re.M
)
# What else decides how XLA compiles.
FLAGS = "XLA_", "TF_XLA_", "PJRT_", "NPROC"
LEAST_S = "jax_persistent_cache_min_compile_time_secs"
DIGEST_BYTES = hashlib.sha256().digest_size
SETTINGS: Any = jax.config


def kept(
    function: Callable[..., Any], arguments: Sequence[Any], compile_as: Callable[[str], Any]
) -> Any:
    """A function's program for arguments of these shapes and other values, kept or compiled; what
    `compile_as` is given ends the name that JAX knows it by."""
    name = _name_of(function, arguments)
    content = _read(name) if name else b""
    program = _loaded(content) if content else None
    # Empty is the file of what JAX cannot write, so that its own cache has it.
    if name and content != b"" and program is None:
        # What JAX reads from its own cache it cannot write, so that must not know this one. What
        # else this process compiles, it keeps the next time.
        SETTINGS.update(LEAST_S, math.inf)
        program = compile_as(f"_{name[:8]}")
        _keep(program, name)
    return compile_as("") if program is None else program


def _name_of(function: Callable[..., Any], arguments: Sequence[Any]) -> str | None:
    """The name of a program's file; None where none is kept."""
    is_on = SETTINGS.jax_enable_compilation_cache and SETTINGS.jax_compilation_cache_dir
    # Flags can be in a file, too.
    has_flags = any(name.startswith(FLAGS) for name in os.environ)
    if not is_on or has_flags or devices.source is None or jax.default_backend() != "cpu":
        return None
    request, processor = _request(function, arguments), _processor()
    if not request or not processor or _folder() is None:
        return None
    own = [
        (name, getattr(SETTINGS, name, value))
        for name, value in sorted(SETTINGS.values.items())
        # Those of JAX's own cache change while it runs.
        if not name.startswith("jax_persistent_cache")
    ]
    versions = sys.version, str(sys.flags), jax.__version__, jaxlib.__version__
    cores = len(os.sched_getaffinity(0))
    # In full: these are texts, bytes and numbers.
    made_from = devices.source, versions, processor, cores, own, request
    return hashlib.sha256(repr(made_from).encode()).hexdigest() + ".program"


def _request(function: Callable[..., Any], arguments: Sequence[Any]) -> bytes | None:
    """A function and its arguments, arrays by their shapes, in bytes that differ if they do; None
    where that is not possible, as for a function within another."""

    def described(leaf: Any) -> tuple[Any, ...]:
        if not eqx.is_array(leaf):
            return "value", leaf
        return leaf.shape, str(leaf.dtype), getattr(leaf, "weak_type", False)

    text = BytesIO()
    pickler = pickle.Pickler(text)
    # Equal values are equal bytes, whether or not they are one object.
    pickler.fast = True
    try:
        pickler.dump((function, jax.tree.map(described, arguments)))
    except (pickle.PicklingError, AttributeError, TypeError, ValueError):
        return None
    return text.getvalue()


@functools.cache
def _processor() -> list[str]:
    """The processor, as Linux describes it."""
    return sorted(set(PROCESSOR.findall(Path("/proc/cpuinfo").read_text(encoding="utf-8"))))


@functools.cache
def _folder() -> int | None:
    """The folder of this process's programs, open; None where it is not this user's alone."""
    cache = SETTINGS.jax_compilation_cache_dir
    with suppress(OSError):
        # An address is left to JAX.
        if "://" not in cache:
            folder = Path(cache) / FOLDER
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            if _is_private(opened) and os.access(".", os.W_OK, dir_fd=opened, effective_ids=True):
                return opened
    return None


def _is_private(opened: int) -> bool:
    """True for what belongs to this user and has no right to write for others."""
    status = os.fstat(opened)
    return status.st_uid == os.geteuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _open(name: str, flags: int) -> int:
    """A file of the folder: no link, and nothing that waits for a writer."""
    return os.open(name, flags | os.O_NOFOLLOW | os.O_NONBLOCK, 0o600, dir_fd=_folder())


def _read(name: str) -> bytes | None:
    """The content of a file; None where there is none that this user has written whole."""
    with suppress(OSError), open(name, "rb", opener=_open) as file:
        if _is_private(file.fileno()):
            # What is used stays longest.
            os.utime(file.fileno())
            digest, content = file.read(DIGEST_BYTES), file.read()
            return content if digest == hashlib.sha256(content).digest() else None
    return None


def _loaded(content: bytes) -> Any | None:
    try:
        # As lowering does: a program that calls LAPACK crashes without.
        lapack.prepare_lapack_call("potrf", np.float64)
        return serialize_executable.deserialize_and_load(*pickle.loads(content))
    except Exception:
        # Whatever it is that JAX cannot load is compiled anew.
        return None


def _keep(program: Any, name: str) -> None:
    """Write a program into its file, unless the source was edited meanwhile or the disk is full."""
    if devices.hash_source() != devices.source:
        return
    try:
        content = pickle.dumps(serialize_executable.serialize(program))
        # Some modules are not themselves again.
        content *= pickle.loads(content)[2] == program.out_tree
    except Exception:
        # It has callbacks, or constants that JAX does not write.
        content = b""
    written, folder = f"{uuid.uuid4().hex}.program", _folder()
    with suppress(OSError):
        with open(written, "xb", opener=_open) as file:
            file.write(hashlib.sha256(content).digest() + content)
        os.replace(written, name, src_dir_fd=folder, dst_dir_fd=folder)
        _remove_oldest()
    with suppress(OSError):
        # Of a disk that is full.
        os.unlink(written, dir_fd=folder)


def _remove_oldest() -> None:
    """Delete the programs that were not used for longest, where all are too large."""
    folder, total = _folder(), 0
    with os.scandir(folder) as entries:
        files = [own for own in entries if own.is_file(follow_symlinks=False)]
        ages = [(own.stat().st_mtime, own.stat().st_size, own.name) for own in files]
    for _, size, name in sorted(ages, reverse=True):
        if NAME.fullmatch(name):
            total += size
            if total > MOST_BYTES:
                os.unlink(name, dir_fd=folder)
