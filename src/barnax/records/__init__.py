"""Measured data in, checked records out."""

from .logger import Decision as Decision
from .logger import Hold as Hold
from .read import read_record as read_record
from .read import record_from_frame as record_from_frame
from .record import Record as Record
from .source import Given as Given
from .source import Source as Source
from .source import find_file as find_file
from .source import folders_around as folders_around
from .source import read_source as read_source
from .source import source_from_frame as source_from_frame
