"""Changes of the model that would lower the error, each tried by a fit, ranked."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from scipy.optimize import lsq_linear, minimize_scalar

from ..cell import CircuitParameters
from ..cell.circuits import CIRCUITS, get_circuit
from ..errors import InputError
from ..execution import in_float64
from ..model.axes import axes_of
from ..model.layout import layout_of
from ..model.prepared import prepare_record
from ..model.problem import Problem, rmse_by_scan, with_one_more_pair
from ..model.reduced import reduce_records, scored_alone
from ..model.search_space import RATE, RATE_RANGE
from ..search.refine import Descent
from .batch_fit import Refit

KNOTS = 6
# Over a narrower range of SOC a table has nothing to tell.
NARROWEST = 0.05
TOLERANCE = 1e-7
STARTS = 8
# How far the initial SOC and the capacity (relative) are tried, and to what accuracy.
SOC_REACH = 0.1
CAPACITY_REACH = 0.15
SEARCHED_TO = 1e-3
# Digits of a proposed initial SOC after the point, and significant ones of a capacity. Errors are
# those at the rounded values, so that whoever follows the proposal finds what it promised.
SOC_DECIMALS = 4
CAPACITY_DIGITS = 5

Change = Literal[
    "one more pair",
    "dynamic hysteresis",
    "initial SOC",
    "capacity",
    "resistance over SOC",
    "OCV over SOC",
]


@dataclass(frozen=True)
class Suggestion:
    """One change that was tried, the RMSE it reaches and how many numbers it adds to the model.

    `circuit` is the registered one that has the change, None where none has. Of the other fields
    those are given that the change has: the time constants of all pairs, gamma, the new initial SOC
    or capacity and, as `instead_of`, the present one, or the number of knots over SOC.
    """

    kind: Change
    rmse_v: float
    added: int
    circuit: str | None = None
    tau_s: tuple[float, ...] = ()
    gamma: float | None = None
    initial_soc: float | None = None
    capacity_ah: float | None = None
    instead_of: float | None = None
    knots: int | None = None


def suggestions(
    problem: Problem, parameters: CircuitParameters, *, refit: Refit | None = None
) -> tuple[Suggestion, ...]:
    """Changes of the model in the order of the error that each alone leaves, the lowest first.

    Tried are one more RC pair, dynamic hysteresis, another initial SOC, another capacity of the
    record, and, with the time constants kept, resistances and an OCV that are tabulated over SOC.
    Each is a fit of the changed circuit to the same samples; changes that do not apply are left
    out. A lower error here is where to look first, not yet a better model: validate it on another
    record. Where no other initial SOC or capacity fits better, they are left out.
    """
    refit = refit or Refit(problem)
    (rmse_v,) = rmse_by_scan(problem, [parameters])
    found = [
        *_one_more_pair(problem, parameters),
        *_dynamic_hysteresis(problem, parameters),
        *_start_and_capacity(problem, parameters, rmse_v, refit),
        *_over_soc(problem, parameters),
    ]
    return tuple(sorted(found, key=lambda change: change.rmse_v))


def _one_more_pair(problem: Problem, parameters: CircuitParameters) -> list[Suggestion]:
    wider = with_one_more_pair(problem)
    if wider is None:
        return []
    pairs = problem.bounds.pairs
    low, high = wider.bounds.ranges[wider.bounds.element_names[pairs].tau]
    r = float(np.mean(parameters.r)) / 3
    taus_s = np.geomspace(low, high, STARTS + 2)[1:-1].tolist()
    elements, own = wider.bounds.elements, parameters
    starts = [
        CircuitParameters.of_tau(own.r0, (*own.r, r), (*own.tau_s, tau_s), own.gamma, elements)
        for tau_s in taus_s
    ]
    best = _best_of(wider, starts)
    circuit = get_circuit(problem.circuit)
    wanted = (elements, circuit.source_voltage, circuit.hysteresis_amplitude)
    like = [
        name
        for name, circuit in CIRCUITS.items()
        if (circuit.elements, circuit.source_voltage, circuit.hysteresis_amplitude) == wanted
    ]
    tau_s = tuple(sorted(best.parameters.tau_s))
    circuit = like[0] if like else None
    return [Suggestion("one more pair", best.rmse_v, 2, circuit=circuit, tau_s=tau_s)]


def _dynamic_hysteresis(problem: Problem, parameters: CircuitParameters) -> list[Suggestion]:
    if problem.bounds.has_rate or not np.any(problem.cell.hysteresis_v(problem.prepared.soc)):
        return []
    bounds = replace(problem.bounds, ranges=dict(problem.bounds.ranges) | {RATE: RATE_RANGE})
    changed = replace(_prepared_again(problem, "esc"), bounds=bounds)
    gammas = np.geomspace(*RATE_RANGE, STARTS + 2)[1:-1]
    best = _best_of(changed, [parameters.with_rate(gamma) for gamma in gammas.tolist()])
    circuit = "esc" if get_circuit("esc").elements == problem.bounds.elements else None
    gamma = best.parameters.gamma
    return [Suggestion("dynamic hysteresis", best.rmse_v, 1, circuit=circuit, gamma=gamma)]


def _start_and_capacity(
    problem: Problem, parameters: CircuitParameters, rmse_v: float, refit: Refit
) -> Iterator[Suggestion]:
    """One initial SOC and one capacity for every record; neither where theirs differ."""
    socs = {prepared.start.soc for prepared in problem.prepared_records}
    if len(socs) == 1:
        (own,) = socs

        def started(change: float) -> Problem:
            soc = round(own + change, SOC_DECIMALS)
            return _prepared_again(problem, problem.circuit, initial_soc=soc)

        for best, best_v in _best_along(problem, parameters, rmse_v, refit, started, SOC_REACH):
            soc = best.prepared.start.soc
            yield Suggestion("initial SOC", best_v, 1, initial_soc=soc, instead_of=own)
    capacities_ah = {prepared.capacity_ah for prepared in problem.prepared_records}
    if len(capacities_ah) == 1:
        (own_ah,) = capacities_ah

        def scaled(change: float) -> Problem:
            capacity_ah = float(f"{own_ah * (1 + change):.{CAPACITY_DIGITS}g}")
            return _prepared_again(problem, problem.circuit, capacity_ah=capacity_ah)

        for best, best_v in _best_along(problem, parameters, rmse_v, refit, scaled, CAPACITY_REACH):
            capacity_ah = best.prepared.capacity_ah
            yield Suggestion("capacity", best_v, 1, capacity_ah=capacity_ah, instead_of=own_ah)


@in_float64
def _over_soc(problem: Problem, parameters: CircuitParameters) -> list[Suggestion]:
    """Resistances and OCV tabulated at `KNOTS` knots over the scored SOC, time constants kept.

    The error is then linear in them, as in that of tables. Nothing where the SOC hardly changes.
    """
    prepared_records = problem.prepared_records
    soc = np.concatenate([prepared.soc[prepared.scored] for prepared in prepared_records])
    knots = np.linspace(soc.min(), soc.max(), KNOTS)
    if knots[-1] - knots[0] < NARROWEST:
        return []
    nodes, elements = tuple(knots.tolist()), parameters.elements
    held = {name: (value, value) for name, value in parameters.constants.items()}
    interval_s = min(float(np.min(np.diff(prepared.time_s))) for prepared in prepared_records)
    layout = layout_of(nodes, nodes, held, True, False, elements, interval_s)
    groups = [scored_alone(prepared) for prepared in prepared_records]
    (reduced,) = reduce_records(prepared_records, layout, groups, 1)
    base, tables = reduced.part("base")[0][:, 0], [reduced.part("current")[0]]
    for axis in axes_of(reduced, elements, held):
        if axis.table is None:
            base = base + axis.columns_at(axis.low)[:, 0]
        else:
            tables.append(axis.columns_at(axis.low))
    over_soc = np.concatenate(tables, axis=1)
    constant = np.stack([table.sum(axis=1) for table in tables], axis=1)
    resistance_v = _nonnegative_rmse(base, over_soc)
    ocv_v = _nonnegative_rmse(base, constant, reduced.part("correction")[0])
    more = over_soc.shape[1] - constant.shape[1]
    return [
        Suggestion("resistance over SOC", resistance_v, more, knots=KNOTS),
        Suggestion("OCV over SOC", ocv_v, KNOTS, knots=KNOTS),
    ]


def _nonnegative_rmse(
    base: Float[np.ndarray, "rows"],
    resistances: Float[np.ndarray, "rows resistances"],
    offsets: Float[np.ndarray, "rows knots"] | None = None,
) -> float:
    """The RMSE with the best nonnegative resistances and, where given, the best offsets."""
    lower = np.zeros(resistances.shape[1])
    if offsets is not None:
        lower = np.append(lower, np.full(offsets.shape[1], -np.inf))
        resistances = np.concatenate([resistances, offsets], axis=1)
    fitted = lsq_linear(resistances, -base, (lower, np.inf), method="bvls")
    return float(np.sqrt(2 * fitted.cost))


def _best_of(problem: Problem, starts: Sequence[CircuitParameters]):
    ends = Descent(problem)(starts, TOLERANCE)
    return min(ends, key=lambda end: end.rmse_v)


def _best_along(
    problem: Problem,
    parameters: CircuitParameters,
    own_v: float,
    refit: Refit,
    changed: Callable[[float], Problem],
    reach: float,
) -> list[tuple[Problem, float]]:
    """The problem whose one number is changed to the lowest refitted error, and that error.

    It is sought with the refits' own hysteresis columns, which hardly depend on it, and the error
    is then that of the changed problem. Nothing where no change lowers it.
    """
    starts = _spread_starts(problem, parameters)
    points = np.stack([refit.encode(start) for start in starts])

    def refitted(change: float) -> float:
        prepared_records = changed(float(change)).prepared_records
        base_v = np.concatenate(
            [
                (prepared.voltage_v - prepared.source_v)[prepared.scored]
                for prepared in prepared_records
            ]
        )
        lanes = np.broadcast_to(refit.voltages.project(base_v[None]), (len(starts), refit.rows))
        return float(np.nanmin(refit(points, base_v=lanes).rmse_v))

    best, lowest_v = 0.0, own_v
    for end in (_furthest(changed, -reach), _furthest(changed, reach)):
        if end != 0:
            span, options = (min(end, 0.0), max(end, 0.0)), {"xatol": SEARCHED_TO}
            found: Any = minimize_scalar(refitted, bounds=span, method="bounded", options=options)
            if found.fun < lowest_v:
                best, lowest_v = float(found.x), float(found.fun)
    if best == 0:
        return []
    other = changed(best)
    exact_v = _best_of(other, starts).rmse_v
    return [(other, exact_v)] if exact_v < own_v else []


def _furthest(changed: Callable[[float], Problem], end: float) -> float:
    """The largest change to one side that keeps the state of charge on the OCV curve."""

    def is_possible(change: float) -> bool:
        with suppress(InputError):
            return bool(changed(change))
        return False

    if is_possible(end):
        return end
    inside, outside = 0.0, end
    for _ in range(10):
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if is_possible(middle) else (inside, middle)
    return inside


def _spread_starts(problem: Problem, parameters: CircuitParameters) -> list[CircuitParameters]:
    """The optimum and others with their time constants all over the box.

    With another SOC the answer may be far from the present one, which may sit at a bound.
    """
    low, high = problem.bounds.tau_limits_s
    places = np.arange(1, parameters.pairs + 1) / (parameters.pairs + 1)
    starts, own = [parameters], parameters
    for span in np.linspace(0.4, 1.2, STARTS - 1):
        taus_s = low * (high / low) ** (span * places)
        starts.append(CircuitParameters.of_tau(own.r0, own.r, taus_s, own.gamma, own.elements))
    return starts


def _prepared_again(problem: Problem, circuit: str, **changes: float) -> Problem:
    """The same problem with its records made ready otherwise: `changes` are of their windows.

    Raises `InputError` where the state of charge then leaves the OCV curve."""
    prepared_records = []
    for prepared in problem.prepared_records:
        present: dict[str, Any] = {
            "initial_soc": prepared.start.soc,
            # What is suggested must be what can be given.
            "soc_source": None if "initial_soc" in changes else "registered",
            "rest_current_a": prepared.rest_current_a,
            "capacity_ah": prepared.capacity_ah,
        }
        window = replace(prepared.settled_window, **present | changes)
        prepared_records.append(prepare_record(prepared.record, problem.cell, circuit, window))
    return replace(problem, prepared_records=tuple(prepared_records))
