"""The contents of cells as numbers: decimal commas, clock times, dates, and words for steps."""

import re
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
import polars as pl
from jaxtyping import Float

from .columns import Column
from .quantities import Unit
from .record import OTHER_STATE

Numbers = Float[np.ndarray, "lines"]

CLOCKS = frozenset({"time", "step time", "date"})


_ABSENT_DEGC = -300.0
# 1899-12-31, the date that spreadsheets show for a time of day; and a length that no test reaches.
_DAY_ZERO_S, DATED_S = -2_209_075_200.0, 5e8


def numbers(cells: pl.Series, column: Column) -> Numbers:
    """The cells in the base unit of the column's quantity; NaN for those that are not numbers.

    Clock times ("1d 02:03:04.5", "144:02:18") are in seconds, whatever the unit; dates in seconds
    since 1970.
    """
    return dated_numbers(cells, column)[0]


def dated_numbers(cells: pl.Series, column: Column) -> tuple[Numbers, float | None]:
    """`numbers`, and the date at which the times are zero, in s since 1970; None if they are not
    dates, or are themselves counted from 1970."""
    if isinstance(cells.dtype, pl.Categorical | pl.Enum):
        cells = cells.cast(pl.String)
    quantity = column.quantity.name
    if quantity in CLOCKS and not cells.dtype.is_numeric():
        seconds = _seconds(cells)
        if np.isfinite(seconds).any():
            if quantity == "date":
                return seconds, None
            if quantity == "time":
                seconds = _past_the_end(seconds, DAY_S)
            # Clock times keep their origin; dates start at the first one, or at day zero of
            # spreadsheets.
            first = float(seconds[np.argmax(np.isfinite(seconds))])
            zero_s = _DAY_ZERO_S if first < _DAY_ZERO_S + 100 * DAY_S else 0.0
            zero_s = first if first >= DATED_S else zero_s
            return seconds - zero_s, zero_s if zero_s >= DATED_S else None
    return (_states(cells) if quantity == "state" else _plain_numbers(cells, column)), None


def _plain_numbers(cells: pl.Series, column: Column) -> Numbers:
    """Cells other than clock times, in the base unit of the column's quantity."""
    quantity, unit = column.quantity.name, column.unit
    if cells.dtype == pl.String:
        cells = _plain(cells)
    elif not cells.dtype.is_numeric():
        # A date or a truth value has no place in a column with a unit.
        return np.full(len(cells), np.nan)
    # NumPy concatenates into larger memory pages than Polars, whose first use is slow.
    pieces = cells.cast(pl.Float64).get_chunks()
    values = np.concatenate([piece.to_numpy() for piece in pieces])
    if quantity == "date" and column.is_unit_assumed:
        unit = epoch_unit(values) or unit
    if quantity == "temperature":
        # Some loggers write a large negative number for a missing sensor.
        values = np.where(values < _ABSENT_DEGC, np.nan, values)
    return unit.to_base(values)


def _plain(text: pl.Series, has_points: Callable[[], bool] = lambda: False) -> pl.Series:
    """The numbers in a column of text, null if a cell has none; `has_points` says whether other
    columns of the table have decimal points."""
    plain = text.cast(pl.Float64, strict=False)
    if plain.null_count() == text.null_count():
        return plain
    text = text.str.strip_chars().str.replace("\u2212", "-", literal=True)
    text = text.str.replace_all(_GROUPS, "$1$2")
    plain = text.cast(pl.Float64, strict=False)
    with_comma = text.filter(plain.is_null() & text.str.contains(",", literal=True))
    if not len(with_comma):
        return plain
    # "1,005" is one thousand and five if numbers without a comma reach at most 999, or have decimal
    # points.
    are_groups = with_comma.str.contains(r"^[+-]?[1-9]\d{0,2}(,\d{3})+$").all()
    are_groups = are_groups and ((plain.abs().max() or 0) >= 100 or has_points())  # type: ignore[operator]
    if with_comma.str.contains(r"\d\.\d{3}[.,]").any():
        text = text.str.replace_all(".", "", literal=True)
    elif are_groups or with_comma.str.contains(r"\d,\d{3}[.,]").any():
        text = text.str.replace_all(",", "", literal=True)
    return text.str.replace(",", ".", literal=True).cast(pl.Float64, strict=False)


