"""Many fits of one circuit to changed voltages, or along a constraint, by one small program."""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float

from ..blas import one_blas_thread
from ..cell import CircuitParameters
from ..execution import (
    SEEDS_PER_BLOCK,
    compile_for,
    in_float64,
    run_blocks,
    seed_blocks,
    wanted_rows,
)
from ..model.compressed import Compressed, objective_of, to_nodes
from ..model.coordinates import Coordinates
from ..model.layout import Layout, Spans
from ..model.problem import Objective, Problem, rc_parameters, residuals
from ..model.reduced import blocks
from ..search.refine import angle_of, levenberg_marquardt, point_at
from .covariance import Linearization

# Of a unit response, relative to the largest current: far below the noise, with half the columns
# of the compressed objective.
PROJECTION_TOLERANCE = 1e-9
# The relative tolerance of errors and unknowns: far below what any interval could show.
TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Voltages:
    """The basis of one problem's unit responses, and its own voltage in it, as an objective."""

    basis: Float[np.ndarray, "scored rows"]
    own_v: Float[np.ndarray, "scored"]
    objective: Compressed

    @classmethod
    @in_float64
    def of(cls, problem: Problem) -> "Voltages":
        """The voltages of a problem, as errors of a circuit without any resistance.

        Raises `InputError` where the box is too wide.
        """
        box = Coordinates.of(problem.bounds, "log")
        spans = Spans.of(problem.prepared_records, box, PROJECTION_TOLERANCE)
        layout = Layout.constant(spans)
        rows = [
            block.rows(layout, prepared.scored[block.here])
            for prepared in problem.prepared_records
            for block in blocks(prepared, layout)
        ]
        columns, own_v = np.split(np.concatenate(rows), [-1], axis=1)
        # One thread: what a library does with several would change the last bits.
        with one_blas_thread():
            basis, factor = np.linalg.qr(columns)
        own_v = own_v[:, 0]
        whole = np.column_stack([np.pad(factor, ((0, 1), (0, 0))), _project(basis, own_v[None])[0]])
        objective = objective_of(spans, to_nodes(spans, whole), len(own_v))
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


@dataclass(frozen=True, eq=False)
class Ends:
    """The ends of fits in `log` coordinates, and their RMSE in V."""

    points: Float[np.ndarray, "fits coordinates"]
    rmse_v: Float[np.ndarray, "fits"]
    has_converged: Bool[np.ndarray, "fits"]


class Refit:
    """Levenberg-Marquardt for one problem's times and currents, compiled once.

    What changes from fit to fit are arguments: the voltage, the start, and a constraint
    x = matrix y + shift on the coordinates x, y being any point of the box. A parameter is held
    by a row of zeros and its value as the shift.
    """

    @in_float64
    def __init__(self, problem: Problem):
        self.voltages = Voltages.of(problem)
        self.box = Coordinates.of(problem.bounds, "log")
        free = len(self.box.names)
        self._compiled = compile_for(
            _refit,
            self.voltages.objective,
            self.box,
            jnp.stack([self.voltages.objective.factor[:, -1]] * SEEDS_PER_BLOCK),
            jnp.zeros((SEEDS_PER_BLOCK, free)),
            jnp.zeros((SEEDS_PER_BLOCK, free, free)),
            jnp.zeros((SEEDS_PER_BLOCK, free)),
        )

    @property
    def rows(self) -> int:
        """The length of a projected voltage."""
        return len(self.voltages.objective.factor)

    @in_float64
    def encode(self, parameters: CircuitParameters) -> Float[np.ndarray, "coordinates"]:
        """A circuit as a start."""
        return np.asarray(self.box.encode(rc_parameters(parameters)))

    @in_float64
    def __call__(
        self,
        starts: Float[np.ndarray, "fits coordinates"],
        *,
        base_v: Float[np.ndarray, "fits rows"] | None = None,
        matrix: Float[np.ndarray, "coordinates coordinates"] | None = None,
        shift: Float[np.ndarray, "fits coordinates"] | None = None,
    ) -> Ends:
        """The end of each fit, from the y of `starts`.

        `base_v` are voltages as `Voltages.project` gives them; without it the record's own is
        fitted.
        """
        fits, free = starts.shape
        own = np.asarray(self.voltages.objective.factor[:, -1])
        base_v = np.broadcast_to(own, (fits, self.rows)) if base_v is None else base_v
        matrix = np.eye(free) if matrix is None else matrix
        shift = np.zeros((fits, free)) if shift is None else shift
        given = (base_v, starts, np.broadcast_to(matrix, (fits, free, free)), shift)
        blocks = [
            # The last block is filled up with its last fit: all have one shape.
            tuple(part[np.minimum(block, fits - 1)] for part in given)
            for block in seed_blocks(fits)
        ]

        @in_float64  # the setting belongs to a thread
        def run(block):
            given = (jnp.asarray(part) for part in block)
            ends = self._compiled(self.voltages.objective, self.box, *given)
            return jax.tree.map(np.asarray, ends)

        rows = run_blocks(run, blocks, wanted_rows(fits), None)
        points, rmse_v, converged = zip(*rows, strict=True)
        return Ends(np.stack(points), np.array(rmse_v), np.array(converged))


def holding(linearization: Linearization) -> tuple[np.ndarray, np.ndarray]:
    """The constraint, matrix and shift, that holds what a linearization holds."""
    is_free = np.isin(np.arange(len(linearization.point)), linearization.free)
    return np.diag(is_free.astype(linearization.point.dtype)), np.where(
        is_free, 0.0, linearization.point
    )


def _refit(
    own: Compressed,
    box: Coordinates,
    base_v: Float[Array, "lanes rows"],
    starts: Float[Array, "lanes free"],
    matrices: Float[Array, "lanes free free"],
    shifts: Float[Array, "lanes free"],
):
    """End point, its RMSE in V and whether it converged, for every lane."""

    def place(angle, matrix, shift):
        return matrix @ point_at(angle, box) + shift

    def errors(angle, given):
        objective, matrix, shift, unit_v = given
        return residuals(place(angle, matrix, shift), objective) / unit_v

    def one(base_v, start, matrix, shift):
        # The last column is the voltage.
        factor = own.factor.at[:, -1].set(base_v)
        changed = Objective(eqx.tree_at(lambda compressed: compressed.factor, own, factor), box)
        angle = angle_of(start, box)
        unit_v = jnp.linalg.norm(errors(angle, (changed, matrix, shift, 1.0)))
        given = (changed, matrix, shift, jnp.where(unit_v > 0, unit_v, 1.0))
        solution = levenberg_marquardt(errors, angle, given, TOLERANCE)
        end = place(solution.value, matrix, shift)
        rmse_v = jnp.linalg.norm(residuals(end, changed))
        return end, rmse_v, solution.result == optx.RESULTS.successful

    return jax.vmap(one)(base_v, starts, matrices, shifts)
