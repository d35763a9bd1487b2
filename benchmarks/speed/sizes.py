"""How large every measurement is, in earnest and for a trial."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Sizes:
    """Numbers of turns, generations, seeds, cells and samples.

    `evaluations_of_peers` bounds a fit that would take hours; its whole time is extrapolated.
    """

    turns: int = 5
    generations_a_turn: int = 10
    generations: int = 500
    seeds: int = 30
    seeds_shown: tuple[int, ...] = (1, 3, 10, 30, 100)
    cells: int = 1000
    seeds_a_cell: int = 10
    lengths: tuple[int, ...] = (10**3, 10**4, 10**5, 10**6, 10**7)
    longest_scan: int = 10**6
    starts: int = 10
    warm_starts: int = 3
    evaluations_of_peers: int = 20
    rows_read: int = 2_600_000


QUICK = Sizes(
    turns=1,
    generations_a_turn=2,
    generations=20,
    seeds=9,
    seeds_shown=(1, 9),
    cells=20,
    seeds_a_cell=3,
    lengths=(10**3, 10**4, 10**5),
    longest_scan=10**4,
    starts=3,
    warm_starts=1,
    evaluations_of_peers=2,
    rows_read=100_000,
)

# The paper's population; both circuits have two RC pairs.
POPULATION = 30
KEY = 2023
