"""Ageing in the rows of a fleet's dataset: the estimates from a row's records, the age of each row,
and its quantities given all rows.

Ages are dates of all kinds, or numbers in a unit of time or use.

A row gives each quantity, and the probability of its records, for every size s of the change of the
OCV's shape (`fit.ageing`). One record hardly determines a small s, and the part it leaves open
may be another capacity; the cells of a fleet determine it together. A cell's change is one walk
that grows as it ages, so its rows repeat each other, and its early ones contain no information
about its late ones. Other cells at about that age are other draws: a row r has the probabilities

    P_r(s) ~ pi(s) P(r | s),

pi those among the others, each of which has one vote, by its row nearest in age. They maximize the
likelihood, with the usual prior weights as one more cell (Dempster, Laird and Rubin 1977). One cell
in five may be unlike all others, with the usual weights: otherwise a few that change among many
that do not are detected late.
"""

import datetime
import hashlib
import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float, Int
from scipy.special import softmax

from ..errors import InputError, cut
from ..fit.ageing import (
    AGED,
    CAPACITY,
    OCV_NODES,
    SHAPE_ODDS,
    SHAPES_V,
    AgeingEstimate,
    is_determined,
    measure_ageing,
    shows_both_ends,
)
from ..fit.registration import REACH
from ..fit.settings import TableSettings
from ..model.prepared import PreparedRecord
from ..notices import Notice

Ages = Float[np.ndarray, "rows"]
# Units in a column's name, as a word or a separate abbreviation: the unit in which ages are
# reported, and the size of the named unit in it.
_UNITS = (
    ("efc|cycle", "cyc", "cycle", 1.0),
    ("milliampere", r"ma\W?h", "A.h", 1e-3),
    ("kiloampere", r"ka\W?h", "A.h", 1e3),
    ("throughput", r"a\W?h", "A.h", 1.0),
    ("hour", "hr?s?", "day", 1 / 24),
    ("minute", "mins?", "day", 1 / 1440),
    ("second", "s|secs?", "day", 1 / 86_400),
    ("day", "d", "day", 1.0),
    ("week", "w|wks?", "week", 1.0),
    ("month", "mos?", "month", 1.0),
    ("year", "y|yrs?", "year", 1.0),
)
# A capacity this far off has an effect on the slower resistances.
OTHER_CAPACITY = 0.01
# Without a unit, numbers this large are days such as 20240115, or seconds since 1970, thousandths
# of them and so on; one this small in a column of dates may be a year.
_COMPACT, _EPOCH_S, _YEARS = (19_000_101, 22_001_231), (6.3e8, 4.2e9), (1900, 2200)
# Days counted by spreadsheets end in the year 2100.
_LATEST_DAY = 73_051
EVIDENCE = "aged log evidence by shape"
ANOTHER, ROUNDS = 0.2, 200
# A fleet's ages are divided into this many parts of its span, and a cell without a row within this
# share of the span has no vote.
PARTS, NEAR = 10, 0.25


def ages_of(column: pl.Series, name: str) -> tuple[Ages, str]:
    """The age of every row, NaN if it has none, and the unit; for dates, days since the first.

    Dates may be of any type, ISO texts, numbers such as 20240115, and seconds since 1970 or parts
    of them; without a time zone they are in UTC. Raises `InputError` for a value that is neither a
    number nor a date, and if it may be either.
    """
    if column.dtype == pl.String:
        column = column.replace("", None)
        number = column.cast(pl.Float64, strict=False)
        # A text that is not a number makes all of them dates, unless most are numbers.
        is_text = number.is_null() & column.is_not_null()
        if is_text.any() and 2 * is_text.sum() < len(column) - column.null_count():
            row = is_text.arg_true()[0]
            raise _neither(column[row], row + 1, name)
        if is_text.any():
            texts = column.set((~number.is_finite()).fill_null(False), None)
            number = pl.Series([_date(text, row, name) for row, text in enumerate(texts, 1)])
        column = number
    if column.dtype in (pl.Duration, pl.Time, pl.Boolean):
        for row in column.is_not_null().arg_true()[:1]:
            raise _neither(str(column[row]), row + 1, name)
        column = column.cast(pl.Int64)
    if column.dtype.is_temporal():
        days = column.cast(pl.Datetime("us")).cast(pl.Int64) / 86_400e6
        return (days - days.min()).cast(pl.Float64).to_numpy(), "day"  # pyrefly: ignore
    number = column.cast(pl.Float64, strict=False).to_numpy()
    number = np.where(np.isfinite(number), number, np.nan)
    if np.isnan(number).all():
        raise InputError(f"`age` {name}: no row has a finite age; give the column that has them")
    lower, said = name.lower(), _unit_in(name)
    if said is not None:
        factor, unit = said
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
    # Days counted by a spreadsheet belong to dates.
    unknown = re.search(r"(?:[\[(]\s*|age[\W_]+(?!date))([a-z]+)\s*[\])]?$", lower)
    if unknown and not lower.startswith("date"):
        raise InputError(
            f"`age` {name}: {unknown[1]} is no unit of an age; there are s, min, h, d, weeks, "
            "months, years, cycles, mAh, Ah and kAh"
        )
    if lower.startswith("date") and _YEARS[0] <= low and high < _YEARS[1]:
        raise InputError(f"`age` {name}: {low:g} may be a year or a day; write it as 2024-01-15")
    return number, "day"


