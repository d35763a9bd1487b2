"""Many cells in words: a fleet's progress, last lines and report, and the cells of a pack."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import polars as pl

from ..errors import as_keys
from ..files import csv_text
from .document import (
    Document,
    Paragraph,
    Picture,
    Section,
    Table,
    make_table,
    rows_table,
)
from .view import View
from .wording import document, sentences, wording
from .words import NOTHING, figures, fixed, gathered, millivolt

if TYPE_CHECKING:
    from ..fleet import FleetCell
    from ..fleet.summary import Cause, Summary
    from ..pack import Pack
    from ..search.evaluate import Evaluation

# The longest list shown; the dataset has all.
MOST_ROWS = 50


def fleet_illustrations(rows: pl.DataFrame, worst: "Mapping[str, Evaluation]") -> list[Picture]:
    """Distributions, and the worst fits."""
    from ..fleet.summary import summed_up
    from ..plots.cells import plot_distributions
    from ..plots.voltage import plot_voltage
    from .illustrations import illustrate

    good = rows.filter(pl.col("error").is_null())
    names = summed_up(good) if len(good) else []
    values = {name: good[name].drop_nulls().to_numpy() for name in names}
    positive = {name: own for name, own in values.items() if len(own) and own.min() > 0}
    found = []
    if positive:
        found.append(illustrate("distributions", "", plot_distributions, positive))
    for place, (name, evaluation) in enumerate(worst.items(), 1):
        caption = f"{name}, RMSE {millivolt(evaluation.metrics.rmse_v)}."
        draw = partial(plot_voltage, evaluation)
        found.append(Picture(f"worst-{place}", draw, caption, caption))
    return found


def fleet_document(summary: "Summary", illustrations: Sequence[Picture] = ()) -> Document:
    """The whole report."""
    blocks = {
        "distributions": (_distributions(summary),),
        "outliers": (_outliers(summary),),
        "failures": (_causes(summary.failures, "Cells without an answer"),),
        "warnings": (_causes(summary.warnings, "Cells with a warning"),),
        "worst": (_worst(summary),),
    }
    return document("fleet_page", blocks, illustrations, fleet=summary)


def _distributions(summary: "Summary") -> Table:
    return make_table(
        wording("fleet.distributions"),
        summary.distributions,
        {
            "circuit": lambda spread: spread.circuit,
            "quantity": lambda spread: spread.name,
            "cells": lambda spread: f"{spread.cells:,}",
            "at a bound": lambda spread: f"{spread.at_bound:,}",
            "5 %": lambda spread: figures(spread.low),
            "median": lambda spread: figures(spread.median),
            "95 %": lambda spread: figures(spread.high),
            "spread": lambda spread: figures(spread.sd_log, 2),
        },
        ["circuit", "quantity"],
    )


def _outliers(summary: "Summary") -> Table:
    from ..fleet.summary import OUTLYING

    return make_table(
        wording("fleet.outliers", OUTLYING),
        summary.outliers[:MOST_ROWS],
        {
            "cell": lambda outlier: outlier.id,
            "because of": lambda outlier: outlier.name,
            "value": lambda outlier: figures(outlier.value),
            "median": lambda outlier: figures(outlier.median),
            "deviations": lambda outlier: f"{outlier.deviations:+.1f}",
        },
        ["cell", "because of"],
    )


def _causes(causes: "Sequence[Cause]", which: str) -> Table:
    return make_table(
        f"{which}, by cause, with the message of the first.",
        causes[:MOST_ROWS],
        {
            "cells": lambda cause: f"{len(cause.ids):,}",
            "cause": lambda cause: cause.text,
            "such as": lambda cause: ", ".join(cause.ids[:3]),
        },
        ["cause", "such as"],
    )


def _worst(summary: "Summary") -> Table:
    return make_table(
        "The cells with the largest RMSE.",
        summary.worst,
        {"cell": lambda cell: cell[0], "RMSE [mV]": lambda cell: figures(1e3 * cell[1])},
        ["cell"],
    )


def problem_lines(cells: "Sequence[FleetCell]") -> list[str]:
    """Mistakes in a manifest, one a line."""
    from ..fleet.rows import reasons_against

    return [f"{cell.id}: {as_keys(reason)}" for cell in cells for reason in reasons_against(cell)]


# With more cells than this, the screen shows only those that stand out.
MOST_SHOWN = 24
SCALES = {
    "R0 [Ohm]": ("R0 [mOhm]", 1e3),
    "total R [Ohm]": ("total R [mOhm]", 1e3),
    "SOC shift": ("SOC shift [%]", 100.0),
    "capacity ratio": ("capacity [%]", 100.0),
}


def pack_document(pack: "Pack") -> Document:
    """The pack as the screen shows it."""
    from ..pack import FEWEST

    odd = gathered((outlier.cell, outlier) for outlier in pack.odd)
    told = [*sentences("pack.cells", pack, odd, FEWEST)]
    told += [f"Resistances: {text}" for text in sentences("tables.law", pack.result.fits)]
    told += sentences("pack.left_out", pack.left_out)
    told += [f"Assumed: {guess}" for guess in View(pack.result).guesses]
    return Document("Pack", "", (Section("Pack", (*map(Paragraph, told), _cells_table(pack))),))


def _cells_table(pack: "Pack") -> Table:
    rows = pack.rows()
    caption = (
        "The cells, with 95 % intervals; SOC shift and capacity are relative to the mean cell."
    )
    if len(rows) > MOST_SHOWN:
        rows = [row for row in rows if row["odd"] or row["weakest"]]
        caption = f"Those that stand out of {len(pack.fit.cells)} cells; cells.csv has all."
    heads = ["cell", *(head for head, _ in SCALES.values()), "RMSE [mV]", "stands out"]

    def line(row: Mapping[str, Any]) -> Iterator[str]:
        yield row["cell"]
        for name, (_, scale) in SCALES.items():
            known = (row[name], row[f"{name} low"], row[f"{name} high"])
            value, low, high = (fixed(None if own is None else scale * own, 2) for own in known)
            yield NOTHING if row[name] is None else f"{value} ({low} to {high})"
        yield figures(1e3 * row["RMSE [V]"])
        out = (row["odd"].replace(" [Ohm]", ""), "weakest" if row["weakest"] else "")
        yield "; ".join(filter(None, out))

    return rows_table(caption, heads, map(line, rows), ["cell", "stands out"])


def cells_csv(pack: "Pack") -> str:
    """A row for each cell."""
    rows = pack.rows()
    return csv_text(list(rows[0]), (list(row.values()) for row in rows))
