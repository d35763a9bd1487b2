"""Every exporter by its target. A new one is one file and one line here."""

from collections.abc import Mapping
from types import MappingProxyType

from ..errors import InputError
from .c_header import C_HEADER
from .exporter import Exporter
from .flat_csv import CSV
from .pybamm_module import PYBAMM
from .simscape_mat import SIMSCAPE
from .thevenin_module import THEVENIN

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
