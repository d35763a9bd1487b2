"""A fleet as a whole: distributions, outliers, failures, and the worst fits."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from ..errors import REFUSED
from ..files import located
from ..metrics import TO_SD
from .dataset import read_rows, rows_of_others

# Columns summarized for every circuit, by the beginning of their names, without the intervals.
SUMMED_UP = re.compile(r"((tables )?R\d \[Ohm\]|tau\d \[s\]|gamma|(validation )?RMSE \[V\])$")
# A value this many robust deviations from the median is an outlier, in the logarithm: parameters
# and errors are positive. With fewer cells there are no outliers.
OUTLYING = 5.0
FEWEST = 8
# A median absolute deviation below this is rounding.
LEAST_SD = 1e-6
WORST = 10


@dataclass(frozen=True)
class Distribution:
    """One quantity over the cells of one circuit, in `at_bound` of which it is at a bound.

    `sd_log` is the robust standard deviation of its logarithm.
    """

    circuit: str
    name: str
    cells: int
    at_bound: int
    low: float
    median: float
    high: float
    sd_log: float


@dataclass(frozen=True)
class Outlier:
    """A cell far from the others: by `deviations` robust ones, negative below the median."""

    id: str
    name: str
    value: float
    median: float
    deviations: float


@dataclass(frozen=True)
class Cause:
    """Cells with the same failure or warning, in the words of the first; numbers differ."""

    text: str
    ids: tuple[str, ...]


@dataclass(frozen=True)
class Summary:
    """A whole fleet in numbers. `worst` are the cells with the largest RMSE, the worst first."""

    cells: int
    identified: int
    certified: int
    at_bound: int
    distributions: tuple[Distribution, ...]
    outliers: tuple[Outlier, ...]
    failures: tuple[Cause, ...]
    warnings: tuple[Cause, ...]
    worst: tuple[tuple[str, float], ...]


def read_fleet(out: str | Path, ids: Iterable[str] | None = None) -> pl.DataFrame:
    """The rows of a fleet's folder, finished or not, one per cell.

    Args:
        out: Folder of the dataset, from any author unless `ids` are given.
        ids: The cells to read; by default all.

    Raises `InputError` if a file is broken, or unpacks to far more than a fleet's do.
    """
    if ids is None:
        return rows_of_others(located(out))
    rows, wanted = read_rows(located(out)), [*ids]
    is_wanted = pl.col("id").is_in(wanted)
    if "pack" in rows.columns:
        is_wanted |= pl.col("pack").is_in(wanted)
    return rows.filter(is_wanted)


def summarize(rows: pl.DataFrame) -> Summary:
    """The summary of rows.

    Args:
        rows: Rows of a dataset.
    """
    failed = rows.filter(pl.col("error").is_not_null())
    good = rows.filter(pl.col("error").is_null())
    failures = _causes(failed, "error", "error code")
    if not len(good):
        return Summary(len(rows), 0, 0, 0, (), (), failures, (), ())
    distributions: list[Distribution] = []
    outliers: list[Outlier] = []
    for (circuit,), group in good.group_by("circuit", maintain_order=True):
        for name in summed_up(group):
            positive = group.filter(pl.col(name).is_finite() & (pl.col(name) > 0))
            if len(positive):
                distribution, far = _distribution(str(circuit), name, positive)
                distributions.append(distribution)
                outliers += far
    worst = good.sort("RMSE [V]", descending=True).head(WORST)
    warned = good.explode("warnings", "warning codes").drop_nulls("warnings")
    return Summary(
        cells=len(rows),
        identified=len(good),
        certified=int(good["certified"].sum()),
        at_bound=int((good["at bound"] != "").sum()),
        distributions=tuple(distributions),
        outliers=tuple(sorted(outliers, key=lambda outlier: -abs(outlier.deviations))),
        failures=failures,
        warnings=_causes(warned, "warnings", "warning codes"),
        worst=tuple(zip(worst["id"], worst["RMSE [V]"], strict=True)),
    )


def summed_up(rows: pl.DataFrame) -> list[str]:
    """The columns that are summarized and contain any value."""
    return [
        name for name in rows.columns
        if SUMMED_UP.match(name) and rows[name].null_count() < len(rows)
    ]  # fmt: skip


def _distribution(
    circuit: str, name: str, rows: pl.DataFrame
) -> tuple[Distribution, list[Outlier]]:
    values = rows[name].to_numpy()
    logarithms = np.log(values)
    median = float(np.median(logarithms))
    sd = TO_SD * float(np.median(np.abs(logarithms - median)))
    low, middle, high = np.quantile(values, [0.05, 0.5, 0.95]).tolist()
    is_bound = rows["at bound"].str.contains(name, literal=True)
    distribution = Distribution(
        circuit, name, len(values), int(is_bound.sum()), low, middle, high, sd
    )
    if len(values) < FEWEST or sd < LEAST_SD:
        return distribution, []
    deviations = (logarithms - median) / sd
    return distribution, [
        Outlier(rows["id"][index], name, float(values[index]), middle, float(deviations[index]))
        for index in np.flatnonzero(np.abs(deviations) > OUTLYING).tolist()
    ]


def _causes(rows: pl.DataFrame, text: str, code: str) -> tuple[Cause, ...]:
    """Causes, the most frequent first: one for all texts of one code that differ only in names and
    numbers."""
    causes: dict[str, tuple[str, list[str]]] = {}
    for name, said, kind in rows.select("id", text, code).iter_rows():
        # Without the file's name.
        cause = re.sub(r"^[^:]*\.\w+: ", "", said)
        shape = re.sub(r"\b\d+(\.\d+)?|'[^']*'", "#", cause)
        # A message without its own code is grouped by its words alone.
        key = shape if kind in (None, REFUSED) else f"{kind}: {shape}"
        causes.setdefault(key, (cause, []))[1].append(name)
    causes_by_count = [Cause(cause, tuple(dict.fromkeys(ids))) for cause, ids in causes.values()]
    return tuple(sorted(causes_by_count, key=lambda failure: -len(failure.ids)))
