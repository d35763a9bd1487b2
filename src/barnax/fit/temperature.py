"""Tables over SOC at several temperatures, fitted together with shared time constants.

Time constants and gamma are searched once for all temperatures; for every candidate, the tables at
each temperature are the exact optimum of a bounded least-squares problem of their own.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ..cell import TemperatureTables
from ..cell.model import SAME_DEGC, group_near
from ..errors import InputError
from ..execution import in_float64
from ..global_optimum.proof import Proof
from ..model.descent import Axis, LogScales, Solved, polish
from ..model.prepared import PreparedRecord
from .certificate import certify
from .dependence import with_requested_dependence
from .objective import Solution, TableObjective
from .settings import TableSettings
from .table_fit import TableFit, assemble_fit, pooled_errors
from .table_problem import find_best, reduced_objective, search_ranges
from .temperature_fits import LeftOut, OverTemperature, Reversal, TableFits, require_temperature


@dataclass(frozen=True, eq=False)
class _JointSolution(Solved):
    """The best tables at every temperature for some scales."""

    parts: tuple[Solution, ...]


@dataclass(frozen=True, eq=False)
class _Joint:
    """The mean of several objectives in one box."""

    objectives: tuple[TableObjective, ...]

    @cached_property
    def weights(self) -> Float[np.ndarray, "temperatures"]:
        scored = np.array([objective.reduced.scored for objective in self.objectives], float)
        return scored / scored.sum()

    def parts_at(self, best: _JointSolution) -> list[tuple[float, TableObjective, Solution]]:
        return list(zip(self.weights.tolist(), self.objectives, best.parts, strict=True))

    @property
    def settings(self) -> TableSettings:
        return self.objectives[0].settings

    @property
    def axes(self) -> tuple[Axis, ...]:
        return self.objectives[0].axes

    @property
    def interchangeable(self) -> int:
        return self.objectives[0].interchangeable

    def solve(self, log_scales: LogScales, active_set=None, exact: bool = False) -> _JointSolution:
        active_sets = active_set or [None] * len(self.objectives)
        parts = tuple(
            objective.solve(log_scales, active, exact)
            for objective, active in zip(self.objectives, active_sets, strict=True)
        )
        objective_v2 = float(self.weights @ [part.objective_v2 for part in parts])
        active_sets = tuple(part.active_set for part in parts)
        return _JointSolution(log_scales, active_sets, objective_v2, parts)

    def least_v2(self, log_scales: Float[np.ndarray, "axes points"]) -> Float[np.ndarray, "points"]:
        return self.weights @ [objective.least_v2(log_scales) for objective in self.objectives]

    def slope(self, best: _JointSolution) -> Float[np.ndarray, "axes"]:
        pairs = zip(self.objectives, best.parts, strict=True)
        return self.weights @ [objective.slope(part) for objective, part in pairs]

    def root(self, squares: Sequence[float]) -> float:
        """The root of the weighted mean of the temperatures' mean squares."""
        return math.sqrt(float(self.weights @ squares))


@in_float64
def fit_temperatures(
    by_degc: Mapping[float, Sequence[PreparedRecord]],
    settings: TableSettings | None = None,
    records_with_ocv: Callable[[TableObjective, Solution], Sequence[PreparedRecord]] | None = None,
) -> TableFits:
    """The tables over SOC that fit the records at each temperature best, with shared time constants
    (and gamma). `by_degc` are the records by temperature in degC; `records_with_ocv` gives the
    records of an objective with the OCV of its solution, from cold to warm.

    Raises `InputError` for fewer than two temperatures, and as `fit_tables` does.
    """
    settings = settings or TableSettings()
    require_temperatures(by_degc)
    degc = tuple(sorted(by_degc))
    ranges = search_ranges([prepared for at in degc for prepared in by_degc[at]], settings)
    joint = _Joint(tuple(reduced_objective(by_degc[at], settings, ranges) for at in degc))
    best = find_best(joint)
    given = zip(joint.objectives, best.parts, strict=True)
    following = tuple(with_requested_dependence(objective, part)[0] for objective, part in given)
    if following != joint.objectives:
        joint = _Joint(following)
        best = find_best(joint)
    proofs = [
        certify(objective, polish(objective, part))
        for objective, part in zip(joint.objectives, best.parts, strict=True)
    ]
    lower_bound_v, best = _prove_together(joint, best, proofs)
    evaluation_records = [
        records_with_ocv(objective, part) if records_with_ocv else objective.prepared_records
        for _, objective, part in joint.parts_at(best)
    ]
    left_out = _left_out(joint, best, degc, evaluation_records)
    fits = tuple(
        assemble_fit(
            objective, Proof(min(proof.lower_bound_v, part.rms_v), proof.boxes, part), home
        )
        for objective, proof, part, home in zip(
            joint.objectives, proofs, best.parts, evaluation_records, strict=True
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
    return TableFits(fits, over_temperature, settings)


def group_by_temperature(
    prepared_records: Sequence[PreparedRecord],
) -> dict[float, list[PreparedRecord]]:
    """Records by temperature in degC, those within `SAME_DEGC` of each other together, at their
    mean. Raises `InputError` if a record's temperature is missing."""
    return group_near((require_temperature(prepared), prepared) for prepared in prepared_records)


def require_temperatures(by_degc: Mapping[float, Sequence[PreparedRecord]]) -> None:
    """Raise `InputError` for fewer than two temperatures."""
    if len(by_degc) < 2:
        raise InputError(
            "tables over temperature need records of at least two temperatures, more than "
            f"{SAME_DEGC:g} degC apart, but these are all at {min(by_degc):.3g} degC; give them "
            "with `temperature`, or use `over` 'soc'"
        )


def _prove_together(
    joint: _Joint, best: _JointSolution, proofs: Sequence[Proof]
) -> tuple[float, _JointSolution]:
    """A lower bound in V for shared time constants, and the best tables met on the way.

    The proofs for each temperature alone may suffice, unless sharing costs more than that.
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
    evaluation_records: Sequence[Sequence[PreparedRecord]],
) -> tuple[LeftOut, ...]:
    """Every temperature predicted from the others, whose time constants are searched again."""
    left_out = []
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
        records, identified = evaluation_records[left], objective.tables_at(best.parts[left])
        left_out.append(
            LeftOut(
                temperature_degc=degc[left],
                is_between=0 < left < len(degc) - 1,
                errors=pooled_errors(records, tables.at(degc[left])),
                identified=pooled_errors(records, identified),
            )
        )
    return tuple(left_out)


def _reversals(fits: Sequence[TableFit]) -> tuple[Reversal, ...]:
    """The nodes at which intervals of neighboring temperatures are disjoint in both directions."""
    reversals = []
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
                reversals.append(Reversal(name, soc, tuple(node.value for node in nodes)))
    return tuple(reversals)
