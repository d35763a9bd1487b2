"""Neware's binary files (.nda, .ndax), by fastnda.

fastnda knows files by their names only, so the content goes through a temporary one.
"""

from collections.abc import Mapping

import numpy as np
import polars as pl

from ...errors import InputError
from ..table import Reader, Table
from .libraries import as_file, quieted

_ZIP = b"PK\x03\x04"


def _recognizes(content: bytes) -> bool:
    """An .nda file begins with the maker's name; an .ndax file is a zip archive of .ndc files."""
    return content.startswith(b"NEWARE") or (content.startswith(_ZIP) and b".ndc" in content)


def _read(content: bytes, file: str, given: Mapping[str, str]) -> Table:
    # Of the formats only this one needs it, and it takes long to load.
    import fastnda

    del given
    suffix = ".ndax" if content.startswith(_ZIP) else ".nda"
    try:
        with as_file(content, suffix) as path, quieted("fastnda") as told:
            frame = fastnda.read(path, cycle_mode="auto")
    except Exception as error:
        # What a damaged file makes the library raise is of many kinds.
        raise InputError(
            f"{file}: the {suffix} file is damaged, cut short or of an unknown version; export the "
            "record as CSV from BTSDA."
        ) from error
    if not frame.height:
        raise InputError(f"{file}: this Neware file has no samples; give another.")
    is_damaged = any(record.exc_info for record in told)
    notes = ("a part beside the records is damaged, and was left out",) if is_damaged else ()
    columns = [
        column.cast(pl.String) if column.dtype == pl.Categorical else column
        for column in frame.get_columns()
    ]
    return Table(tuple(frame.columns), tuple(columns), np.arange(2, frame.height + 2), notes=notes)


NEWARE = Reader("Neware .nda or .ndax", _recognizes, _read)