# Blanks and apostrophes separate thousands.
_GROUPS = "(\\d)[ \u00a0\u202f'\u2019](\\d{3})"


def settled(columns: Sequence[pl.Series]) -> tuple[pl.Series, ...]:
    """The columns, with text replaced by numbers where every cell is one.

    "1,005" is one thousand and five if other columns use the point as their decimal mark.
    """

    @cache
    def has_points() -> bool:
        return any(
            column.head(_LOOKED_AT).str.contains(_WITH_POINT).any()
            if column.dtype == pl.String
            else column.dtype.is_float() and (column % 1 > 0).any()
            for column in columns
        )

    numeric = []
    for column in columns:
        first = column.drop_nulls().head(1)
        # Most text columns begin with a word or a clock time, and a file may have millions of
        # cells.
        if first.dtype == pl.String and first.str.contains(_SPELLS_NUMBER).any():
            plain = _plain(column, has_points)
            is_whole = plain.null_count() == column.null_count() and plain.is_finite().all()
            # If the cells were read again without the other columns, commas could be understood
            # differently.
            is_read = (plain.is_finite() & column.str.contains(",", literal=True)).fill_null(False)
            column = plain if is_whole else plain.cast(pl.String).zip_with(is_read, column)
        numeric.append(column)
    return tuple(numeric)


_SPELLS_NUMBER = r"^\s*[+\-\u2212]?\d[\d., \u00a0\u202f'\u2019]*([eE][+-]?\d+)?\s*$"
_LOOKED_AT, _WITH_POINT = 1000, r"^\s*[+-]?\d[\d,]*\.\d+\s*$"


# Days, hours and minutes, or minutes alone; seconds with a comma, or a colon before milliseconds.
_CLOCK = (
    r"(?i)^\s*(?:(?:(\d+)\s*(?:d|days?)?[\s.,-]+)?(\d+):)?(\d+):(\d+(?:[.,:]\d*)?)\s*([ap]m)?\s*$"
)
_DATED = r"^\s*\d+[-/.]([A-Za-z]+|\d+)[-/.]\d+"
_MINUTE_AND_SECOND = r"^[0-5]\d:[0-5]\d$"
DAY_S, _HOUR_S = 86_400.0, 3600.0
# A clock of hours or days restarts only this close to its end.
_NEAR_END = 0.01


def _seconds(cells: pl.Series) -> Numbers:
    """Clock times, durations and dates in seconds."""
    if cells.dtype == pl.Time:
        cells = cells.cast(pl.Duration("us"))
    if cells.dtype == pl.Duration:
        return cells.dt.total_microseconds().cast(pl.Float64).to_numpy() / 1e6
    if cells.dtype == pl.String:
        if not cells.drop_nulls().head(1).str.contains(_DATED).any():
            return _clock_s(cells)
        cells = _dates(cells)
    if not cells.dtype.is_temporal():
        return np.full(len(cells), np.nan)
    return cells.cast(pl.Datetime("us")).dt.epoch("us").cast(pl.Float64).to_numpy() / 1e6


def _clock_s(text: pl.Series) -> Numbers:
    """Seconds of "1d 02:03:04.5", "144:02:18", "08:41:18 PM" or "05:30.0"; NaN for anything
    else."""
    *parts, second, half = text.str.extract_groups(_CLOCK).struct.unnest().get_columns()
    days, hours, minutes = (part.cast(pl.Float64).fill_null(0).to_numpy() for part in parts)
    if half.count():
        hours = hours % 12 + 12 * half.str.to_lowercase().eq_missing("pm").to_numpy()
    seconds = second.str.replace("[,:]", ".").cast(pl.Float64, strict=False).to_numpy()
    clock_s = ((24 * days + hours) * 60 + minutes) * 60 + seconds
    if second.str.contains(_MINUTE_AND_SECOND).all() and (second.str.tail(2) != "00").any():
        by_days_s = _clock_s(text.str.replace(":", "d ", literal=True))
        if uneven(by_days_s, 0.1) < uneven(clock_s, 0.1):
            # Days before the hours, rather than hundredths of a second after the seconds.
            return by_days_s
    if parts[1].count():
        return clock_s
    # Minutes and seconds, as spreadsheets show times without hours, or hours and minutes.
    are_seconds = bool(second.str.contains(".", literal=True).any())
    return _past_the_end(clock_s, _HOUR_S) if are_seconds else np.full(len(text), np.nan)


