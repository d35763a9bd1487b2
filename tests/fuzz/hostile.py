"""Files that nobody meant well: random, damaged, and well formed with absurd contents."""

import copy
import io
import json
import math
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np
import polars as pl
from hypothesis import strategies as st

from helpers.records import arbin_rows, pulse_frame, workbook

TIME, CURRENT, VOLTAGE = "Test Time / s", "Current / A", "Voltage / V"
FRAME = pulse_frame(40)

# Where one kind of number ends and the next begins, or does not.
NUMBERS = [
    0.0, -0.0, 5e-324, 1e-300, 1e-9, 1.0, 65_535.0, 2.0**31, 2.0**53, 2.0**63, 1e20, 1e155, 1e300,
    1.7976931348623157e308, math.inf, math.nan,
]  # fmt: skip
CELLS = [
    "", " ", "nan", "-inf", "1e400", "1e-400", "1_000", "0x10", "1,5", "1.2.3", "--", "+", "٣", "é",
    "true", "2020-01-01", "9" * 5000, "0." + "3" * 5000, '"', "\ufeff1", "\u2028", "=1+1", "..",
]  # fmt: skip


def parquet(frame: pl.DataFrame, **options: Any) -> bytes:
    """A table as a Parquet file."""
    file = io.BytesIO()
    frame.write_parquet(file, **options)
    return file.getvalue()


def sheet(frame: pl.DataFrame, name: str = "data") -> bytes:
    """A table as a workbook of one sheet."""
    return workbook({name: [frame.columns, *map(list, frame.rows())]})


def repacked(content: bytes, change: Callable[[str, bytes], bytes]) -> bytes:
    """An archive with every part given to `change` with its name."""
    file = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(content)) as old,
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as new,
    ):
        for name in old.namelist():
            new.writestr(name, change(name, old.read(name)))
    return file.getvalue()


GOOD_FILES = {
    "csv": [FRAME.write_csv().encode(), FRAME.write_csv(separator=";").encode("utf-16")],
    "parquet": [
        *(parquet(FRAME, compression=kind) for kind in ("zstd", "snappy", "uncompressed")),
        parquet(FRAME, row_group_size=7, data_page_size=64, statistics=False),
        parquet(FRAME.with_columns(pl.lit("pause").alias("Mode"), pl.lit(7).alias("Step"))),
    ],
    "workbook": [sheet(FRAME), workbook({"Info": [["x"]], "Channel_1-001": arbin_rows(FRAME)})],
}
"""Good files of every format but the old workbook, for which nothing here can write one."""


@st.composite
def damaged(draw: st.DrawFn, good: list[bytes]) -> bytes:
    """A good file with some bytes changed, cut out, put in, or a part of another file."""
    content = bytearray(draw(st.sampled_from(good)))
    for _ in range(draw(st.integers(1, 6))):
        at = draw(st.integers(0, max(0, len(content) - 1)))
        if draw(st.booleans()):
            # What a format says of itself stands at the ends.
            at = draw(st.integers(0, min(800, len(content)))) * draw(st.sampled_from([1, -1]))
            at %= max(1, len(content))
        kind = draw(st.sampled_from(["flip", "byte", "many", "cut", "insert", "end", "splice"]))
        if kind == "flip" and content:
            content[at] ^= 1 << draw(st.integers(0, 7))
        elif kind == "byte" and content:
            content[at] = draw(st.integers(0, 255))
        elif kind == "many":
            run = draw(st.sampled_from([b"\xff" * 8, bytes(8), b"\x80" * 7 + b"\x01", b"\xfe" * 9]))
            content[at : at + len(run)] = run
        elif kind == "cut":
            del content[at : at + draw(st.integers(1, 16))]
        elif kind == "insert":
            content[at:at] = draw(st.binary(min_size=1, max_size=16))
        elif kind == "end":
            del content[at:]
        else:
            other = draw(st.sampled_from(good))
            begin = draw(st.integers(0, len(other)))
            content[at:] = other[begin:]
    return bytes(content)


numbers = st.one_of(
    st.sampled_from(NUMBERS).flatmap(lambda size: st.sampled_from([size, -size])),
    st.floats(),
    st.floats(-10, 10),
)


