"""Models and methods side by side on one cell: run, compared, stored."""

from .result import ComparisonResult, make_comparison_result
from .run import PAPER_ROWS, Comparison, Difference, Row, compare

__all__ = [
    "PAPER_ROWS",
    "Comparison",
    "ComparisonResult",
    "Difference",
    "Row",
    "compare",
    "make_comparison_result",
]
