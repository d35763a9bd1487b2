"""Checks that a record is of the same cell as the OCV test, by charge, voltage and temperature."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ..cell import CellModel
from ..cell.soc_axis import BEYOND_SOC
from ..notices import Notice
from ..records import Record
from ..records.quantities import FAHRENHEIT
from ..records.record import LEAST_REACH, reach_of_steps

# A mistake of unit or range multiplies the charge by one of these; a wrong capacity by some other
# factor.
_UNITS = {60.0: "minutes", 3600.0: "hours", 1e-3: "milli", 1e3: "small"}
_CAPACITIES = np.geomspace(0.25, 4, 49)
# The factors of a current measured over a wrong range, unless the tester counts it.
_RANGES, _NEAR = {2.0: "half", 0.5: "twice"}, 0.03
# The smallest distance of most voltages from the OCV that is reported, the share of it that another
# charge must remove, and a distance that no unit explains.
_APART_V, _VANISHES, _ELSEWHERE_V = 0.03, 0.5, 0.15
_LEFT, _FAR_V = 0.2, 0.25
_MOST = 0.75
# Number of samples that are compared, preferably at a small current.
_SAMPLES, _SMALL_HOURS = 400, 5.0
# A load of this duration leaves the OCV by this many more times the resistance of its steps.
_SLOW_S, _SLOW_TIMES = 120.0, (0.0, 1.0, 2.0, 3.0, 4.0)
_STARTS = 61
# The parameters of a cell change noticeably over this many degrees.
_DEGREES = 5.0
# From this value on, a temperature in a column with another name may be in Fahrenheit (15 degC).
_WARM_DEGC = 59.0
Chosen = Float[np.ndarray, "chosen"]
# In degC, by the names of files.
Temperatures = Sequence[tuple[str, float | None]]
# Records of one cell with sampling intervals within the first factor have resistances within the
# second.
_AS_FAST, _ALIKE = 2.0, 1.5


def follow(record: Record, cell: CellModel, capacity_ah: float) -> Callable[[float], float]:
    """The voltage's distance from the cell's OCV for a factor of the charge, at the best start and
    with the amount of a slow response to the load that brings it nearest.

    Between the OCV points and full or empty, only a voltage beyond theirs counts.
    """
    source_v, passed, slow_v = _source(record, capacity_ah)
    soc = np.linspace(*cell.soc_range, 501)
    ocv_v = (cell.charge(soc) + cell.discharge(soc)) / 2

    def apart_v(factor: float) -> float:
        moved = factor * (passed - passed.min())
        room = 1 + 2 * BEYOND_SOC - float(np.ptp(moved))
        if room < 0:
            return np.inf
        starts = 1 + BEYOND_SOC - room * np.linspace(0, 1, _STARTS)
        at = starts[:, None] - moved
        modeled_v = np.interp(at, soc, ocv_v)
        low_v = np.where((at >= 0) & (at < soc[0]), 0.0, -np.inf)
        high_v = np.where((at <= 1) & (at > soc[-1]), 0.0, np.inf)

        def distance_v(times: float) -> float:
            error_v = np.clip(source_v + times * slow_v - modeled_v, low_v, high_v)
            return float(np.quantile(np.abs(error_v), _MOST, axis=1).min())

        return min(map(distance_v, _SLOW_TIMES))

    return apart_v


def _source(record: Record, capacity_ah: float) -> tuple[Chosen, Chosen, Chosen]:
    """The voltage without R I, the discharged charge as a share of the capacity, and R times the
    mean current of the two minutes before."""
    small_a = capacity_ah / _SMALL_HOURS
    at = np.flatnonzero(np.abs(record.current_a) < small_a)
    if len(at) < _SAMPLES:
        at = np.arange(record.samples)
    passed = record.discharged_ah / capacity_ah
    # Evenly over the charge, or one long rest would outweigh everything else.
    order = at[np.argsort(passed[at], kind="stable")]
    wanted = np.linspace(passed[order[0]], passed[order[-1]], _SAMPLES)
    chosen = order[np.minimum(np.searchsorted(passed[order], wanted), len(order) - 1)]
    time_s, discharged_ah = record.time_s, record.discharged_ah
    earlier_ah = np.interp(time_s[chosen] - _SLOW_S, time_s, discharged_ah)
    slow_a = (discharged_ah[chosen] - earlier_ah) * 3600 / _SLOW_S
    return record.source_v[chosen], passed[chosen], record.resistance_ohm * slow_a


def compare_with_cell(
    record: Record, cell: CellModel, capacity_ah: float | None = None
) -> list[Notice]:
    """Notices that the record's charge or voltage is not that of the cell in the OCV test: an error
    if no unit makes its charge fit."""
    capacity_ah = capacity_ah or cell.capacity_ah
    apart_v = follow(record, cell, capacity_ah)
    given_v = apart_v(1.0)
    # A voltage that never moves is of no cell, whatever its charge.
    if given_v <= _APART_V or not np.ptp(record.voltage_v):
        return []
    factor = min((*_UNITS, *_CAPACITIES), key=apart_v)
    best_v = apart_v(factor)
    is_near = bool(np.isfinite(given_v))
    values: dict[str, Any] = {"apart": "voltage" if is_near else "charge"}
    values["apart_v"] = given_v if is_near else None
    # A large load leaves the OCV somewhat further, whatever its unit.
    allowed_v = max(_APART_V, _LEFT * min(given_v, _FAR_V))
    if best_v < min(_VANISHES * given_v, allowed_v):
        values |= {"mistake": _UNITS.get(factor, "capacity"), "best_v": best_v, "factor": factor}
        if factor not in _UNITS:
            values |= {"capacity_ah": capacity_ah / factor, "given_ah": capacity_ah}
            ranges = (word for ratio, word in _RANGES.items() if abs(factor / ratio - 1) < _NEAR)
            values["current"] = next(ranges, None) if record.charge_ah is None else None
        return [Notice("cell.charge", values)]
    if given_v > _ELSEWHERE_V:
        is_assumed = any(one.code == "ocv-test.capacity-assumed" for one in cell.warnings)
        span_ah = float(np.ptp(record.discharged_ah))
        if not is_near and is_assumed and span_ah > cell.capacity_ah:
            spans = {"span_ah": span_ah, "capacity_ah": cell.capacity_ah}
            return [Notice("cell.more-charge", spans)]
        # Charge that fits nowhere leads to an error sooner or later.
        values["ocv"] = "records" if cell.ocv_is_fitted else None
        return [Notice("cell.other", values).rated("warning" if is_near else "error")]
    return []


def compare_temperatures(
    records: Temperatures, tests: Temperatures, identified: Temperatures = ()
) -> list[Notice]:
    """A notice of each record that is much warmer or colder than every OCV test, or than every
    record that its circuit was identified on."""
    notices = []
    for kind, others in (("test", tests), ("circuit", identified)):
        measured = [(degc, name) for name, degc in reversed(others) if degc is not None]
        for name, degc in records:
            if degc is None or not measured:
                continue
            other_degc, other = min(measured, key=lambda pair, degc=degc: abs(pair[0] - degc))
            if abs(other_degc - degc) > _DEGREES:
                values = {"temperature_degc": degc, "other": other, "other_degc": other_degc}
                converted = FAHRENHEIT.to_base(degc)
                is_wrong = degc > _WARM_DEGC and abs(converted - other_degc) <= _DEGREES
                values |= {"of": "fahrenheit", "fahrenheit_degc": converted} if is_wrong else {}
                notices.append(Notice("cell.temperature", {"of": kind, **values}, name))
    return notices


def compare_resistances(records: Sequence[tuple[Record, float | None]]) -> list[Notice]:
    """A notice of each record whose current steps show a different resistance from most of those at
    about the same temperature and logged about as fast. Of two records, the first one has it."""
    determined = []
    for record, degc in records:
        step_ohm, charge_ah = record.resistance_ohm, record.discharged_ah
        # The steps of a charge are all at its ends, where the resistance differs.
        reach_ah = reach_of_steps(record.current_a, charge_ah)
        if step_ohm and reach_ah > LEAST_REACH * np.ptp(charge_ah):
            determined.append((step_ohm, record, degc))
    notices: list[Notice] = []
    for step_ohm, record, degc in determined:
        alike = [
            (ohm, another.name)
            for ohm, another, other in determined
            if (degc is None or other is None or abs(other - degc) <= _DEGREES)
            and 1 / _AS_FAST <= another.usual_s / record.usual_s <= _AS_FAST
        ]
        if len(alike) == 2:
            alike = [pair for pair in alike if pair[1] != record.name]
            if any(earlier.values["other"] == record.name for earlier in notices):
                continue
        usual_ohm, other = sorted(alike)[(len(alike) - 1) // 2]
        if not 1 / _ALIKE <= step_ohm / usual_ohm <= _ALIKE:
            values = {"own_ohm": step_ohm, "other": other, "other_ohm": usual_ohm}
            notices.append(Notice("answer.other-resistance", values, record.name))
    return notices
