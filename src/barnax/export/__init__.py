"""Results in the formats of other tools.

>>> [exporter.file_name for exporter in EXPORTERS.values()][:2]
['barnax_pybamm.py', 'barnax_thevenin.py']
"""

from .exporter import Export, Exporter, Profile
from .registry import EXPORTERS, get_exporter
from .verification import Verification, pulse_profile, require_package, verify

__all__ = [
    "EXPORTERS",
    "Export",
    "Exporter",
    "Profile",
    "Verification",
    "get_exporter",
    "pulse_profile",
    "require_package",
    "verify",
]
