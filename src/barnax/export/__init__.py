"""Results in the formats of other tools.

>>> [exporter.file_name for exporter in EXPORTERS.values()][:2]
['barnax_pybamm.py', 'barnax_thevenin.py']
"""

from collections.abc import Mapping
from types import MappingProxyType

from ..errors import InputError
from .exporter import Export, Exporter, Profile
from .files import C_FILTER, C_HEADER, CSV, JSON, SIMSCAPE
from .python_modules import PYBAMM, THEVENIN
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

# A new target is one file and one name here.
EXPORTERS: Mapping[str, Exporter] = MappingProxyType(
    {
        exporter.name: exporter
        for exporter in (PYBAMM, THEVENIN, SIMSCAPE, C_HEADER, CSV, JSON, C_FILTER)
    }
)


def get_exporter(name: str) -> Exporter:
    """The exporter registered as `name`. Raises `InputError` that lists the names.

    >>> get_exporter("csv").file_name
    'barnax_parameters.csv'
    """
    if name not in EXPORTERS:
        raise InputError(f"`to` {name!r} is not known; there are {', '.join(EXPORTERS)}")
    return EXPORTERS[name]
