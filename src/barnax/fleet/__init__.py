"""Many cells identified: a manifest, a standard executor, one row per cell, nothing lost.

`summary` summarizes a dataset; it is imported separately because it loads SciPy.
"""

from .engine import Progress, identify_fleet
from .manifest import FleetCell, fleet_cell_from_row, read_manifest

__all__ = ["FleetCell", "Progress", "fleet_cell_from_row", "identify_fleet", "read_manifest"]
