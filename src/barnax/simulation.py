"""A result's circuit on a current of your own: the resulting voltage and state of charge."""

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from .cell.curves import SegmentedHysteresis
from .cell.dependence import BETA
from .cell.model import SAME_DEGC
from .cell.parameters import HALF_HYSTERESIS
from .errors import InputError
from .model.prepared import prepare_record
from .model.reference import simulate_circuit
from .model.window import OCV_MARGIN, SAME_FULL, Window
from .notices import Notice
from .records import Record, source_from_frame
from .records.table import take_lines
from .results import Result

NAME = "the current"
# A charge-positive current is the usual mistake.
REMEDY = "check `initial_soc` and the sign of the current (discharge is positive)"

# Currents above this multiple of the largest in the identification are far from it.
FAR_CURRENT = 1.5


class Simulated(NamedTuple):
    """Terminal voltage in V and state of charge at every sample."""

    voltage_v: Float[np.ndarray, "samples"]
    soc: Float[np.ndarray, "samples"]


class Load(NamedTuple):
    """A current over time, and the names of its columns."""

    time_s: Float[np.ndarray, "samples"]
    current_a: Float[np.ndarray, "samples"]
    names: tuple[str, str]
    temperature_degc: Float[np.ndarray, "samples"] | None


def simulate_frame(
    result: Result,
    current: Any,
    time: Any = None,
    *,
    temperature_degc: float | None = None,
    **given: Any,
) -> Any:
    """The columns of `Result.simulate`, of the same kind as `current`."""
    if time is not None:
        current = {"Time [s]": time, "Current [A]": current}
    elif isinstance(current, list | tuple) or (hasattr(current, "ndim") and current.ndim == 1):
        raise InputError(f"{NAME} has no times; give them in s as the second argument")
    profile = _columns(current)
    _require_numbers(profile)
    time_s, current_a, *_ = profile
    given |= {"temperature_degc": temperature_degc, "measured_degc": profile.temperature_degc}
    simulated = simulate_current(result, time_s, current_a, **given)
    for doubt in _doubts(result, profile, simulated.soc, temperature_degc):
        # Attributed to the line that calls `Result.simulate`.
        warnings.warn(str(doubt), stacklevel=3)
    columns = {
        "Time [s]": time_s,
        "Current [A]": current_a,
        "Voltage [V]": simulated.voltage_v,
        "SOC": simulated.soc,
    }
    if isinstance(current, Mapping):
        return columns
    # Only data frames need it.
    import narwhals as nw

    return nw.from_dict(columns, backend=nw.get_native_namespace(current)).to_native()


def _columns(frame: Any) -> Load:
    """The time in s and the current in A of a frame, under the column names that records use."""
    if isinstance(frame, Mapping):
        lengths = {str(name): np.size(values) for name, values in frame.items()}
        short, long = (pick(lengths, key=lengths.__getitem__, default="") for pick in (min, max))
        if short != long and lengths[short] < lengths[long]:
            raise InputError(
                f"{NAME}: {short!r} has {lengths[short]} values and {long!r} has {lengths[long]}: "
                f"row {lengths[short]} (from 0) is incomplete; give as many of each"
            )
    table = source_from_frame(frame, NAME).table
    columns = table.header.columns
    missing = [name for name in ("time", "current") if name not in columns]
    if missing:
        raise InputError(
            f"{NAME}: no column of the {missing[0]} among {', '.join(table.header.names)}; name it "
            f"'{missing[0].capitalize()} [{'s' if missing[0] == 'time' else 'A'}]'"
        )
    wanted = [name for name in ("time", "current", "temperature") if name in columns]
    values = take_lines(table, {name: columns[name] for name in wanted}).values
    names = repr(columns["time"].header), repr(columns["current"].header)
    return Load(values["time"], values["current"], names, values.get("temperature"))


def _doubts(
    result: Result, profile: Load, soc: Float[np.ndarray, "samples"], given_degc: float | None
) -> Iterator[Notice]:
    """Notices that a simulation goes beyond the range of the identification."""
    parts = result.of_role("identification")
    max_a = max((part.peak_current_a or 0.0 for part in parts), default=0.0)
    far = np.flatnonzero(np.abs(profile.current_a) > FAR_CURRENT * max_a)
    if max_a and len(far):
        worst = far[np.argmax(np.abs(profile.current_a[far]))]
        at = {"current_a": profile.current_a[worst], "time_s": profile.time_s[worst]}
        more = len(far) - 1 or None
        yield Notice(
            "simulation.far-current", {**at, "sample": worst, "largest_a": max_a, "more": more}
        )
    ranges = [part.soc_range for part in parts if part.soc_range is not None]
    if ranges:
        low, high = min(low for low, _ in ranges), max(high for _, high in ranges)
        outside = np.flatnonzero((soc < low - SAME_FULL) | (soc > high + SAME_FULL))
        if len(outside):
            at = {"samples": len(outside), "time_s": profile.time_s[outside[0]]}
            at |= {"low_percent": 100 * low, "high_percent": 100 * high}
            at |= {"what": "tables" if result.over else "circuit"}
            ends = _at(result, given_degc).cell_at().soc_range
            is_within = ends[0] - SAME_FULL <= soc.min() and soc.max() <= ends[1] + SAME_FULL
            held = "true" if result.over else None
            yield Notice("simulation.outside-soc", {**at, "held": held if is_within else "ocv"})
    degc = profile.temperature_degc
    dependence = _at(result, given_degc).circuit_parameters.dependence
    is_followed = dependence is not None and BETA in dependence.numbers
    if degc is not None and not is_followed and np.nanmax(degc) - np.nanmin(degc) > SAME_DEGC:
        yield Notice("simulation.temperature", subject=NAME)
    if degc is not None and is_followed and given_degc is not None:
        values = {"column_degc": float(np.nanmedian(degc)), "given_degc": given_degc}
        if abs(values["column_degc"] - given_degc) > SAME_DEGC:
            yield Notice("simulation.temperature", values, NAME)


