"""Exports that are plain files: C headers, CSV, JSON, and a `.mat` file for Simscape.

The C filter is the sum of `barnax.filters` with "joint" offset and capacity: no allocation, one
structure, single or double precision set by one definition.
"""

import io
import json
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime

import numpy as np
from scipy.io import savemat
from xlsxwriter import Workbook

from ..cell.circuits import TURN_WIDTH
from ..cell.dependence import CHARGE
from ..errors import InputError
from ..execution import in_float64
from ..files import csv_text
from ..filters.kalman import GATE_S, GATE_SD, OUTSIDE_SD, OVERLAP, PARTS, SIDES
from ..filters.model import (
    BIAS_SOC,
    CAPACITY,
    GRID,
    OFFSET,
    RESTING,
    RESTING_S,
    STEPS_PER_SOC,
    WALK_S,
)
from ..records.quantities import KELVIN
from ..result_filter import model_of
from ..results import Result
from .exporter import Export, caveats_of, from_template, note_lines
from .tables import Tables, VoltageTable, tables_of

# Codes of the hysteresis kinds in C programs.
HYSTERESIS = {"none": 0, "instant": 1, "dynamic": 2, "loops": 3}


def write_c_header(result: Result) -> Export:
    """The header's source, in C89: everything needed to simulate the circuit as barnax does.

    Pairs start without voltage. Tables follow the curves within `TOLERANCE_V`.
    """
    tables = tables_of(result)
    return from_template(
        "barnax_cell.h.jinja",
        tables.heading,
        tables.caveats,
        tables=tables,
        kind=HYSTERESIS[tables.kind],
    )


@in_float64
def write_c_filter(result: Result) -> Export:
    """The header's source. Raises `InputError` for a result without an assessment."""
    measured_degc, caveats = result.fits.temperatures_degc, ()
    if measured_degc:
        degc = result.fits.reference_degc or 0.0
        result = result.at_temperature(degc)
        others = [other for other in measured_degc if other != degc]
        caveats = caveats_of("c_filter", degc, others)
    tables, model = tables_of(result, may_remember=True), model_of(result, (OFFSET, CAPACITY))
    # Columns that change with SOC are a table, all others constants. Table values are relative to
    # the middle: in single precision a flat OCV's slope would be lost in its volts.
    table = np.asarray(model.table)
    varies = np.ptp(table, axis=0) > 0
    middle = np.median(table, axis=0)
    return from_template(
        "barnax_filter.h.jinja", tables.heading, caveats + tables.caveats,
        tables=tables, model=model,
        kind=HYSTERESIS[model.hysteresis],
        gate_sd=GATE_SD, gate_s=GATE_S,
        parts=PARTS, sides=SIDES, overlap=OVERLAP, outside_sd=OUTSIDE_SD, bias_soc=BIAS_SOC,
        resting=RESTING, resting_s=RESTING_S,
        turn_soc=TURN_WIDTH, walk_s=WALK_S, first_soc=GRID[0], steps_per_soc=STEPS_PER_SOC,
        column=np.where(varies, np.cumsum(varies) - 1, -1),
        constant=middle,
        rows=(table - middle)[:, varies].tolist(),
    )  # fmt: skip


def write_csv(result: Result) -> Export:
    """The table. `OCV(0.5)`, `W(0.5)`, `R0(0.5)` are points of the curves over SOC, for linear
    interpolation; `R0(0.5, 25.0)` is at a temperature in degC too.

    The hysteresis starts in the initial direction, and keeps its direction below the rest current.
    """
    tables = tables_of(result)
    rows = ((name, repr(value), unit) for name, value, unit in _rows(tables, result))
    return Export(csv_text(("name", "value", "unit"), rows).encode(), tables.caveats)


