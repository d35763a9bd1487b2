"""Results in the formats of other tools.

>>> [exporter.file_name for exporter in EXPORTERS.values()][:2]
['barnax_pybamm.py', 'barnax_thevenin.py']
"""

import difflib
from collections.abc import Mapping
from types import MappingProxyType

from ..errors import InputError
from . import files, python_modules
from .exporter import Export as Export
from .exporter import Exporter as Exporter
from .exporter import HeldLoad as HeldLoad
from .verification import Verification as Verification
from .verification import pulse_profile as pulse_profile
from .verification import require_package as require_package
from .verification import verify as verify

# A new target is a function and one entry here: its name, a one-line description, its usual file,
# and the package that runs it, if there is one.
_ALL = (
    Exporter(
        "pybamm", "Python module: parameter values of PyBaMM's Thevenin model", "barnax_pybamm.py",
        python_modules.write_pybamm, "pybamm", python_modules.simulate_pybamm, starts_within=True,
    ),
    Exporter(
        "thevenin", "Python module: parameter dictionary of NREL's thevenin", "barnax_thevenin.py",
        python_modules.write_thevenin, "thevenin", python_modules.simulate_thevenin,
    ),
    Exporter(
        "simscape", "MATLAB file: Simscape's Battery (Table-Based) and Battery Equivalent Circuit",
        "barnax_simscape.mat", files.write_simscape,
    ),
    Exporter(
        "c-header", "C header: constants and tables", "barnax_cell.h", files.write_c_header
    ),
    Exporter("csv", "CSV: name, value, unit", "barnax_parameters.csv", files.write_csv),
    Exporter(
        "xlsx", "Excel workbook: parameters, and OCV after charging and discharging",
        "barnax_parameters.xlsx", files.write_xlsx,
    ),
    Exporter("json", "JSON: constants and tables", "barnax_cell.json", files.write_json),
    Exporter(
        "c-filter", "C99 header: the circuit with its Gaussian sum of Kalman filters",
        "barnax_filter.h", files.write_c_filter,
    ),
)  # fmt: skip
EXPORTERS: Mapping[str, Exporter] = MappingProxyType({exporter.name: exporter for exporter in _ALL})


def get_exporter(name: str) -> Exporter:
    """The exporter registered as `name`. Raises `InputError` that lists the names, or similar ones.

    Args:
        name: One of `EXPORTERS`.

    >>> get_exporter("csv").file_name
    'barnax_parameters.csv'
    """
    if name not in EXPORTERS:
        near = [one for one in EXPORTERS if name.lower() in one.split("-")]
        near = near or difflib.get_close_matches(name, EXPORTERS, 1, 0.7)
        remedy = (
            f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(EXPORTERS)}"
        )
        raise InputError(f"`to` {name!r} is not known; {remedy}")
    return EXPORTERS[name]