def simulate_current(
    result: Result,
    time_s: Float[np.ndarray, "samples"],
    current_a: Float[np.ndarray, "samples"],
    *,
    initial_soc: float | None = None,
    initial_direction: Literal[-1, 1] | None = None,
    temperature_degc: float | None = None,
    measured_degc: Float[np.ndarray, "samples"] | None = None,
    has_hysteresis: bool = True,
    has_dependence: bool = True,
) -> Simulated:
    """A result's circuit, or its tables, on a current that is held from each time to the next.

    Starts like the identification unless given otherwise. Raises `InputError` as `Result.simulate`
    does.
    """
    result = _at(result, temperature_degc)
    cell, circuit = result.cell_at(), result.circuit_parameters
    if not has_hysteresis:
        cell = replace(cell, hysteresis=SegmentedHysteresis.zero())
        circuit = circuit.without(HALF_HYSTERESIS)
    if not has_dependence:
        circuit = replace(circuit, dependence=None)
    start = result.start
    start_soc = start.soc if initial_soc is None else initial_soc
    # Counted charge may put a start slightly beyond full or empty.
    parts = result.of_role("identification")
    ends = [part.start.soc for part in parts if part.start is not None]
    ends += [soc for part in parts for soc in part.soc_range or ()]
    is_shown = min(ends) <= start_soc <= max(ends)
    window = Window(
        start_time_s=float(time_s[0]),
        initial_soc=start_soc,
        soc_source="registered" if is_shown else None,
        initial_direction=start.direction if initial_direction is None else initial_direction,
        rest_current_a=result.start_rest_current_a,
        temperature_degc=temperature_degc,
    )
    discharged_ah = np.cumsum(current_a[:-1] * np.diff(time_s)) / 3600
    soc = start_soc - np.concatenate([[0.0], discharged_ah]) / cell.capacity_ah
    low, high = cell.soc_range
    # Identified records may leave the OCV too, at samples that are not scored.
    lowest, highest = min(low, *ends), max(high, *ends)
    far = np.flatnonzero((soc < lowest - OCV_MARGIN) | (soc > highest + OCV_MARGIN))
    if len(far):
        raise InputError(
            f"{NAME} takes the cell to a state of charge of {soc[far[0]]:.3f} at "
            f"{time_s[far[0]]:g} s (sample {far[0]}), but its OCV and the records identified on "
            f"reach from {lowest:.3f} to {highest:.3f} only; {REMEDY}, or end before"
        )
    # Nothing is measured here; a simulation does not use the voltage.
    signals = time_s, current_a, cell.average_ocv_v(soc)
    record = Record.of_load(NAME, *signals, temperature_degc=measured_degc)
    prepared = prepare_record(record, cell, result.model, window, is_measured=False)
    return Simulated(simulate_circuit(prepared, circuit), soc)


def _require_numbers(profile: Load) -> None:
    """Raise `InputError` for anything other than a current over time."""
    time_s, current_a, names, _ = profile
    if time_s.ndim != 1 or time_s.shape != current_a.shape or len(time_s) < 2:
        raise InputError(
            f"{NAME} has the shape {current_a.shape} and its times {time_s.shape}; give one "
            "current for each of at least two times"
        )
    for name, values in zip(names, (time_s, current_a), strict=True):
        wrong = np.flatnonzero(~np.isfinite(values))
        if len(wrong):
            raise InputError(
                f"{NAME}: {name} is {values[wrong[0]]} in row {wrong[0]} (from 0); give a number, "
                "or leave the row out"
            )
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if len(back):
        raise InputError(
            f"{NAME}: {names[0]} does not rise from row {back[0]} (from 0), {time_s[back[0]]:g} s, "
            f"to the next, {time_s[back[0] + 1]:g} s; sort the rows, and leave out what is there "
            "twice"
        )


def _at(result: Result, degc: float | None) -> Result:
    """The result at a temperature, if it covers that."""
    if measured_degc := result.fits.temperatures_degc:
        low, high = measured_degc[0], measured_degc[-1]
        if degc is None or not low - SAME_DEGC <= degc <= high + SAME_DEGC:
            given = "" if degc is None else f", not at {degc:g} degC"
            raise InputError(
                f"the tables are known from {low:.3g} to {high:.3g} degC{given}; give a "
                "`temperature` among these"
            )
        return result.at_temperature(degc)
    if degc is None:
        return result
    measured = [each for _, each in result.measured_at if each is not None]
    if not any(abs(each - degc) <= SAME_DEGC for each in measured):
        scope = f"is of {measured[0]:.3g} degC alone" if measured else "is of no known temperature"
        raise InputError(
            f"the circuit {scope}, and says nothing of {degc:g} degC; leave `temperature` out, or "
            "identify `over` 'soc,temperature' on records of several"
        )
    return result.at_temperature(degc)
