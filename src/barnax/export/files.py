"""Exports that are plain files: a C header, CSV, JSON, and a `.mat` file for Simscape."""

import csv
import io
import json
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from scipy.io import savemat

from ..results import Result
from .exporter import Export, Exporter, hysteresis_is_left_out, note_lines, numbers
from .tables import Table, Tables, TemperatureAxis, table_caveats, tables_of

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
 * Tables are read linearly and are constant beyond their ends, as barnax_look_up does, which is
 * there where BARNAX_LOOK_UP is defined first.{over_soc}
 */
#ifndef BARNAX_CELL_H
#define BARNAX_CELL_H

#define BARNAX_RC_PAIRS {pairs}
/* 0 none, 1 turns at once, 2 turns with the charge passed */
#define BARNAX_HYSTERESIS {kind}

{declarations}

#ifdef BARNAX_LOOK_UP
static double barnax_look_up(const double *soc, const double *values, int points, double at)
{{
    int k = 1;
    if (points == 1 || at <= soc[0])
        return values[0];
    if (at >= soc[points - 1])
        return values[points - 1];
    while (soc[k] < at)
        k++;
    return values[k - 1]
        + (values[k] - values[k - 1]) * (at - soc[k - 1]) / (soc[k] - soc[k - 1]);
}}
{over_temperature}#endif

#endif /* BARNAX_CELL_H */
"""
OVER_TEMPERATURE = """\

/* A row of values for each temperature, such as &barnax_r0_ohm[0][0] over barnax_nodes_soc. */
static double barnax_look_up_degc(const double *soc, const double *values, int points, double at,
                                  double degc)
{
    double rows[BARNAX_TEMPERATURES];
    int k;
    for (k = 0; k < BARNAX_TEMPERATURES; k++)
        rows[k] = barnax_look_up(soc, values + k * points, points, at);
    return barnax_look_up(barnax_degc, rows, BARNAX_TEMPERATURES, degc);
}
"""
OVER_SOC = """
 * R0 and every R are tables over barnax_nodes_soc; C_k(soc) = tau_k / R_k(soc)."""


def write_c_header(result: Result) -> Export:
    """The header's source, in C89: all that simulates the circuit as barnax does.

    Pairs start without voltage. Tables follow the curves within `TOLERANCE_V`.
    """
    tables = tables_of(result)
    content = TEMPLATE.format(
        notes=note_lines(tables.heading, table_caveats(tables), " * "),
        over_soc="" if tables.over_soc is None else OVER_SOC,
        over_temperature="" if tables.over_temperature is None else OVER_TEMPERATURE,
        pairs=tables.pairs,
        kind=HYSTERESIS[tables.kind],
        declarations="\n".join(_declarations(tables)),
    )
    return Export(content.encode(), table_caveats(tables))


def _declarations(tables: Tables) -> Iterator[str]:
    yield _scalar("capacity_ah", tables.capacity_ah, "A.h")
    yield _scalar("initial_soc", tables.initial_soc, "1")
    yield _scalar("initial_direction", float(tables.initial_direction), "1, at the start")
    yield _scalar("rest_current_a", tables.rest_current_a, "A, turns no hysteresis below")
    if tables.over_soc is None:
        circuit = tables.parameters
        yield _scalar("r0_ohm", circuit.r0, "ohm")
        yield from _array("r_ohm", "BARNAX_RC_PAIRS", circuit.r, "ohm")
        yield from _array("c_f", "BARNAX_RC_PAIRS", circuit.c, "F")
    else:
        yield f"#define BARNAX_NODES {len(tables.over_soc.nodes)}"
        yield from _array("nodes_soc", "BARNAX_NODES", tables.over_soc.nodes, "1")
        axis = tables.over_temperature
        if axis is not None:
            yield f"#define BARNAX_TEMPERATURES {len(axis.degc)}"
            yield from _array("degc", "BARNAX_TEMPERATURES", axis.degc, "degC")
        for name, values in (axis or tables).resistances.items():
            yield from _array(f"{name.lower()}_ohm", "BARNAX_NODES", values, "ohm")
    yield from _array("tau_s", "BARNAX_RC_PAIRS", tables.tau_s, "s")
    if tables.gamma is not None:
        yield _scalar("gamma", tables.gamma, "per unit of SOC")
    yield ""
    axis = tables.over_temperature
    yield from _table("ocv", tables.ocv, None if axis is None else axis.ocv_v)
    if tables.hysteresis is not None:
        yield ""
        yield from _table("hysteresis", tables.hysteresis)


def _scalar(name: str, value: float, unit: str) -> str:
    return f"static const double barnax_{name} = {value!r}; /* {unit} */"


def _array(name: str, count: str, values: Iterable, unit: str) -> Iterator[str]:
    array = np.asarray(values)
    rows = f"[BARNAX_TEMPERATURES][{count}]" if array.ndim > 1 else f"[{count}]"
    yield f"static const double barnax_{name}{rows} = {{ /* {unit} */"
    for row in array if array.ndim > 1 else []:
        yield f"    {{\n{numbers(row, indent='        ')}\n    }},"
    yield "};" if array.ndim > 1 else f"{numbers(array)}\n}};"


def _table(name: str, table: Table, rows_v: np.ndarray | None = None) -> Iterator[str]:
    """A voltage over SOC, with a row for each temperature where there are several."""
    points = f"BARNAX_{name.upper()}_POINTS"
    yield f"#define {points} {len(table.soc)}"
    yield from _array(f"{name}_soc", points, table.soc, "1")
    yield from _array(f"{name}_v", points, table.voltage_v if rows_v is None else rows_v, "V")


C_HEADER = Exporter(
    name="c-header",
    description="C header: constants and tables, hysteresis included",
    file_name="barnax_cell.h",
    write=write_c_header,
)


def write_csv(result: Result) -> Export:
    """The table. `OCV(0.5)`, `W(0.5)`, `R0(0.5)` are the curves at a SOC, to be read linearly;
    `R0(0.5, 25.0)` is at a temperature in degC too.

    The hysteresis starts in the initial direction; below the rest current it keeps its own.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("name", "value", "unit"))
    tables = tables_of(result)
    writer.writerows(_rows(tables))
    return Export(text.getvalue().encode(), table_caveats(tables))