def uneven(clock_s: Numbers, share: float) -> int:
    """The number of intervals that differ from the usual one by more than this share of it."""
    interval_s = np.diff(clock_s)
    usual_s = np.median(interval_s) if len(interval_s) else 0.0
    return int(np.sum(np.abs(interval_s - usual_s) > share * abs(usual_s)))


def _past_the_end(clock_s: Numbers, period_s: float) -> Numbers:
    """The clock, continued past midnight for a time of day, and past the full hour for minutes."""
    if np.any(clock_s >= period_s):
        return clock_s
    begins = np.abs(np.diff(clock_s) + period_s) < _NEAR_END * period_s
    return clock_s + period_s * np.cumsum(np.append(False, begins))


def _by_word(text: pl.Series, meaning: Callable[[str], float]) -> Numbers:
    """The meanings of a column's words; NaN for unknown ones. Words come in runs, and few are
    distinct."""
    lengths, words = text.rle().struct.unnest().get_columns()
    meanings = {word: meaning(word) for word in words.unique().drop_nulls()}
    values = words.replace_strict(meanings, default=None, return_dtype=pl.Float64)
    return np.repeat(values.to_numpy(), lengths.to_numpy())


def is_clock(cells: pl.Series) -> bool:
    """True if the cells are clock times or dates rather than numbers with a unit."""
    if cells.dtype != pl.String:
        return cells.dtype.is_temporal()
    return ":" in "".join(cells.drop_nulls().head(1).to_list())


def is_local_date(cells: pl.Series, column: Column) -> bool:
    """True for local dates, which give no offset from UTC; Unix times do."""
    if cells.dtype.is_numeric():
        return column.unit.offset != 0
    if cells.dtype != pl.String:
        return getattr(cells.dtype, "time_zone", None) is None
    return not cells.head(1).str.strip_chars().str.contains(_ZONE).any()


# A four-digit year read as two digits leaves a remainder; a two-digit year read as four is in the
# first century.
_NAMED_MONTHS = "%d-%b-%y", "%d-%b-%Y"
_DAYS = ("%Y-%m-%d", "%Y/%m/%d", "%m/%d/%Y", "%d/%m/%Y", "%d.%m.%Y", "%d-%m-%Y", *_NAMED_MONTHS)
_TIMES = ("%H:%M:%S%.f", "%I:%M:%S%.f %p", "%H:%M", "%I:%M %p", "")


_OFFSET = r"([+-]\d\d(?::?\d\d)?)"
_ZONE = rf"(:.*?)\s?(?:Z|UTC|GMT|{_OFFSET})$"


def _dates(text: pl.Series) -> pl.Series:
    """The dates in a column of text: day first or month first, whichever spans the shorter time."""
    text = text.str.strip_chars()
    offsets = text.str.extract(rf":.*?{_OFFSET}$")
    plain = text.str.replace(_ZONE, "$1")
    plain = plain.str.replace("T", " ", literal=True).str.replace(r"(:\d\d:\d\d)[,:]", "$1.")
    first = plain.drop_nulls().head(1)
    read = []
    for form in (f"{day} {time}".strip() for day in _DAYS for time in _TIMES):
        if first.str.to_datetime(form, strict=False).null_count():
            continue
        dates = plain.str.to_datetime(form, time_unit="us", strict=False)
        # Python has no year 0.
        stamps = dates.dt.epoch("us")
        falls = (stamps.diff() < 0).sum()
        read.append(((dates.null_count(), falls, stamps.max() - stamps.min()), dates))  # type: ignore[operator]
    if not read:
        return text

    def east_us(offset: str) -> float:
        """An offset from UTC, such as "+01:00", in microseconds."""
        hours, minutes = int(offset[1:3]), int(offset[3:].lstrip(":") or 0)
        return 6e7 * float(f"{offset[0]}{60 * hours + minutes}")

    east = pl.Series(np.nan_to_num(_by_word(offsets, east_us))).cast(pl.Duration("us"))
    return min(read, key=lambda candidate: candidate[0])[1] - east


