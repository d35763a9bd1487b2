"""A plan run: `identify` given a folder, a plan, or files without an OCV test; and pulse tests.

Pulse tests are made ready to be identified: their own OCV, and where each of them starts.
"""

import functools
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..cell import CellModel, OcvPoint, characterize_over_temperature
from ..cell.model import REFERENCE_DEGC, group_near
from ..errors import InputError
from ..inputs import (
    OVER_TEMPERATURE,
    Given,
    Reading,
    Watch,
    file_names,
    listed,
    source_of,
    unwatched,
    window_of,
    windows_by_name,
)
from ..model.prepared import OCV_MARGIN, soc_along, temperature_of
from ..model.window import Window
from ..pulses import Pulse, first_pulse
from ..records import Record, Source, read_record, read_source
from ..results import Result
from .choosing import plan
from .document import Part, Plan, Use, plan_from_toml

Run = Callable[..., Result]


def plan_of(records: Any, ocv: Any = (), validate: Any = (), **options: Any) -> Plan | None:
    """The plan of what `identify` was given, None where the files' roles are all given.

    There is one for a folder, a plan or its TOML file, and for files without an OCV test of a cell
    that is not known. Of `options` those matter that say how files are read, and what is known of
    them.
    """
    given = listed(records)
    if options.get("cell") is not None:
        return None
    if len(given) == 1 and isinstance(given[0], Plan):
        return given[0]
    paths = [Path(each) for each in given if isinstance(each, str | Path)]
    if len(given) == len(paths) == 1 and paths[0].suffix.lower() == ".toml":
        return plan_from_toml(paths[0])
    if not any(map(os.path.isdir, paths)) and (not paths or listed(ocv)):
        return None
    if len(paths) < len(given):
        return None
    reading = _reading(options)
    watch = options.get("watch", unwatched)
    said = {name: options.get(name) for name in ("over", "window", "capacity")}
    return plan(given, ocv=ocv, validate=validate, **said, reading=reading, watch=watch)


def _reading(options: Mapping[str, Any]) -> Reading:
    own = {name: options[name] for name in ("columns", "series") if name in options}
    return options.get("reading") or Reading(**own)


def plans_first(identify: Run) -> Run:
    """`identify`, which makes a plan first where it is given a folder or no OCV test."""

    @functools.wraps(identify)
    def planned(records: Any = (), *, ocv: Any = (), validate: Any = (), **options: Any) -> Result:
        found = plan_of(records, ocv, validate, **options)
        if found is None:
            return identify(records, ocv=ocv, validate=validate, **options)
        result = identify(**arguments(found, **options))
        return result.model_copy(update={"plan": found.stored})

    return planned


def arguments(
    found: Plan, *, window: Any = None, capacity: float | None = None, **options: Any
) -> dict[str, Any]:
    """What `identify` is given for a plan; options that are given replace the plan's.

    Raises `InputError` where a test is missing.
    """
    if found.missing:
        raise InputError("\n".join([found.missing, *found.lines]))
    found = found.changed(window, capacity=capacity)
    windows = {
        each.name: each.window
        for each in found.parts
        # Of an OCV test its temperature counts.
        if each.is_simulated or each.window.temperature_degc is not None
    }
    reading = _reading({**found.options, **options})
    given = {
        **found.options,
        **options,
        "records": _sources(found, "identification", reading),
        "ocv": _sources(found, "OCV test", reading),
        # Windows for names that are not simulated are refused further on.
        "window": {**windows_by_name(window), **windows},
    }
    validate = _sources(found, "validation", reading)
    if found.command == "hppc":
        given = prepare_pulse_tests(**given)
    return {**given, "validate": validate}


def _sources(found: Plan, role: Use, reading: Reading) -> list[Any]:
    return [_source(part, reading) for part in found.of_role(role)]


def _source(part: Part, reading: Reading) -> Any:
    if part.source is not None or part.span_s is None:
        return part.source or part.path
    source = read_source(part.path, columns=reading.columns, series=reading.series)
    return replace(source, name=part.name, span_s=part.span_s)


@dataclass(frozen=True, eq=False)
class _Test:
    """One test: what was given, the record in it, and its first pulse, whose SOC is not known."""

    source: Source | Record
    record: Record
    pulse: Pulse


