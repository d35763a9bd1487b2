"""Models and methods side by side on one cell: run, compared, stored."""

from .result import ComparisonResult, make_comparison_result
from .rows import Comparison, Difference, Row
from .run import PAPER_ROWS, compare

__all__ = [
    "PAPER_ROWS",
    "Comparison",
    "ComparisonResult",
    "Difference",
    "Row",
    "compare",
    "make_comparison_result",
]
