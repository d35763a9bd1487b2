"""A plain C header: constants and tables of one cell, for firmware and hand-written simulators."""

from collections.abc import Iterator

from ..result import Result
from .exporter import Export, Exporter
from .tables import Table, Tables, tables_of
from .text import note_lines, numbers

HYSTERESIS = {"none": 0, "instant": 1, "dynamic": 2}

TEMPLATE = """\
/*
{notes}
 *
 * v = OCV(soc) - R0 i - v_1 - v_2 - ... + h W(soc) / 2, i > 0 while discharging.
 * Each pair: dv_k/dt = (R_k i - v_k) / tau_k. SOC: d(soc)/dt = -i / (3600 capacity).
 * h starts as barnax_initial_direction, 1 after charging, -1 after discharging. It stays as it is
 * while |i| < barnax_rest_current_a or i = 0. Else with BARNAX_HYSTERESIS 1: h = sign(-i); with 2,
 * over an interval that passes the share dz of the capacity:
 * h = exp(-gamma |dz|) h + (1 - exp(-gamma |dz|)) sign(-i).
 * Tables are read linearly and are constant beyond their ends.
 */
#ifndef BARNAX_CELL_H
#define BARNAX_CELL_H

#define BARNAX_RC_PAIRS {pairs}
/* 0 none, 1 turns at once, 2 turns with the charge passed */
#define BARNAX_HYSTERESIS {kind}

{declarations}

#endif /* BARNAX_CELL_H */
"""


def write_c_header(result: Result) -> Export:
    """The header's source, in C89: all that simulates the circuit as barnax does.

    Pairs start without voltage. Tables follow the curves within `TOLERANCE_V`.
    """
    tables = tables_of(result)
    content = TEMPLATE.format(
        notes=note_lines(tables.heading, (), " * "),
        pairs=tables.parameters.pairs,
        kind=HYSTERESIS[tables.kind],
        declarations="\n".join(_declarations(tables)),
    )
    return Export(content.encode(), ())


def _declarations(tables: Tables) -> Iterator[str]:
    circuit = tables.parameters
    yield _scalar("capacity_ah", tables.capacity_ah, "A.h")
    yield _scalar("initial_soc", tables.initial_soc, "1")
    yield _scalar("initial_direction", float(tables.initial_direction), "1, at the start")
    yield _scalar("rest_current_a", tables.rest_current_a, "A, turns no hysteresis below")
    yield _scalar("r0_ohm", circuit.r0, "ohm")
    for name, values, unit in (
        ("r_ohm", circuit.r, "ohm"),
        ("c_f", circuit.c, "F"),
        ("tau_s", circuit.tau_s, "s"),
    ):
        yield f"static const double barnax_{name}[BARNAX_RC_PAIRS] = {{ /* {unit} */"
        yield f"{numbers(values)}\n}};"
    if circuit.gamma is not None:
        yield _scalar("gamma", circuit.gamma, "per unit of SOC")
    yield ""
    yield from _table("ocv", tables.ocv)
    if tables.hysteresis is not None:
        yield ""
        yield from _table("hysteresis", tables.hysteresis)


def _scalar(name: str, value: float, unit: str) -> str:
    return f"static const double barnax_{name} = {value!r}; /* {unit} */"


def _table(name: str, table: Table) -> Iterator[str]:
    points = f"BARNAX_{name.upper()}_POINTS"
    yield f"#define {points} {len(table.soc)}"
    for axis, values, unit in (("soc", table.soc, "1"), ("v", table.voltage_v, "V")):
        yield f"static const double barnax_{name}_{axis}[{points}] = {{ /* {unit} */"
        yield f"{numbers(values)}\n}};"


C_HEADER = Exporter(
    name="c-header",
    description="C header: constants and tables, hysteresis included",
    file_name="barnax_cell.h",
    write=write_c_header,
)
