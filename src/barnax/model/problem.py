"""The identification problem: records of one cell, one circuit, one box."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Scalar

from ..cell import CellModel, CircuitParameters, get_circuit
from ..display import Brief
from ..errors import InputError, require_choice
from ..execution import CIRCUITS_PER_BLOCK, as_input, compile_for, in_float64, seed_blocks
from ..notices import Notice
from ..records import Record
from .compressed import Compressed, compress
from .coordinates import Coordinates
from .exponentials import can_span
from .layout import TOLERANCE, ends_of
from .prepared import PreparedRecord, prepare_record
from .search_space import KINDS, Bounds, Kind, Range, Scale
from .simulate import AbstractEvaluator, Joint, RCParameters, SimulationInput
from .start import require_whole_log
from .window import Window


class Objective(eqx.Module):
    """The errors and the map from points to circuits, as the compiled search uses them."""

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


def errors_and_slopes(
    point: Float[Array, "free"], objective: Objective
) -> tuple[Float[Array, "samples"], Float[Array, "samples free"]]:
    """The residuals and their derivatives, in one pass."""

    def errors(point):
        error = residuals(point, objective)
        return error, error

    slope, error = jax.jacfwd(errors, has_aux=True)(point)
    return error, slope


# Rows and nodes of a compressed record are padded to a multiple of this for refinement: a program
# for another size takes five seconds to compile, the zeros a few percent of its time.
FACTOR_STEP = 64


@dataclass(frozen=True, eq=False, repr=False)
class Problem(Brief):
    """Prepared records, cell, circuit and bounds: all that a search needs. Records share one
    circuit.

    Attributes:
        prepared_records: The records in their windows.
        cell: OCV, hysteresis voltage and capacity.
        bounds: The circuit and its box.
        scale: Search coordinates: "rc", or logarithms of R and tau.
        kind: How the search computes its errors: by simulation of every sample, or from a reduced
            record.
    """

    prepared_records: tuple[PreparedRecord, ...]
    cell: CellModel
    bounds: Bounds
    scale: Scale
    kind: Kind = "scan"

    def __reduce__(self):
        # Without computed properties, which are larger than their inputs.
        return Problem, tuple(getattr(self, field.name) for field in fields(self))

    @property
    def prepared(self) -> PreparedRecord:
        """The first prepared record, and the only one unless records are identified jointly."""
        return self.prepared_records[0]

    @property
    def circuit(self) -> str:
        return self.prepared.circuit

    @property
    def name(self) -> str:
        """The names of the records."""
        return " + ".join(prepared.record.name for prepared in self.prepared_records)

    @property
    def scored(self) -> int:
        """Number of scored samples."""
        return sum(int(np.count_nonzero(prepared.scored)) for prepared in self.prepared_records)

    def keeping_computed(self, **changes: Any) -> "Problem":
        """The problem with other fields, keeping computed properties if box and scale stay the same
        and the records have the same samples."""
        other = replace(self, **changes)
        ours, theirs = self.prepared_records, other.prepared_records
        if (other.bounds, other.scale, len(theirs)) == (self.bounds, self.scale, len(ours)) and all(
            map(PreparedRecord.simulates_as, ours, theirs)
        ):
            vars(other).update(vars(self) | vars(other))
        return other

    @property
    def warnings(self) -> tuple[Notice, ...]:
        records = self.prepared_records
        warnings = [warning for prepared in records for warning in prepared.record.warnings]
        warnings += self.cell.warnings
        return (*warnings, *(warning for prepared in records for warning in prepared.warnings))

    @cached_property
    def coordinates(self) -> Coordinates:
        """The search coordinates."""
        return (
            self.log_coordinates if self.scale == "log" else Coordinates.of(self.bounds, self.scale)
        )

    @cached_property
    def log_coordinates(self) -> Coordinates:
        """The coordinates of every descent."""
        return Coordinates.of(self.bounds, "log")

    @cached_property
    def all_inputs(self) -> tuple[SimulationInput, ...]:
        """The input of every record to the scan, exact in the whole box."""
        return self._inputs(in_common_size=False)

    def _inputs(self, *, in_common_size: bool) -> tuple[SimulationInput, ...]:
        from .sampling_intervals import common_size

        (shortest_s, _), gammas = self.coordinates.spans
        exact_for = shortest_s, None if gammas is None else gammas[1]
        sizes = (common_size(len(prepared.soc)) for prepared in self.prepared_records)
        return tuple(
            prepared.simulation_input(*exact_for, size if in_common_size else None)
            for prepared, size in zip(self.prepared_records, sizes, strict=True)
        )

    @property
    def scan(self) -> AbstractEvaluator:
        """The objective by simulating every sample: the reference."""
        return Joint.of(self.all_inputs)

    @property
    def is_compressible(self) -> bool:
        """True if the box is narrow enough for the small factor."""
        ends = ends_of(self.prepared_records, *self.coordinates.spans)
        return all(can_span(*each, TOLERANCE) for each in ends)

    @cached_property
    @in_float64
    def compressed(self) -> Compressed:
        """The objective in compressed form. Raises `InputError` if the box is too wide."""
        return compress(self.prepared_records, self.coordinates)

    @cached_property
    def padded_inputs(self) -> tuple[SimulationInput, ...]:
        """The input of every record in one of a few shapes; padded samples have no weight."""
        return self._inputs(in_common_size=True)

    @property
    def padded_scan(self) -> AbstractEvaluator:
        """The reference in one of a few shapes, with the same bits."""
        return Joint.of(self.padded_inputs)

    @cached_property
    def padded_compressed(self) -> Compressed:
        """The compressed objective in one of a few shapes, for programs that take seconds to
        compile."""
        return self.compressed.padded_to_multiple(FACTOR_STEP)

    @property
    def objective(self) -> Objective:
        """The objective of the search."""
        evaluator = self.compressed if self.kind == "compressed" else self.scan
        return Objective(evaluator, self.coordinates)

    def padded_objective(self, kind: Kind = "scan") -> Objective:
        """The objective in log coordinates, in one of a few shapes."""
        evaluator = self.padded_compressed if kind == "compressed" else self.padded_scan
        return Objective(evaluator, self.log_coordinates)

    def parameters_at(
        self, points: Sequence[Float[np.ndarray, "free"]], coordinates: Coordinates
    ) -> list[CircuitParameters]:
        """The circuits at the given points, pairs ordered by tau if they share one box."""
        # In NumPy: JAX would compile a program for every number of points.
        decoded = coordinates.decode(as_input(points).T, np)
        leaves, tree = jax.tree.flatten(decoded)
        rows = np.stack([np.broadcast_to(leaf, len(points)) for leaf in leaves], axis=1).tolist()
        each = (jax.tree.unflatten(tree, row) for row in rows)
        circuits = [
            CircuitParameters.of_tau(one.r0, one.r, one.tau, one.gamma, self.bounds.elements)
            for one in each
        ]
        is_ordered = self.bounds.interchangeable_pairs
        return [circuit.ordered() for circuit in circuits] if is_ordered else circuits


def applicable_to(
    model: str, values: Mapping[str, Any] | None, models: Sequence[str]
) -> dict[str, Any]:
    """The bounds or fixed values that do not belong only to other models; a name unknown to all is
    left for the first model to reject."""
    others = set().union(*map(_names_of, models)) - _names_of(model)
    return {name: value for name, value in (values or {}).items() if name not in others}


def _names_of(model: str) -> set[str]:
    """Every name under which a parameter of a model can be bounded or fixed."""
    circuit = get_circuit(model)
    box = Bounds.default(1.0, 1.0, 1.0, elements=circuit.elements, has_rate=circuit.has_rate)
    return set(box.names)


@in_float64
def rmse_by_scan(problem: Problem, circuits: Sequence[CircuitParameters]) -> list[float]:
    """The RMSE of circuits by the reference, in V, whatever the problem's objective."""
    objective = problem.padded_objective()
    errors_v = []
    for points in point_blocks(circuits, objective.coordinates):
        errors_v += compile_for(rmse_of_all, points, objective)(points, objective).tolist()
    return errors_v[: len(circuits)]


