"""What the libraries behind the readers need, and what they must not do: open files, and speak."""

import logging
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from logging.handlers import BufferingHandler


@contextmanager
def as_file(content: bytes, suffix: str) -> Iterator[str]:
    """The path of a temporary file of that content, for libraries that open files themselves."""
    with tempfile.TemporaryDirectory() as folder:
        with tempfile.NamedTemporaryFile(suffix=suffix, dir=folder, delete=False) as file:
            file.write(content)
        yield file.name


@contextmanager
def quieted(library: str) -> Iterator[list[logging.LogRecord]]:
    """What the library logs meanwhile, kept from the terminal."""
    log = logging.getLogger(library)
    handler = BufferingHandler(10_000)
    was_propagating, log.propagate = log.propagate, False
    log.addHandler(handler)
    try:
        yield handler.buffer
    finally:
        log.removeHandler(handler)
        log.propagate = was_propagating
