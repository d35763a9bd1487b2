"""The lowest error that resistances can reach, over all time constants."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import label, minimum_filter

from ..cell import CircuitParameters
from ..precision import in_float64
from ..problem import Problem
from ..threads import one_blas_thread
from .bounded_least_squares import least_in_box
from .reduced import Reduced, errors_of, normal_equations

# Grid points of a time constant by the number of pairs, and of gamma. An answer varies over a
# factor of e in tau; four pairs are still sampled twice as densely as that.
TAUS = {1: 192, 2: 96, 3: 28, 4: 18}
TAUS_BESIDE_GAMMA = {1: 96, 2: 48, 3: 20, 4: 12}
GAMMAS = 24
# Points that are solved at a time.
CHUNK = 4096


@dataclass(frozen=True, eq=False)
class Landscape:
    """RMSE in V with the best resistances, at every point of a grid.

    One axis a pair, in the order of the pairs, then gamma's where the circuit has one. `rmse_v`
    and `resistances_ohm` (R0, R1, ... first) are NaN where alike pairs would be out of order.
    """

    tau_s: tuple[Float[np.ndarray, "taus"], ...]
    gamma: Float[np.ndarray, "gammas"] | None
    rmse_v: Float[np.ndarray, "*grid"]
    resistances_ohm: Float[np.ndarray, "resistances *grid"]

    def circuit(self, point: tuple[int, ...]) -> CircuitParameters:
        """The best circuit at a point of the grid."""
        taus = [float(axis[index]) for axis, index in zip(self.tau_s, point, strict=False)]
        r0, *r = self.resistances_ohm[:, *point].tolist()
        gamma = None if self.gamma is None else float(self.gamma[point[-1]])
        c = tuple(tau / each for tau, each in zip(taus, r, strict=True))
        return CircuitParameters(r0, tuple(r), c, gamma)

    def minima(self, factor: float) -> list[tuple[int, ...]]:
        """The points no neighbor of which is lower, best first; level ground counts once.

        Only those with at most `factor` times the lowest error.
        """
        known_v = np.where(np.isnan(self.rmse_v), np.inf, self.rmse_v)
        is_minimum = known_v == minimum_filter(known_v, 3, mode="nearest")
        is_minimum &= known_v <= factor * np.min(known_v)
        grounds = np.empty(known_v.shape, int)
        label(is_minimum, np.ones((3,) * known_v.ndim), output=grounds)
        _, first = np.unique(grounds[is_minimum], return_index=True)
        points = np.argwhere(is_minimum)[first].tolist()
        return sorted(map(tuple, points), key=lambda point: self.rmse_v[point])


@in_float64
def make_landscape(problem: Problem) -> Landscape:
    """The landscape of a problem, whichever its objective, from the compressed form.

    Raises `InputError` where the box is too wide to compress.
    """
    return landscape_of(Reduced.of(problem))


def landscape_of(reduced: Reduced) -> Landscape:
    """The landscape of the same, already reduced."""
    places = _grid(reduced)
    # One thread: what a library does with several would change the last bits.
    with one_blas_thread():
        tables = [axis.columns(place) for axis, place in zip(reduced.axes, places, strict=True)]
    shape, pairs = tuple(len(place) for place in places), reduced.box.bounds.pairs
    points = np.indices(shape).reshape(len(shape), -1)
    if reduced.is_ordered:
        points = points[:, np.all(np.diff(points[:pairs], axis=0) >= 0, axis=0)]
    rmse_v = np.full(shape, np.nan)
    resistances_ohm = np.full((pairs + 1, *shape), np.nan)
    for first in range(0, points.shape[1], CHUNK):
        here = points[:, first : first + CHUNK]
        base = np.broadcast_to(reduced.base, (here.shape[1], len(reduced.base)))
        columns = [np.broadcast_to(reduced.current, base.shape)]
        columns += [table[index] for table, index in zip(tables, here, strict=True)]
        at = np.stack([place[index] for place, index in zip(places, here, strict=True)])
        box = reduced.coefficient_box(at)
        found = least_in_box(*normal_equations(columns, base), *box)
        errors_v = errors_of(columns, base, found)
        rmse_v[tuple(here)] = np.linalg.norm(errors_v, axis=1)
        resistances_ohm[:, *here] = found[: pairs + 1]
    return Landscape(
        tau_s=tuple(np.exp(place) for place in places[:pairs]),
        gamma=np.exp(places[pairs]) if len(places) > pairs else None,
        rmse_v=rmse_v,
        resistances_ohm=resistances_ohm,
    )


def _grid(reduced: Reduced) -> list[Float[np.ndarray, "places"]]:
    """Evenly spaced places on every axis; one where there is nothing to choose."""
    pairs = reduced.box.bounds.pairs
    has_gamma = len(reduced.axes) > pairs
    sizes = [(TAUS_BESIDE_GAMMA if has_gamma else TAUS)[pairs]] * pairs + [GAMMAS] * has_gamma
    return [
        np.linspace(axis.low, axis.high, size if axis.high > axis.low else 1)
        for axis, size in zip(reduced.axes, sizes, strict=True)
    ]
