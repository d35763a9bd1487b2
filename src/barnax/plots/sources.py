"""What a figure may be drawn from: a result, or the file that holds it."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..cell import CellModel
    from ..comparison import ComparisonResult
    from ..result import Result


def cell_of(source: "CellModel | Result | str | Path") -> "CellModel":
    """The cell itself, that of a result, or that of a `result.json`."""
    from ..cell import CellModel

    if isinstance(source, CellModel):
        return source
    # A result needs JAX, which a cell does not.
    return result_of(source).cell_model


def result_of(source: "Result | str | Path") -> "Result":
    """A stored result, or that of a `result.json`."""
    from ..result import Result

    return source if isinstance(source, Result) else Result.from_json(source)


def comparison_of(source: "ComparisonResult | str | Path") -> "ComparisonResult":
    """A stored comparison, or that of a `comparison.json`."""
    from ..comparison import ComparisonResult

    return source if isinstance(source, ComparisonResult) else ComparisonResult.from_json(source)
