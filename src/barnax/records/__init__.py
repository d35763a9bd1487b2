"""Measured data in, checked records out."""

from barnax.records.read import read_record
from barnax.records.record import Decision, Hold, Record, Strength
from barnax.records.rests import current_direction, is_rested, rest_blocks, rest_current_a

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
