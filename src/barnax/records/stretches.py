"""Unbroken stretches of a condition."""

import numpy as np
from jaxtyping import Bool, Int


def stretches(
    holds: Bool[np.ndarray, "places"],
) -> tuple[Int[np.ndarray, "stretches"], Int[np.ndarray, "stretches"]]:
    """First and last place of each unbroken stretch where `holds` is true, in order."""
    edges = np.diff(np.concatenate([[0], holds.astype(np.int8), [0]]))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
