"""The best circuit there is in a box: a grid, a polish and a proof."""

from .search import (
    GlobalOptimum,
    find_global_optimum,
    hold_warning,
    optimality_gap,
    with_better_directions,
    with_better_hold,
    without_sweep_drop,
)

__all__ = [
    "GlobalOptimum",
    "find_global_optimum",
    "hold_warning",
    "optimality_gap",
    "with_better_directions",
    "with_better_hold",
    "without_sweep_drop",
]
