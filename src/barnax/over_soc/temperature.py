"""Tables over SOC at several temperatures, with the same time constants: fitted together.

Time constants and gamma are searched once for all temperatures; at every one of them the tables of
each temperature are the exact optimum of its own bounded least-squares problem.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float

from ..blas import one_blas_thread
from ..cell import CircuitParameters, TemperatureTables
from ..cell.model import REFERENCE_DEGC, SAME_DEGC, group_near
from ..errors import InputError
from ..global_optimum.proof import Proof
from ..model.axes import Axis
from ..model.descent import LogScales, Solved, polish
from ..model.prepared import PreparedRecord
from ..notices import notice
from ..search.evaluate import Evaluation, evaluate
from ..settings import is_temperature
from .certificate import certify
from .cross_validation import SocErrors
from .dependence import with_asked
from .fit import TableFit, fit_of, pooled_errors
from .objective import Solution, TableObjective
from .problem import box_of, find_best, reduced_objective
from .settings import TableSettings


@dataclass(frozen=True)
class LeftOut:
    """Errors of one temperature, predicted by the tables of the others.

    `errors` are of the prediction, `own` of the tables identified there. `is_between` says whether
    the temperature lies between others: else the nearest one's tables are taken as they are.
    """

    temperature_degc: float
    is_between: bool
    errors: SocErrors
    own: SocErrors


@dataclass(frozen=True)
class Reversal:
    """A node at which a resistance surely falls from one temperature to the next, and surely rises
    elsewhere; `values_ohm` are those at every temperature, from cold to warm."""

    name: str
    soc: float
    values_ohm: tuple[float, ...]


@dataclass(frozen=True)
class OverTemperature:
    """Tables at several temperatures taken together, from cold to warm.

    J is the mean of each temperature's own, by its scored samples; `objective_v` is sqrt(J).
    `separate_v` is what time constants of its own for each temperature would leave, and
    `lower_bound_v` what no shared ones could fall below.
    """

    temperatures_degc: tuple[float, ...]
    objective_v: float
    separate_v: float
    lower_bound_v: float
    left_out: tuple[LeftOut, ...]
    reversals: tuple[Reversal, ...]

    @property
    def proved_gap(self) -> float:
        """The largest share of sqrt(J) that other tables could save."""
        return max(0.0, 1 - self.lower_bound_v / self.objective_v) if self.objective_v else 0.0

    def measured_near(self, temperature_degc: float) -> float | None:
        """The measured temperature within `SAME_DEGC` of one, None without such."""
        nearest = min(self.temperatures_degc, key=lambda degc: abs(degc - temperature_degc))
        return nearest if abs(nearest - temperature_degc) <= SAME_DEGC else None

    def like(self, temperature_degc: float) -> tuple[LeftOut, ...]:
        """The temperatures left out that were predicted as this one is: from both sides, or from
        one; all of them where none was."""
        ends = self.temperatures_degc[0], self.temperatures_degc[-1]
        is_between = ends[0] < temperature_degc < ends[1]
        alike = tuple(left for left in self.left_out if left.is_between == is_between)
        return alike or self.left_out


@dataclass(frozen=True)
class TableFits:
    """Tables over SOC: of one temperature, or from cold to warm of several; a constant circuit as
    one table of one node.

    Those of several have the same time constants; what is proved of each is against time constants
    of its own. `over_temperature` is None for one.
    """

    fits: tuple[TableFit, ...]
    over_temperature: OverTemperature | None = None

    def __iter__(self) -> Iterator[TableFit]:
        return iter(self.fits)

    @property
    def over(self) -> Literal["ocv", "soc", "soc,temperature"] | None:
        """What the tables are over, of "ocv" the OCV alone; None of a constant circuit."""
        if self.over_temperature is not None:
            return "soc,temperature"
        if self.reference.tables.is_constant:
            return None
        return "soc" if self.reference.is_over_soc else "ocv"

    @property
    def reference(self) -> TableFit:
        """The fit of `reference_degc`."""
        if self.over_temperature is None or self.reference_degc is None:
            return self.fits[0]
        return self.fits[self.over_temperature.temperatures_degc.index(self.reference_degc)]

    @property
    def reference_degc(self) -> float | None:
        """The temperature nearest to `REFERENCE_DEGC`, None where there is one only."""
        if self.over_temperature is None:
            return None
        return min(
            self.over_temperature.temperatures_degc, key=lambda degc: abs(degc - REFERENCE_DEGC)
        )

    @property
    def by_degc(self) -> list[tuple[float | None, TableFit]]:
        """Every temperature with its tables; None stands for that of the only ones."""
        over = self.over_temperature
        return [*zip((None,) if over is None else over.temperatures_degc, self.fits, strict=True)]

    @cached_property
    def tables(self) -> TemperatureTables | None:
        """The tables over temperature, None where they are of one."""
        if self.over_temperature is None:
            return None
        degc = self.over_temperature.temperatures_degc
        return TemperatureTables(degc, tuple(fit.tables for fit in self.fits))

    def at(self, temperature_degc: float) -> CircuitParameters:
        """The tables at a temperature: the measured ones within `SAME_DEGC`, else what lies
        between; the only ones where they are of one temperature."""
        if self.over_temperature is None or self.tables is None:
            return self.fits[0].tables
        near = self.over_temperature.measured_near(temperature_degc)
        return self.tables.at(temperature_degc if near is None else near)

    def evaluate(self, prepared: PreparedRecord) -> Evaluation:
        """The tables at a record's temperature, simulated on it."""
        return evaluate(prepared, self.of(prepared))

    def of(self, prepared: PreparedRecord) -> CircuitParameters:
        """The tables at a record's temperature. Raises `InputError` where that is needed and not
        known."""
        if self.over_temperature is None:
            return self.fits[0].tables
        return self.at(require_temperature(prepared))


