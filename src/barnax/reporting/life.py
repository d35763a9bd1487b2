"""A fleet's ageing in words: the screen, the page of the fleet, that of a cell, and the tables."""

import json
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from ..life import QUANTITIES, SHIFT
from .document import (
    Block,
    Bullets,
    Document,
    Paragraph,
    Section,
    Table,
    make_table,
    picture,
    rows_table,
)
from .words import NOTHING, counted, figures, percent, symbol

if TYPE_CHECKING:
    from ..life import Fault, Life, Trend

NAMES = {"R": "total R"}
MAX_TOLD = 50
WORDS = {
    "level": "differs from the fleet throughout",
    "slope": "ages at another rate than the fleet",
    "knee": "bends away from the fleet",
    "step": "steps",
}
TREND_HEADS = ("low", "high", "trend", "trend low", "trend high")
# Kinds of faults that begin at some age.
BEGINNING = ("knee", "step")
UNTOLD = {
    "capacity [A.h]": "capacity needs an OCV of before (`ocv` or `cell` in the manifest), and "
    "records from full to a rest near empty, or over much of the charge: their interval is to be "
    "within 5 %",
    "R0 [Ohm]": "R0 needs steps of the current around 50 % SOC; a charge at constant current alone "
    "has none, and is refused",
    "R [Ohm]": "total R needs an OCV of before, and loads of several minutes around 50 % SOC",
    "OCV shift [V]": "a shift of the OCV needs an OCV of before",
}


def quantity_name(quantity: str) -> str:
    """A quantity's name in a sentence."""
    return NAMES.get(symbol(quantity), symbol(quantity))


def life_lines(life: "Life") -> list[str]:
    """The screen."""
    told = [_told_sentence(life, quantity) for quantity in QUANTITIES]
    return [
        f"{counted(len(life.cells), 'cell')}, {counted(life.rows, 'row')}, "
        f"{counted(round(life.exposure), 'cell year')}.",
        *_left_out(life),
        *told,
        *_assumed(life),
        _judging_sentence(life),
        *(f"  {fault_sentence(life, fault)}" for fault in life.faults[:10]),
        *([f"  {len(life.faults) - 10} more on the page"] if len(life.faults) > 10 else []),
        *_failed(life)[:3],
    ]


def _left_out(life: "Life") -> list[str]:
    """Rows that say nothing, and those that may say the same thing twice."""
    rows = counted(life.without_age, "row")
    more = f" and {len(life.twice) - 10} more" if len(life.twice) > 10 else ""
    twice = f"Of one cell at one age, both counted: {', '.join(life.twice[:10])}{more}."
    without = f"{rows} without a finite age, or without a cell: left out."
    return [*[without] * bool(life.without_age), *[twice] * bool(life.twice)]


def life_document(life: "Life", drawn: Sequence[Any]) -> Document:
    """The page of the fleet."""
    odd = (_fault_table(life),) if life.faults else ()
    return Document(
        "A fleet over its life",
        f"{counted(len(life.cells), 'cell')} in {counted(life.rows, 'row')}.",
        (
            Section("Trends", (*map(picture, drawn), _fleet_table(life))),
            Section("Odd cells", (Paragraph(_judging_sentence(life)), *odd)),
            Section("What is not determined", _untold(life)),
            Section("How it is made", (Bullets((*_left_out(life), *_method(life))),)),
        ),
    )


def cell_document(life: "Life", cell: str, drawn: Sequence[Any]) -> Document:
    """The page of a cell."""
    faults = [fault for fault in life.faults if fault.cell == cell]
    told = tuple(fault_sentence(life, fault) for fault in faults)
    blocks: list[Block] = [Bullets(told, are_warnings=True)] if told else []
    blocks += [*map(picture, drawn)]
    blocks += [
        _trend_table(life, trend)
        for quantity in QUANTITIES
        for trend in life.of(quantity, cell)
        if trend.estimates
    ]
    missing = [name for name in QUANTITIES if not any(t.estimates for t in life.of(name, cell))]
    if missing:
        blocks.append(Bullets(tuple(f"Not determined: {UNTOLD[name]}." for name in missing)))
    at_least = "" if life.cycles_known else "at least "
    summary = f"{at_least}{life.cycles[cell]:.3g} equivalent full cycles at its last record."
    return Document(f"The life of {cell}", summary, (Section("Trends", tuple(blocks)),))


