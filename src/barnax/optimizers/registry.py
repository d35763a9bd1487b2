"""Every optimizer by its name. A new one is one file and one line here."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from .bmo import bmo
from .ibmo import ibmo, ibmo_centered, ibmo_printed
from .population import AbstractPopulationMinimiser

OPTIMIZERS: Mapping[str, Callable[..., AbstractPopulationMinimiser]] = MappingProxyType(
    {
        "ibmo": ibmo,
        "ibmo-printed": ibmo_printed,
        "ibmo-centered": ibmo_centered,
        "bmo": bmo,
    }
)


def make_optimizer(name: str, population: int, iterations: int) -> AbstractPopulationMinimiser:
    """The optimizer registered as `name`.

    Raises `ValueError` for an unknown name, and for a population or budget that is too small.
    """
    if name not in OPTIMIZERS:
        raise ValueError(f"no optimizer is called {name!r}; there are {', '.join(OPTIMIZERS)}")
    if population < 4:
        raise ValueError(f"a population needs at least 4 candidates; {population} was given")
    if iterations < 1:
        raise ValueError(f"a search needs at least 1 iteration; {iterations} was given")
    return OPTIMIZERS[name](population=population, iterations=iterations)
