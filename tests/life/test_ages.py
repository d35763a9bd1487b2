"""Ages of rows: dates however they are written, units, and what is left out or refused."""

import datetime

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax.errors import InputError
from barnax.life import life_of
from barnax.life.rows import ages_of
from barnax.reporting.life import life_lines

from .test_ageing import dataset

UTC = datetime.UTC
DATES = st.datetimes(datetime.datetime(2001, 9, 10), datetime.datetime(2099, 12, 31))
WRITTEN = {
    "ISO texts": lambda one: one.isoformat(),
    "texts with a time zone": lambda one: (
        one.replace(tzinfo=UTC)
        .astimezone(datetime.timezone(datetime.timedelta(hours=-7)))
        .isoformat()
    ),
    "dates": lambda one: one,
    "seconds since 1970": lambda one: one.replace(tzinfo=UTC).timestamp(),
    "milliseconds since 1970": lambda one: round(one.replace(tzinfo=UTC).timestamp() * 1e3),
    "numbers as texts": lambda one: str(one.replace(tzinfo=UTC).timestamp()),
}


@given(dates=st.lists(DATES, min_size=2, max_size=5), how=st.sampled_from([*WRITTEN]))
def test_dates_are_the_same_however_they_are_written(dates, how):
    days, unit = ages_of(pl.Series([WRITTEN[how](one) for one in dates]), "date")
    expected = [(one - min(dates)).total_seconds() / 86_400 for one in dates]
    assert unit == "day"
    np.testing.assert_allclose(days, expected, atol=1e-6)


@given(dates=st.lists(DATES, min_size=2, max_size=5), kind=st.sampled_from([int, float, str]))
def test_compact_dates_are_dates_and_no_numbers(dates, kind):
    column = pl.Series([kind(one.strftime("%Y%m%d")) for one in dates])
    days, unit = ages_of(column, "date")
    expected = [(one.date() - min(dates).date()).days for one in dates]
    assert (days.tolist(), unit) == (expected, "day")


@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [
        ("age [h]", 1 / 24, "day"),
        ("age", 1.0, "day"),
        ("ncycles", 1.0, "cycle"),
        ("throughput [mAh]", 1e-3, "A.h"),
        ("age_yrs", 1.0, "year"),
        # A zone of dates is no unit.
        ("date (utc)", 1.0, "day"),
    ],
)
def test_a_unit_in_the_name_counts(name, factor, unit):
    ages, told_unit = ages_of(pl.Series([0, 10, 480]), name)
    np.testing.assert_allclose(ages, factor * np.array([0, 10, 480]))
    assert told_unit == unit


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (["2024-01-15", "12.5"], "row 2 is '12.5'; give a number in every row, or a date"),
        ([2020.5, 2021.0], "2020.5 may be a year or a day"),
        ([20240115, 20240231], "row 2 is '2024-02-31'"),
        ([float("nan"), None], "no row has a finite age"),
        ([20240115, 20240301, 0], "row 2 is 20240301, which is neither"),
        ([1.7e9, 0.0, 1.7e9 + 86_400], "row 3 is 1700086400, which is neither"),
        # They are no milliseconds since 1970, which would be in the year 2611.
        ([20240115120000, 20240116120000], "row 2 is 2.02401161.*, which is neither"),
        ([None, datetime.timedelta(days=3)], "row 2 is '3 days.*'; give a number in every row"),
        ([True, False], "row 1 is 'True'; give a number"),
    ],
)
def test_what_is_neither_or_may_be_either_is_refused(values, message):
    with pytest.raises(InputError, match=message):
        ages_of(pl.Series(values), "date")


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("age_quarters", range(15), "quarters is no unit of an age; there are s, min, h, d"),
        ("age [m]", range(15), "m is no unit of an age"),
        ("age", [3.0] * 15, "all rows are of one age"),
        # A date that stands for none.
        ("date", ["1970-01-01"] + 14 * ["2022-01-01"], "1970-01-01 in row 1 and 2022-01-01 in r"),
    ],
)
def test_a_column_that_gives_no_ages_is_refused(name, values, message):
    frame = dataset(cells=3).with_columns(pl.Series(name, values))
    with pytest.raises(InputError, match=message):
        life_of(frame, age=name)


def test_rows_without_a_finite_age_are_counted_and_those_of_one_age_named():
    ages = [float("nan"), float("inf"), 24.0, 24.0, None, *(24.0 * k for k in range(1, 11))]
    life = life_of(dataset(cells=3).with_columns(pl.Series("age [h]", ages)), age="age [h]")
    lines = life_lines(life)
    assert "Left out: 3 rows without a finite age or a cell." in lines
    assert "Several rows of a cell at the same age, all counted: 0-2, 0-3." in lines
    assert (life.rows, life.unit, life.span) == (15 - 3, "day", 9.0)


@pytest.mark.parametrize("none", ["nan", "NaN", "inf", ""])
def test_a_text_that_stands_for_no_number_is_no_age(none):
    days, _ = ages_of(pl.Series(["2024-01-15", none, "2024-01-25"]), "date")
    np.testing.assert_array_equal(days, [0.0, np.nan, 10.0])
