"""What a report says of where it comes from, and of what was odd on the way."""

import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING

from .document import Bullets, Column, Listing, Paragraph, Section, Table

if TYPE_CHECKING:
    from .decisions import Stored


def reproduction_section(stored: "Stored") -> Section:
    """The exact command, and the versions that can change a digit."""
    versions = Table(
        caption="Versions that can change a digit.",
        columns=(Column("package", role="text"), Column("version", role="text")),
        rows=tuple(stored.versions.items()),
    )
    if not stored.command:
        made = (Paragraph("This was made from Python, not by a command."),)
    else:
        made = (
            Paragraph(
                "The command, run in the folder of the files. The same files, key and versions on "
                "the same machine give the same numbers to the last bit."
            ),
            Listing(shlex.join(stored.command)),
        )
    return Section("How to repeat this", (*made, versions))


def warnings_section(warnings: Sequence[str]) -> list[Section]:
    """A section of warnings, where there are any."""
    if not warnings:
        return []
    return [Section("Warnings", (Bullets(tuple(warnings), are_warnings=True),))]
