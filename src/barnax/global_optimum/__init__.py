"""The best circuit there is in a box: a landscape, a polish and a proof."""

from .assumptions import OtherHold, try_other_hold, with_better_directions
from .search import GlobalOptimum, Landscape, find_global_optimum, make_landscape, optimality_gap

__all__ = [
    "GlobalOptimum",
    "Landscape",
    "OtherHold",
    "find_global_optimum",
    "make_landscape",
    "optimality_gap",
    "try_other_hold",
    "with_better_directions",
]
