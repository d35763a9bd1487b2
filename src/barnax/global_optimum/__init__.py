"""The best circuit there is in a box: a grid, a polish and a proof."""
