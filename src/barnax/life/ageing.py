"""Ageing of the cells in a fleet's dataset: trends with intervals, and outlying cells."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from jaxtyping import Float

from ..errors import InputError, listed
from ..fit.ageing import CAPACITY, R0, SHIFT, R
from ..fit.registration import REACH
from .rows import ages_of, ampere_hours, with_pooled_shapes
from .trends import Judged, Series, judge

QUANTITIES = (CAPACITY, R0, R, SHIFT)
# Columns tried by default for the age of a cell, and for its name.
AGES = ("date", "age", "year", "month", "week", "day", "cycle", "efc", "throughput")
NAMES = ("specimen", "cell_name", "name", "serial", "cell_id")
# Years per unit of time; for other quantities, the number of units judged like a year.
YEARS = {"year": 1.0, "month": 1 / 12, "week": 7 / 365.25, "day": 1 / 365.25}
CYCLES_A_YEAR = 365.0
# Lithium-ion cells are hardly older than this.
MOST_YEARS = 40
# Fewer cells do not define an outlier; covariates that vary by less are not informative.
FEWEST, LEAST_K = 8, 2.0
# Errors of up to this many OCVs are separated over the whole fleet; those of more, within each
# cell.
MOST_OCVS = 8
# Common errors that add less than this share of the largest are left out.
LEAST_ERROR = 0.02
OCV = "aged beside OCV"
# The cells for which a quantity is known, and their model.
Fleet = tuple[tuple[str, ...], Judged]
TO_EMPTY = "aged capacity to empty"


@dataclass(frozen=True)
class Trend:
    """A quantity of a cell at the ages of its records: the estimate from each, and the smooth
    trend, both with 95 % intervals, and at the reference temperature if there is one. It is NaN for
    a record that does not determine it, and the trend is NaN before the first and after the last
    that do."""

    cell: str
    quantity: str
    age: Float[np.ndarray, "n"]
    measured: Float[np.ndarray, "n 3"]
    smooth: Float[np.ndarray, "n 3"]

    @property
    def estimates(self) -> int:
        """Number of records that determine it."""
        return int(np.count_nonzero(np.isfinite(self.measured[:, 0])))


@dataclass(frozen=True)
class Fault:
    """A cell's departure from the fleet in a quantity: its first age and its size, in the
    quantity's unit, or as a share for capacity and resistances; `slope` and `knee` per unit of
    age."""

    cell: str
    quantity: str
    kind: str
    age: float
    size: float
    deviations: float


@dataclass(frozen=True)
class Life:
    """A fleet over its ages, which are counted in `unit` from the first. `judged` has the models,
    by quantity. `cycles` are equivalent full cycles of each cell at its last record, if
    `counts_cycles`; otherwise those within the records only. `without_empty` counts the rows whose
    capacity no record from full to a rest near empty determines, `without_age` those left out for
    lack of a name or an age; `twice` are rows of one cell at one age."""

    unit: str
    first_age: float
    span: float
    exposure: float
    false_alarms: float
    cells: tuple[str, ...]
    trends: tuple[Trend, ...]
    faults: tuple[Fault, ...]
    judged: dict[str, Fleet]
    reference_degc: float | None
    cycles: dict[str, float]
    counts_cycles: bool
    failed: tuple[tuple[str, str], ...]
    rows: int
    without_empty: int
    without_age: int
    twice: tuple[str, ...]

    def of(self, quantity: str, cell: str | None = None) -> list[Trend]:
        """Trends of a quantity, for all cells or one."""
        return [
            trend for trend in self.trends
            if trend.quantity == quantity and cell in (None, trend.cell)
        ]  # fmt: skip

    def along(self, trend: Trend, count: int = 80) -> tuple[np.ndarray, np.ndarray]:
        """Ages, and the trend with its interval between the first and the last estimate."""
        names, judged = self.judged[trend.quantity]
        ages = trend.age[np.isfinite(trend.measured[:, 0])]
        age = np.linspace(ages.min(), ages.max(), count)
        at = (age - self.first_age) / self.span
        return age, _smooth(judged, names.index(trend.cell), at, trend.quantity)


def life_of(
    rows: pl.DataFrame,
    age: str | None = None,
    by: str | None = None,
    throughput: str | None = None,
    false_alarms: float = 0.005,
    key: int = 0,
) -> Life:
    """A fleet's ageing from its dataset.

    Args:
        rows: Rows of a fleet identified with `ageing`.
        age: Column with dates, or with ages in days, months, years, cycles or ampere-hours.
        by: Column that names the cell of a row.
        throughput: Column with the ampere-hours passed since the cell was new.
        false_alarms: Expected number of false alarms per cell and year.
        key: Random key for the fleets without faults that set the threshold.

    Raises `InputError` if a column is missing or cannot be recognized by its name, if a value is
    not an age, and if all rows have one age.
    """
    if OCV not in rows.columns:
        raise InputError("the dataset says nothing of ageing; identify the fleet with `ageing`")
    names, ages = _column(rows, by, NAMES, "by"), _column(rows, age, AGES, "age")
    at, unit = ages_of(rows[ages], ages)
    years = YEARS.get(unit, 1 / CYCLES_A_YEAR)
    if unit in YEARS and (np.nanmax(at) - np.nanmin(at)) * years > MOST_YEARS:
        first_row, last_row = int(np.nanargmin(at)), int(np.nanargmax(at))
        raise InputError(
            f"`age` {ages}: {rows[ages][first_row]} in row {first_row + 1} and "
            f"{rows[ages][last_row]} in row {last_row + 1} are more than {MOST_YEARS} years apart; "
            "correct the wrong one, or leave it empty"
        )
    rows = rows.with_columns(pl.col(names).cast(pl.String), pl.Series("_age", at))
    without_age = len(rows)
    rows = rows.filter(pl.col(names).is_not_null() & pl.col("_age").is_not_nan()).sort("_age")
    without_age -= len(rows)
    bad = rows.filter(pl.col("error").is_not_null())
    good = rows.filter(pl.col("error").is_null())
    if not len(good):
        raise InputError("no row of the dataset was identified; see the column error")
    twice = good.filter(pl.struct(names, "_age").is_duplicated())
    cells = tuple(good[names].unique().sort())
    good = with_pooled_shapes(good, names, "_age", QUANTITIES)
    first, last = float(good["_age"].min()), float(good["_age"].max())  # pyrefly: ignore
    span = last - first
    if not span:
        raise InputError(f"`age` {ages}: all rows are of one age; give ages that differ")
    degc = good["temperature [degC]"].drop_nulls().to_numpy()
    has_degc = len(degc) == len(good) and np.ptp(degc) > LEAST_K
    reference_degc = float(np.median(degc)) if has_degc else None
    warmer = (good["temperature [degC]"] - reference_degc) / 10 if has_degc else pl.lit(0.0)
    good = good.with_columns(_at=(pl.col("_age") - first) / span, _warmer=warmer)
    passed_ah = good["_age"] if unit == "A.h" else None
    if throughput is not None:
        passed_ah = ampere_hours(good[_column(good, throughput, (), "throughput")], throughput)
    good = good.with_columns(_passed=passed_ah)
    by_cell = {name: good.filter(pl.col(names) == name) for name in cells}
    spans = [float(np.ptp(rows["_age"].to_numpy())) for rows in by_cell.values()]
    nominal_ah = {name: float(rows["capacity [A.h]"][0]) for name, rows in by_cell.items()}
    if unit == "A.h":
        years = 1 / (CYCLES_A_YEAR * 2 * float(np.median([*nominal_ah.values()])))
    expected = false_alarms * years * sum(spans) / len(QUANTITIES)
    trends, faults, judged = [], [], {}
    for quantity in QUANTITIES:
        fleet = _judged(by_cell, quantity, expected, np.random.default_rng(key))
        if fleet is not None:
            judged[quantity] = fleet
            faults += _faults(quantity, *fleet, first, span)
        trends += _trends(by_cell, quantity, fleet)
    capacities = good.filter(pl.col(f"aged {CAPACITY}").is_not_null())
    without_empty = len(capacities)
    if TO_EMPTY in capacities.columns:
        without_empty -= int(capacities[TO_EMPTY].cast(pl.Boolean).sum() or 0)
    passed = {name: float(rows["record throughput [A.h]"].sum()) for name, rows in by_cell.items()}
    if passed_ah is not None:
        passed = {name: _last_passed_ah(rows, name, throughput) for name, rows in by_cell.items()}
    return Life(
        unit, first, span, sum(spans) * years, false_alarms, cells, tuple(trends),
        tuple(sorted(faults, key=lambda fault: -abs(fault.deviations))), judged, reference_degc,
        {name: ah / (2 * nominal_ah[name]) for name, ah in passed.items()},
        passed_ah is not None,
        tuple(zip(bad[names], bad["error"], strict=True)), len(rows),
        without_empty, without_age, tuple(twice["id"].cast(pl.String)),
    )  # fmt: skip


def _last_passed_ah(rows: pl.DataFrame, cell: str, throughput: str | None) -> float:
    """The ampere-hours since new from the last row of a cell that has any."""
    passed_ah = rows["_passed"].drop_nulls().to_list()
    if not passed_ah:
        raise InputError(f"`throughput` {throughput}: no row of {cell} has ampere-hours there")
    return float(passed_ah[-1])


def _column(rows: pl.DataFrame, chosen: str | None, usual: Iterable[str], option: str) -> str:
    """The chosen column, else the first with a usual name."""
    measured = re.compile(r"id|record throughput \[A\.h\]|aged .*")
    columns = [name for name in rows.columns if not measured.fullmatch(name)]
    usual_columns = [name for start in usual for name in columns if name.lower().startswith(start)]
    if chosen in rows.columns or (chosen is None and usual_columns):
        return chosen or usual_columns[0]
    raise InputError(
        f"`{option}` {chosen or 'is not given'}: no such column; the dataset has {listed(columns)}"
    )


def _judged(
    by_cell: dict[str, pl.DataFrame], quantity: str, expected: float, rng: np.random.Generator
) -> Fleet | None:
    """The cells for which a quantity is known, and their model; None if there are none."""
    is_given = pl.col(f"aged {quantity}").is_not_null()
    given = {name: rows.filter(is_given) for name, rows in by_cell.items()}
    given = {name: rows for name, rows in given.items() if len(rows)}
    if not given:
        return None
    series = _series(given, quantity)
    is_enough = np.count_nonzero(series.is_estimate.sum(axis=1) > 2) >= FEWEST
    return tuple(given), judge(series, expected if is_enough else 0.0, rng)


def _series(by_cell: dict[str, pl.DataFrame], quantity: str) -> Series:
    """The estimates of a quantity. If they depend on an OCV, its error is common to all estimates
    made with it."""
    shape = len(by_cell), max(map(len, by_cell.values()))
    ocvs = sorted({ocv or "" for rows in by_cell.values() for ocv in rows[OCV]})
    sizes = {
        size for rows in by_cell.values() for size in rows[f"aged {quantity} by OCV"].list.len()
    }
    is_few, width = len(ocvs) <= MOST_OCVS, max(sizes)
    series = Series(
        age=np.zeros(shape),
        value=np.zeros(shape),
        variance=np.zeros(shape),
        is_estimate=np.zeros(shape, bool),
        covariate=np.zeros(shape),
        of_fleet=np.zeros((*shape, width * len(ocvs) if is_few else 0)),
        of_cell=np.zeros((*shape, 0 if is_few else width)),
    )
    for index, rows in enumerate(by_cell.values()):
        here = index, slice(len(rows))
        measured = _measured(rows, quantity)
        numbers = measured if quantity == SHIFT else np.log(measured)
        by_ocv = np.array(rows[f"aged {quantity} by OCV"].to_list())
        if quantity != SHIFT:
            by_ocv = by_ocv / measured[:, :1]
        series.age[here], series.is_estimate[here] = rows["_at"].to_numpy(), True
        series.value[here] = numbers[:, 0]
        variance = ((numbers[:, 2] - numbers[:, 1]) / (2 * REACH)) ** 2
        series.variance[here] = np.maximum(variance - np.sum(by_ocv**2, axis=1), 0.0)
        beside = rows[OCV].to_numpy()[:, None] == np.array(ocvs)
        apart = (beside[:, :, None] * by_ocv[:, None, :]).reshape(len(rows), -1)
        (series.of_fleet if is_few else series.of_cell)[here] = apart if is_few else by_ocv
        if quantity in (R0, R):
            series.covariate[here] = rows["_warmer"].to_numpy()
    return replace(series, of_fleet=_condensed(series.of_fleet))


def _condensed(errors: Float[np.ndarray, "cells n errors"]) -> Float[np.ndarray, "cells n few"]:
    """Fewer errors with the same effect on all estimates, without those of hardly any effect."""
    if not errors.size:
        return errors
    turned, sizes, _ = np.linalg.svd(errors.reshape(-1, errors.shape[2]), full_matrices=False)
    kept = sizes > LEAST_ERROR * sizes[0]
    return (turned * sizes)[:, kept].reshape(*errors.shape[:2], -1)


def _faults(
    quantity: str, names: tuple[str, ...], judged: Judged, first: float, span: float
) -> Iterator[Fault]:
    for index, shape in judged.faults.items():
        by_age = span if shape.kind in ("slope", "knee") else 1.0
        yield Fault(
            names[index], quantity, shape.kind, first + span * shape.age, shape.size / by_age,
            shape.deviations,
        )  # fmt: skip


def _trends(
    by_cell: dict[str, pl.DataFrame], quantity: str, fleet: Fleet | None
) -> Iterator[Trend]:
    for name, rows in by_cell.items():
        age, measured = rows["_age"].to_numpy(), _measured(rows, quantity)
        smooth = np.full_like(measured, np.nan)
        ages = age[np.isfinite(measured[:, 0])]
        if len(ages) and fleet is not None:
            (names, judged), inside = fleet, (age >= ages.min()) & (age <= ages.max())
            index = names.index(name)
            smooth[inside] = _smooth(judged, index, rows["_at"].to_numpy()[inside], quantity)
            if quantity != SHIFT:
                to_reference = np.exp(-judged.fit.covariate_part(index))
                measured[np.isfinite(measured[:, 0])] *= to_reference[:, None]
        yield Trend(name, quantity, age, measured, smooth)


def _smooth(judged: Judged, index: int, age: np.ndarray, quantity: str) -> np.ndarray:
    value, error = judged.fit.trend(index, age)
    band = np.stack([value, value - REACH * error, value + REACH * error], axis=1)
    return band if quantity == SHIFT else np.exp(band)


def _measured(rows: pl.DataFrame, quantity: str) -> np.ndarray:
    columns = (f"aged {quantity}{end}" for end in ("", " low", " high"))
    return np.stack(
        [rows[column].cast(pl.Float64).fill_null(np.nan).to_numpy() for column in columns], 1
    )