@dataclass(frozen=True, eq=False)
class _JointSolution(Solved):
    """The best tables of every temperature at some scales."""

    parts: tuple[Solution, ...]


@dataclass(frozen=True, eq=False)
class _Joint:
    """The mean of some objectives in one box."""

    objectives: tuple[TableObjective, ...]

    @cached_property
    def weights(self) -> Float[np.ndarray, "temperatures"]:
        scored = np.array([objective.reduced.scored for objective in self.objectives], float)
        return scored / scored.sum()

    def parts_at(self, found: _JointSolution) -> list[tuple[float, TableObjective, Solution]]:
        return list(zip(self.weights.tolist(), self.objectives, found.parts, strict=True))

    @property
    def settings(self) -> TableSettings:
        return self.objectives[0].settings

    @property
    def axes(self) -> tuple[Axis, ...]:
        return self.objectives[0].axes

    @property
    def interchangeable(self) -> int:
        return self.objectives[0].interchangeable

    def solve(self, log_scales: LogScales, sides=None, exact: bool = False) -> _JointSolution:
        sides = sides or [None] * len(self.objectives)
        parts = tuple(
            objective.solve(log_scales, own, exact)
            for objective, own in zip(self.objectives, sides, strict=True)
        )
        objective_v2 = float(self.weights @ [part.objective_v2 for part in parts])
        sides = tuple(part.sides for part in parts)
        return _JointSolution(log_scales, sides, objective_v2, parts)

    def least_v2(self, log_scales: Float[np.ndarray, "axes points"]) -> Float[np.ndarray, "points"]:
        return self.weights @ [objective.least_v2(log_scales) for objective in self.objectives]

    def slope(self, found: _JointSolution) -> Float[np.ndarray, "axes"]:
        pairs = zip(self.objectives, found.parts, strict=True)
        return self.weights @ [objective.slope(part) for objective, part in pairs]

    def root(self, squares: Sequence[float]) -> float:
        """The root of what the temperatures' mean squares come to."""
        return math.sqrt(float(self.weights @ squares))


def _as_fitted(objective: TableObjective, best: Solution) -> Sequence[PreparedRecord]:
    del best
    return objective.prepared_records


def fit_temperatures(
    by_degc: Mapping[float, Sequence[PreparedRecord]],
    settings: TableSettings | None = None,
    at_home: Callable[[TableObjective, Solution], Sequence[PreparedRecord]] = _as_fitted,
) -> TableFits:
    """The tables over SOC that fit the records of each temperature best, with time constants (and
    gamma) that are the same at all of them. `by_degc` are the records by temperature in degC;
    `at_home` gives those of an objective with the OCV of its solution, from cold to warm.

    Raises `InputError` for fewer than two temperatures, and as `fit_tables` does.
    """
    settings = settings or TableSettings()
    require_temperatures(by_degc)
    degc = tuple(sorted(by_degc))
    ranges = box_of([prepared for own in degc for prepared in by_degc[own]], settings)
    joint = _Joint(tuple(reduced_objective(by_degc[own], settings, ranges) for own in degc))
    with one_blas_thread():
        best = find_best(joint)
        given = zip(joint.objectives, best.parts, strict=True)
        following = tuple(with_asked(objective, part)[0] for objective, part in given)
        if following != joint.objectives:
            joint = _Joint(following)
            best = find_best(joint)
        proofs = [
            certify(objective, polish(objective, part))
            for objective, part in zip(joint.objectives, best.parts, strict=True)
        ]
        lower_bound_v, best = _prove_together(joint, best, proofs)
        homes = [at_home(objective, part) for _, objective, part in joint.parts_at(best)]
        left_out = _left_out(joint, best, degc, homes)
    fits = tuple(
        fit_of(objective, Proof(min(proof.lower_bound_v, part.rms_v), proof.boxes, part), home)
        for objective, proof, part, home in zip(
            joint.objectives, proofs, best.parts, homes, strict=True
        )
    )
    over_temperature = OverTemperature(
        temperatures_degc=degc,
        objective_v=best.rms_v,
        separate_v=joint.root([proof.best.objective_v2 for proof in proofs]),
        lower_bound_v=lower_bound_v,
        left_out=left_out,
        reversals=_reversals(fits),
    )
    return TableFits(fits, over_temperature)


