"""Models and methods side by side on one cell: run, compared, stored."""

from .result import ComparisonResult as ComparisonResult
from .result import make_comparison_result as make_comparison_result
from .run import PAPER_ROWS as PAPER_ROWS
from .run import Comparison as Comparison
from .run import Difference as Difference
from .run import Row as Row
from .run import compare as compare
