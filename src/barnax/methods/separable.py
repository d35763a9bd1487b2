"""The linear half of the problem: at given time constants, the exact best resistances."""

from dataclasses import dataclass, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import lsq_linear

from ..evaluator import Impedance
from ..precision import in_float64
from ..problem import Problem
from ..simulate import Drive, overpotential, unit_response
from ..split_box import SplitBox


@dataclass(frozen=True, eq=False)
class Separable:
    """One problem whose error is linear in the resistances once tau and gamma are known.

    The error is base(gamma) + R0 times the current + the sum of R_i times the answer of a pair of
    1 ohm. Everything is in V and ohm over the scored samples, scaled so that the sum of squares is
    the RMSE squared.
    """

    drive: Drive
    box: SplitBox

    @classmethod
    def of(cls, problem: Problem) -> "Separable":
        """The problem by the scan, whatever its own objective."""
        return cls(problem.drives[0], SplitBox(problem.bounds))

    @property
    def current(self) -> Float[np.ndarray, "samples"]:
        return self._scored(self.drive.current_a)

    @in_float64
    def answers(self, tau_s: Float[np.ndarray, "taus"]) -> Float[np.ndarray, "samples taus"]:
        """What a pair of 1 ohm answers, for every time constant."""
        return np.stack([self._scored(row) for row in _answers(jnp.asarray(tau_s), self.drive)], 1)

    @in_float64
    def bases(
        self, gammas: Float[np.ndarray, "gammas"] | None
    ) -> Float[np.ndarray, "samples gammas"]:
        """The error of a circuit without resistances, for every rate of the hysteresis.

        One column for a circuit without dynamic hysteresis.
        """
        if gammas is None:
            return self._scored(self.drive.base_error_v)[:, None]
        rows = _bases(jnp.asarray(gammas), self.drive)
        return np.stack([self._scored(row) for row in rows], axis=1)

    def _scored(self, signal) -> Float[np.ndarray, "samples"]:
        weight = self.drive.weight
        chosen = np.asarray(signal)
        chosen = chosen if weight is None else chosen[np.asarray(weight) > 0]
        return chosen / np.sqrt(len(chosen))


def bounded_least_squares(
    columns: Float[np.ndarray, "samples resistances"],
    base: Float[np.ndarray, "samples"],
    low: Float[np.ndarray, "resistances"],
    high: Float[np.ndarray, "resistances"],
) -> Float[np.ndarray, "resistances"]:
    """The values in [low, high] with the least sum of squares of base + columns @ values.

    Exact: SciPy's bounded-variable least squares (Stark and Parker, Comput. Stat. 10 (1995) 129)
    on the triangular factor. Where low and high are one value, that is it.
    """
    is_free = high > low
    values = low.copy()
    if not np.any(is_free):
        return values
    target = -(base + columns[:, ~is_free] @ low[~is_free])
    scale = np.maximum(np.linalg.norm(columns[:, is_free], axis=0), np.finfo(float).tiny)
    factor = triangular_factor(np.column_stack([columns[:, is_free] / scale, target]))
    found = lsq_linear(
        factor[:, :-1],
        factor[:, -1],
        (low[is_free] * scale, high[is_free] * scale),
        method="bvls",
        tol=1e-14,
        max_iter=100,
    )
    values[is_free] = np.clip(found.x / scale, low[is_free], high[is_free])
    return values


def triangular_factor(
    matrix: Float[np.ndarray, "rows columns"],
) -> Float[np.ndarray, "few columns"]:
    """R of the QR factorization: all that least squares in the columns needs to know."""
    return np.asarray(np.linalg.qr(matrix, mode="r"))


@eqx.filter_jit
def _answers(tau_s: Float[Array, "taus"], drive: Drive) -> Float[Array, "taus samples"]:
    return jax.vmap(lambda tau: unit_response(tau, drive.held_a, drive.intervals))(tau_s)


@eqx.filter_jit
def _bases(gammas: Float[Array, "gammas"], drive: Drive) -> Float[Array, "gammas samples"]:
    no_current = Impedance(r0=jnp.asarray(0.0), r=(), tau=())

    def base(gamma):
        return drive.base_error_v + overpotential(replace(no_current, gamma=gamma), drive)

    return jax.vmap(base)(gammas)
