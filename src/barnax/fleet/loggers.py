"""The loggers of a fleet, by a sample of its files before any cell is identified."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from pathlib import PurePath
from typing import Any

from ..errors import InputError
from ..files import is_factor_file
from ..inputs import how_read
from ..records import read_record
from ..records.logger import Logger, loggers_of
from ..settings import Reading
from .manifest import FleetCell
from .rows import job_of, sources_of

# So many files of each kind are looked at, evenly among all by the ids of their cells.
SAMPLED = 12
READING = {option.name for option in fields(Reading)}


def loggers_of_fleet(
    cells: Sequence[FleetCell], settings: Mapping[str, Any]
) -> dict[tuple[str, ...], Logger]:
    """The loggers by the names of the columns in their files, whoever identifies which cell.

    Files of a kind have one suffix, and one way in which they are to be read.
    """
    kinds: dict[tuple[str, str], list[FleetCell]] = {}
    for cell in sorted(cells, key=lambda cell: cell.id):
        if cell.records and not cell.missing and not is_factor_file(cell.records[0]):
            suffix = PurePath(cell.records[0]).suffix.lower()
            how_to_read = sorted(item for item in cell.options.items() if item[0] in READING)
            kinds.setdefault((suffix, repr(how_to_read)), []).append(cell)
    records = []
    for alike in kinds.values():
        count = min(SAMPLED, len(alike))
        for cell in [alike[place * len(alike) // count] for place in range(count)]:
            # What cannot be read is told in its own row.
            with suppress(InputError, OSError):
                reading = job_of({**settings, **cell.options}).part(Reading)
                (source,) = sources_of(cell.records[:1], reading, {})
                records.append(read_record(source, **how_read(reading, source.name)))
    return loggers_of(records)
