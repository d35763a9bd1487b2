"""Whether a record is of the cell that the OCV test shows, by charge, voltage and temperature."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from ..cell import CellModel
from ..cell.soc_axis import BEYOND_SOC
from ..records import Record
from ..records.findings import Finding
from ..records.samples import record_resistance_ohm

# A mistake of unit or range multiplies the charge by one of these; a wrong capacity by another.
_UNITS = {
    60.0: "its time is in minutes",
    3600.0: "its time is in hours",
    1e-3: "its current is in mA, or its time in ms",
    1e3: "its current is a thousand times too small",
    2.0: "its current is half of what flowed",
    0.5: "its current is twice what flowed",
}
_CAPACITIES = np.geomspace(0.5, 2, 25)
# What most of the voltage must leave the OCV by before anything is said of it, and what share of
# that must vanish with another charge; and what no unit explains.
_APART_V, _VANISHES, _ELSEWHERE_V = 0.03, 0.5, 0.15
_LEFT, _FAR_V = 0.2, 0.25
_MOST = 0.75
# So many samples tell, best those of a small current.
_SAMPLES, _SMALL_HOURS = 400, 5.0
_STARTS = 61
# Parameters of a cell change noticeably over so many degrees.
_DEGREES = 5.0


def follow(record: Record, cell: CellModel, capacity_ah: float) -> Callable[[float], float]:
    """How far the voltage leaves the cell's OCV at its best start, for a factor on the charge."""
    source_v, passed = _source(record, capacity_ah)
    soc = np.linspace(*cell.soc_range, 501)
    ocv_v = (cell.charge(soc) + cell.discharge(soc)) / 2

    def apart_v(factor: float) -> float:
        moved = factor * (passed - passed.min())
        room = 1 + 2 * BEYOND_SOC - float(np.ptp(moved))
        if room < 0:
            return np.inf
        starts = 1 + BEYOND_SOC - room * np.linspace(0, 1, _STARTS)
        modeled_v = np.interp(starts[:, None] - moved, soc, ocv_v)
        return float(np.quantile(np.abs(source_v - modeled_v), _MOST, axis=1).min())

    return apart_v


def _source(
    record: Record, capacity_ah: float
) -> tuple[Float[np.ndarray, "chosen"], Float[np.ndarray, "chosen"]]:
    """The voltage without R I, and the charge taken out as a share of the capacity."""
    resistance_ohm = record_resistance_ohm(record)
    small_a = capacity_ah / _SMALL_HOURS
    at = np.flatnonzero(np.abs(record.current_a) < small_a)
    if len(at) < _SAMPLES:
        at = np.arange(record.samples)
    passed = record.discharged_ah / capacity_ah
    # Evenly over the charge, or a long rest would be all that counts.
    order = at[np.argsort(passed[at], kind="stable")]
    wanted = np.linspace(passed[order[0]], passed[order[-1]], _SAMPLES)
    chosen = order[np.minimum(np.searchsorted(passed[order], wanted), len(order) - 1)]
    source_v = record.voltage_v[chosen] + resistance_ohm * record.current_a[chosen]
    return source_v, passed[chosen]


def compare_with_cell(
    record: Record, cell: CellModel, capacity_ah: float | None = None
) -> list[Finding]:
    """What says that the record's charge or voltage is not of the cell that the OCV test shows: an
    error where no unit makes its charge fit."""
    capacity_ah = capacity_ah or cell.capacity_ah
    apart_v = follow(record, cell, capacity_ah)
    own_v = apart_v(1.0)
    if own_v <= _APART_V:
        return []
    factor = min((*_UNITS, *_CAPACITIES), key=apart_v)
    best_v = apart_v(factor)
    apart = "its charge goes beyond full and empty"
    if np.isfinite(own_v):
        apart = f"the voltage leaves the OCV by {1e3 * own_v:.3g} mV wherever it starts"
    # A large load leaves the OCV by some more, whatever its unit.
    allowed_v = max(_APART_V, _LEFT * min(own_v, _FAR_V))
    if best_v < min(_VANISHES * own_v, allowed_v):
        remedy = "check `capacity`, and that the OCV test is of this cell"
        meaning = f"as if the cell held {capacity_ah / factor:.3g} Ah"
        if factor in _UNITS:
            remedy = "correct the unit, here or in the OCV test, or give the right column"
            meaning = _UNITS[factor]
        what = (
            f"{apart}, and by {1e3 * best_v:.2g} mV with {factor:.4g} times the charge: {meaning}"
        )
        return [Finding("warning", what, remedy)]
    if own_v > _ELSEWHERE_V:
        remedy = "check that the OCV test is of this cell, and the units of both"
        what = f"it looks like a record of another cell: {apart}, whatever its unit"
        # Charge that fits nowhere ends in an error sooner or later.
        return [Finding("warning" if np.isfinite(own_v) else "error", what, remedy)]
    return []


def compare_temperatures(
    records: Sequence[tuple[str, float | None]],
    tests: Sequence[tuple[str, float | None]],
    identified: Sequence[tuple[str, float | None]] = (),
) -> list[str]:
    """A sentence for each record that is much warmer or colder than every OCV test, or than every
    record that its circuit was identified on."""
    of_test = (
        "the OCV test {} at {:.3g} degC: the open-circuit voltage and the capacity change with "
        "temperature; give an OCV test of the record's temperature with `ocv`"
    )
    of_circuit = (
        "{}, which the circuit was identified on, at {:.3g} degC: resistances, open-circuit "
        "voltage and capacity change with temperature; identify at the record's temperature"
    )
    found = []
    for others, words in ((tests, of_test), (identified, of_circuit)):
        known = [(name, degc) for name, degc in others if degc is not None]
        for name, degc in records:
            if degc is None or not known:
                continue
            apart = {abs(own_degc - degc): (other, own_degc) for other, own_degc in known}
            if min(apart) > _DEGREES:
                other = words.format(*apart[min(apart)])
                found.append(f"{name}: was measured at {degc:.3g} degC, {other}")
    return found
