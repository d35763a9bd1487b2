"""Many cells identified: a manifest, an engine that others wrote, one row a cell, nothing lost."""

from .engine import Progress, identify_fleet
from .manifest import FleetCell, cell_of, read_manifest

__all__ = [
    "FleetCell",
    "Progress",
    "cell_of",
    "identify_fleet",
    "read_manifest",
]
