"""BMO, the barnacle mating optimizer."""

from .barnacle import BarnacleMating


def bmo(population: int = 30, iterations: int = 500, pl: int = 7) -> BarnacleMating:
    """The barnacle mating optimizer of Sulaiman et al. (2020), as Li et al. (2023) ran it.

    `pl` counts ranks and does not scale with the population. The paper's Eq. 11 says p lies in
    [0, 1]; only a standard normal vector, one a generation, reproduces its Table 2, so that is
    what runs here.
    """
    return BarnacleMating(population=population, iterations=iterations, pl=pl)
