"""Pulse tests (HPPC): pulses and rests found in a record, and the resistances they show."""

from .find import STANDARD_S, Pulse, find_pulses, levels, pulse_samples
from .start import first_pulse, own_cell, own_window, pulses_of

__all__ = [
    "STANDARD_S",
    "Pulse",
    "find_pulses",
    "first_pulse",
    "levels",
    "own_cell",
    "own_window",
    "pulse_samples",
    "pulses_of",
]
