"""A flat CSV: one number a line, as name, value, unit."""

import csv
import io
from collections.abc import Iterator

from ..result import Result
from .exporter import Export, Exporter
from .tables import Tables, tables_of


def write_csv(result: Result) -> Export:
    """The table. `OCV(0.5)` and `W(0.5)` are the curves at a SOC, to be read linearly.

    The hysteresis starts in the initial direction; below the rest current it keeps its own.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("name", "value", "unit"))
    writer.writerows(_rows(tables_of(result)))
    return Export(text.getvalue().encode(), ())


def _rows(tables: Tables) -> Iterator[tuple[str, str, str]]:
    for name, value in tables.parameters.to_dict().items():
        plain, _, unit = name.partition(" ")
        yield plain, repr(value), unit.strip("[]") or "1"
    for pair, tau_s in enumerate(tables.parameters.tau_s, start=1):
        yield f"tau{pair}", repr(tau_s), "s"
    yield "capacity", repr(tables.capacity_ah), "A.h"
    yield "initial SOC", repr(tables.initial_soc), "1"
    yield "initial direction", repr(tables.initial_direction), "1"
    yield "rest current", repr(tables.rest_current_a), "A"
    for name, table in (("OCV", tables.ocv), ("W", tables.hysteresis)):
        if table is not None:
            for soc, voltage_v in zip(table.soc.tolist(), table.voltage_v.tolist(), strict=True):
                yield f"{name}({soc!r})", repr(voltage_v), "V"


CSV = Exporter(
    name="csv",
    description="flat table: name, value, unit, hysteresis included",
    file_name="barnax_parameters.csv",
    write=write_csv,
)
