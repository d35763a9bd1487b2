"""Every circuit by its name. A new one is one file and one line here."""

from collections.abc import Mapping
from types import MappingProxyType

from .circuit import Circuit
from .esc import ESC
from .iso_rc import ISO_RC
from .rc import FOUR_RC, ONE_RC, SO_RC, THREE_RC

CIRCUITS: Mapping[str, Circuit] = MappingProxyType(
    {circuit.name: circuit for circuit in (ISO_RC, SO_RC, ESC, ONE_RC, THREE_RC, FOUR_RC)}
)


def get_circuit(name: str) -> Circuit:
    """The circuit registered as `name`. Raises `ValueError` that lists the names.

    >>> get_circuit("so-rc").name
    'so-rc'
    """
    if name not in CIRCUITS:
        raise ValueError(f"no circuit is called {name!r}; there are {', '.join(CIRCUITS)}")
    return CIRCUITS[name]