def fault_sentence(life: "Life", fault: "Fault") -> str:
    """One fault of a cell."""
    since = f" from {_age(life, fault.age)} on" if fault.kind in BEGINNING else ""
    return (
        f"{fault.cell}: {quantity_name(fault.quantity)} {WORDS[fault.kind]}{since}, by "
        f"{_size(life, fault)} ({abs(fault.deviations):.1f} standard deviations)"
    )


def life_json(life: "Life") -> str:
    """Everything but the models, as JSON; what is not determined is null."""
    document = {
        "age unit": life.unit,
        "cell years": life.exposure,
        "false alarms a cell and year": life.false_alarms,
        "reference temperature [degC]": life.reference_degc,
        "equivalent full cycles": life.cycles,
        "equivalent full cycles are complete": life.cycles_known,
        "spread": {name: vars(judged.fit.spread) for name, (_, judged) in life.judged.items()},
        "thresholds": {
            name: judged.threshold if np.isfinite(judged.threshold) else None
            for name, (_, judged) in life.judged.items()
        },
        "faults": [vars(fault) for fault in life.faults],
        "failed": [{"cell": name, "error": error} for name, error in life.failed],
        "trends": life_frame(life).to_dicts(),
    }
    return json.dumps(document, indent=1) + "\n"


def life_frame(life: "Life") -> pl.DataFrame:
    """A row for each quantity of each record: estimate and trend, with intervals."""
    columns = ("estimate", "estimate low", "estimate high", "trend", "trend low", "trend high")
    return pl.DataFrame(
        [
            {"cell": trend.cell, "quantity": trend.quantity, f"age [{life.unit}]": float(age)}
            | dict(
                zip(columns, [None if np.isnan(one) else float(one) for one in row], strict=True)
            )
            for trend in life.trends
            for age, row in zip(trend.age, np.hstack([trend.measured, trend.smooth]), strict=True)
        ],
        schema_overrides=dict.fromkeys(columns, pl.Float64),
        infer_schema_length=None,
    )


def _told_sentence(life: "Life", quantity: str) -> str:
    told = [trend for trend in life.of(quantity) if trend.estimates]
    if not told:
        return f"{quantity_name(quantity)}: not determined: {UNTOLD[quantity]}."
    ends = np.array([_ends(trend) for trend in told])
    if quantity == SHIFT:
        words = f"median {1e3 * float(np.median(ends[:, 1])):+.2g} mV at the end"
    else:
        change = float(np.median(ends[:, 1] / ends[:, 0]) - 1)
        words = f"median change {100 * change:+.2g} % from first to last"
    missing = len(life.cells) - len(told)
    rest = f"; not determined of {counted(missing, 'cell')}" if missing else ""
    return f"{quantity_name(quantity)}: {words}{rest}."


def _assumed(life: "Life") -> list[str]:
    if not life.without_empty:
        return []
    return [
        "Assumed: toward empty the OCV changes its shape as it does above, where no record from "
        "full to a rest near empty tells the capacity, in "
        f"{counted(life.without_empty, 'row')}; an electrode may lose material "
        "without a trace in the OCV above, and such a loss of capacity is missed."
    ]


def _judging_sentence(life: "Life") -> str:
    if not any(np.isfinite(judged.threshold) for _, judged in life.judged.values()):
        return "No cell is judged: that takes at least 8 cells with 3 ages each."
    expected = life.false_alarms * life.exposure
    year = "365 equivalent full cycles" if life.unit == "A.h" else "365 cycles"
    unit = year if life.unit in ("A.h", "cycle") else "year"
    odd = len({fault.cell for fault in life.faults})
    return (
        f"{counted(odd, 'odd cell')}, at {percent(life.false_alarms)} false alarms a cell and "
        f"{unit}: {expected:.2g} of a fleet like this one without any fault."
    )


def _failed(life: "Life") -> list[str]:
    causes = Counter(error for _, error in life.failed)
    return [f"{counted(number, 'row')} failed: {error}" for error, number in causes.most_common()]