def _rows(tables: Tables) -> Iterator[tuple[str, str, str]]:
    if tables.over_soc is None:
        for name, value in tables.parameters.to_dict().items():
            plain, _, unit = name.partition(" ")
            yield plain, repr(value), unit.strip("[]") or "1"
    else:
        axis = tables.over_temperature
        for name, values in (axis or tables).resistances.items():
            yield from _points(name, tables.over_soc.nodes, values, "Ohm", axis)
        if tables.gamma is not None:
            yield "gamma", repr(tables.gamma), "1"
    for pair, tau_s in enumerate(tables.tau_s, start=1):
        yield f"tau{pair}", repr(tau_s), "s"
    yield "capacity", repr(tables.capacity_ah), "A.h"
    yield "initial SOC", repr(tables.initial_soc), "1"
    yield "initial direction", repr(tables.initial_direction), "1"
    yield "rest current", repr(tables.rest_current_a), "A"
    axis = tables.over_temperature
    ocv_v = tables.ocv.voltage_v if axis is None else axis.ocv_v
    yield from _points("OCV", tables.ocv.soc.tolist(), ocv_v, "V", axis)
    if tables.hysteresis is not None:
        yield from _points("W", tables.hysteresis.soc.tolist(), tables.hysteresis.voltage_v, "V")


def _points(
    name: str,
    soc: Sequence[float],
    values: Iterable,
    unit: str,
    axis: TemperatureAxis | None = None,
) -> Iterator[tuple[str, str, str]]:
    """A row a point, at each temperature in turn where there are several."""
    where_at = [""] if axis is None else [f", {each!r}" for each in axis.degc]
    rows = zip(where_at, np.atleast_2d(np.asarray(values)), strict=True)
    for where, row in rows:
        for at, value in zip(soc, row.tolist(), strict=True):
            yield f"{name}({at!r}{where})", repr(value), unit


CSV = Exporter(
    name="csv",
    description="flat table: name, value, unit, hysteresis included",
    file_name="barnax_parameters.csv",
    write=write_csv,
)


def write_json(result: Result) -> Export:
    """One object of plain numbers and lists: what is a list stands over its SOC, and a list of
    lists over temperature and SOC."""
    tables = tables_of(result)
    axis = tables.over_temperature
    content: dict[str, object] = {
        "notes": [tables.heading, *table_caveats(tables)],
        "circuit": tables.model,
        "capacity [A.h]": tables.capacity_ah,
        "initial SOC": tables.initial_soc,
        "initial direction": tables.initial_direction,
        "rest current [A]": tables.rest_current_a,
        "hysteresis": tables.kind,
        "gamma": tables.gamma,
        "tau [s]": tables.tau_s,
        "temperature [degC]": None if axis is None else axis.degc,
        "resistances": {"SOC": tables.over_soc.nodes if tables.over_soc else None}
        | {
            f"{name} [Ohm]": np.asarray(values).tolist()
            for name, values in (axis or tables).resistances.items()
        },
        "OCV": _listed(tables.ocv) | ({} if axis is None else {"voltage [V]": axis.ocv_v.tolist()}),
        "W": None if tables.hysteresis is None else _listed(tables.hysteresis),
    }
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    return Export(text.encode(), table_caveats(tables))


