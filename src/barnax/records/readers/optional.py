"""Binary formats that a package reads which barnax does not install by itself.

galvani is under the GPL: whoever wants .mpr files read installs it, and it is loaded for them only.
"""

import io
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import polars as pl

from ...errors import InputError
from ..table import Reader, Table
from .libraries import as_file

Columns = Mapping[str, Any]


def _reader(name: str, start: bytes, extra: str, export: str, parse: Callable[[bytes], Columns]):
    """A reader of content that holds `start` near its beginning, by the package of an extra."""

    def recognizes(content: bytes) -> bool:
        return start in content[:64]

    def read(content: bytes, file: str, given: Mapping[str, str]) -> Table:
        del given
        try:
            columns = parse(content)
        except ImportError as error:
            raise InputError(
                f"{file}: this is a {name} file; install the package that reads it with "
                f"pip install 'barnax[{extra}]', or export the record as {export}."
            ) from error
        except Exception as error:
            # What a damaged file makes the package raise is of many kinds.
            raise InputError(
                f"{file}: the {name} file is damaged, cut short or of an unknown version; export "
                f"the record as {export}."
            ) from error
        series = tuple(pl.Series(key, np.array(values)) for key, values in columns.items())
        return Table(tuple(columns), series, np.arange(2, len(series[0]) + 2))

    return Reader(name, recognizes, read)


def _parse_mpr(content: bytes) -> Columns:
    from galvani.BioLogic import MPRfile  # pyright: ignore[reportMissingImports]

    data = MPRfile(io.BytesIO(content)).data
    return {name: data[name] for name in data.dtype.names or ()}


def _parse_res(content: bytes) -> Columns:
    from access_parser import AccessParser  # pyright: ignore[reportMissingImports]

    with as_file(content, ".res") as path:
        table = AccessParser(path).parse_table("Channel_Normal_Table")
    # Rows are not stored in order.
    order = np.argsort(table["Data_Point"], kind="stable")
    return {name: np.array(values)[order] for name, values in table.items()}


BIOLOGIC_MPR = _reader(
    "BioLogic .mpr",
    b"BIO-LOGIC MODULAR FILE",
    "biologic",
    "text (.mpt) from EC-Lab or BT-Lab",
    _parse_mpr,
)
ARBIN_RES = _reader(
    "Arbin .res",
    b"Standard Jet DB",
    "arbin",
    "a workbook or CSV from Arbin's Data Watcher",
    _parse_res,
)
