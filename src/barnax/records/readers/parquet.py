"""Parquet tables."""

import io

import numpy as np
import polars as pl

from ...errors import InputError, reason_of
from ..table import Reader, Table

# Polars panics, outside Exception, on some files damaged in their middle.
_DAMAGE = (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError)


def _recognizes(content: bytes) -> bool:
    return content.startswith(b"PAR1")


def _read(content: bytes, file: str) -> Table:
    try:
        frame = pl.read_parquet(io.BytesIO(content))
    except _DAMAGE as error:
        raise InputError(
            f"{file}: the Parquet file is damaged or cut short ({reason_of(error)}); "
            "copy or export it again."
        ) from error
    return Table(
        header=tuple(frame.columns),
        columns=tuple(frame.get_columns()),
        row=np.arange(2, frame.height + 2),
    )


PARQUET = Reader("Parquet table", _recognizes, _read)
