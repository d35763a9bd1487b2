"""Compiled programs of a command, kept as executables between runs, and templates beside them.

JAX's own cache saves a warm run from compiling, but not from tracing and lowering, a fifth of the
time of `barnax identify`. So XLA's output is kept in a file, whose name is a hash of all its
inputs: the source, versions, the processor, settings, the function, the shapes of its arrays and
all other values. These can be stated only in a process that barnax's command began, in which
nothing else has run; any other uses JAX's own cache alone.

To load a program is to run the content of its file, so files and folder must belong to this user,
and be writable by nobody else.
"""

import functools
import hashlib
import os
import pickle
import re
import stat
import sys
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import util
from io import BytesIO
from pathlib import Path
from typing import Any

# In the folder of JAX's own cache.
FOLDER = "barnax-programs"
# The programs of about eighty runs.
MOST_BYTES = 256 * 2**20
# Packages whose functions are traced, and that of templates.
TRACED = (
    "equinox", "jax", "jaxlib", "jinja2", "lineax", "ml_dtypes", "numpy", "opt_einsum",
    "optimistix"
)  # fmt: skip
# Modules of barnax that a process has loaded when its command begins.
BEGUN = {f"barnax.{name}" for name in ("__main__", "devices", "display", "programs")}
# Variables that change the traced program; and those that change XLA's compilation, some through
# files: with one of these nothing is kept.
VARIABLES, FLAGS = ("EQX_", "JAX_"), ("XLA_", "TF_XLA_", "PJRT_", "NPROC")
# Fields that determine which machine code a processor runs, and which of it compilers choose.
PROCESSOR = re.compile(
    r"^(?:vendor_id|cpu family|model|stepping|flags|CPU \w+|Features)\s*:.*", re.M
)
# Values with which JAX's variables switch something off.
OFF = ("0", "f", "false", "n", "no", "off")
DIGEST_BYTES = hashlib.sha256().digest_size

_source: str | None = None


@contextmanager
def of_command() -> Iterator[None]:
    """Keep programs in this context: in a process started by the command, in which nothing loaded
    can have changed since."""
    global _source
    loaded = {name for name in sys.modules if name.startswith("barnax.")}
    is_new = loaded <= BEGUN and not sys.modules.keys() & {*TRACED} and sys.gettrace() is None
    with suppress(OSError):
        _source = _hash_source() if is_new and sys.platform == "linux" else None
    try:
        yield
    finally:
        _source = None


def _hash_source() -> str:
    """A hash of barnax's source on the disk, and of the files of traced packages by their sizes and
    times."""
    digest, package = hashlib.sha256(), Path(__file__).parent
    for path in sorted(package.rglob("*.py*")):
        if path.parent.name != "__pycache__":
            content = path.read_bytes()
            digest.update(f"{path.relative_to(package)} {len(content)} ".encode() + content)
    for name in TRACED:
        spec = util.find_spec(name)
        for folder in (spec and spec.submodule_search_locations) or ():
            digest.update(repr(sorted(_files_of(folder))).encode())
    return digest.hexdigest()


def _files_of(folder: str) -> Iterator[tuple[str, int, int]]:
    """Every file of Python or machine code below a folder, its size and its time of change."""
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir():
                if entry.name not in ("__pycache__", "tests"):
                    yield from _files_of(entry.path)
            elif entry.name.endswith((".py", ".pyc", ".so")):
                yield entry.path, entry.stat().st_size, entry.stat().st_mtime_ns


def kept(
    function: Callable[..., Any], arguments: Sequence[Any], compile_as: Callable[[str], Any]
) -> Any:
    """A function's program for arguments of these shapes and other values, kept or compiled; the
    argument of `compile_as` is a suffix of the name under which JAX knows it."""
    path, program = None, None
    # With a JAX that has other settings nothing is kept.
    with suppress(AttributeError, OSError):
        path = _path_of(function, arguments)
    content = b"" if path is None else read(path)
    if content:
        program = _loaded(content)
    elif content is None and path is not None:
        # A program that JAX read from its own cache would be written incompletely, so it must not
        # find this one there.
        ending = uuid.uuid4().hex
        program = compile_as(ending)
        write(path, _content_of(program))
        for other in path.parents[1].glob(f"*{ending}*"):
            with suppress(OSError):
                other.unlink()
    if program is None:
        # A program that cannot be kept has an empty file, and is in JAX's own cache.
        program = compile_as("")
        if content and path is not None:
            write(path, b"")
    return program


