"""Measured data in, checked records out."""

from .logger import Decision, Hold
from .read import read_record, record_from_frame
from .record import Record
from .source import Source, find_file, folders_around, read_source, source_from_frame

__all__ = [
    "Decision",
    "Hold",
    "Record",
    "Source",
    "find_file",
    "folders_around",
    "read_record",
    "read_source",
    "record_from_frame",
    "source_from_frame",
]
