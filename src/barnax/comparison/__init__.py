"""Models and methods side by side on one cell: run, compared, stored."""

from .result import ComparisonResult as ComparisonResult
from .result import Difference as Difference
from .result import Row as Row
from .run import PAPER_ROWS as PAPER_ROWS
from .run import ComparisonJob as ComparisonJob
from .run import compare as compare