def prepare_pulse_tests(
    records: Given | Sequence[Given],
    *,
    ocv: Given | Sequence[Given] = (),
    window: Window | Mapping[str, Window] | None = None,
    capacity: float | None = None,
    reading: Reading | None = None,
    watch: Watch = unwatched,
    **options: Any,
) -> dict[str, Any]:
    """The arguments of `identify` for pulse tests, as `barnax.hppc` describes; others stay.

    Raises `InputError` where a record has no pulses.
    """
    reading = reading or Reading()
    own = {name: options.pop(name) for name in list(options) if hasattr(reading, name)}
    reading = replace(reading, **own)
    with watch("Finding pulses", 0):
        tests = _read(listed(records), reading)
        chosen = windows_by_name(window)
        ocv_tests, cell = listed(ocv), None
        if not ocv_tests:
            given_ah = chosen.get("", Window()).capacity_ah if capacity is None else capacity
            # A polynomial would swing between ten points, whatever was asked for.
            options["ocv_fit"] = "interpolated"
            by_degc = group_near((_degc(each, chosen), each) for each in tests)
            own = {degc: each[:1] for degc, each in by_degc.items()}
            cell = characterize_over_temperature(
                {degc: [first.record] for degc, (first,) in own.items()},
                capacity_ah=given_ah,
                ocv_fit="interpolated",
            )
            ocv_tests = [first.source for (first,) in own.values()]
            reading = replace(reading, ocv_current_sign=reading.current_sign)
        # From the rest before the first pulse on, but where something else is chosen.
        windows = {
            each.record.name: _own_window(each, cell, window_of(chosen, each.record.name))
            for each in tests
        }
        is_one = len(group_near((_degc(each, chosen), each) for each in tests)) == 1
    return {
        "over": "soc" if is_one else OVER_TEMPERATURE,
        **options,
        "records": [each.source for each in tests],
        "ocv": ocv_tests,
        "window": {"": window_of(chosen, ""), **chosen, **windows},
        "capacity": capacity,
        "reading": reading,
        "watch": watch,
    }


def _read(given: Sequence[Given], reading: Reading) -> list[_Test]:
    """Every test once. Raises `InputError` where one has no pulses."""
    names = file_names([each for each in given if isinstance(each, str | Path)])
    tests = []
    for each in given:
        source = record = each
        if not isinstance(each, Record):
            source = source_of(each, names, reading)
            record = read_record(source, **reading.options())
        pulse = first_pulse(record)
        if pulse is None:
            raise InputError(
                f"{record.name}: found no pulses of up to 2 min after rests of at least 5 min; "
                "identify it as a dynamic record"
            )
        tests.append(_Test(source, record, pulse))
    return tests


def _degc(test: _Test, chosen: Mapping[str, Window]) -> float:
    """The temperature given for a test, else its median; the reference where none is known."""
    known = temperature_of(test.record, window_of(chosen, test.record.name))
    return REFERENCE_DEGC if known is None else known


def _own_window(test: _Test, cell: CellModel | None, window: Window) -> Window:
    """Where a pulse test starts: at its first OCV point, at that point's state of charge.

    Where the OCV is of another record, or `cell` is None, at the end of the rest before the first
    pulse. What `window` has stays.
    """
    if window.start_time_s is not None or window.start_after_step is not None:
        return window
    record = test.record
    if cell is not None:
        cell = cell.at(temperature_of(record, window))
    branches = () if cell is None else (*cell.charge_points, *cell.discharge_points)
    points = [point for point in branches if point.source == record.name]
    if cell is not None and points:
        first: OcvPoint = min(points, key=lambda point: point.row)
        at = int(np.searchsorted(record.row, first.row))
        soc = min(max(first.soc, 0.0), 1.0) if window.initial_soc is None else window.initial_soc
        window = replace(window, start_time_s=float(record.time_s[at]), initial_soc=soc)
        return _within_ocv(window, record, cell, at)
    at = int(np.searchsorted(record.row, test.pulse.row)) - 1
    return replace(window, start_time_s=float(record.time_s[at]))


def _within_ocv(window: Window, record: Record, cell: CellModel, first: int) -> Window:
    """The window without the samples too far beyond the OCV points.

    A test that ends at its cut-off without a rest has no point there.
    """
    low, high = cell.soc_range
    start = 1.0 if window.initial_soc is None else window.initial_soc
    soc = soc_along(record, window.capacity_ah or cell.capacity_ah, first, start)
    reach = (low - OCV_MARGIN, high + OCV_MARGIN)
    is_inside = reach[0] <= soc[first:].min() and soc[first:].max() <= reach[1]
    return window if is_inside or window.score_soc else replace(window, score_soc=reach)