def write_xlsx(result: Result) -> Export:
    """A workbook: the parameters as in `csv`, notes, and the OCV over SOC of a discharged and of a
    charged cell."""
    tables = tables_of(result)
    soc, ocv_v = tables.ocv.soc, tables.ocv.voltage_v
    half_v = 0 * soc if tables.hysteresis is None else tables.hysteresis(soc) / 2
    sheets = {
        "parameters": [("name", "value", "unit"), *_rows(tables, result)],
        "OCV": [
            ("SOC", "after discharging [V]", "after charging [V]"),
            *zip(soc.tolist(), (ocv_v - half_v).tolist(), (ocv_v + half_v).tolist(), strict=True),
        ],
        "notes": [(text,) for text in (tables.heading, *tables.caveats)],
    }
    content = io.BytesIO()
    # Text is never a formula, whatever its first character; and equal results give equal bytes.
    with Workbook(content, {"in_memory": True, "strings_to_formulas": False}) as workbook:
        workbook.set_properties({"created": datetime(2000, 1, 1, tzinfo=UTC)})
        for name, rows in sheets.items():
            sheet = workbook.add_worksheet(name)
            for index, row in enumerate(rows):
                sheet.write_row(index, 0, row)
    return Export(content.getvalue(), tables.caveats)


def _rows(tables: Tables, result: Result) -> Iterator[tuple[str, float, str]]:
    if tables.nodes is None:
        for name, value in tables.parameters.to_dict().items():
            plain, _, unit = name.partition(" ")
            yield plain, value, unit.strip("[]") or "1"
    else:
        for name, values in tables.resistances.items():
            yield from _points(name, np.array(tables.nodes), values, "Ohm", tables.degc)
        if tables.gamma is not None:
            yield "gamma", tables.gamma, "1"
    for pair, tau_s in enumerate(tables.tau_s, start=1):
        yield f"tau{pair}", tau_s, "s"
    yield from _means(result)
    yield "capacity", tables.capacity_ah, "A.h"
    yield "initial SOC", result.initial_soc, "1"
    yield "initial direction", result.start.direction, "1"
    yield "rest current", result.start_rest_current_a, "A"
    yield from _beside(result)
    yield from _points("OCV", tables.ocv.soc, tables.ocv_v, "V", tables.degc)
    if tables.hysteresis is not None:
        yield from _points("W", tables.hysteresis.soc, tables.hysteresis.voltage_v, "V")


def _means(result: Result) -> Iterator[tuple[str, float, str]]:
    """The means of tables over SOC with the ends of their intervals, or the ends of constants."""
    for degc, fit in result.fits.by_degc:
        where = "" if degc is None else f", {degc:.4g} degC"
        for mean in (fact for fact in fit.facts if fact.is_mean):
            name, _, unit = mean.name.rstrip("]").partition(" [")
            label = f"mean {name}" if fit.is_over_soc else name
            ends = {label: mean.value, f"{label} low": mean.low, f"{label} high": mean.high}
            for called, value in ends.items():
                if value is not None and (fit.is_over_soc or called != name or " + " in name):
                    yield f"{called}{where}", value, unit


def _beside(result: Result) -> Iterator[tuple[str, float, str]]:
    """The numbers of the resistance law, with the meaning of the given resistances."""
    for degc, fit in result.fits.by_degc:
        law = fit.tables.dependence
        where = "" if degc is None else f", {degc:.4g} degC"
        for name, value in {} if law is None else law.numbers.items():
            plain, _, unit = name.removesuffix("]").partition(" [")
            taken = " (R: geometric mean of charge and discharge)" if name == CHARGE else ""
            yield f"{plain}{where}{taken}", value, unit or "1"


def _points(
    name: str, soc: np.ndarray, values: np.ndarray, unit: str, degc: Sequence[float] | None = None
) -> Iterator[tuple[str, float, str]]:
    """A row per point, at each temperature in turn if there are several."""
    where_at = [""] if degc is None else [f", {each!r}" for each in degc]
    for where, row in zip(where_at, np.atleast_2d(values).tolist(), strict=True):
        for at, value in zip(soc.tolist(), row, strict=True):
            yield f"{name}({at!r}{where})", value, unit