def _path_of(function: Callable[..., Any], arguments: Sequence[Any]) -> Path | None:
    """A program's file; None if programs are not kept."""
    import jax
    import jaxlib

    settings: Any = jax.config
    cache = settings.jax_compilation_cache_dir if settings.jax_enable_compilation_cache else None
    folder, has_flags = _folder_in(cache), any(name.startswith(FLAGS) for name in os.environ)
    if folder is None or has_flags:
        return None
    request = _request(function, arguments)
    # A program is loaded for all devices.
    is_alone = jax.default_backend() == "cpu" and jax.device_count() == 1
    if request is None or not is_alone:
        return None
    variables = sorted(pair for pair in os.environ.items() if pair[0].startswith(VARIABLES))
    in_thread = [
        (name, getattr(settings, name, value))
        for name, value in sorted(settings.values.items())
        # The options of JAX's own cache change while it runs.
        if not name.startswith("jax_persistent_cache")
    ]
    versions = sys.version, str(sys.flags), jax.__version__, jaxlib.__version__
    cores = len(os.sched_getaffinity(0))
    # In full: these are texts, bytes and numbers.
    made_from = _source, versions, _processor(), cores, variables, in_thread, request
    return _file_in(folder, made_from)


def template_file(key: str) -> Path | None:
    """The file of a template's bytecode; None if templates are not kept."""
    is_off = os.environ.get("JAX_ENABLE_COMPILATION_CACHE", "1").lower() in OFF
    folder = _folder_in(None if is_off else os.environ.get("JAX_COMPILATION_CACHE_DIR"))
    return folder and _file_in(folder, (_source, sys.version, key))


def _folder_in(cache: str | None) -> Path | None:
    """The folder of programs in JAX's cache; None if none are kept, as at an address."""
    if _source is None or not cache or "://" in cache:
        return None
    folder = Path(cache) / FOLDER
    return folder if _is_ready(folder) else None


def _file_in(folder: Path, made_from: tuple[Any, ...]) -> Path:
    return folder / f"{hashlib.sha256(repr(made_from).encode()).hexdigest()}.program"


def _request(function: Callable[..., Any], arguments: Sequence[Any]) -> bytes | None:
    """A function and its arguments, arrays by their shapes, in bytes that differ if they do; None
    if that is not possible, as for a nested function."""
    import equinox as eqx
    import jax

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
def _is_ready(folder: Path) -> bool:
    """True for a folder to which programs can be written, if the processor is described."""
    with suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        is_ours = _is_private(folder.lstat()) and not folder.is_symlink()
        return is_ours and os.access(folder, os.W_OK) and bool(_processor())
    return False


def _is_private(status: os.stat_result) -> bool:
    """True if it belongs to this user and is not writable by others."""
    return status.st_uid == os.geteuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def read(path: Path) -> bytes | None:
    """The content of a file; None if there is none that this user has written whole."""

    def opened(name: str, flags: int) -> int:
        return os.open(name, flags | os.O_NOFOLLOW | os.O_NONBLOCK)

    with suppress(OSError), open(path, "rb", opener=opened) as file:
        if _is_private(os.fstat(file.fileno())):
            # Recently used programs stay longest.
            os.utime(file.fileno())
            digest, content = file.read(DIGEST_BYTES), file.read()
            return content if digest == _digest(path, content) else None
    return None


def _digest(path: Path, content: bytes) -> bytes:
    """The digest of a program and of its file's name, which stands for all its inputs."""
    return hashlib.sha256(path.name.encode() + content).digest()


def _loaded(content: bytes) -> Any:
    """The program in a file; None if JAX does not load it."""
    try:
        import numpy as np
        from jax.experimental import serialize_executable
        from jaxlib import lapack

        # As lowering does: without it a program that calls LAPACK crashes.
        lapack.prepare_lapack_call("potrf", np.float64)
        return serialize_executable.deserialize_and_load(*pickle.loads(content))
    except Exception:
        return None


def _content_of(program: Any) -> bytes:
    """The content of a program's file; empty if JAX cannot write it, such as one with callbacks, or
    if its values would not survive."""
    try:
        from jax.experimental import serialize_executable

        content = pickle.dumps(serialize_executable.serialize(program))
        return content if pickle.loads(content)[2] == program.out_tree else b""
    except Exception:
        return b""


def write(path: Path, content: bytes) -> None:
    """Write a program's file whole, unless the source was edited meanwhile or the disk is full."""
    written = path.with_name(uuid.uuid4().hex)
    with suppress(OSError):
        try:
            if _hash_source() == _source:
                written.touch(0o600)
                written.write_bytes(_digest(path, content) + content)
                written.replace(path)
                _remove_oldest(path.parent)
        finally:
            written.unlink(missing_ok=True)


def _remove_oldest(folder: Path) -> None:
    """Delete the least recently used programs if all together are too large."""
    files = [(path.lstat().st_mtime, path.lstat().st_size, path) for path in folder.iterdir()]
    total = 0
    for _, size, path in sorted(files, reverse=True):
        total += size
        if total > MOST_BYTES:
            path.unlink(missing_ok=True)
