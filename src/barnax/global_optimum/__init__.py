"""The best circuit in a box: a grid, a polish and a proof."""
