"""What a figure is drawn from, and the figure with its captions."""

import io
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure
from PIL.Image import Dither, Quantize
from PIL.PngImagePlugin import PngImageFile

from .style import encode

if TYPE_CHECKING:
    from ..cell import CellModel
    from ..comparison import ComparisonResult
    from ..results import Result


def cell_of(source: "CellModel | Result | str | Path") -> "CellModel":
    """The cell itself, that of a result, or that of a `result.json`."""
    from ..cell import CellModel

    if isinstance(source, CellModel):
        return source
    # A result needs JAX, which a cell does not.
    return result_of(source).cell_model


def result_of(source: "Result | str | Path") -> "Result":
    """A stored result, or that of a `result.json`."""
    from ..results import Result

    return source if isinstance(source, Result) else Result.from_json(source)


def comparison_of(source: "ComparisonResult | str | Path") -> "ComparisonResult":
    """A stored comparison, or that of a `comparison.json`."""
    from ..comparison import ComparisonResult

    return source if isinstance(source, ComparisonResult) else ComparisonResult.from_json(source)


# Sharp on a phone and in print, and still small enough to be sent.
DPI = 180


@dataclass(frozen=True, eq=False)
class Illustration:
    """A figure, its file's name without a suffix, its caption, and words for who cannot see it.

    `is_dense` says that it holds so many points that PNG is the smaller form. Each form is drawn
    once, when it is asked for. `live` gives the numbers of an interactive form and its caption.
    """

    name: str
    figure: Figure
    caption: str
    alt: str
    is_dense: bool = True
    live: Callable[[], tuple[dict[str, Any], str]] | None = None

    @cached_property
    def png(self) -> bytes:
        return encode(self.figure, "png", DPI)

    @cached_property
    def small_png(self) -> bytes:
        """The PNG with 256 colors, a third of the bytes, for a page that holds many."""
        image = PngImageFile(io.BytesIO(self.png)).convert("RGB")
        buffer = io.BytesIO()
        # Of Pillow's ways the one that leaves no rare color far off.
        few = image.quantize(method=Quantize.MAXCOVERAGE, dither=Dither.NONE)
        few.save(buffer, "png", optimize=True)
        return buffer.getvalue()

    @cached_property
    def svg(self) -> bytes:
        return encode(self.figure, "svg", DPI)


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
