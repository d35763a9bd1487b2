"""Fewer samples that draw the same line."""

import numpy as np
from jaxtyping import Float, Int

# Twice as many as a 7 inch figure has pixel columns at 150 dpi.
COLUMNS = 2000


def decimate(
    x: Float[np.ndarray, "samples"], y: Float[np.ndarray, "samples"], columns: int = COLUMNS
) -> Int[np.ndarray, "kept"]:
    """Indices of the samples that are enough to draw y over x, which must not decrease.

    The first, last, lowest and highest sample of each of `columns` equal parts of the range of x:
    the drawn line is the same as long as a part is no wider than a pixel (U. Jugel et al., "M4: A
    Visualization-Oriented Time Series Data Aggregation", VLDB 7 (2014) 797). All samples where
    there are fewer than those.

    >>> decimate(np.arange(6.0), np.array([0.0, 5.0, 2.0, -3.0, 1.0, 1.0]), columns=1)
    array([0, 1, 3, 5])
    """
    if len(x) <= 4 * columns:
        return np.arange(len(x))
    column = np.minimum((x - x[0]) * (columns / (x[-1] - x[0])), columns - 1).astype(int)
    first = np.flatnonzero(np.diff(column, prepend=-1))
    last = np.append(first[1:], len(x)) - 1
    by_height = np.lexsort((y, column))
    return np.unique(np.concatenate([first, last, by_height[first], by_height[last]]))
