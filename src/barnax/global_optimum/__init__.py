"""The best circuit there is in a box: a landscape, a polish and a proof."""

from .assumptions import with_better_directions
from .search import GlobalOptimum, Landscape, find_global_optimum, make_landscape, optimality_gap

__all__ = [
    "GlobalOptimum",
    "Landscape",
    "find_global_optimum",
    "make_landscape",
    "optimality_gap",
    "with_better_directions",
]
