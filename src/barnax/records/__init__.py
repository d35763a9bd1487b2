"""Measured data in, checked records out."""

from .logger import Decision, Hold
from .read import read_record, record_from_frame
from .record import Record
from .segments import current_direction, is_rested, rest_blocks, rest_current_a
from .source import Source, find_file, folders_around, read_source, source_from_frame

__all__ = [
    "Decision",
    "Hold",
    "Record",
    "Source",
    "current_direction",
    "find_file",
    "folders_around",
    "is_rested",
    "read_record",
    "read_source",
    "record_from_frame",
    "rest_blocks",
    "rest_current_a",
    "source_from_frame",
]
