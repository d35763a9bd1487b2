"""A pack in words and tables: its cells, the odd ones and the weakest."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from ..files import csv_text
from ..pack import FEWEST
from .document import Document, Paragraph, Section, Table, rows_table
from .view import View
from .wording import sentences
from .words import NOTHING, figures, fixed, gathered

if TYPE_CHECKING:
    from ..pack import Pack

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
    odd = gathered((outlier.cell, outlier) for outlier in pack.odd)
    told = [*sentences("pack.cells", pack, odd, FEWEST)]
    told += [f"Resistances: {text}" for text in sentences("tables.law", pack.result.fits)]
    told += sentences("pack.left_out", pack.left_out)
    told += [f"Assumed: {guess}" for guess in View(pack.result).guesses]
    return Document("Pack", "", (Section("Pack", (*map(Paragraph, told), _table(pack))),))


def _table(pack: "Pack") -> Table:
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
