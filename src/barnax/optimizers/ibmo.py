"""IBMO, the improved barnacle mating optimizer, in the three readings the paper allows."""

from .barnacle import BarnacleMating


def ibmo(population: int = 30, iterations: int = 500, pl: int = 7) -> BarnacleMating:
    """The reading of Li et al. (2023) closest to its Table 2.

    The cosine factor of Eq. 15, as printed, times one standard normal vector a generation; one
    Levy number a cast, times 0.1; tent start branching on the state. The equations do not
    determine it uniquely.
    """
    return BarnacleMating(
        population=population,
        iterations=iterations,
        pl=pl,
        tent_start=True,
        cosine_factor=True,
        levy_cast=True,
        levy_scale=0.1,
    )


def ibmo_printed(population: int = 30, iterations: int = 500, pl: int = 7) -> BarnacleMating:
    """Eq. 13 to 19 of Li et al. (2023) as they stand: the cosine factor alone, Levy scale 1."""
    return BarnacleMating(
        population=population,
        iterations=iterations,
        pl=pl,
        tent_start=True,
        cosine_factor=True,
        gaussian_factor=False,
        levy_cast=True,
    )


def ibmo_centered(population: int = 30, iterations: int = 500, pl: int = 7) -> BarnacleMating:
    """The barnacle search without its pull to the origin, ours.

    Sperm is cast about the population's centroid with a Levy step for every dimension, and every
    mating draws its own normal factor, so moving the origin moves the whole run with it.
    """
    return BarnacleMating(
        population=population,
        iterations=iterations,
        pl=pl,
        tent_start=True,
        shared_factor=False,
        levy_cast=True,
        levy_per_dimension=True,
        cast_center="centroid",
    )
