"""Parquet tables."""

import io

import numpy as np
import polars as pl

from ...errors import InputError, reason_of
from ..table import Reader, Table


def _recognizes(content: bytes) -> bool:
    return content.startswith(b"PAR1")


def _read(content: bytes, file: str) -> Table:
    damaged = f"{file}: the Parquet file is damaged or cut short"
    try:
        frame = pl.read_parquet(io.BytesIO(content))
    except pl.exceptions.PanicException as error:
        # Some files damaged in their middle make Polars panic, in words for its developers.
        raise InputError(f"{damaged}; copy or export it again.") from error
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InputError(f"{damaged} ({reason_of(error)}); copy or export it again.") from error
    return Table(
        header=tuple(frame.columns),
        columns=tuple(frame.get_columns()),
        row=np.arange(2, frame.height + 2),
    )


PARQUET = Reader("Parquet table", _recognizes, _read)