def point_blocks(
    circuits: Sequence[CircuitParameters], coordinates: Coordinates
) -> list[Float[Array, "seeds free"]]:
    """The points of circuits in blocks of one size; the last is padded with its last circuit.

    Call inside float64.
    """
    values: Any = [(each.r0, each.r, each.tau_s, each.gamma) for each in circuits]
    points = [coordinates.encode(RCParameters(*each)) for each in values]
    last = len(points) - 1
    numbers = seed_blocks(len(points), CIRCUITS_PER_BLOCK)
    return [as_input([points[min(at, last)] for at in block]) for block in numbers]


def rmse_of_all(points: Float[Array, "points free"], objective: Objective):
    return jax.vmap(rmse, in_axes=(0, None))(points, objective)


@in_float64
def make_problem(
    record: Record | Sequence[Record],
    cell: CellModel,
    circuit: str = "iso-rc",
    *,
    window: Window | Sequence[Window] | None = None,
    bounds: Mapping[str, Range] | None = None,
    fixed: Mapping[str, float] | None = None,
    coordinates: Scale = "rc",
    objective: Kind = "scan",
    source: str = "bounds",
) -> Problem:
    """The problem of identifying a circuit's parameters from one or more records of a cell.

    Args:
        record: One or more records.
        cell: A cell from `characterize`.
        circuit: Name of the circuit.
        window: The part of the records that is simulated: one for all, or one for each.
        bounds: Lowest and highest value by PyBaMM's names (`"R0 [Ohm]"`, `"C1 [F]"`, `"tau1 [s]"`).
        fixed: Parameters that keep a value, by the same names.
        coordinates: Search coordinates: "rc", or logarithms of R and tau.
        objective: "scan" simulates every sample for every candidate; "compressed" reduces the
            records once and agrees with it to 1e-9.
        source: The origin of the bounds, for messages.

    Raises `InputError` if window, box or OCV range do not fit a record, the box is too wide to
    compress, or circuit or objective are unknown; `ValueError` for windows that do not match.
    """
    require_choice("objective", objective, KINDS)
    records = (record,) if isinstance(record, Record) else tuple(record)
    if not records:
        raise ValueError("a problem needs at least one record")
    windows = [window] * len(records) if isinstance(window, Window | None) else window
    if len(windows) != len(records):
        raise ValueError(
            f"{len(windows)} windows for {len(records)} records; give one for all, or one for each"
        )
    ready = list[PreparedRecord]()
    for record, its in zip(records, windows, strict=True):
        try:
            ready.append(prepare_record(record, cell, circuit, its))
        except InputError as problem:
            if problem.code.startswith("start."):
                require_whole_log(record, records, problem)
            raise
    prepared_records = tuple(ready)
    for prepared in prepared_records:
        require_changing_voltage(prepared)
    model = get_circuit(circuit)
    box = Bounds.default(
        prepared_records[0].capacity_ah,
        min(prepared.median_interval_s for prepared in prepared_records),
        max(prepared.scored_duration_s for prepared in prepared_records),
        elements=model.elements,
        has_rate=model.has_rate,
    )
    box = box.with_changes(bounds or {}, fixed or {}, source)
    problem = Problem(prepared_records, cell, box, coordinates, objective)
    # A box that cannot be searched is rejected here, not in the middle of a search.
    _ = problem.objective
    return problem


def require_changing_voltage(prepared: PreparedRecord) -> None:
    """Raise `InputError` if the scored voltage is constant: errors on it mean nothing."""
    voltage_v = prepared.voltage_v[prepared.scored]
    if np.ptp(voltage_v) == 0:
        raise InputError(
            f"{prepared.record.name}: the voltage is {voltage_v[0]:g} V at every scored sample; "
            "widen the window or check the file"
        )


# With fewer samples, parameters would fit the noise of single samples.
SAMPLES_A_PARAMETER = 10


def require_enough(problem: Problem) -> None:
    """Raise `InputError` if there are too few samples for the parameters."""
    wanted = SAMPLES_A_PARAMETER * len(problem.coordinates.names)
    if problem.scored < wanted:
        raise InputError(
            f"{problem.name}: {problem.scored} samples are scored, too few for "
            f"{len(problem.coordinates.names)} parameters; give a longer record or a wider window, "
            f"of {wanted} samples or more"
        )
