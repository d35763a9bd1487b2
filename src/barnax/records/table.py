"""A file's cells as they stand, before anybody asks what they mean."""

from dataclasses import dataclass

import numpy as np
import polars as pl
from jaxtyping import Int


@dataclass(frozen=True, eq=False)
class Table:
    """A header and one series a column, all of one length.

    `row` is each line's row in the source, the header being row 1. `sheets` names the sheets the
    lines come from, with the number of lines of each, in order; it is empty for formats without
    sheets. `notes` are for the user.
    """

    header: tuple[str, ...]
    columns: tuple[pl.Series, ...]
    row: Int[np.ndarray, "lines"]
    sheets: tuple[tuple[str, int], ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def sheet_of_line(self) -> Int[np.ndarray, "lines"]:
        """Which of `sheets` each line comes from; zero everywhere for formats without sheets."""
        if not self.sheets:
            return np.zeros(len(self.row), int)
        return np.repeat(np.arange(len(self.sheets)), [lines for _, lines in self.sheets])