def _unit_in(name: str) -> tuple[float, str] | None:
    """The unit in a column's name: the unit in which ages are reported, and its size in that."""
    for word, short, unit, factor in _UNITS:
        if re.search(rf"{word}|(?<![a-z])({short})(?![a-z])", name.lower()):
            return factor, unit
    return None


def ampere_hours(column: pl.Series, name: str) -> pl.Series:
    """The ampere-hours of every row, in the unit given by the name; null if a value is not a
    number."""
    factor, unit = _unit_in(name) or (1.0, "A.h")
    number = column.cast(pl.Float64, strict=False)
    number = number.set((~number.is_finite()).fill_null(False), None)
    return factor * number if unit == "A.h" else number


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


def ageing_row(
    records: Sequence[PreparedRecord], *, is_fitted_ocv: bool = False
) -> tuple[dict[str, Any], list[Notice]]:
    """Values of a cell's ageing from its records at one age, under "aged" names, and notices of
    doubtful ones; `is_fitted_ocv` if its OCV comes neither from other records nor from an OCV
    test."""
    passed_as = sum(
        float(np.abs(prepared.record.interval_current_a) @ np.diff(prepared.record.time_s))
        for prepared in records
    )
    ocv_v = records[0].cell.average_ocv_v(OCV_NODES)
    row: dict[str, Any] = {
        "record throughput [A.h]": passed_as / 3600,
        "aged beside OCV": hashlib.sha256(ocv_v.tobytes()).hexdigest()[:16],
    }
    is_fitted_ocv = is_fitted_ocv and records[0].cell.ocv_is_fitted
    ageing = measure_ageing(records, TableSettings(), is_fitted=is_fitted_ocv)
    capacity = ageing.get(CAPACITY)
    row["aged capacity to empty"] = capacity and shows_both_ends(records, capacity.value)
    row[EVIDENCE] = None
    for name in AGED:
        value = ageing.get(name)
        is_determined = value is not None and value.is_determined
        for end in ("value", "low", "high"):
            column = f"aged {name}" + f" {end}" * (end != "value")
            row[column] = getattr(value, end) if is_determined else None
        row[f"aged {name} by OCV"] = value and [*value.by_ocv]
        row[f"aged {name} by shape"] = None
        if value is not None and len(value.by_shape) == len(SHAPES_V):
            row[EVIDENCE] = [*value.log_evidence]
            row[f"aged {name} by shape"] = [*itertools.chain(*value.by_shape)]
    return row, [*_doubts(ageing, records[0])]


def _doubts(ageing: Mapping[str, AgeingEstimate], used: PreparedRecord) -> Iterator[Notice]:
    """Notices that values have not settled, and that a record implies a capacity which differs from
    its circuit's by more than is negligible."""
    if not all(value.is_settled for value in ageing.values()):
        yield Notice("ageing.not-settled", subject=used.record.name)
    capacity = ageing.get(CAPACITY)
    if capacity is None or not capacity.is_determined:
        return
    nearest_ah = min(max(used.capacity_ah, capacity.low), capacity.high)
    if abs(nearest_ah / used.capacity_ah - 1) > OTHER_CAPACITY:
        ends = {"low_ah": capacity.low, "high_ah": capacity.high, "used_ah": used.capacity_ah}
        yield Notice("ageing.other-capacity", ends, used.record.name)