# Testers usually log every 1, 2 or 5 times a power of ten seconds, or every 30 s, and no faster
# than this.
_SET, _RARELY = (1.0, 2.0, 5.0), (0.025, 0.04, 0.25, 3.0, 4.0, 6.0, 8.0, 12.0, 15.0, 20.0)
_PATTERN, _EXACT, FINEST_S = 0.03, 0.003, 5e-3


def is_usual(interval_s: float) -> bool:
    """True for an interval that testers are usually set to, up to an hour.

    >>> [is_usual(interval_s) for interval_s in (0.1, 1.003, 4.0, 30.0, 240.0, 0.0667, 42.0)]
    [True, True, True, True, True, False, False]
    """
    decades = (digit * 10.0**power for digit in _SET for power in (-4, -3, -2, -1, 0))
    if any(abs(interval_s / set_s - 1) < _PATTERN for set_s in (*decades, 10.0, 30.0)):
        return True
    minutes = min(round(interval_s / 60), 60)
    others = (*_RARELY, 60.0 * max(minutes, 1))
    return any(abs(interval_s / set_s - 1) < _EXACT for set_s in others)


# Units of dates as numbers, and their ranges for the years 1985 to 2100.
_EPOCHS = (
    *(
        (Unit(f"Unix {symbol}", factor=1 / parts), 4.7e8 * parts, 4.1e9 * parts)
        for symbol, parts in (("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9))
    ),
    (Unit("Excel days", factor=DAY_S, offset=-25_569 * DAY_S), 31_048.0, 73_051.0),
    (Unit("MATLAB days", factor=DAY_S, offset=-719_529 * DAY_S), 725_008.0, 767_011.0),
    # 20240309090000 is a written date, not a count.
    (Unit("s", factor=np.nan), 1.9e13, 2.1e13),
)
# Dated samples are no further apart than this, except where the interval is a usual one.
_DATED_APART_S = 500.0


def epoch_unit(values: Numbers) -> Unit | None:
    """The unit of numbers that are dates, and its epoch: Unix time in s to ns, or days as counted
    by spreadsheets and MATLAB. None if they are not dates."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return None
    apart = np.abs(np.diff(finite))
    middle, interval = np.median(finite), np.median(apart[apart > 0]) if apart.any() else 0
    for unit, low, high in _EPOCHS:
        apart_s = interval * unit.factor
        # Days are distinguished from seconds by their intervals: too short as seconds, or a usual
        # setting as days.
        is_close = interval < FINEST_S if unit.factor == DAY_S else apart_s < _DATED_APART_S
        if low <= middle < high and (is_close or np.isnan(apart_s) or is_usual(apart_s)):
            return unit
    return None


# Testers' words for the type of a step; any other word is another state.
_STATES = (
    (
        1,
        r"^(d|d (cc|cv)|dis|dch|dch?r?g|rated|.*dch?g|.*dis-?charg(e|ing)|.*entlad.*|"
        r".*放电|.*放電|.*방전)$",
    ),
    (
        -1,
        r"^(c|c (cc|cv)|chr?g?|cha|ratec|.*chg|.*charg(e|ing)|.*lad[eu].*|"
        r".*充电|.*充電|.*충전)$",
    ),
    (
        0,
        r"^(r|rest|p|pau|pause|idle|ocv|ocp|.*rest|open circuit.*|.*ruhe.*|静置|搁置|靜置|擱置|"
        r"休止|휴지|휴식)$",
    ),
)


def _states(cells: pl.Series) -> Numbers:
    """The codes of `Record.state` for a column of words, of which few are distinct."""
    if cells.dtype != pl.String:
        return np.full(len(cells), np.nan)

    def code(word: str) -> float:
        plain = re.sub(r"[\s_]+", " ", word).strip().lower()
        return next((code for code, words in _STATES if re.match(words, plain)), OTHER_STATE)

    return np.nan_to_num(_by_word(cells, code), nan=OTHER_STATE)
