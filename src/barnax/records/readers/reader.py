"""What a file format must offer to be read."""

from collections.abc import Callable
from dataclasses import dataclass

from ..table import Table


@dataclass(frozen=True)
class Reader:
    """One file format: how its content is recognized, and how a table is taken from it.

    `read` takes the file's bytes and the name for messages, and raises InputError when the
    content is damaged.
    """

    name: str
    recognizes: Callable[[bytes], bool]
    read: Callable[[bytes, str], Table]
