"""Metrics, circuits and comparisons as tables."""

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING

from ..plots.style import readable
from .comparison_sentences import (
    NARROW,
    answered,
    bound_places,
    differences_on,
    errors_on,
    leaders,
    ranked,
    records,
    rmse_on,
)
from .document import Item, Table, make_table
from .words import NOTHING, figures, fixed, joined, significant

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..comparison.result import DifferencePart, RowPart
    from ..results import MetricsPart

Cells = dict[str, Callable[[Item], str]]

METRICS: "Cells[MetricsPart]" = {
    "RMSE [mV]": lambda each: _millivolts(each.rmse_v),
    "R2": lambda each: fixed(each.r2, 4),
    "R2 (paper)": lambda each: fixed(each.r2_paper, 4),
    "MAPE [%]": lambda each: fixed(each.mape_percent, 3),
    "CE [V]": lambda each: fixed(each.ce_v, 2),
    "max [mV]": lambda each: fixed(1e3 * each.max_v, 1),
    "samples": lambda each: str(each.samples),
}


def circuits_table(
    caption: str,
    circuits: Mapping[str, Mapping[str, float]],
    further: Cells[str],
    first: str = "row",
) -> Table:
    """Circuits by their names under `first`, a dash where one has not got a parameter.

    `further` columns follow, filled by what they give for a name.
    """
    values = {name: readable(parameters) for name, parameters in circuits.items()}

    def of_circuit(head: str) -> Callable[[str], str]:
        return lambda name: figures(values[name].get(head), 4)

    heads = sorted(dict.fromkeys(chain.from_iterable(values.values())), key=_order)
    cells = {first: str, **{head: of_circuit(head) for head in heads}, **further}
    return make_table(caption, circuits, cells, [first])


def _order(head: str) -> tuple[str, int]:
    """R0, R1, C1, tau1, R2, ...: pair by pair, what has no pair last."""
    symbol = head.split()[0]
    kinds = ("R", "C", "tau")
    kind = symbol.rstrip("0123456789")
    number = symbol[len(kind) :]
    return (number or "9", kinds.index(kind) if kind in kinds else len(kinds))


# With more pairs than these only those are shown that a reader asks for first.
ALL_PAIRS = 15
NARROW_MARK = "†"


def parameters_table(result: "ComparisonResult") -> Table:
    """Every row's own parameters and time constants (Li et al., 2023, Table 3)."""
    rows = answered(result)
    caption = "Parameters and time constants of each row's median seed, not refined."
    bounds = [f"{place}." for place in bound_places(result)]
    return circuits_table(
        " ".join([caption, *bounds]),
        {row.name: row.parameters or {} for row in rows},
        {},
    )


def refined_table(result: "ComparisonResult") -> Table:
    """Every row's median seed after Levenberg-Marquardt."""
    rows = {row.name: row for row in answered(result) if row.refined_parameters is not None}
    return circuits_table(
        "The same after Levenberg-Marquardt has refined the median seed in the same box.",
        {name: row.refined_parameters or {} for name, row in rows.items()},
        {"RMSE [mV]": lambda name: _millivolts(rows[name].refined_rmse_v)},
    )


def errors_table(result: "ComparisonResult", record: int) -> Table:
    """Errors of every row's own answer on one record (Li et al., 2023, Tables 4 and 5)."""
    rows = answered(result)
    best = leaders(rows, record)
    what = "identification record" if record == 0 else "validation record"

    def of_row(cell: "Callable[[MetricsPart], str]") -> "Callable[[RowPart], str]":
        return lambda row: cell(errors_on(row, record).metrics)

    cells = {head: of_row(cell) for head, cell in METRICS.items()}
    return make_table(
        f"Errors on {records(result)[record]}, {what}. Bold: the lowest RMSE.",
        rows,
        {"row": lambda row: row.name, **cells},
        ["row"],
        [(place, 1) for place, row in enumerate(rows) if row in best],
    )


def search_table(result: "ComparisonResult", seconds: Mapping[str, float] | None = None) -> Table:
    """What every row's search gave and cost on the identification record."""
    rows = answered(result)
    has_gap = any(row.optimality_gap is not None for row in rows)
    gap: Cells[RowPart] = {"gap [%]": lambda row: _percents(row.optimality_gap)}
    time: Cells[RowPart] = {"time [s]": lambda row: fixed((seconds or {}).get(row.name), 2)}
    cells: Cells[RowPart] = {
        "row": lambda row: row.name,
        "median [mV]": lambda row: _millivolts(rmse_on(row, 0)),
        "best [mV]": lambda row: _millivolts(row.spread and row.spread.best_rmse_v),
        "worst [mV]": lambda row: _millivolts(row.spread and row.spread.worst_rmse_v),
        "SD [mV]": lambda row: _millivolts(row.spread and row.spread.deviation_v),
        **(gap if has_gap else {}),
        "refined [mV]": lambda row: _millivolts(row.refined_rmse_v),
        "seeds": lambda row: str(len(row.seeds)),
        "evaluations": lambda row: NOTHING if row.evaluations is None else str(row.evaluations),
        **(time if seconds else {}),
    }
    caption = (
        "RMSE of the median, best and worst seed on the identification record, with the standard "
        "deviation (SD) over the seeds"
        + ("; optimality gap of the median seed" if has_gap else "")
        + "; the median seed after refinement; evaluations of the median seed"
        + (", and the time of all seeds, compilation included." if seconds else ".")
    )
    return make_table(caption, rows, cells, ["row"])


