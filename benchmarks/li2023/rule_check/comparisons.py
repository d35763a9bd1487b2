"""Which implementation is compared with which of our options, and how their rules differ."""

from typing import NamedTuple

from barnax.optimizers import (
    AbstractPopulationMinimiser,
    AdaptiveGenetic,
    Ecosystem,
    GreyWolf,
    ParticleSwarm,
    SeagullSearch,
    WhaleSearch,
)

from .sizes import ITERATIONS, PARTICLE_RUNS, POPULATION, RUNS

REQUIREMENTS = {
    "evolopy": "EvoloPy==4.0.6",
    "niapy": "niapy==2.7.1",
    "pyswarms": "pyswarms==1.3.0",
    "mealpy": "mealpy==3.0.3",
}
NAMES = {"evolopy": "EvoloPy", "niapy": "NiaPy", "pyswarms": "PySwarms", "mealpy": "mealpy"}


class Comparison(NamedTuple):
    """An implementation, ours under the same rule, and ours under another one.

    The control is what the comparison ought to tell apart. `evaluates_last_move` says whether
    the library evaluates where the last generation moved to; ours always does, so else our
    generation before it counts. `differs` is empty where the rules are the same. `runs` are
    the library's.
    """

    library: str
    task: str
    ours: AbstractPopulationMinimiser
    control: AbstractPopulationMinimiser
    control_option: str
    evaluates_last_move: bool
    same: str
    differs: str = ""
    runs: int = RUNS

    @property
    def name(self) -> str:
        return f"{NAMES[self.library]} {self.task}"


def particles(
    inertia_end: float, velocity_limit: float | None = None, bounded: bool = True
) -> ParticleSwarm:
    """Particles whose inertia falls from 0.9 as the libraries' does: theirs starts in the first
    generation from its first value, ours one step further down.
    """
    step = (0.9 - inertia_end) / ITERATIONS
    return ParticleSwarm(
        POPULATION,
        ITERATIONS,
        inertia_start=0.9 + step,
        inertia_end=inertia_end + step,
        velocity_limit=velocity_limit,
        bounded=bounded,
    )


SWARM = (
    "both pulls are 2 times the distance times a fresh uniform number in every dimension; "
    "velocities start at zero; the inertia falls linearly from 0.9 to {end}; the whole swarm is "
    "evaluated before the common best changes; a best gives way only to a strictly better "
    "position; "
)
PACK = (
    "A and C are fresh numbers for each leader, wolf and dimension; a falls linearly from 2 to 0, "
    "one step a generation; every wolf moves to the mean of the three places, better or not; "
    "positions are clipped to the box before they are evaluated; "
)