def with_pooled_shapes(
    rows: pl.DataFrame, names: str, ages: str, quantities: Sequence[str]
) -> pl.DataFrame:
    """Rows with their quantities, intervals, and errors due to the earlier OCV, using the shapes
    pooled over all rows; unchanged if they lack the values for each shape."""
    if EVIDENCE not in rows.columns:
        return rows
    evidence = np.full((len(rows), len(SHAPE_ODDS)), np.nan)
    has_evidence = rows[EVIDENCE].is_not_null().to_numpy()
    if has_evidence.any():
        evidence[has_evidence] = np.array(rows[EVIDENCE].drop_nulls().to_list(), float)
    is_finite = np.all(np.isfinite(evidence), axis=1)
    if not is_finite.any():
        return rows
    used = rows.filter(is_finite)
    cells = np.unique(used[names].to_numpy(), return_inverse=True)[1]
    at = used[ages].cast(pl.Float64).to_numpy()
    shares, columns = pooled_shares(evidence[is_finite], cells, at), {}
    for quantity in quantities:
        cell_shapes = used[f"aged {quantity} by shape"]
        here = cell_shapes.is_not_null().to_numpy()
        if not here.any():
            continue
        by_shape = np.array(cell_shapes.drop_nulls().to_list()).reshape(
            here.sum(), len(SHAPE_ODDS), -1
        )
        mean, positions = (
            np.einsum("rs,rsn->rn", shares[here], by_shape),
            np.flatnonzero(is_finite)[here],
        )
        value, off = mean[:, 0].copy(), by_shape[..., 0] - mean[:, :1]
        error = np.sqrt(np.sum(shares[here] * (by_shape[..., 1] ** 2 + off**2), axis=1))
        value[~is_determined(quantity, value, error)] = np.nan
        for end, sign in (("", 0.0), (" low", -1.0), (" high", 1.0)):
            column = rows[f"aged {quantity}{end}"].cast(pl.Float64).to_numpy(writable=True)
            column[positions] = value + sign * REACH * error
            columns[f"aged {quantity}{end}"] = pl.Series(column, nan_to_null=True)
        by_ocv = rows[f"aged {quantity} by OCV"].to_list()
        for position, moved in zip(positions.tolist(), mean[:, 2:].tolist(), strict=True):
            by_ocv[position] = moved
        columns[f"aged {quantity} by OCV"] = pl.Series(by_ocv, dtype=pl.List(pl.Float64))
    return rows.with_columns(**columns)


def pooled_shares(
    log_evidence: Float[np.ndarray, "rows sizes"],
    cells: Int[np.ndarray, "rows"],
    ages: Float[np.ndarray, "rows"],
) -> Float[np.ndarray, "rows sizes"]:
    """The probabilities of every size in every row."""
    span = float(np.ptp(ages)) or 1.0
    middles = ages.min() + span * (np.arange(PARTS) + 0.5) / PARTS
    parts = np.argmin(np.abs(ages[:, None] - middles), axis=1)
    by_row, shares = softmax(log_evidence, axis=1), np.empty_like(log_evidence)
    for part in np.unique(parts):
        here, away = parts == part, np.abs(ages - middles[part])
        nearest = np.lexsort((away, cells))
        voters = nearest[np.unique(cells[nearest], return_index=True)[1]]
        voters = voters[away[voters] <= NEAR * span]
        odds, of_voters = np.ones_like(SHAPE_ODDS), by_row[voters]
        for _ in range(ROUNDS):
            of_voters = odds * by_row[voters]
            of_voters /= np.sum(of_voters, axis=1, keepdims=True)
            odds = np.sum(of_voters, axis=0) + SHAPE_ODDS
        of_cells = np.zeros((cells.max() + 1, len(SHAPE_ODDS)))
        of_cells[cells[voters]] = of_voters
        others = np.maximum(np.sum(of_voters, axis=0) - of_cells[cells[here]], 0.0)
        by_others = others + SHAPE_ODDS
        by_others /= np.sum(by_others, axis=1, keepdims=True)
        product = ((1 - ANOTHER) * by_others + ANOTHER * SHAPE_ODDS) * by_row[here]
        shares[here] = product / np.sum(product, axis=1, keepdims=True)
    return shares
