"""The best circuit there is in a box: a landscape, a polish and a proof."""

from .search import (
    GlobalOptimum,
    Landscape,
    OtherHold,
    find_global_optimum,
    optimality_gap,
    try_other_hold,
    with_better_directions,
    without_sweep_drop,
)

__all__ = [
    "GlobalOptimum",
    "Landscape",
    "OtherHold",
    "find_global_optimum",
    "optimality_gap",
    "try_other_hold",
    "with_better_directions",
    "without_sweep_drop",
]
