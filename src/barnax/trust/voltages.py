"""Many voltages on one current: each reduced to what a circuit's answer can meet of it.

For the records' times and currents every circuit's answer lies in the span of a few (see
`exponentials`). With their orthonormal basis a voltage is its coordinates there and the length of
the rest, which no circuit can change; an error of a hundred numbers stands for one of a hundred
thousand, exactly.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..compressed import Compressed
from ..coordinates import Coordinates
from ..exponentials import Lagrange, span_of
from ..intervals import Intervals
from ..precision import in_float64
from ..problem import Problem
from ..simulate import unit_response
from ..threads import one_blas_thread

# Of an answer, relative to the largest current: far below the noise, with half the columns of the
# compressed objective.
TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Voltages:
    """The basis of one problem's answers, and its own voltage in it, as an objective."""

    basis: Float[np.ndarray, "scored rows"]
    own_v: Float[np.ndarray, "scored"]
    objective: Compressed

    @classmethod
    @in_float64
    def of(cls, problem: Problem) -> "Voltages":
        """The voltages of a problem, as errors of a circuit without any impedance.

        Raises `InputError` where the box is too wide.
        """
        box = Coordinates.of(problem.bounds, "log")
        in_tau = span_of(box.shortest_tau_s, box.longest_tau_s, TOLERANCE)
        in_rate = None
        if box.gamma_limits is not None:
            slowest, fastest = box.gamma_limits
            in_rate = span_of(1 / fastest, 1 / slowest, TOLERANCE)
        parts, own = [], []
        for course, drive in zip(problem.courses, problem.drives, strict=True):
            columns = [_answers(jnp.asarray(in_tau.skeleton_tau), drive.held_a, drive.intervals)]
            moved = drive.hysteresis
            if in_rate is not None and moved is not None:
                turns = _answers(jnp.asarray(in_rate.skeleton_tau), moved.push, moved.intervals)
                columns.append(-moved.amplitude_v * turns)
            columns.append(drive.current_a[None])
            parts.append(np.asarray(jnp.concatenate(columns)).T[course.scored])
            own.append(np.asarray(drive.base_error_v)[course.scored])
        # One thread: what a library does with several would change the last bits.
        with one_blas_thread():
            basis, factor = np.linalg.qr(np.concatenate(parts))
        count = len(in_tau.skeleton)
        columns = [factor[:, :count] @ in_tau.from_skeleton]
        if in_rate is not None:
            columns.append(factor[:, count:-1] @ in_rate.from_skeleton)
        columns.append(factor[:, -1:])
        answers = np.pad(np.concatenate(columns, axis=1), ((0, 1), (0, 0)))
        own_v = np.concatenate(own)
        whole = np.column_stack([answers, _project(basis, own_v[None])[0]])
        objective = Compressed(
            scored=jnp.asarray(float(len(own_v))),
            factor=jnp.asarray(whole),
            in_tau=Lagrange.of(in_tau),
            in_rate=None if in_rate is None else Lagrange.of(in_rate),
        )
        return cls(basis, own_v, objective)

    def project(
        self, voltages_v: Sequence[np.ndarray] | Float[np.ndarray, "fits scored"]
    ) -> Float[np.ndarray, "fits rows"]:
        """The base columns of other voltages over the scored samples."""
        return _project(self.basis, np.asarray(voltages_v))


def _project(basis: np.ndarray, voltages_v: np.ndarray) -> np.ndarray:
    with one_blas_thread():
        inside = voltages_v @ basis
        squares = np.einsum("fs,fs->f", voltages_v, voltages_v)
    rest = np.sqrt(np.maximum(squares - np.einsum("fr,fr->f", inside, inside), 0.0))
    return np.column_stack([inside, rest])


@eqx.filter_jit
def _answers(
    taus: Float[Array, "taus"], held: Float[Array, "samples"], intervals: Intervals
) -> Float[Array, "taus samples"]:
    return jax.vmap(unit_response, in_axes=(0, None, None))(taus, held, intervals)
