"""The best circuit there is in a box: a landscape, a polish and a proof."""

from .search import GlobalOptimum, Landscape, global_optimum, make_landscape, regret

__all__ = ["GlobalOptimum", "Landscape", "global_optimum", "make_landscape", "regret"]
