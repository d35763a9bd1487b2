"""A result's circuit on a current of one's own: the voltage and the state of charge that follow."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from .cell.curves import SegmentedHysteresis
from .cell.model import SAME_DEGC
from .errors import InputError
from .model.prepared import OCV_MARGIN, prepare_record
from .model.window import Window
from .over_soc import simulate_tables
from .records import Decision, Record, source_from_frame
from .records.columns import columns_of
from .records.table import take_lines
from .results import Result
from .search.evaluate import simulate_circuit

NAME = "the current"
# A charge-positive current is the usual mistake.
REMEDY = "check `initial_soc` and the sign of the current (discharge is positive)"


class Simulated(NamedTuple):
    """Terminal voltage in V and state of charge at every sample."""

    voltage_v: Float[np.ndarray, "samples"]
    soc: Float[np.ndarray, "samples"]


def simulate_frame(result: Result, current: Any, time: Any = None, **known: Any) -> Any:
    """What `Result.simulate` gives: columns of the same kind as `current`."""
    if time is not None:
        time_s, current_a = (np.asarray(each, float) for each in (time, current))
    elif isinstance(current, list | tuple) or (hasattr(current, "ndim") and current.ndim == 1):
        raise InputError(f"{NAME} has no times; give them in s as the second argument")
    else:
        time_s, current_a = _columns(current)
    found = simulate_current(result, time_s, current_a, **known)
    columns = {
        "time [s]": time_s,
        "current [A]": current_a,
        "voltage [V]": found.voltage_v,
        "SOC": found.soc,
    }
    if time is not None or isinstance(current, Mapping):
        return columns
    # Only data frames need it.
    import narwhals as nw

    return nw.from_dict(columns, backend=nw.get_native_namespace(current)).to_native()


def _columns(frame: Any) -> tuple[Float[np.ndarray, "samples"], Float[np.ndarray, "samples"]]:
    """The time in s and the current in A of a frame, by the names that records have too."""
    table = source_from_frame(frame, NAME).table
    found = columns_of(table.header)
    missing = [name for name in ("time", "current") if name not in found]
    if missing:
        raise InputError(
            f"{NAME}: no column of the {missing[0]} among {', '.join(table.header)}; name it "
            f"'{missing[0].capitalize()} [{'s' if missing[0] == 'time' else 'A'}]'"
        )
    lines = take_lines(table, {name: found[name] for name in ("time", "current")})
    return lines.values["time"], lines.values["current"]


def simulate_current(
    result: Result,
    time_s: Float[np.ndarray, "samples"],
    current_a: Float[np.ndarray, "samples"],
    *,
    initial_soc: float | None = None,
    initial_direction: Literal[-1, 1] | None = None,
    temperature_degc: float | None = None,
    has_hysteresis: bool = True,
) -> Simulated:
    """A result's circuit, or its tables, on a current that is held from each time to the next.

    Starts as the identification did where nothing else is given. Raises `InputError` as
    `Result.simulate` does.
    """
    _require_numbers(time_s, current_a)
    result = _at(result, temperature_degc)
    cell, tables = result.cell_at(), result.tables.fit.tables if result.tables else None
    if not has_hysteresis:
        cell = replace(cell, hysteresis=SegmentedHysteresis.zero())
        tables = None if tables is None else replace(tables, half_hysteresis_v=None)
    start = result.start
    start_soc = start.soc if initial_soc is None else initial_soc
    window = Window(
        initial_soc=start_soc,
        initial_direction=start.direction if initial_direction is None else initial_direction,
        rest_current_a=result.start_rest_current_a,
    )
    discharged_ah = np.cumsum(current_a[:-1] * np.diff(time_s)) / 3600
    soc = start_soc - np.concatenate([[0.0], discharged_ah]) / cell.capacity_ah
    low, high = cell.soc_range
    far = np.flatnonzero((soc < low - OCV_MARGIN) | (soc > high + OCV_MARGIN))
    if len(far):
        raise InputError(
            f"{NAME} takes the cell to a state of charge of {soc[far[0]]:.3f} at "
            f"{time_s[far[0]]:g} s (sample {far[0]}), but its OCV is known from {low:.3f} to "
            f"{high:.3f} only; {REMEDY}, or end before"
        )
    given = Decision("forward", "given", "made so")
    record = Record(
        name=NAME,
        time_s=time_s,
        current_a=current_a,
        # Nothing is measured here; a simulation does not look at it.
        voltage_v=cell.average_ocv_v(soc),
        temperature_degc=None,
        step=None,
        row=np.arange(len(soc)) + 2,
        sign=replace(given, value="discharge-positive"),
        hold=given,
        sha256="",
    )
    prepared = prepare_record(record, cell, result.model, window, is_measured=False)
    if tables is None:
        return Simulated(simulate_circuit(prepared, result.constant.circuit_parameters), soc)
    return Simulated(simulate_tables(prepared, tables), soc)


def _require_numbers(time_s: np.ndarray, current_a: np.ndarray) -> None:
    """Raise `InputError` for what is no current over time."""
    if time_s.ndim != 1 or time_s.shape != current_a.shape or len(time_s) < 2:
        raise InputError(
            f"{NAME} has the shape {current_a.shape} and its times {time_s.shape}; give one "
            "current for each of at least two times"
        )
    for name, values in (("time", time_s), ("current", current_a)):
        wrong = np.flatnonzero(~np.isfinite(values))
        if len(wrong):
            raise InputError(f"{NAME}: the {name} of sample {wrong[0]} is {values[wrong[0]]}")
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if len(back):
        raise InputError(
            f"{NAME}: the time does not rise from sample {back[0]}, {time_s[back[0]]:g} s, to the "
            f"next, {time_s[back[0] + 1]:g} s; sort the samples, and leave out what is there twice"
        )


def _at(result: Result, degc: float | None) -> Result:
    """The result at a temperature, where it says something of that."""
    over = result.tables and result.tables.over_temperature
    if over is not None:
        low, high = over.temperatures_degc[0], over.temperatures_degc[-1]
        if degc is None or not low - SAME_DEGC <= degc <= high + SAME_DEGC:
            given = "" if degc is None else f", not at {degc:g} degC"
            raise InputError(
                f"the tables are known from {low:.3g} to {high:.3g} degC{given}; give a "
                "`temperature` among these"
            )
        return result.at_temperature(degc)
    if degc is None:
        return result
    known = [each for _, each in result.measured_at if each is not None]
    if not any(abs(each - degc) <= SAME_DEGC for each in known):
        told = f"is of {known[0]:.3g} degC alone" if known else "is of no known temperature"
        raise InputError(
            f"the circuit {told}, and says nothing of {degc:g} degC; leave `temperature` out, or "
            "identify `over` 'soc,temperature' on records of several"
        )
    return result.at_temperature(degc)