def _untold(life: "Life") -> tuple[Block, ...]:
    lines = []
    for quantity in QUANTITIES:
        found = life.of(quantity)
        rows = sum(len(trend.age) for trend in found)
        told = sum(trend.estimates for trend in found)
        if told < rows:
            lines.append(
                f"{quantity_name(quantity)}: {rows - told:,} of {counted(rows, 'row')}; "
                f"{UNTOLD[quantity]}."
            )
    lines += _failed(life)[:MAX_TOLD]
    if not life.cycles_known:
        lines.append(
            "Equivalent full cycles between the records: those told are within the records alone; "
            "give `throughput`, a column of ampere-hours since new."
        )
    if life.reference_degc is None:
        lines.append("Resistances at one temperature: temperatures are not known, or do not vary.")
    return (Bullets(tuple(lines)),)


def _method(life: "Life") -> list[str]:
    lines = [
        *_assumed(life),
        "Trends are smoothing splines over age: the fleet's shape, and what is a cell's own, with "
        "variances of the largest restricted likelihood; intervals are of 95 %.",
        "A trend goes from the first to the last record that tells the quantity, never beyond.",
        "Cells that are flagged do not count for the fleet's shape and variances.",
        "R0 is that at the records' own currents, of which charge transfer takes less the larger "
        "they are: compare ages under like loads.",
    ]
    if life.reference_degc is not None:
        lines.append(
            f"Resistances are at {life.reference_degc:.3g} degC, by the fleet's own dependence on "
            "temperature."
        )
    return lines


def _fleet_table(life: "Life") -> Table:
    rows = (
        [
            cell,
            f"{life.cycles[cell]:.4g}",
            *(_last(life, quantity, cell) for quantity in QUANTITIES),
        ]
        for cell in life.cells[:MAX_TOLD]
    )
    return rows_table(
        "The trend at the last record that tells it, and half its interval.",
        ["cell", "eq. full cycles", *map(_head, QUANTITIES)],
        rows,
        ["cell"],
    )


def _last(life: "Life", quantity: str, cell: str) -> str:
    (trend,) = life.of(quantity, cell)
    if not trend.estimates:
        return NOTHING
    value, low, high = _scale(quantity) * trend.smooth[np.isfinite(trend.smooth[:, 0])][-1]
    return f"{figures(value, 4)} ± {figures((high - low) / 2, 2)}"


def _fault_table(life: "Life") -> Table:
    cells = {
        "cell": lambda fault: fault.cell,
        "quantity": lambda fault: quantity_name(fault.quantity),
        "what": lambda fault: fault.kind,
        "from": lambda fault: _age(life, fault.age) if fault.kind in BEGINNING else NOTHING,
        "by": lambda fault: _size(life, fault),
        "deviations": lambda fault: f"{abs(fault.deviations):.1f}",
    }
    return make_table("The oddest first.", life.faults[:MAX_TOLD], cells, [*cells][:5])


def _trend_table(life: "Life", trend: "Trend") -> Table:
    scale = _scale(trend.quantity)

    def number(value: float) -> str:
        return NOTHING if np.isnan(value) else figures(scale * float(value), 4)

    rows = (
        [f"{age:.4g}", *map(number, (*measured, *smooth))]
        for age, measured, smooth in zip(trend.age, trend.measured, trend.smooth, strict=True)
    )
    return rows_table(
        f"{quantity_name(trend.quantity)}, with 95 % intervals.",
        [f"age [{life.unit}]", _head(trend.quantity), *TREND_HEADS],
        rows,
    )


def _ends(trend: "Trend") -> tuple[float, float]:
    known = trend.smooth[np.isfinite(trend.smooth[:, 0]), 0]
    return float(known[0]), float(known[-1])


def _scale(quantity: str) -> float:
    return 1.0 if quantity.startswith("capacity") else 1e3


def _head(quantity: str) -> str:
    unit = "" if quantity.startswith("capacity") else "m"
    name, _, own = quantity.partition(" [")
    return f"{name} [{unit}{own}"


def _age(life: "Life", age: float) -> str:
    return f"{life.unit} {age:.3g}" if life.unit != "A.h" else f"{age:.3g} A.h"


def _size(life: "Life", fault: "Fault") -> str:
    by = f" per {life.unit}" if fault.kind in ("slope", "knee") else ""
    scale, unit = (1e3, "mV") if fault.quantity == SHIFT else (100, "%")
    return f"{scale * fault.size:+.2g} {unit}{by}"
