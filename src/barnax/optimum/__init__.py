"""The best circuit there is in a box: a landscape, a polish and a proof."""

from .landscape import Landscape, make_landscape
from .search import GlobalOptimum, global_optimum, regret

__all__ = ["GlobalOptimum", "Landscape", "global_optimum", "make_landscape", "regret"]
