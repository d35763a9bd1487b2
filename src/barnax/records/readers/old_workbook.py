"""Workbooks of the kind before OOXML, read in a process of their own.

The library that reads them takes what they declare at its word: of damaged ones one in ten makes
it panic, and one in a hundred ends its process. So that is not ours, and has limits.
"""

import io
import json
import subprocess
import sys

import polars as pl

from .workbook_sheets import Sheets, open_sheets
from .workbook_xml import Damaged

MOST_MEMORY, MOST_SECONDS = 8_000_000_000, 60


def open_old_sheets(content: bytes) -> Sheets:
    """The sheets of such a workbook.

    Raises `Damaged` where they cannot be read within a minute and 8 GB.
    """
    try:
        done = subprocess.run(
            # Without -P a file in the user's folder could pass for one of our libraries.
            [sys.executable, "-P", "-m", __name__],
            input=content,
            capture_output=True,
            timeout=MOST_SECONDS,
        )
    except subprocess.TimeoutExpired as problem:
        raise Damaged(f"not read within {MOST_SECONDS} s") from problem
    except OSError as problem:
        raise Damaged(f"no process to read it in: {problem}") from problem
    if done.returncode:
        raise Damaged("it does not hold what it declares")
    head, _, frames = done.stdout.partition(b"\n")
    headers, bodies, start = {}, {}, 0
    for name, header, length in json.loads(head):
        headers[name] = tuple(header)
        bodies[name] = pl.read_ipc(io.BytesIO(frames[start : start + length]))
        start += length
    return Sheets(list(headers), headers.__getitem__, bodies.__getitem__)


def main() -> None:
    """Read a workbook from stdin.

    Every sheet's name, first row and length go to stdout as JSON, then all bodies in Arrow's form.
    """
    _limit_memory()
    sheets = open_sheets(sys.stdin.buffer.read())
    described, frames = [], []
    for name in sheets.names:
        frame = io.BytesIO()
        sheets.body(name).write_ipc(frame)
        frames.append(frame.getvalue())
        described.append((name, sheets.header(name), len(frames[-1])))
    sys.stdout.buffer.write(json.dumps(described).encode() + b"\n")
    sys.stdout.buffer.writelines(frames)


def _limit_memory() -> None:
    try:
        import resource
    except ImportError:  # Windows has no such limit.
        return
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    limit = MOST_MEMORY if most == resource.RLIM_INFINITY else min(most, MOST_MEMORY)
    resource.setrlimit(resource.RLIMIT_AS, (limit, most))


if __name__ == "__main__":
    main()
