"""The pulses of a test in words and tables, and the same numbers as CSV."""

from collections.abc import Sequence
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..cell.model import REFERENCE_DEGC, SAME_DEGC
from ..errors import escaped
from ..files import csv_text
from ..pulses import STANDARD_S, Pulse, levels, rate_label

if TYPE_CHECKING:
    from ..results import Result

HEADS = tuple(f"{time_s:g} s" if time_s else "at once" for time_s in STANDARD_S)
MIDDLE_SOC = 0.5
# Pulses on either side of the middle are no further apart.
NEAR_SOC = 0.4


class Level(NamedTuple):
    """The pulses of one direction, rate and temperature."""

    label: str
    pulses: tuple[Pulse, ...]

    @property
    def times(self) -> list[int]:
        """The indices in `STANDARD_S` at which some pulse has a resistance."""
        return _times(self.pulses)

    def middle_ohm(self, index: int) -> float | None:
        """The resistance in the middle of SOC, interpolated between pulses; None if no pulse is
        long enough or near enough."""
        points = [
            (pulse.soc, ohm)
            for pulse in self.pulses
            if (ohm := pulse.resistance_ohm[index]) is not None
        ]
        below = max((point for point in points if point[0] <= MIDDLE_SOC), default=None)
        above = min((point for point in points if point[0] >= MIDDLE_SOC), default=None)
        if below is None or above is None or above[0] - below[0] > NEAR_SOC:
            return None
        soc, ohm = zip(below, above, strict=True)
        return float(np.interp(MIDDLE_SOC, soc, ohm))


def _times(pulses: Sequence[Pulse]) -> list[int]:
    ohms = zip(*(pulse.resistance_ohm for pulse in pulses), strict=True)
    return [index for index, row in enumerate(ohms) if any(ohm is not None for ohm in row)]


def pulse_facts(result: "Result") -> tuple[Any, ...]:
    """The facts for the section on the pulses of a test."""
    return _levels(result), *_heads(result)


def middle_facts(result: "Result") -> tuple[Any, ...] | None:
    """The resistances in the middle of SOC for each direction, rate and temperature; None if no
    pulses give any."""
    times = _times(result.pulses)
    rows = [(level.label, [*map(level.middle_ohm, times)]) for level in _levels(result)]
    # For example those of a drive cycle's last pulses.
    rows = [row for row in rows if any(ohm is not None for ohm in row[1])]
    return (rows, times, MIDDLE_SOC, *_heads(result)) if rows else None


def _levels(result: "Result") -> list[Level]:
    """The pulses by direction and rate, and by temperature if there are several."""
    groups: list[list[Pulse]] = []
    for pulse in sorted(result.pulses, key=_degc):
        if not groups or _degc(pulse) - _degc(groups[-1][-1]) > SAME_DEGC:
            groups.append([])
        groups[-1].append(pulse)
    rates: list[Level] = []
    for group in groups:
        degc = _degc(group[0]) if len(groups) > 1 else None
        where = "" if degc is None else f", {degc:.0f} degC"
        capacity_ah = result.cell_at(degc).capacity_ah
        rates += [Level(rate_label(level, capacity_ah) + where, level) for level in levels(group)]
    return rates


def _degc(pulse: Pulse) -> float:
    return REFERENCE_DEGC if pulse.temperature_degc is None else pulse.temperature_degc


def _heads(result: "Result") -> tuple[Any, ...]:
    """The heads of resistances, their unit (milliohm, or ohm for a small cell), and its scale."""
    ohms = [ohm for pulse in result.pulses for ohm in pulse.resistance_ohm if ohm is not None]
    is_small = bool(ohms) and np.median(ohms) >= 1
    return HEADS, *(("Ohm", 1.0) if is_small else ("mOhm", 1e3))


def pulses_csv(pulses: Sequence[Pulse]) -> bytes:
    """Every pulse in a row, empty where a resistance is unknown."""
    head = ["record", "row", "SOC", "current [A]", "duration [s]", "rest before [s]"]
    head += ["temperature [degC]", "met a limit", "first sample [s]"]
    head += [f"R({time_s:g} s) [Ohm]" for time_s in STANDARD_S]
    what = attrgetter("row", "soc", "current_a", "duration_s", "rest_s", "temperature_degc")
    rows = [
        (escaped(p.record), *what(p), int(p.is_limited), p.delay_s, *p.resistance_ohm)
        for p in pulses
    ]
    return csv_text(head, rows).encode()
