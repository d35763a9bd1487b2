"""Fits of records of which only factors were kept, in words and tables."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .document import Document, Paragraph, Section
from .soc_tables import nodes_table
from .words import counted, millivolt, symbol, with_unit

if TYPE_CHECKING:
    from ..over_soc import TableFit
    from ..over_soc.kept import Kept

# With more records than this, only the smallest and largest error are shown.
MOST_NAMED = 8


def kept_document(kept: "Sequence[Kept]", fit: "TableFit") -> Document:
    """The fit of some kept records together."""
    samples = sum(record.scored for record in kept)
    told_apart = zip(kept, fit.errors, strict=True)
    errors = ", ".join(f"{record.name} {millivolt(one.rmse_v)}" for record, one in told_apart)
    if len(kept) > MOST_NAMED:
        ends = (millivolt(end(one.rmse_v for one in fit.errors)) for end in (min, max))
        errors = " to ".join(ends)
    constants = ", ".join(
        f"{symbol(name)} {with_unit(name, value)}" for name, value in fit.tables.constants.items()
    )
    told = [
        f"{counted(len(kept), 'record')} of {samples:,} samples, from factors: RMSE {errors}.",
        f"{constants}, verified on a grid.",
    ]
    if held := fit.cross_validation:
        told.append(f"Each record left out in turn: {millivolt(held.tables.rmse_v)}.")
    else:
        told.append("No intervals: they are of the spread of three records or more.")
    blocks = (*map(Paragraph, told), nodes_table(fit))
    return Document("Kept records", "", (Section("Kept records", blocks),))