def _listed(table: Table) -> dict[str, list]:
    return {"SOC": table.soc.tolist(), "voltage [V]": table.voltage_v.tolist()}


JSON = Exporter(
    name="json",
    description="JSON: constants and tables, hysteresis included",
    file_name="barnax_cell.json",
    write=write_json,
)


HEADER_BYTES = 116
HEADER = b"MATLAB 5.0 MAT-file, written by barnax"


# The block asks for states of charge from 0 to 1.
IN_RANGE = (
    "The blocks accept states of charge from 0 to 1: the nodes beyond are left out. Below empty, "
    "the blocks hold the values at 0, while barnax uses the nodes there."
)


def write_simscape(result: Result) -> Export:
    """The .mat file (MATLAB 5), with what two blocks ask for.

    Variables as Battery (Table-Based) calls its parameters; and, as one structure,
    `BatteryEquivalentCircuit` with the fields that the block of that name asks for.
    """
    tables = tables_of(result)
    degc = tables.over_temperature
    inner = (tables.ocv.soc >= 0) & (tables.ocv.soc <= 1)
    soc = tables.ocv.soc[inner]
    nodes = np.array(tables.over_soc.nodes if tables.over_soc else [0.0, 1.0])
    is_cut = bool(len(soc) < len(tables.ocv.soc))
    caveats = (
        *table_caveats(tables),
        *hysteresis_is_left_out("The block Battery (Table-Based)", tables),
        'The block interpolates linearly; set "Extrapolation method for all tables" to '
        "Nearest, because barnax holds the OCV constant beyond its end points.",
        *([IN_RANGE] if is_cut else []),
    )

    def over(axis: np.ndarray, values: Iterable) -> np.ndarray:
        """A resistance read at every point of an axis, a column a temperature."""
        rows = np.atleast_2d(np.asarray(values))
        read = [np.interp(axis, nodes, np.broadcast_to(row, len(nodes))) for row in rows]
        return np.array(read).T if degc is not None else read[0]

    inside = np.unique(np.clip(nodes, 0.0, 1.0))
    # The blocks call what is tabulated over temperature by names of their own.
    kind, thermal = ("vec", "") if degc is None else ("mat", "Thermal")
    ocv_v = tables.ocv(soc) if degc is None else degc.ocv_v[:, inner].T
    table_based: dict[str, object] = {"SOC_vec": soc, f"V0_{kind}": ocv_v}
    equivalent: dict[str, object] = {
        "BatteryCapacity": tables.capacity_ah,
        "SOCBreakpoints": soc,
        f"OpenCircuitVoltage{thermal}": ocv_v,
        "ResistanceSOCBreakpoints": inside,
    }
    if degc is not None:
        kelvin = np.array(degc.degc) + 273.15
        table_based["T_vec"] = kelvin
        equivalent["TemperatureBreakpoints"] = kelvin
        equivalent["ResistanceTemperatureBreakpoints"] = kelvin
    for name, values in (degc or tables).resistances.items():
        table_based[f"{name}_{kind}"] = over(soc, values)
        equivalent[f"{name}{thermal}"] = over(inside, values)
    for pair, tau_s in enumerate(tables.tau_s, start=1):
        constant = [tau_s] if degc is None else np.full((len(degc.degc), 1), tau_s)
        table_based[f"tau{pair}_{kind}"] = over(soc, constant)
        equivalent[f"Tau{pair}{thermal}"] = over(inside, constant)
    variables = table_based | {
        "V_range": np.array([0.0, np.inf]),
        "AH": tables.capacity_ah,
        "prm_dyn": f"simscape.enum.tablebattery.prm_dyn.rc{tables.pairs}",
        "stateOfCharge": tables.initial_soc,
        "BatteryEquivalentCircuit": equivalent,
        "barnax_notes": note_lines(tables.heading, caveats),
    }
    file = io.BytesIO()
    savemat(file, variables, oned_as="row", long_field_names=degc is not None)
    # SciPy writes the date there; equal results are to give equal bytes.
    file.seek(0)
    file.write(HEADER.ljust(HEADER_BYTES))
    return Export(file.getvalue(), caveats)


SIMSCAPE = Exporter(
    name="simscape",
    description="MATLAB file: Simscape's Battery (Table-Based) and Battery Equivalent Circuit",
    file_name="barnax_simscape.mat",
    write=write_simscape,
)