COMPARISONS = (
    Comparison(
        "evolopy",
        "pso",
        particles(0.2, velocity_limit=6.0),
        particles(0.2, velocity_limit=6.0, bounded=False),
        "bounded=False",
        False,
        SWARM.format(end=0.2)
        + "a velocity is at most 6 whatever the function; positions are clipped to the box "
        "(`velocity_limit=6`).",
        runs=PARTICLE_RUNS,
    ),
    Comparison(
        "pyswarms",
        "pso",
        particles(0.4),
        particles(0.4, velocity_limit=6.0),
        "velocity_limit=6",
        False,
        SWARM.format(end=0.4)
        + "a velocity is at most 0.06 of the box's width; positions are clipped to the box (our "
        "defaults but for the inertia, whose end PySwarms fixes at 0.4; its first velocities, "
        "random else, are set to zero through its `swarm.velocity`).",
        runs=PARTICLE_RUNS,
    ),
    Comparison(
        "pyswarms",
        "pso-unbounded",
        particles(0.4, velocity_limit=6.0, bounded=False),
        particles(0.4, velocity_limit=6.0),
        "bounded=True",
        False,
        SWARM.format(end=0.4)
        + "a velocity is at most 6 whatever the function; positions are never clipped "
        "(`velocity_limit=6, bounded=False`, as in Table 2).",
        runs=PARTICLE_RUNS,
    ),
    Comparison(
        "evolopy",
        "gwo",
        GreyWolf(POPULATION, ITERATIONS, demote_leaders=True),
        GreyWolf(POPULATION, ITERATIONS),
        "demote_leaders=False",
        False,
        PACK + "a leader that is beaten moves down a rank (`demote_leaders`).",
    ),
    Comparison(
        "niapy",
        "gwo",
        GreyWolf(POPULATION, ITERATIONS),
        GreyWolf(POPULATION, ITERATIONS, demote_leaders=True),
        "demote_leaders=True",
        True,
        PACK + "a leader that is beaten is forgotten (our default, the authors' code). NiaPy's a "
        "falls by evaluations, so the first pack is evaluated beside its count; its first leaders "
        "are the three best of that pack, ours those whom the authors' loop over it leaves.",
    ),
    Comparison(
        "mealpy",
        "soa",
        SeagullSearch(POPULATION, ITERATIONS, spiral_attack=True),
        SeagullSearch(POPULATION, ITERATIONS),
        "spiral_attack=False",
        True,
        "the paper's Eq. 5 to 14 with u = v = 1: B one number and the spiral one angle a gull, "
        "shared by the dimensions; every gull moves, better or not; positions are clipped to the "
        "box; the best gull is the best so far (`spiral_attack`). mealpy's A is one step ahead; "
        "one epoch more and `fc` to match make it fall as ours.",
    ),
    Comparison(
        "evolopy",
        "woa",
        WhaleSearch(POPULATION, ITERATIONS),
        WhaleSearch(POPULATION, ITERATIONS, one_random_whale=True),
        "one_random_whale=True",
        False,
        "A, C, l and the choice are one number a whale; a random whale is drawn anew for every "
        "dimension; a falls from 2 to 0 and a2 from -1 to -2, one step a generation; every whale "
        "moves, better or not; positions are clipped to the box before they are evaluated; the "
        "leader gives way only to a strictly better whale.",
        "EvoloPy moves its whales one after the other and in place, so a random whale may have "
        "moved already in the same generation; ours all move from where the last one left them.",
    ),
    Comparison(
        "mealpy",
        "aeo",
        Ecosystem(POPULATION, ITERATIONS),
        Ecosystem(POPULATION, ITERATIONS, bounded=False),
        "bounded=False",
        True,
        "a candidate consumes the producer, a worse consumer or both, each by a third; all decay "
        "about the best; a candidate gives way only to a better one.",
        "mealpy's producer is made of the worst candidate and takes its place, better or not, "
        "where the authors make it of the best; the best is what consumers eat, or a better "
        "consumer, where the authors take a worse one; a consumption factor is one number for all "
        "dimensions.",
    ),
    Comparison(
        "mealpy",
        "ga",
        AdaptiveGenetic(POPULATION, ITERATIONS),
        AdaptiveGenetic(POPULATION, ITERATIONS, mutation=0.05),
        "mutation=0.05",
        True,
        "two parents are crossed, children mutate coordinate by coordinate.",
        "mealpy's rates are constant (0.95 and 0.025), a fifth of the population fights for "
        "parenthood, a child takes each coordinate from one of its parents, and a mutation is a "
        "fresh coordinate; no library was found with rates that follow the losses.",
    ),
)

# Read, not run: why these are no checks.
OTHER_RULES = (
    "mealpy 3.0.3, PSO: the inertia is constant (`LDW_PSO`: falling), a particle moves only to a "
    "better place, first velocities are random, and a coordinate outside the box is drawn anew.",
    "mealpy 3.0.3, WOA: a whale moves only to a better place; the random whale is a random point "
    "of the box; A and C share their number; l is uniform in [-1, 1] throughout.",
    "mealpy 3.0.3, GWO: a wolf moves only to a better place.",
    "mealpy 3.0.3, IGWO: another algorithm (Kaveh and Zakian, 2018).",
    "mealpy 3.0.3, SFO: a sailfish moves only to a better place and about the best sardine; there "
    "are ten sardines a sailfish.",
    "mealpy 3.0.3, BMO: p is uniform, and the offspring replace their parents.",
    "NiaPy 2.7.1, PSO: the inertia is constant, and the common best changes within a generation.",
    "opytimizer 5.0.1: in WOA a random point stands for the random whale and l is normal; GWO has "
    "one A and C for all dimensions and moves only to better places; PSO has one number for all "
    "dimensions and constant inertia; in SFO no sardine is ever eaten; AEO draws one factor for "
    "all dimensions, and an omnivore's second share has none.",
    "pyMetaheuristic 7.4.4: WOA draws l anew for every dimension; GWO and IGWO evaluate the place "
    "about each leader too and keep the best of five packs; SOA and SFO move only to better "
    "places; BMO takes a uniform p and replaces the parents.",
)