def bands_table(result: "ComparisonResult", record: int) -> Table:
    """Errors by state of charge on one record, for the bands that hold any sample."""
    rows = answered(result)
    cells: Cells[RowPart] = {"row": lambda row: row.name}
    samples = []

    def of_band(place: int, name: str) -> "Callable[[RowPart], str]":
        return lambda row: _millivolts(getattr(errors_on(row, record).bands[place], name))

    for place, band in enumerate(errors_on(rows[0], record).bands):
        if band.samples:
            head = f"{100 * band.low_soc:g}–{100 * band.high_soc:g} %"
            samples.append(f"{band.samples} in {head}")
            cells[f"{head} RMSE [mV]"] = of_band(place, "rmse_v")
            cells[f"{head} mean [mV]"] = of_band(place, "mean_v")
    caption = (
        f"Errors on {records(result)[record]} by state of charge: RMSE and mean of measured minus "
        f"simulated voltage. Samples: {joined(samples)}."
    )
    return make_table(caption, rows, cells, ["row"])


def differences_table(result: "ComparisonResult", record: int) -> Table:
    """The differences between rows on one record, and whether each is more than chance."""
    rows = answered(result)
    found = differences_on(result, record)
    note = ""
    if len(found) > ALL_PAIRS:
        leader = ranked(rows, record)[0].name
        found = [each for each in found if _is_asked_for(each, leader, rows)]
        note = " Shown are the pairs with the leader and those of one method."
    if any(each.over_time.is_block_capped for each in found):
        note += f" {NARROW_MARK}: {NARROW}."
    has_seeds = any(each.over_seeds is not None for each in found)
    cells: Cells[DifferencePart] = {
        "first": lambda each: each.first,
        "second": lambda each: each.second,
        "difference [mV]": lambda each: _millivolts(each.over_time.difference_v),
        "from [mV]": lambda each: _millivolts(each.over_time.interval_v[0]),
        "to [mV]": lambda each: _millivolts(each.over_time.interval_v[1]),
        "significant": lambda each: (
            ("yes" if each.over_time.is_real else "no")
            + (NARROW_MARK if each.over_time.is_block_capped else "")
        ),
    }
    if has_seeds:
        cells["wins–losses"] = lambda each: (
            f"{each.over_seeds.wins}–{each.over_seeds.losses}" if each.over_seeds else NOTHING
        )
        cells["p"] = lambda each: significant(each.over_seeds and each.over_seeds.p_value, 2)
    caption = (
        f"Differences of RMSE on {records(result)[record]}, first row minus second, with the 95 % "
        "interval of a moving-block bootstrap over time"
        + ("; seeds won and lost by the first row, and Wilcoxon's p." if has_seeds else ".")
        + note
    )
    return make_table(caption, found, cells, ["first", "second", "significant"])


def methods_table(result: "ComparisonResult") -> Table:
    """Where every method comes from."""
    sources = {row.method: row.source for row in result.rows}
    return pairs_table("The methods.", "method", "source", sources)


def failures_table(result: "ComparisonResult") -> Table:
    """The rows without an answer."""
    failures = {row.name: row.failure for row in result.rows if row.failure is not None}
    return pairs_table("Rows without an answer.", "row", "why", failures)


def pairs_table(caption: str, name: str, value: str, pairs: Mapping[str, str]) -> Table:
    """Names and what is said of each, both in words."""
    return make_table(caption, pairs, {name: str, value: lambda each: pairs[each]}, [name, value])


def _is_asked_for(each: "DifferencePart", leader: str, rows: "Sequence[RowPart]") -> bool:
    methods = {row.name: row.method for row in rows}
    return leader in (each.first, each.second) or methods[each.first] == methods[each.second]


def _millivolts(value_v: float | None) -> str:
    return fixed(None if value_v is None else 1e3 * value_v, 3)


def _percents(ratio: float | None) -> str:
    """A ratio in percent, two digits or all before the point."""
    value = None if ratio is None else 100 * ratio
    return fixed(value, 0) if value and abs(value) >= 10 else significant(value, 2)