def group_by_temperature(
    prepared_records: Sequence[PreparedRecord],
) -> dict[float, list[PreparedRecord]]:
    """Records by temperature in degC, those within `SAME_DEGC` of each other together, at the mean
    of theirs. Raises `InputError` where a record's temperature is not known."""
    return group_near((require_temperature(prepared), prepared) for prepared in prepared_records)


def require_temperatures(by_degc: Mapping[float, Sequence[PreparedRecord]]) -> None:
    """Raise `InputError` for fewer than two temperatures."""
    if len(by_degc) < 2:
        raise InputError(
            "tables over temperature need records of at least two temperatures, more than "
            f"{SAME_DEGC:g} degC apart, but these are all at {min(by_degc):.3g} degC; give them "
            "with `temperature`, or use `over` 'soc'"
        )


def require_temperature(prepared: PreparedRecord) -> float:
    """A record's temperature in degC. Raises `InputError` where it is not known, or no cell's."""
    degc, name = prepared.temperature_degc, prepared.record.name
    if degc is None:
        raise notice("temperature.unknown", name).error()
    if not is_temperature(degc):
        raise InputError(
            f"{name}: no cell is measured at {degc:.4g} degC; give it with `temperature`, or "
            "rename a column in kelvin to 'Temperature / K'"
        )
    return degc


def _prove_together(
    joint: _Joint, best: _JointSolution, proofs: Sequence[Proof]
) -> tuple[float, _JointSolution]:
    """A lower bound in V for shared time constants, and the best ones met.

    What is proved of each temperature alone may be enough, unless sharing costs more than that.
    """
    settings = joint.settings
    alone_v = joint.root([proof.lower_bound_v**2 for proof in proofs])
    if not settings.max_boxes or alone_v >= (1 - settings.proved_share) * best.rms_v:
        return min(alone_v, best.rms_v), best
    together = certify(joint, best, [proof.lower_bound_v for proof in proofs])
    best_v = together.best.rms_v
    return min(max(alone_v, together.lower_bound_v), best_v), together.best


def _left_out(
    joint: _Joint,
    best: _JointSolution,
    degc: Sequence[float],
    homes: Sequence[Sequence[PreparedRecord]],
) -> tuple[LeftOut, ...]:
    """Every temperature predicted by the others, whose time constants are searched anew."""
    found = []
    for left, objective in enumerate(joint.objectives):
        others = _Joint(joint.objectives[:left] + joint.objectives[left + 1 :])
        anew = polish(others, others.solve(best.log_scales))
        tables = TemperatureTables(
            (*degc[:left], *degc[left + 1 :]),
            tuple(
                objective.tables_at(part)
                for objective, part in zip(others.objectives, anew.parts, strict=True)
            ),
        )
        own, of_own = homes[left], objective.tables_at(best.parts[left])
        found.append(
            LeftOut(
                temperature_degc=degc[left],
                is_between=0 < left < len(degc) - 1,
                errors=pooled_errors(own, tables.at(degc[left])),
                own=pooled_errors(own, of_own),
            )
        )
    return tuple(found)


def _reversals(fits: Sequence[TableFit]) -> tuple[Reversal, ...]:
    """The nodes at which intervals of neighboring temperatures lie apart in both directions."""
    found = []
    for name in (table for table in fits[0].tables.tables if table.endswith("[Ohm]")):
        for soc in fits[0].tables.nodes:
            nodes = [
                node for fit in fits for node in fit.of_table(name)
                if node.soc == soc and node.low is not None and node.high is not None
            ]  # fmt: skip
            steps = list(itertools.pairwise(nodes))
            falls = any((two.high or 0.0) < (one.low or 0.0) for one, two in steps)
            rises = any((two.low or 0.0) > (one.high or 0.0) for one, two in steps)
            if falls and rises:
                found.append(Reversal(name, soc, tuple(node.value for node in nodes)))
    return tuple(found)
