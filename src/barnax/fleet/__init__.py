"""Many cells identified: a manifest, a standard executor, one row a cell, nothing lost.

`summary` sums a dataset up; it is imported by itself, since it loads SciPy.
"""

from .engine import Progress, identify_fleet
from .manifest import FleetCell, cell_of, read_manifest

__all__ = ["FleetCell", "Progress", "cell_of", "identify_fleet", "read_manifest"]
