"""Pulse tests (HPPC): pulses and rests found in a record, and the resistances they show."""

from .find import STANDARD_S, Pulse, find_pulses, levels, pulse_samples
from .start import own_cell, own_window

__all__ = [
    "STANDARD_S",
    "Pulse",
    "find_pulses",
    "levels",
    "own_cell",
    "own_window",
    "pulse_samples",
]