@st.composite
def absurd_frames(draw: st.DrawFn) -> pl.DataFrame:
    """A record with all columns there are, some of its numbers or whole columns absurd."""
    lines = draw(st.integers(10, 40))
    frame = FRAME[:lines].with_columns(
        pl.lit(25.0).alias("Temperature / degC"),
        (pl.col(TIME) // 7).alias("Step Index / 1"),
        (pl.col(TIME) / 3600).alias("Charging Capacity / Ah"),
        (pl.col(TIME) / 3600).alias("Discharging Capacity / Ah"),
    )
    columns = {name: frame[name].to_numpy().copy() for name in frame.columns}
    for _ in range(draw(st.integers(0, 4))):
        column = columns[draw(st.sampled_from(frame.columns))]
        change = draw(st.sampled_from(["one", "all", "scale", "shift"]))
        value = draw(numbers)
        with np.errstate(all="ignore"):
            if change == "one":
                column[draw(st.integers(0, lines - 1))] = value
            elif change == "all":
                column[:] = value
            elif change == "scale":
                column *= value
            else:
                column += value
    left_out = draw(st.sets(st.sampled_from(frame.columns[3:])))
    return pl.DataFrame({name: values for name, values in columns.items() if name not in left_out})


@st.composite
def absurd_texts(draw: st.DrawFn) -> bytes:
    """A delimited file with absurd cells, names, lines or separators."""
    lines = [line.split(",") for line in draw(absurd_frames()).write_csv().splitlines()]
    words = st.sampled_from(CELLS) | st.text(max_size=8)
    for _ in range(draw(st.integers(0, 4))):
        line = draw(st.sampled_from(lines))
        if draw(st.booleans()):
            line[draw(st.integers(0, len(line) - 1))] = draw(words)
        elif draw(st.booleans()):
            line.append(draw(words))
        else:
            del line[draw(st.integers(0, len(line) - 1)) :]
            line.append("")
    separator = draw(st.sampled_from([",", ";", "\t", "|"]))
    text = draw(st.sampled_from(["\n", "\r\n", "\r", "\n\n"])).join(map(separator.join, lines))
    encoding = draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "latin-1"]))
    return text.encode(encoding, errors="replace")


# Written where a JSON reader may read it, but JSON has no such numbers.
NUMBER_TEXTS = [
    "NaN", "Infinity", "-Infinity", "1e400", "-1e400", "9" * 400, "9" * 5000, "-" + "9" * 400,
    "1e308", "5e-324", "0", "-0.0", "0.5", "-1", "1.5", "true", "null", '"0.5"',
]  # fmt: skip
STRINGS = [
    "", " ", "\0", "\n", "'''", '"""\nimport os\n"""', "*/ int x; /*", "../../../etc/passwd",
    "[bold]", "[/]", "<script>alert(1)</script>", "{0}", "%s", "\ud800", "\u202e", "x" * 10_000,
    "nan", "--out=/", "é", "\\", "\\u0000",
]  # fmt: skip

OTHERS = [[], {}, [[]], {"": 0}, [0.5], None, True]


def places_of(document: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The path to every value in a JSON document, the document's own being empty."""
    items: Any = ()
    if isinstance(document, dict):
        items = document.items()
    elif isinstance(document, list):
        # One end of a long list is like the other.
        items = list(enumerate(document))[:3]
    found = [path]
    for key, value in items:
        found += places_of(value, (*path, key))
    return found


@st.composite
def absurd_documents(draw: st.DrawFn, good: dict[str, Any]) -> str:
    """A JSON document with some values replaced, removed or moved, as text."""
    document = copy.deepcopy(good)
    marks: dict[str, str] = {}
    for number in range(draw(st.integers(1, 3))):
        *path, last = draw(st.sampled_from(places_of(document)[1:]))
        parent = document
        for step in path:
            parent = parent[step]
        kind = draw(st.sampled_from(["number", "string", "other", "remove", "move", "deep"]))
        if kind == "remove":
            del parent[last]
        elif kind == "number":
            parent[last] = mark = f"@mark {number}@"
            marks[f'"{mark}"'] = draw(st.sampled_from(NUMBER_TEXTS))
        elif kind == "string":
            parent[last] = draw(st.sampled_from(STRINGS))
        elif kind == "move":
            parent[last] = copy.deepcopy(good[draw(st.sampled_from(["cell", "window", "inputs"]))])
        elif kind == "deep":
            parent[last] = mark = f"@mark {number}@"
            levels = draw(st.sampled_from([50, 300, 5000]))
            marks[f'"{mark}"'] = "[" * levels + "]" * levels
        else:
            parent[last] = copy.deepcopy(draw(st.sampled_from(OTHERS)))
    text = json.dumps(document)
    for mark, value in marks.items():
        text = text.replace(mark, value)
    return text