def write_json(result: Result) -> Export:
    """One object of plain numbers and lists: a list is over its SOC, and a list of lists over
    temperature and SOC. A single temperature is that of the first record, null if it is unknown."""
    tables = tables_of(result)
    content: dict[str, object] = {
        "notes": [tables.heading, *tables.caveats],
        "circuit": result.model,
        "capacity [A.h]": tables.capacity_ah,
        "initial SOC": result.initial_soc,
        "initial direction": result.start.direction,
        "rest current [A]": result.start_rest_current_a,
        "hysteresis": tables.kind,
        "gamma": tables.gamma,
        "tau [s]": tables.tau_s,
        "temperature [degC]": tables.degc or result.measured_at[0][1],
        "resistances": {"SOC": tables.nodes}
        | {f"{name} [Ohm]": values.tolist() for name, values in tables.resistances.items()},
        "OCV": _listed(tables.ocv) | {"voltage [V]": tables.ocv_v.tolist()},
        "W": None if tables.hysteresis is None else _listed(tables.hysteresis),
    }
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    return Export(text.encode(), tables.caveats)


def _listed(table: VoltageTable) -> dict[str, list]:
    return {"SOC": table.soc.tolist(), "voltage [V]": table.voltage_v.tolist()}


HEADER_BYTES = 116
# For Battery (Table-Based), `prm_dyn` from rc1 on.
MAX_SIMSCAPE_PAIRS = 5
HEADER = b"MATLAB 5.0 MAT-file, written by barnax"


def write_simscape(result: Result) -> Export:
    """The .mat file (MATLAB 5), with the parameters of two blocks.

    Variables named like the parameters of Battery (Table-Based); and, as one structure,
    `BatteryEquivalentCircuit` with the fields of the block of that name.
    """
    tables = tables_of(result)
    if tables.pairs > MAX_SIMSCAPE_PAIRS:
        raise InputError(
            f"Simscape's Battery (Table-Based) has at most {MAX_SIMSCAPE_PAIRS} RC pairs, and "
            f"{result.model} takes {tables.pairs}; export `to` another format, or identify a "
            "circuit of RC pairs"
        )
    degc = tables.degc
    inner = (tables.ocv.soc >= 0) & (tables.ocv.soc <= 1)
    soc = tables.ocv.soc[inner]
    nodes = np.array([0.0, 1.0] if tables.nodes is None else tables.nodes)
    caveats = tables.caveats + caveats_of("simscape", tables, inner.all())

    def over(points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """A resistance at the given SOC, with a column per temperature if there are several."""
        rows = np.atleast_2d(values)
        read = [np.interp(points, nodes, np.broadcast_to(row, len(nodes))) for row in rows]
        return np.array(read).T if degc is not None else read[0]

    inside = np.unique(np.clip(nodes, 0.0, 1.0))
    # The blocks have separate names for parameters tabulated over temperature.
    kind, thermal = ("vec", "") if degc is None else ("mat", "Thermal")
    ocv_v = tables.ocv_v[..., inner].T
    table_based: dict[str, object] = {"SOC_vec": soc, f"V0_{kind}": ocv_v}
    equivalent: dict[str, object] = {
        "BatteryCapacity": tables.capacity_ah,
        "SOCBreakpoints": soc,
        f"OpenCircuitVoltage{thermal}": ocv_v,
        "ResistanceSOCBreakpoints": inside,
    }
    if degc is not None:
        kelvin = np.array(degc) - KELVIN.offset
        table_based["T_vec"] = kelvin
        equivalent["TemperatureBreakpoints"] = kelvin
        equivalent["ResistanceTemperatureBreakpoints"] = kelvin
    times_s = {
        f"tau{pair}": np.full((len(degc or [0]), 1), tau_s)
        for pair, tau_s in enumerate(tables.tau_s, start=1)
    }
    for name, values in (tables.resistances | times_s).items():
        table_based[f"{name}_{kind}"] = over(soc, values)
        equivalent[f"{name.capitalize()}{thermal}"] = over(inside, values)
    variables = table_based | {
        "V_range": np.array([0.0, np.inf]),
        "AH": tables.capacity_ah,
        "prm_dyn": f"simscape.enum.tablebattery.prm_dyn.rc{tables.pairs}",
        "stateOfCharge": result.initial_soc,
        "BatteryEquivalentCircuit": equivalent,
        "barnax_notes": note_lines(tables.heading, caveats),
    }
    file = io.BytesIO()
    savemat(file, variables, oned_as="row", long_field_names=degc is not None)
    # SciPy writes the date there; equal results must give equal bytes.
    file.seek(0)
    file.write(HEADER.ljust(HEADER_BYTES))
    return Export(file.getvalue(), caveats)
