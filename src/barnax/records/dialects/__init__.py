"""The makes whose tables are known, and the columns of a table by its make.

A new make is one `Dialect` and its place in `DIALECTS`; the first that a header is marked as wins.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from ..columns import OCV_QUANTITIES, QUANTITIES, Column, find_columns, named_column, unit_of
from .arbin import ARBIN
from .biologic import BIOLOGIC
from .dialect import CHARGE, DISCHARGE, Dialect, Sign, bare
from .digatron import DIGATRON
from .maccor import MACCOR
from .neware import NEWARE
from .others import (
    BASYTEC,
    BDF,
    BITRODE,
    CHINESE,
    GAMRY,
    GERMAN,
    IVIUM,
    LANDT,
    NOVONIX,
    PEC,
    PLAIN,
    PYBAMM,
)

DIALECTS: tuple[Dialect, ...] = (
    BDF,
    ARBIN,
    NEWARE,
    MACCOR,
    DIGATRON,
    BASYTEC,
    NOVONIX,
    LANDT,
    PEC,
    BITRODE,
    GAMRY,
    BIOLOGIC,
    PYBAMM,
    GERMAN,
    CHINESE,
    IVIUM,
)

# Tables that are no record of one cell over time, by their names, and what to give instead.
OTHER_TABLES: Mapping[str, str] = {
    "freq & re & -im": "an impedance spectrum",
    "freq & zreal & zimag": "an impedance spectrum",
    "freq & z' & z''": "an impedance spectrum",
    "schedule file name & start datetime": "Arbin's description of a test",
    "cycle & vstart & vend": "a table of one row a cycle",
}


NOTHING: Mapping[str, str] = MappingProxyType({})
# What can tell the time, and the current.
_CLOCKS, _CURRENTS = {"time", "step time", "date"}, {"current", "charge of the interval"}


def dialect_of(header: Sequence[str]) -> Dialect:
    """Whose names these are; `PLAIN` where they are nobody's."""
    names = bare(header)
    for dialect in DIALECTS:
        if dialect.is_marked(names):
            return dialect
    return PLAIN


def columns_of(header: Sequence[str], given: Mapping[str, str] = NOTHING) -> dict[str, Column]:
    """The column of each quantity of a record that the header names.

    `given` holds the user's own names by quantity, as `columns` takes them, and comes first.
    """
    found = find_columns(header, dialect_of(header).quantities)
    for quantity in QUANTITIES:
        if quantity.name in given:
            column = named_column(header, quantity, given[quantity.name])
            if column is not None:
                found[quantity.name] = column
    return found


def names_record(header: Sequence[str], given: Mapping[str, str] = NOTHING) -> bool:
    """Whether the header names a clock, a current and a voltage."""
    found = columns_of(header, given).keys() if len(header) > 2 else set()
    return "voltage" in found and bool(found & _CURRENTS) and bool(found & _CLOCKS)


def with_units(header: Sequence[str], below: Sequence[str]) -> tuple[tuple[str, ...], bool]:
    """The names with the units that stand in the cells below them, and whether they do."""
    units = [cell.strip("[]()") for cell in below]
    units += [""] * (len(header) - len(units))
    own = {each.index: each for each in columns_of(header).values()}
    spelled = {
        k: unit_of(own[k].quantity, units[k])
        for k in own
        if units[k] and own[k].quantity.is_required
    }
    if not spelled or not all(
        unit and (own[k].is_unit_assumed or unit == own[k].unit) for k, unit in spelled.items()
    ):
        return tuple(header), False
    return tuple(
        name
        if (k in own and not own[k].is_unit_assumed) or not _is_unit(units[k])
        else f"{name} [{units[k]}]"
        for k, name in enumerate(header)
    ), True


def _is_unit(text: str) -> bool:
    return any(unit_of(quantity, text) for quantity in QUANTITIES)


def other_table(header: Sequence[str]) -> str | None:
    """What a table is that is known to be no record, if it is such."""
    names = bare(header)
    held = (what for mark, what in OTHER_TABLES.items() if names.issuperset(mark.split(" & ")))
    return next(held, None)


def is_ocv_table(header: Sequence[str]) -> bool:
    """Whether the header names SOC and a voltage, but no record."""
    ocv = find_columns(header, OCV_QUANTITIES).keys()
    return "SOC" in ocv and len(ocv) > 1 and not names_record(header)


__all__ = ["CHARGE", "DIALECTS", "DISCHARGE", "PLAIN", "Dialect", "Sign"]
