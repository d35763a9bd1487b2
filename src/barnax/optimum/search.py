"""The best circuit there is in the box, and how far any answer is from it."""

from dataclasses import dataclass
from decimal import ROUND_CEILING, Context
from typing import Literal

from ..cell import CircuitParameters
from ..descent import Descent, RefinedSeed
from ..precision import in_float64
from ..problem import Problem
from ..programs import SEEDS_PER_BLOCK
from ..refinement import (
    FINAL_ROUNDS,
    FINAL_TOLERANCE,
    SEED_TOLERANCE,
    Optimum,
    at_bound,
    distinct_optima,
)
from .certificate import CERTIFIED_GAP, SMALLEST_RMSE_V, Certificate, certify
from .landscape import Landscape, landscape_of
from .reduced import Reduced

# Local minima of the grid up to this many times its lowest error are polished, but never more of
# them than this.
FACTOR = 1.5
MOST_MINIMA = 4 * SEEDS_PER_BLOCK
# Another optimum so little above the best one is worth a word.
HARDLY_ABOVE = 0.01
# Cells of a proof: two pairs need hundreds, three and gamma thousands, four tens of thousands.
MOST_CELLS = 50_000
# A circuit that a proof comes upon and that is better than all polished ones; seldom more than one.
MOST_PROOFS = 8

ROUNDED_UP = Context(prec=2, rounding=ROUND_CEILING)

Status = Literal["certified", "grid-verified"]


@dataclass(frozen=True, eq=False)
class GlobalOptimum:
    """The best circuit of a box, how sure that is, and the landscape around it.

    `optima` are the distinct local optima up to `FACTOR` times the best, which comes first; their
    errors are the scan's. `certificate` is None where no proof was asked for.
    """

    optima: tuple[Optimum, ...]
    at_bound: tuple[str, ...]
    certificate: Certificate | None
    landscape: Landscape

    @property
    def parameters(self) -> CircuitParameters:
        return self.optima[0].parameters

    @property
    def rmse_v(self) -> float:
        return self.optima[0].rmse_v

    @property
    def local_optima(self) -> tuple[Optimum, ...]:
        """The other optima."""
        return self.optima[1:]

    @property
    def lower_bound_v(self) -> float:
        """What no circuit in the box has an RMSE below; 0 where nothing was proved."""
        return 0.0 if self.certificate is None else self.certificate.lower_bound_v

    @property
    def proved_gap(self) -> float:
        """The largest share of the RMSE that a better circuit could save."""
        return max(0.0, -regret(self.lower_bound_v, self.rmse_v))

    @property
    def status(self) -> Status:
        return "certified" if self.proved_gap <= CERTIFIED_GAP else "grid-verified"

    @property
    def verdict(self) -> str:
        """What was found and how sure it is, in sentences."""
        return " ".join([_sureness(self), _other_optima(self), _at_bound(self)])


def regret(rmse_v: float, optimum_v: float) -> float:
    """How far an RMSE is above the optimum's, as a share of it.

    An optimum below `SMALLEST_RMSE_V` counts as one of that: rounding is nothing to regret.

    >>> round(regret(10.1e-3, 10e-3), 6)
    0.01
    """
    return (rmse_v - optimum_v) / max(optimum_v, SMALLEST_RMSE_V)


@in_float64
def global_optimum(
    problem: Problem, *, prove: bool = True, most_cells: int = MOST_CELLS
) -> GlobalOptimum:
    """The best circuit in the box: the landscape's minima polished, and a proof of it.

    It draws nothing and does not depend on the problem's own objective. `prove` adds a lower bound
    on every circuit's RMSE by branch and bound over at most `most_cells` cells of time constants;
    where that ends within `CERTIFIED_GAP` of the best, the status is "certified", else
    "grid-verified". Raises `InputError` where the box is too wide to compress.
    """
    reduced = Reduced.of(problem)
    landscape = landscape_of(reduced)
    polish = _Polish(problem)
    starts = landscape.minima(FACTOR)[:MOST_MINIMA]
    ends = polish([landscape.circuit(point) for point in starts])
    certificate = None
    for _ in range(MOST_PROOFS if prove else 0):
        certificate = certify(reduced, min(end.rmse_v for end in ends), most_cells)
        if certificate.better is None:
            break
        # The grid can miss a basin; a proof cannot.
        ends += polish([certificate.better])
    optima = distinct_optima(ends)
    optima = tuple(each for each in optima if each.rmse_v <= FACTOR * optima[0].rmse_v)
    bounded = at_bound(polish.descent.objective.coordinates, optima[0].parameters)
    return GlobalOptimum(optima, bounded, certificate, landscape)


class _Polish:
    """Levenberg-Marquardt from grid points, in blocks of one shape so that nothing recompiles."""

    def __init__(self, problem: Problem):
        self.descent = Descent(problem)

    def __call__(self, circuits: list[CircuitParameters]) -> list[RefinedSeed]:
        missing = -len(circuits) % SEEDS_PER_BLOCK
        starts = [*circuits, *circuits[-1:] * missing]
        ends = self.descent(starts, SEED_TOLERANCE)
        for _ in range(FINAL_ROUNDS):
            ends = self.descent(
                [end.parameters for end in ends], FINAL_TOLERANCE, holds_bounds=True
            )
            if min(ends, key=lambda end: end.rmse_v).has_converged:
                break
        return ends[: len(circuits)]


def _sureness(found: GlobalOptimum) -> str:
    best, proof = f"The lowest RMSE in the box is {1e3 * found.rmse_v:.6g} mV", found.certificate
    # Rounded up: a claim may not say more than was proved.
    percent = ROUNDED_UP.create_decimal_from_float(100 * found.proved_gap)
    if found.status == "certified":
        return f"{best}; certified: no circuit in the box is more than {percent:f} % lower."
    best += ", by a grid of time constants and descents from it"
    if proof is None:
        return f"{best}; nothing was proved."
    return (
        f"{best}; after {proof.cells} cells all that is proved is that no circuit in the box is "
        f"more than {percent:f} % lower."
    )


def _other_optima(found: GlobalOptimum) -> str:
    others, reach = found.local_optima, f"{100 * (FACTOR - 1):.0f} %"
    if not others:
        return f"No other local optimum was found up to {reach} above it."
    nearest = f"{100 * regret(others[0].rmse_v, found.rmse_v):.2g} %"
    tau = " and ".join(f"{tau_s:.4g}" for tau_s in others[0].parameters.tau_s)
    count = "One other local optimum lies" if len(others) == 1 else f"{len(others)} others lie"
    where = f"{count} up to {reach} above it, the nearest {nearest} above at tau of {tau} s"
    is_close = others[0].rmse_v < (1 + HARDLY_ABOVE) * found.rmse_v
    return f"{where}: another circuit with nearly the same error." if is_close else f"{where}."


def _at_bound(found: GlobalOptimum) -> str:
    if not found.at_bound:
        return "No parameter is at a bound."
    return f"{'; '.join(found.at_bound)}: the box, not the data, decides there."
