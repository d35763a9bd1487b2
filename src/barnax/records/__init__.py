"""Measured data in, checked records out."""

from .findings import Finding, Severity
from .read import Source, read_record, read_source, record_from_frame, source_from_frame
from .record import (
    Decision,
    Hold,
    Record,
    Strength,
    current_direction,
    is_rested,
    rest_blocks,
    rest_current_a,
)

__all__ = [
    "Decision",
    "Finding",
    "Hold",
    "Record",
    "Severity",
    "Source",
    "Strength",
    "current_direction",
    "is_rested",
    "read_record",
    "read_source",
    "record_from_frame",
    "rest_blocks",
    "rest_current_a",
    "source_from_frame",
]
