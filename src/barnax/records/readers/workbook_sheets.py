"""The sheets of a workbook, as tables."""

from collections.abc import Callable
from dataclasses import dataclass

import fastexcel
import polars as pl


@dataclass(frozen=True)
class Sheets:
    """The sheets' names, and functions from a name to the first row and to the rows below."""

    names: list[str]
    header: Callable[[str], tuple[str, ...]]
    body: Callable[[str], pl.DataFrame]


def open_sheets(content: bytes) -> Sheets:
    """The sheets of a workbook. What is opened and called raises FastExcelError if damaged."""
    workbook = fastexcel.read_excel(content)

    def header(name: str) -> tuple[str, ...]:
        sheet = workbook.load_sheet(name, header_row=None, n_rows=1, dtypes="string")
        first = sheet.to_polars()
        return tuple(str(cell) for cell in first.row(0)) if first.height else ()

    def body(name: str) -> pl.DataFrame:
        if workbook.load_sheet(name, header_row=None).height < 2:
            return pl.DataFrame()
        sheet = workbook.load_sheet(name, header_row=None, skip_rows=1, schema_sample_rows=None)
        return sheet.to_polars()

    return Sheets(workbook.sheet_names, header, body)
