"""Metrics, circuits and comparisons as tables."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from ..plots.style import readable
from .comparison_sentences import NARROW, answered, errors_on, leaders, ranked, records, rmse_on
from .document import Column, Table
from .words import NOTHING, bound_words, fixed, joined, significant

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..comparison.result import DifferencePart, RowPart
    from ..results import MetricsPart


METRICS = (
    Column("RMSE", "mV"),
    Column("R2"),
    Column("R2 (paper)"),
    Column("MAPE", "%"),
    Column("CE", "V"),
    Column("max", "mV"),
    Column("samples"),
)


def metrics_cells(metrics: "MetricsPart") -> tuple[str, ...]:
    """One record's metrics under the columns `METRICS`."""
    return (
        f"{1e3 * metrics.rmse_v:.3f}",
        f"{metrics.r2:.5f}",
        f"{metrics.r2_paper:.5f}",
        f"{metrics.mape_percent:.3f}",
        f"{metrics.ce_v:.2f}",
        f"{1e3 * metrics.max_v:.1f}",
        str(metrics.samples),
    )


ROW = Column("row", role="text")


def circuits_table(
    caption: str,
    circuits: Mapping[str, Mapping[str, float]],
    further: tuple[Column, ...],
    cells: Callable[[str], tuple[str, ...]],
    first: Column = ROW,
) -> Table:
    """Circuits by their names under `first`, a dash where one has not got a parameter.

    `further` columns follow, filled by what `cells` gives for a name.
    """
    values = {name: readable(parameters) for name, parameters in circuits.items()}
    heads = sorted({head for each in values.values() for head in each}, key=_order)
    return Table(
        caption=caption,
        columns=(first, *(_column(head) for head in heads), *further),
        rows=tuple(
            (name, *(significant(each.get(head)) for head in heads), *cells(name))
            for name, each in values.items()
        ),
    )


def _order(head: str) -> tuple[str, int]:
    """R0, R1, C1, tau1, R2, ...: pair by pair, what has no pair last."""
    symbol = head.split()[0]
    kinds = ("R", "C", "tau")
    kind = symbol.rstrip("0123456789")
    number = symbol[len(kind) :]
    return (number or "9", kinds.index(kind) if kind in kinds else len(kinds))


def _column(head: str) -> Column:
    name, _, unit = head.partition(" ")
    return Column(name, unit.strip("[]"))


# With more pairs than these only those are shown that a reader asks for first.
ALL_PAIRS = 15
NARROW_MARK = "†"


def parameters_table(result: "ComparisonResult") -> Table:
    """Every row's own parameters and time constants (Li et al., 2023, Table 3)."""
    rows = answered(result)
    bounds = {
        row.name: "; ".join(bound_words(each.name, each.side) for each in row.at_bound)
        for row in rows
    }
    return circuits_table(
        "Parameters and time constants of each row's median seed, not refined.",
        {row.name: row.parameters or {} for row in rows},
        (Column("at a bound", role="text"),),
        lambda name: (bounds[name] or NOTHING,),
    )


def refined_table(result: "ComparisonResult") -> Table:
    """What Levenberg-Marquardt makes of every row's median seed."""
    rows = [row for row in answered(result) if row.refined_parameters is not None]
    refined_v = {row.name: row.refined_rmse_v for row in rows}
    return circuits_table(
        "The same after Levenberg-Marquardt has refined the median seed in the same box.",
        {row.name: row.refined_parameters or {} for row in rows},
        (Column("RMSE", "mV"),),
        lambda name: (_millivolts(refined_v[name]),),
    )


def errors_table(result: "ComparisonResult", record: int) -> Table:
    """Errors of every row's own answer on one record (Li et al., 2023, Tables 4 and 5)."""
    rows = answered(result)
    best = leaders(rows, record)
    what = "identified on" if record == 0 else "that no row has seen"
    return Table(
        caption=f"Errors on {records(result)[record]}, the record {what}. Bold: the lowest RMSE.",
        columns=(ROW, *METRICS),
        rows=tuple((row.name, *metrics_cells(errors_on(row, record).metrics)) for row in rows),
        best=frozenset((place, 1) for place, row in enumerate(rows) if row in best),
    )


def search_table(result: "ComparisonResult", seconds: Mapping[str, float] | None = None) -> Table:
    """What every row's search gave and cost on the identification record."""
    rows = answered(result)
    has_gap = any(row.optimality_gap is not None for row in rows)
    columns = (
        ROW,
        Column("median", "mV"),
        Column("best", "mV"),
        Column("worst", "mV"),
        Column("deviation", "mV"),
        *((Column("optimality gap", "%"),) if has_gap else ()),
        Column("refined", "mV"),
        Column("seeds"),
        Column("evaluations"),
        *((Column("time", "s"),) if seconds else ()),
    )
    return Table(
        caption="RMSE of the median, best and worst seed on the record identified on, with the "
        "standard deviation over the seeds"
        + ("; optimality gap: the median seed's excess over the global optimum" if has_gap else "")
        + "; what refinement makes of it; evaluations of the median seed"
        + (", and the time of all seeds, compilation included." if seconds else "."),
        columns=columns,
        rows=tuple(_search_cells(row, seconds, has_gap) for row in rows),
    )


