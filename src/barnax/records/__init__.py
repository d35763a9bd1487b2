"""Measured data in, checked records out."""

from .read import read_record
from .record import Decision, Hold, Record, Strength
from .rests import current_direction, is_rested, rest_blocks, rest_current_a

__all__ = [
    "Decision",
    "Hold",
    "Record",
    "Strength",
    "current_direction",
    "is_rested",
    "read_record",
    "rest_blocks",
    "rest_current_a",
]
