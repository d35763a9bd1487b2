"""Pulse tests made ready to be identified: their own OCV, and where each of them starts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..cell import CellModel, OcvPoint, characterize_over_temperature
from ..cell.model import REFERENCE_DEGC, group_near
from ..errors import InputError
from ..gather import (
    OVER_TEMPERATURE,
    Given,
    Reading,
    Watch,
    file_names,
    listed,
    source_of,
    unwatched,
)
from ..model.inputs import OCV_MARGIN, soc_along, temperature_of
from ..model.window import Window
from ..pulses import Pulse, first_pulse
from ..records import Record, Source, read_record


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
        chosen = {"": window or Window()} if isinstance(window, Window | None) else dict(window)
        ocv_tests, cell = listed(ocv), None
        if not ocv_tests:
            given_ah = chosen.get("", Window()).capacity_ah if capacity is None else capacity
            # A polynomial would swing between ten points.
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
        windows = _windows(tests, cell, chosen)
        is_one = len(group_near((_degc(each, chosen), each) for each in tests)) == 1
    return {
        "over": "soc" if is_one else OVER_TEMPERATURE,
        **options,
        "records": [each.source for each in tests],
        "ocv": ocv_tests,
        "window": windows,
        "capacity": capacity,
        "reading": reading,
        "watch": watch,
    }


def _read(given: Sequence[Given], reading: Reading) -> list[_Test]:
    """Every test once. Raises `InputError` where one has no pulses."""
    names = file_names([each for each in given if isinstance(each, str | Path)])
    sign: Any = reading.current_sign
    hold: Any = reading.current_hold
    tests = []
    for each in given:
        source = each if isinstance(each, Record) else source_of(each, names, reading.columns)
        record = (
            source
            if isinstance(source, Record)
            else read_record(source, current_sign=sign, current_hold=hold)
        )
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
    window = chosen.get(test.record.name, chosen.get("", Window()))
    known = temperature_of(test.record, window)
    return REFERENCE_DEGC if known is None else known


def _windows(
    tests: Sequence[_Test], cell: CellModel | None, chosen: Mapping[str, Window]
) -> dict[str, Window]:
    """Each test from the rest before its first pulse on, but where something else is chosen."""
    common = chosen.get("", Window())
    own = {
        each.record.name: _own_window(each, cell, chosen.get(each.record.name, common))
        for each in tests
    }
    return {"": common, **chosen, **own}


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
