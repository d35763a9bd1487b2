"""The ages of a dataset's rows: dates of all kinds, or numbers in a unit of time or use."""

import datetime
import re

import numpy as np
import polars as pl
from jaxtyping import Float

from ..errors import InputError, cut

Ages = Float[np.ndarray, "rows"]
# What a column's name says of its unit, by a word or an abbreviation that stands alone: the unit
# that ages are told in, and how much of it that is.
_UNITS = (
    ("efc|cycle", "cyc", "cycle", 1.0),
    ("throughput", r"a\W?h", "A.h", 1.0),
    ("hour", "hr?s?", "day", 1 / 24),
    ("minute", "min", "day", 1 / 1440),
    ("second", "s|sec", "day", 1 / 86_400),
    ("day", "d", "day", 1.0),
    ("week", "wk?", "week", 1.0),
    ("month", "mo", "month", 1.0),
    ("year", "yr?", "year", 1.0),
)
# Without a unit, numbers so large are days such as 20240115, or seconds since 1970, thousandths of
# them and so on; such a small one in a column of dates may be a year.
_COMPACT, _EPOCH_S, _YEARS = (19_000_101, 22_001_231), (1e8, 1e11), (1900, 2200)
# Days that spreadsheets count go to that of the year 2100.
_LATEST_DAY = 73_051


def ages_of(column: pl.Series, name: str) -> tuple[Ages, str]:
    """The age of every row, NaN where it has none, and its unit; of dates, days since the first.

    Dates are of any type, ISO texts, numbers such as 20240115, and seconds since 1970 or parts of
    them; without a time zone they are in UTC. Raises `InputError` for a value that is neither a
    number nor a date, and where it may be either.
    """
    if column.dtype == pl.String:
        column = column.replace("", None)
        number = column.cast(pl.Float64, strict=False)
        # A text that is no number makes all of them dates, unless most are numbers.
        is_text = number.is_null() & column.is_not_null()
        if is_text.any() and 2 * is_text.sum() < len(column) - column.null_count():
            row = is_text.arg_true()[0]
            raise _neither(column[row], row + 1, name)
        if is_text.any():
            texts = column.set((~number.is_finite()).fill_null(False), None)
            number = pl.Series([_date(text, row, name) for row, text in enumerate(texts, 1)])
        column = number
    if column.dtype.is_temporal():
        days = column.cast(pl.Datetime("us")).cast(pl.Int64) / 86_400e6
        return (days - days.min()).cast(pl.Float64).to_numpy(), "day"  # pyrefly: ignore
    number = column.cast(pl.Float64, strict=False).to_numpy()
    number = np.where(np.isfinite(number), number, np.nan)
    if np.isnan(number).all():
        raise InputError(f"`age` {name}: no row has a finite age; give the column that has them")
    lower = name.lower()
    for word, short, unit, factor in _UNITS:
        if re.search(rf"{word}|(?<![a-z])({short})(?![a-z])", lower):
            return factor * number, unit
    low, high = np.nanmin(number), np.nanmax(number)
    if _COMPACT[0] <= low and high <= _COMPACT[1]:
        texts = ["" if np.isnan(value) else f"{value:.0f}" for value in number]
        return ages_of(pl.Series([re.sub(r"(..)(..)$", r"-\1-\2", text) for text in texts]), name)
    for parts in (1.0, 1e3, 1e6, 1e9):
        if _EPOCH_S[0] * parts <= low and high < _EPOCH_S[1] * parts:
            return (number - low) / (86_400 * parts), "day"
    if high > _LATEST_DAY:
        row = int(np.nanargmax(number)) + 1
        raise InputError(
            f"`age` {name}: row {row} is {number[row - 1]:.12g}, which is neither an age in days "
            "nor a date beside the others; write dates as 2024-01-15, and none as nothing"
        )
    if lower.startswith("date") and _YEARS[0] <= low and high < _YEARS[1]:
        raise InputError(f"`age` {name}: {low:g} may be a year or a day; write it as 2024-01-15")
    return number, "day"


def _neither(text: str, row: int, name: str) -> InputError:
    return InputError(
        f"`age` {name}: row {row} is {cut(text, 40)!r}; give a number in every row, or a date, as "
        "2024-01-15"
    )


def _date(text: str | None, row: int, name: str) -> datetime.datetime | None:
    try:
        date = datetime.datetime.fromisoformat(text) if text else None
    except ValueError as problem:
        raise _neither(str(text), row, name) from problem
    return date if date is None or date.tzinfo else date.replace(tzinfo=datetime.UTC)
