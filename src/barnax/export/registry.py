"""Every exporter by its target. A new one is one file and one line here."""

from collections.abc import Mapping
from types import MappingProxyType

from ..errors import InputError
from .exporter import Exporter
from .files import C_HEADER, CSV, SIMSCAPE
from .pybamm import PYBAMM
from .thevenin import THEVENIN

EXPORTERS: Mapping[str, Exporter] = MappingProxyType(
    {exporter.name: exporter for exporter in (PYBAMM, THEVENIN, SIMSCAPE, C_HEADER, CSV)}
)


def get_exporter(name: str) -> Exporter:
    """The exporter registered as `name`. Raises `InputError` that lists the names.

    >>> get_exporter("csv").file_name
    'barnax_parameters.csv'
    """
    if name not in EXPORTERS:
        raise InputError(f"--to {name!r} is not known; there are {', '.join(EXPORTERS)}")
    return EXPORTERS[name]
