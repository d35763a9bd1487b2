"""The identification problem: one record, one cell, one circuit, one box."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Scalar

from .bounds import Bounds, Range
from .cell import CellModel, CircuitParameters, get_circuit
from .coordinates import Coordinates, Scale
from .course import Course, make_course, require_changing_voltage
from .evaluator import AbstractEvaluator, Impedance
from .precision import in_float64
from .records import Record
from .window import Window


class Objective(eqx.Module):
    """What the compiled search sees: the errors and the map from points to circuits."""

    evaluator: AbstractEvaluator
    coordinates: Coordinates


def rmse(point: Float[Array, "free"], objective: Objective) -> Scalar:
    """Root mean square error of terminal voltage, in V (Li et al., 2023, Eq. 22)."""
    squares = objective.evaluator.squared_error(objective.coordinates.decode(point))
    return jnp.sqrt(squares / objective.evaluator.scored)


def residuals(point: Float[Array, "free"], objective: Objective) -> Float[Array, "errors"]:
    """Errors of terminal voltage, scaled so that their sum of squares is the RMSE squared."""
    errors_v = objective.evaluator.errors(objective.coordinates.decode(point))
    return errors_v / jnp.sqrt(objective.evaluator.scored)


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything a search needs and a report names."""

    course: Course
    cell: CellModel
    window: Window
    bounds: Bounds
    scale: Scale
    objective: Objective

    @property
    def circuit(self) -> str:
        return self.course.circuit

    @property
    def warnings(self) -> tuple[str, ...]:
        return (*self.course.record.warnings, *self.cell.warnings, *self.course.warnings)

    def objective_in(self, scale: Scale) -> Objective:
        """The same objective in other coordinates. Call inside float64."""
        return Objective(self.objective.evaluator, Coordinates.of(self.bounds, scale))

    def parameters_at(
        self, points: Sequence[Float[np.ndarray, "free"]], coordinates: Coordinates
    ) -> list[CircuitParameters]:
        """The circuits at some points, pairs ordered by tau where both have one box."""
        circuits = jax.tree.map(np.asarray, _decode(jnp.asarray(np.stack(points)), coordinates))
        found = []
        for index in range(len(points)):
            one = jax.tree.map(lambda leaf, index=index: float(leaf[index]), circuits)
            c = tuple(tau / r for r, tau in zip(one.r, one.tau, strict=True))
            found.append(CircuitParameters(one.r0, one.r, c, one.gamma))
        return [each.ordered() for each in found] if self.bounds.pairs_are_alike else found


@eqx.filter_jit
def _decode(points: Float[Array, "points free"], coordinates: Coordinates) -> Impedance:
    return jax.vmap(coordinates.decode)(points)


def impedance_of(parameters: CircuitParameters) -> Impedance:
    """A circuit's values as the simulation takes them. Call inside float64."""
    return Impedance(
        r0=jnp.asarray(parameters.r0),
        r=tuple(jnp.asarray(r) for r in parameters.r),
        tau=tuple(jnp.asarray(tau) for tau in parameters.tau_s),
        gamma=None if parameters.gamma is None else jnp.asarray(parameters.gamma),
    )


@in_float64
def make_problem(
    record: Record,
    cell: CellModel,
    circuit: str = "iso-rc",
    *,
    window: Window | None = None,
    bounds: Mapping[str, Range] | None = None,
    fixed: Mapping[str, float] | None = None,
    coordinates: Scale = "rc",
    source: str = "bounds",
) -> Problem:
    """The problem of finding `circuit`'s parameters for a cell from one of its records.

    `bounds` and `fixed` change the default box under PyBaMM's names (`"R0 [Ohm]"`, `"C1 [F]"`,
    `"tau1 [s]"`); `source` names where they came from in messages. Raises `InputError` where
    window, box or OCV range do not fit the record, `ValueError` for an unknown circuit.
    """
    window = window or Window()
    course = make_course(record, cell, circuit, window)
    require_changing_voltage(course)
    model = get_circuit(circuit)
    box = Bounds.default(
        cell.capacity_ah,
        course.median_interval_s,
        course.scored_duration_s,
        pairs=model.pairs,
        has_rate=model.has_rate,
    )
    box = box.with_changes(bounds or {}, fixed or {}, source)
    coordinate_map = Coordinates.of(box, coordinates)
    return Problem(
        course=course,
        cell=cell,
        window=window,
        bounds=box,
        scale=coordinates,
        objective=Objective(
            course.drive(coordinate_map.shortest_tau_s, coordinate_map.highest_gamma),
            coordinate_map,
        ),
    )
