"""The ages of a dataset's rows: dates of all kinds, or numbers in a unit of time or use."""

import datetime
import re
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float

from ..errors import InputError, cut

Ages = Float[np.ndarray, "rows"]
# What a column's name says of its unit: a word, or an abbreviation that stands alone; the unit that
# ages are told in, and how much of it that is.
_UNITS = (
    ("efc|cycle", "-", "cycle", 1.0),
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


def ages_of(column: pl.Series, name: str) -> tuple[Ages, str]:
    """The age of every row, NaN where it has none, and its unit; of dates, days since the first.

    Dates are of any type, ISO texts, numbers such as 20240115, and seconds since 1970 or parts of
    them; without a time zone they are in UTC. Raises `InputError` for a value that is neither a
    number nor a date, and where it may be either.
    """
    if column.dtype.is_temporal():
        return _since_first(column.cast(pl.Datetime("us")).cast(pl.Int64).cast(pl.Float64) / 1e6)
    values, are_dates = [], []
    for row, given in enumerate(column, 1):
        try:
            value, is_date = _read(given)
        except ValueError as problem:
            raise InputError(
                f"`age` {name}: row {row} is {cut(str(given), 40)!r}, neither a number nor a date; "
                "write dates as 2024-01-15"
            ) from problem
        values.append(value)
        are_dates += [is_date] if np.isfinite(value) else []
    if not are_dates:
        raise InputError(f"`age` {name}: no row has a finite age; give the column that has them")
    if len(set(are_dates)) > 1:
        raise InputError(f"`age` {name}: some rows are dates and some numbers; write all alike")
    number = pl.Series(values, dtype=pl.Float64)
    return _since_first(number) if any(are_dates) else _numbers(_finite(number), name)


def _read(given: Any) -> tuple[float, bool]:
    """A number, or the seconds since 1970 of a date, and which it is; NaN for nothing."""
    text = "" if given is None else str(given).strip()
    try:
        return float(text or "nan"), False
    except ValueError:
        date = datetime.datetime.fromisoformat(text)
        return (date if date.tzinfo else date.replace(tzinfo=datetime.UTC)).timestamp(), True


def _finite(values: pl.Series) -> Ages:
    number = values.to_numpy().astype(float)
    return np.where(np.isfinite(number), number, np.nan)


def _since_first(seconds: pl.Series) -> tuple[Ages, str]:
    days = _finite(seconds) / 86_400
    return days - np.nanmin(days, initial=np.inf), "day"


def _numbers(number: Ages, name: str) -> tuple[Ages, str]:
    """Ages that are numbers, by the unit in the column's name, or else by how large they are."""
    lower = name.lower()
    for word, short, unit, factor in _UNITS:
        if re.search(rf"{word}|(?<![a-z])({short})(?![a-z])", lower):
            return factor * number, unit
    there = number[np.isfinite(number)]

    def lie(low: float, high: float) -> bool:
        return bool(len(there)) and bool(np.all((there >= low) & (there < high)))

    if lie(*_COMPACT):
        texts = ["" if np.isnan(value) else f"{value:.0f}" for value in number]
        return ages_of(pl.Series([re.sub(r"(..)(..)$", r"-\1-\2", one) for one in texts]), name)
    for power in range(4):
        low, high = (end * 1e3**power for end in _EPOCH_S)
        if lie(low, high):
            return _since_first(pl.Series(number / 1e3**power))
    if lower.startswith("date") and lie(*_YEARS):
        raise InputError(f"`age` {name}: {there[0]:g} may be a year or a day; write 2024-01-15")
    return number, "day"
