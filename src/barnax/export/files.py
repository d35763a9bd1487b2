"""Exports that are plain files: a C header, CSV, and a `.mat` file for Simscape."""

import csv
import io
from collections.abc import Iterator

import numpy as np
from scipy.io import savemat

from ..results import Result
from .exporter import Export, Exporter, hysteresis_is_left_out, note_lines, numbers
from .tables import Table, Tables, tables_of

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


HEADER_BYTES = 116
HEADER = b"MATLAB 5.0 MAT-file, written by barnax"


def write_simscape(result: Result) -> Export:
    """The .mat file (MATLAB 5)."""
    tables = tables_of(result)
    circuit = tables.parameters
    caveats = (
        *hysteresis_is_left_out("The block Battery (Table-Based)", tables),
        'The block reads its tables linearly; set "Extrapolation method for all tables" to '
        "Nearest, as barnax holds the OCV constant beyond its end points.",
    )
    over_soc = np.ones_like(tables.ocv.soc)
    variables: dict[str, object] = {
        "SOC_vec": tables.ocv.soc,
        "V0_vec": tables.ocv.voltage_v,
        "V_range": np.array([0.0, np.inf]),
        "AH": tables.capacity_ah,
        "R0_vec": circuit.r0 * over_soc,
        "prm_dyn": f"simscape.enum.tablebattery.prm_dyn.rc{circuit.pairs}",
        "stateOfCharge": tables.initial_soc,
        "barnax_notes": note_lines(tables.heading, caveats),
    }
    for pair, (r, tau_s) in enumerate(zip(circuit.r, circuit.tau_s, strict=True), start=1):
        variables[f"R{pair}_vec"] = r * over_soc
        variables[f"tau{pair}_vec"] = tau_s * over_soc
    file = io.BytesIO()
    savemat(file, variables, oned_as="row")
    # SciPy writes the date there; equal results are to give equal bytes.
    file.seek(0)
    file.write(HEADER.ljust(HEADER_BYTES))
    return Export(file.getvalue(), caveats)


SIMSCAPE = Exporter(
    name="simscape",
    description="MATLAB file: tables of Simscape's Battery (Table-Based)",
    file_name="barnax_simscape.mat",
    write=write_simscape,
)
