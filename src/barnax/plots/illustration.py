"""A figure with all that stands around it in a report or a folder."""

from dataclasses import dataclass
from functools import cached_property

from matplotlib.figure import Figure

from .encode import encode

# Sharp on a phone and in print, and still small enough to be sent.
DPI = 180


@dataclass(frozen=True, eq=False)
class Illustration:
    """A figure, its file's name without a suffix, its caption, and words for who cannot see it.

    `is_dense` says that it holds so many points that PNG is the smaller form. Each form is drawn
    once, when it is asked for.
    """

    name: str
    figure: Figure
    caption: str
    alt: str
    is_dense: bool = True

    @cached_property
    def png(self) -> bytes:
        return encode(self.figure, "png", DPI)

    @cached_property
    def svg(self) -> bytes:
        return encode(self.figure, "svg", DPI)

    @cached_property
    def pdf(self) -> bytes:
        return encode(self.figure, "pdf", DPI)


def record_roles(identified: int, validated: int) -> list[str]:
    """What the files of each record are called: those identified on, then those for validation.

    >>> record_roles(1, 2)
    ['identification', 'validation-1', 'validation-2']
    """
    first = [f"identification-{number}" for number in range(1, identified + 1)]
    return [
        *(first if identified > 1 else ["identification"]),
        *(f"validation-{number}" for number in range(1, validated + 1)),
    ]
