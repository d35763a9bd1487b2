"""Many cells in words: a fleet's progress, final lines and report, and the cells of a pack."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import polars as pl

from ..files import csv_text
from .document import Page, Picture
from .view import View
from .wording import document
from .words import gathered, millivolt

if TYPE_CHECKING:
    from ..fleet.summary import Summary
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
    positive = {name: column for name, column in values.items() if len(column) and column.min() > 0}
    pictures = []
    if positive:
        pictures.append(illustrate("distributions", "", plot_distributions, positive))
    for number, (name, evaluation) in enumerate(worst.items(), 1):
        caption = f"{name}, RMSE {millivolt(evaluation.metrics.rmse_v)}."
        draw = partial(plot_voltage, evaluation)
        pictures.append(Picture(f"worst-{number}", draw, caption, caption))
    return pictures


def fleet_document(summary: "Summary", illustrations: Sequence[Picture] = ()) -> Page:
    """The whole report."""
    from ..fleet.summary import OUTLYING

    facts = {"fleet": summary, "outlying": OUTLYING, "most": MOST_ROWS}
    return document("fleet_page", illustrations, **facts)


# With more cells than this, the screen only shows those that stand out.
MOST_SHOWN = 24


def pack_document(pack: "Pack") -> Page:
    """The pack as on the screen."""
    from ..pack import FEWEST

    odd, cells = gathered((outlier.cell, outlier) for outlier in pack.odd), pack.fit.cells
    if len(cells) > MOST_SHOWN:
        cells = [cell for cell in cells if cell.name in odd or cell.name == pack.weakest]
    facts = {"pack": pack, "odd": odd, "fewest": FEWEST, "shown": cells}
    return document("pack", view=View(pack.result), **facts)


def cells_csv(pack: "Pack") -> str:
    """One row per cell."""
    rows = pack.rows()
    return csv_text(list(rows[0]), (list(row.values()) for row in rows))
