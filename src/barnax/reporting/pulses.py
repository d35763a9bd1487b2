"""The pulses of a test in words and tables, and the same numbers as CSV."""

from collections.abc import Sequence
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from ..cell.model import REFERENCE_DEGC, SAME_DEGC
from ..errors import escaped
from ..files import csv_text
from ..pulses import STANDARD_S, Pulse, levels, rate_label
from .document import Block, Bullets, Table, make_table
from .wording import sentences
from .words import NOTHING, aligned, fixed

if TYPE_CHECKING:
    from ..results import Result

HEADS = tuple(f"{time_s:g} s" if time_s else "at once" for time_s in STANDARD_S)
MIDDLE_SOC = 0.5
# Pulses on either side of it are no further apart.
NEAR_SOC = 0.4


def pulses_blocks(result: "Result") -> tuple[Block, ...]:
    """The pulses of a test; nothing without any."""
    if not result.pulses:
        return ()
    rates = _levels(result)
    rests_s = [round(pulse.rest_s, -1) for pulse in result.pulses]
    told = Bullets(sentences("pulses.section", result.pulses, rates, rests_s))
    return (told, *(_level_table(result, label, level) for label, level in rates))


def _levels(result: "Result") -> list[tuple[str, tuple[Pulse, ...]]]:
    """The pulses by direction and rate, and by temperature where there are several."""
    groups: list[list[Pulse]] = []
    for pulse in sorted(result.pulses, key=_degc):
        if not groups or _degc(pulse) - _degc(groups[-1][-1]) > SAME_DEGC:
            groups.append([])
        groups[-1].append(pulse)
    found = []
    for group in groups:
        degc = _degc(group[0]) if len(groups) > 1 else None
        where = "" if degc is None else f", {degc:.0f} degC"
        capacity_ah = result.cell_at(degc).capacity_ah
        found += [(rate_label(level, capacity_ah) + where, level) for level in levels(group)]
    return found


def _degc(pulse: Pulse) -> float:
    return REFERENCE_DEGC if pulse.temperature_degc is None else pulse.temperature_degc


def _level_table(result: "Result", label: str, level: Sequence[Pulse]) -> Table:
    """The resistances of one direction and rate over SOC."""
    unit, cells = _unit(result), {}
    if len({pulse.record for pulse in level}) > 1:
        cells["record"] = lambda pulse: pulse.record
    cells["SOC [%]"] = lambda pulse: fixed(100 * pulse.soc, 1)
    for place in _known(level):
        cells[f"{HEADS[place]} [{unit}]"] = lambda pulse, place=place: _shown(
            pulse.resistance_ohm[place], unit
        )
    return make_table(f"Pulse resistances, {label}.", level, cells, ["record"])


def middle_pulses(result: "Result") -> list[tuple[str, ...]]:
    """A line for each direction, rate and temperature: its resistances in the middle of SOC.

    Between pulses linearly; a dash where no pulse is long enough or none is near. Those
    with dashes only, such as of a drive cycle's last pulses, are left out.
    """
    unit, known = _unit(result), _known(result.pulses)
    lines: list[tuple[str, ...]] = []
    for label, level in _levels(result):
        ohms = [_at_middle(level, place) for place in known]
        if any(ohm is not None for ohm in ohms):
            lines.append((label, *(_shown(ohm, unit) for ohm in ohms)))
    return lines


def middle_heads(result: "Result") -> tuple[str, ...]:
    """The heads of `middle_pulses`."""
    heads = (HEADS[place] for place in _known(result.pulses))
    return (f"at {100 * MIDDLE_SOC:.0f} % SOC [{_unit(result)}]", *heads)


def _known(pulses: Sequence[Pulse]) -> list[int]:
    """Places in `STANDARD_S` at which some pulse has a resistance."""
    ohms = zip(*(pulse.resistance_ohm for pulse in pulses), strict=True)
    return [place for place, own in enumerate(ohms) if any(ohm is not None for ohm in own)]


def _at_middle(level: Sequence[Pulse], place: int) -> float | None:
    known = [
        (pulse.soc, ohm) for pulse in level if (ohm := pulse.resistance_ohm[place]) is not None
    ]
    below = max((own for own in known if own[0] <= MIDDLE_SOC), default=None)
    above = min((own for own in known if own[0] >= MIDDLE_SOC), default=None)
    if below is None or above is None or above[0] - below[0] > NEAR_SOC:
        return None
    soc, ohm = zip(below, above, strict=True)
    return float(np.interp(MIDDLE_SOC, soc, ohm))


def _unit(result: "Result") -> str:
    """Milliohm, but of a small cell ohm."""
    known = [ohm for pulse in result.pulses for ohm in pulse.resistance_ohm if ohm is not None]
    return "Ohm" if known and np.median(known) >= 1 else "mOhm"


def _shown(value_ohm: float | None, unit: str) -> str:
    if value_ohm is None:
        return NOTHING
    return aligned(value_ohm if unit == "Ohm" else 1e3 * value_ohm)


def pulses_csv(pulses: Sequence[Pulse]) -> bytes:
    """Every pulse in a row, empty where a resistance is not known."""
    head = ["record", "row", "SOC", "current [A]", "duration [s]", "rest before [s]"]
    head += ["temperature [degC]", "met a limit", "first sample [s]"]
    head += [f"R({time_s:g} s) [Ohm]" for time_s in STANDARD_S]
    what = attrgetter("row", "soc", "current_a", "duration_s", "rest_s", "temperature_degc")
    rows = [
        (escaped(p.record), *what(p), int(p.is_limited), p.delay_s, *p.resistance_ohm)
        for p in pulses
    ]
    return csv_text(head, rows).encode()
