"""A pack in words and tables: its cells, the odd ones and the weakest."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from ..files import csv_text
from ..pack import FEWEST
from .document import Document, Paragraph, Section, Table, rows_table
from .view import View
from .wording import sentences
from .words import NOTHING, counted, figures, fixed, joined, millivolt

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
    cells = pack.fit.cells
    tau_s = [f"{tau:.3g} s" for tau in pack.result.circuit_parameters.tau_s]
    told = [
        f"{counted(len(cells), 'cell')} under one current; the mean cell's time constants are "
        f"{joined(tau_s)}, its RMSE is {millivolt(pack.result.metrics.identification.rmse_v)}."
    ]
    for name in dict.fromkeys(outlier.cell for outlier in pack.odd):
        why = joined(
            [
                f"{outlier.quantity.partition(' [')[0]} ({outlier.deviations:+.1f})"
                for outlier in pack.odd
                if outlier.cell == name
            ]
        )
        told.append(f"{name} is odd: {why} robust standard deviations off the median.")
    if not pack.odd:
        told.append(
            "No cell is odd."
            if len(cells) >= FEWEST
            else f"With fewer than {FEWEST} cells none is judged odd."
        )
    value = next(cell for cell in cells if cell.name == pack.weakest).values["loaded voltage [V]"]
    told.append(
        f"{pack.weakest} is the weakest: under 1C at {100 * pack.fit.loaded_soc:.0f} % SOC it has "
        f"{value.value:.3f} V ({value.low:.3f} to {value.high:.3f})."
    )
    told += [f"Resistances: {text}" for text in sentences("tables.law", pack.result.fits)]
    told += [f"{name} is left out: {why}." for name, why in pack.left_out.items()]
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