def bands_table(result: "ComparisonResult", record: int) -> Table:
    """Errors by state of charge on one record, for the bands that hold any sample."""
    rows = answered(result)
    held = [
        (place, f"{100 * band.low_soc:g}–{100 * band.high_soc:g} %", band.samples)
        for place, band in enumerate(errors_on(rows[0], record).bands)
        if band.samples
    ]
    samples = joined([f"{count} in {head}" for _, head, count in held])
    cells = [[errors_on(row, record).bands[place] for place, _, _ in held] for row in rows]
    return Table(
        caption=f"Errors on {records(result)[record]} by state of charge: RMSE and mean of "
        f"measured minus simulated voltage. Samples: {samples}.",
        columns=(
            ROW,
            *(Column(f"{head} {kind}", "mV") for _, head, _ in held for kind in ("RMSE", "mean")),
        ),
        rows=tuple(
            (
                row.name,
                *(_millivolts(value) for band in bands for value in (band.rmse_v, band.mean_v)),
            )
            for row, bands in zip(rows, cells, strict=True)
        ),
    )


def differences_table(result: "ComparisonResult", record: int) -> Table:
    """The differences between rows on one record, and whether each is more than chance."""
    rows = answered(result)
    name = records(result)[record]
    found = [
        each
        for each in result.differences
        if each.record == name and each.is_validation == (record > 0)
    ]
    note = ""
    if len(found) > ALL_PAIRS:
        leader = ranked(rows, record)[0].name
        found = [each for each in found if _is_asked_for(each, leader, rows)]
        note = " Shown are the pairs with the leader and those of one method."
    if any(each.over_time.is_block_capped for each in found):
        note += f" {NARROW_MARK}: {NARROW}."
    has_seeds = any(each.over_seeds is not None for each in found)
    by_seed = (Column("wins–losses"), Column("p"))
    return Table(
        caption=f"Differences of RMSE on {name}, first row minus second, with the 95 % interval "
        "of a moving-block bootstrap over time"
        + ("; seeds won and lost by the first row, and Wilcoxon's p." if has_seeds else ".")
        + note,
        columns=(
            Column("first", role="text"),
            Column("second", role="text"),
            Column("difference", "mV"),
            Column("from", "mV"),
            Column("to", "mV"),
            Column("more than chance", role="text"),
            *(by_seed if has_seeds else ()),
        ),
        rows=tuple(_difference_cells(each, has_seeds) for each in found),
    )


def methods_table(result: "ComparisonResult") -> Table:
    """Where every method comes from."""
    sources = {row.method: row.source for row in result.rows}
    return Table(
        caption="The methods.",
        columns=(Column("method", role="text"), Column("source", role="text")),
        rows=tuple(sources.items()),
    )


def failures_table(result: "ComparisonResult") -> Table:
    """The rows without an answer."""
    return Table(
        caption="Rows without an answer.",
        columns=(ROW, Column("why", role="text")),
        rows=tuple((row.name, row.failure) for row in result.rows if row.failure is not None),
    )


def _search_cells(
    row: "RowPart", seconds: Mapping[str, float] | None, has_gap: bool
) -> tuple[str, ...]:
    spread = row.spread
    time = (fixed(seconds.get(row.name), 2),) if seconds else ()
    return (
        row.name,
        _millivolts(rmse_on(row, 0)),
        _millivolts(spread and spread.best_rmse_v),
        _millivolts(spread and spread.worst_rmse_v),
        _millivolts(spread and spread.deviation_v),
        *((_percents(row.optimality_gap),) if has_gap else ()),
        _millivolts(row.refined_rmse_v),
        str(len(row.seeds)),
        NOTHING if row.evaluations is None else str(row.evaluations),
        *time,
    )


def _difference_cells(each: "DifferencePart", has_seeds: bool) -> tuple[str, ...]:
    low_v, high_v = each.over_time.interval_v
    mark = NARROW_MARK if each.over_time.is_block_capped else ""
    seeds: tuple[str, ...] = (NOTHING, NOTHING)
    if each.over_seeds is not None:
        seeds = (
            f"{each.over_seeds.wins}–{each.over_seeds.losses}",
            f"{each.over_seeds.p_value:.2g}",
        )
    return (
        each.first,
        each.second,
        _millivolts(each.over_time.difference_v),
        _millivolts(low_v),
        _millivolts(high_v),
        ("yes" if each.over_time.is_real else "no") + mark,
        *(seeds if has_seeds else ()),
    )


def _is_asked_for(each: "DifferencePart", leader: str, rows: "Sequence[RowPart]") -> bool:
    methods = {row.name: row.method for row in rows}
    return leader in (each.first, each.second) or methods[each.first] == methods[each.second]


def _millivolts(value_v: float | None) -> str:
    return fixed(None if value_v is None else 1e3 * value_v, 3)


def _percents(ratio: float | None) -> str:
    """A ratio in percent, two digits or all before the point."""
    value = None if ratio is None else 100 * ratio
    return fixed(value, 0) if value and abs(value) >= 10 else significant(value, 2)
