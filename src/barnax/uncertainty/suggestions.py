"""What would lower the error first: changes of the model, each tried by a fit, ranked."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import lsq_linear, minimize_scalar

from ..cell import CircuitParameters
from ..cell.parameters import MOST_PAIRS
from ..errors import InputError
from ..execution import in_float64
from ..model.inputs import prepare_record
from ..model.problem import Problem, rc_parameters
from ..model.search_space import PAIRS, RATE, RATE_RANGE, RESISTANCES, Bounds
from ..model.simulate import SimulationInput, unit_response
from ..search.refine import Descent, Refinement
from .identifiability import joined, with_unit
from .refit import Refit

KNOTS = 6
# Over a narrower range of SOC a table has nothing to tell.
NARROWEST = 0.05


@dataclass(frozen=True, eq=False)
class SocColumns:
    """Voltages over the scored samples that the error is linear in, time constants kept.

    The error is `base_error_v` plus columns times their coefficients: `constant` with the
    resistances R0, R1, ..., `resistances` with their values at every knot (R0's first), `offsets`
    with the OCV's errors at the knots.
    """

    base_error_v: Float[np.ndarray, "scored"]
    constant: Float[np.ndarray, "scored resistances"]
    resistances: Float[np.ndarray, "scored tabulated"]
    offsets: Float[np.ndarray, "scored knots"]
    knots: int


@in_float64
def soc_columns(refinement: Refinement) -> SocColumns | None:
    """The columns for `KNOTS` knots over the scored SOC; None where that hardly changes.

    A resistance between knots is interpolated. In an RC pair it multiplies the current that
    charges it, so the pair's voltage moves to a new resistance with its own time constant.
    """
    problem = refinement.search.problem
    prepared_records = problem.prepared_records
    soc = np.concatenate([prepared.soc[prepared.scored] for prepared in prepared_records])
    knots = np.linspace(soc.min(), soc.max(), KNOTS)
    if knots[-1] - knots[0] < NARROWEST:
        return None
    rc = rc_parameters(refinement.parameters)
    base, constant, tabulated = [], [], []
    for prepared, inputs in zip(prepared_records, problem.all_inputs, strict=True):
        hats = np.stack([np.interp(prepared.soc, knots, row) for row in np.eye(KNOTS)])
        responses = np.asarray(_responses(jnp.stack(rc.tau), jnp.asarray(hats), inputs))
        scored = prepared.scored
        turned = 0.0 if rc.gamma is None else _turned(rc.gamma, inputs)
        base.append((np.asarray(inputs.base_error_v) - turned)[scored])
        constant.append(responses.sum(axis=1)[:, scored].T)
        tabulated.append(responses.reshape(-1, responses.shape[-1])[:, scored].T)
    return SocColumns(
        base_error_v=np.concatenate(base),
        constant=np.concatenate(constant),
        resistances=np.concatenate(tabulated),
        offsets=np.stack([np.interp(soc, knots, row) for row in np.eye(KNOTS)], axis=1),
        knots=KNOTS,
    )


@eqx.filter_jit
def _responses(
    tau: Float[Array, "pairs"], hats: Float[Array, "knots samples"], inputs: SimulationInput
) -> Float[Array, "resistances knots samples"]:
    """The voltage over R0 and every pair of 1 ohm for the current around each knot."""

    def one(tau, hat):
        return unit_response(tau, hat * inputs.held_a, inputs.intervals)

    pairs = jax.vmap(jax.vmap(one, in_axes=(None, 0)), in_axes=(0, None))(tau, hats)
    return jnp.concatenate([(hats * inputs.current_a)[None], pairs])


@eqx.filter_jit
def _turned(gamma: Float[Array, ""], inputs: SimulationInput) -> Float[Array, "samples"]:
    moved = inputs.hysteresis
    if moved is None:
        return jnp.zeros_like(inputs.base_error_v)
    return moved.amplitude_v * unit_response(1 / gamma, moved.hysteresis_input, moved.intervals)


TOLERANCE = 1e-7
STARTS = 8
# How far the initial SOC and the capacity (relative) are tried, and to what accuracy.
SOC_REACH = 0.1
CAPACITY_REACH = 0.15
SEARCHED_TO = 1e-3
# A smaller share of the error than this is nothing.
WORTH_TELLING = 0.01


@dataclass(frozen=True)
class Suggestion:
    """One change that was tried, in words, the error it reaches and how many numbers it adds."""

    name: str
    text: str
    rmse_v: float
    added: int

    def to_dict(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "text": self.text,
            "rmse [V]": self.rmse_v,
            "added": self.added,
        }


def suggestions(refinement: Refinement, *, refit: Refit | None = None) -> tuple[Suggestion, ...]:
    """Changes of the model in the order of the error that each alone leaves, the lowest first.

    Tried are one more RC pair, dynamic hysteresis, another initial SOC, another capacity, and,
    with the time constants kept, resistances and an OCV that are tabulated over SOC. Each is a fit
    of the changed circuit to the same samples; changes that do not apply are left out. A lower
    error here is where to look first, not yet a better model: validate it on another record.
    Where no other initial SOC or capacity fits better, they are left out.
    """
    refit = refit or Refit(refinement.search.problem)
    found = [
        *_one_more_pair(refinement),
        *_dynamic_hysteresis(refinement),
        *_initial_soc(refinement, refit),
        *_capacity(refinement, refit),
        *_over_soc(refinement),
    ]
    return tuple(sorted(found, key=lambda each: each.rmse_v))


def in_words(found: Sequence[Suggestion], before_v: float) -> str:
    """The ranked list in a sentence, what gains nothing apart."""
    gains = [each for each in found if each.rmse_v < (1 - WORTH_TELLING) * before_v]
    others = [each.name for each in found if each not in gains]
    sentences = []
    if gains:
        ranked = [f"{1e3 * each.rmse_v:.4g} mV by {each.text}" for each in gains]
        sentences.append(f"RMSE {1e3 * before_v:.4g} mV would fall to {joined(ranked, 'or')}.")
    if others:
        sentences.append(f"Nothing is gained by {joined(others, 'or')}.")
    return " ".join(sentences) or "Nothing that could lower the error applies here."


def _one_more_pair(refinement: Refinement) -> list[Suggestion]:
    problem, circuit = refinement.search.problem, refinement.parameters
    pairs = problem.bounds.pairs
    if pairs == MOST_PAIRS:
        return []
    capacity_ah, limits = problem.cell.capacity_ah, problem.bounds.tau_limits_s
    fresh = Bounds.default(capacity_ah, 2 * limits[0], limits[1], pairs=pairs + 1)
    ranges = dict(problem.bounds.ranges)
    ranges |= {name: fresh.ranges[name] for name in (RESISTANCES[pairs + 1], PAIRS[pairs][0])}
    wider = replace(problem, bounds=replace(problem.bounds, ranges=ranges, pairs=pairs + 1))
    low, high = ranges[PAIRS[pairs][0]]
    r = float(np.mean(circuit.r)) / 3
    best = _best_of(
        wider,
        [
            replace(circuit, r=(*circuit.r, r), c=(*circuit.c, float(tau) / r))
            for tau in np.geomspace(low, high, STARTS + 2)[1:-1]
        ],
    )
    taus = joined([with_unit("tau [s]", tau) for tau in sorted(best.parameters.tau_s)])
    text = f"{_ordinal(pairs + 1)} RC pair (tau {taus})"
    return [Suggestion("one more pair", text, best.rmse_v, 2)]


def _dynamic_hysteresis(refinement: Refinement) -> list[Suggestion]:
    problem, circuit = refinement.search.problem, refinement.parameters
    if problem.bounds.has_rate or not np.any(problem.cell.hysteresis_v(problem.prepared.soc)):
        return []
    bounds = replace(problem.bounds, ranges=dict(problem.bounds.ranges) | {RATE: RATE_RANGE})
    turned = replace(_with_courses(problem, "esc"), bounds=bounds)
    starts = [replace(circuit, gamma=float(g)) for g in np.geomspace(*RATE_RANGE, STARTS + 2)[1:-1]]
    best = _best_of(turned, starts)
    text = f"dynamic hysteresis (gamma {best.parameters.gamma:.3g})"
    return [Suggestion("dynamic hysteresis", text, best.rmse_v, 1)]


def _initial_soc(refinement: Refinement, refit: Refit) -> list[Suggestion]:
    problem = refinement.search.problem

    def moved(shift: float) -> Problem:
        return _with_courses(problem, problem.circuit, soc_shift=shift)

    found = _best_along(refinement, refit, moved, SOC_REACH)
    if found is None:
        return []
    shift, rmse_v = found
    own = problem.prepared.initial_soc
    text = f"initial SOC {own + shift:.3f} instead of {own:.3f}"
    return [Suggestion("initial SOC", text, rmse_v, 1)]


def _capacity(refinement: Refinement, refit: Refit) -> list[Suggestion]:
    problem = refinement.search.problem
    own_ah = problem.cell.capacity_ah

    def scaled(change: float) -> Problem:
        return _with_courses(problem, problem.circuit, capacity_ah=own_ah * (1 + change))

    found = _best_along(refinement, refit, scaled, CAPACITY_REACH)
    if found is None:
        return []
    change, rmse_v = found
    text = f"capacity {own_ah * (1 + change):.4g} Ah instead of {own_ah:.4g} Ah"
    return [Suggestion("capacity", text, rmse_v, 1)]


def _over_soc(refinement: Refinement) -> list[Suggestion]:
    columns = soc_columns(refinement)
    if columns is None:
        return []
    return [
        Suggestion(
            "resistance over SOC",
            f"resistances over SOC ({columns.knots} knots, time constants kept)",
            _linear_rmse(columns, with_resistances=True),
            columns.resistances.shape[1] - columns.constant.shape[1],
        ),
        Suggestion(
            "OCV over SOC",
            f"another OCV curve ({columns.knots} knots, time constants kept)",
            _linear_rmse(columns, with_resistances=False),
            columns.offsets.shape[1],
        ),
    ]


def _linear_rmse(columns: SocColumns, *, with_resistances: bool) -> float:
    """The RMSE of the best nonnegative resistances, tabulated, or with tabulated offsets."""
    parts = [columns.resistances] if with_resistances else [columns.constant, columns.offsets]
    design = np.concatenate(parts, axis=1)
    lower = np.zeros(design.shape[1])
    if not with_resistances:
        lower[columns.constant.shape[1] :] = -np.inf
    fitted = lsq_linear(design, -columns.base_error_v, (lower, np.inf), method="bvls")
    return float(np.sqrt(2 * fitted.cost / len(columns.base_error_v)))


def _best_of(problem: Problem, starts: Sequence[CircuitParameters]):
    ends = Descent(problem)(starts, TOLERANCE)
    return min(ends, key=lambda each: each.rmse_v)


def _best_along(
    refinement: Refinement, refit: Refit, changed: Callable[[float], Problem], reach: float
) -> tuple[float, float] | None:
    """The change of one number with the lowest refitted error, and that error.

    It is sought with the refits' own hysteresis columns, which hardly depend on it, and the error
    is then that of the changed problem. None where even small changes leave the OCV curve.
    """
    starts = _spread_starts(refinement)
    points = np.stack([refit.encode(start) for start in starts])

    def refitted(change: float) -> float:
        prepared_records = changed(float(change)).prepared_records
        base_v = np.concatenate(
            [(each.voltage_v - each.source_v)[each.scored] for each in prepared_records]
        )
        lanes = np.broadcast_to(refit.voltages.project(base_v[None]), (len(starts), refit.rows))
        return float(np.nanmin(refit(points, base_v=lanes).rmse_v))

    best, lowest_v = 0.0, refinement.rmse_v
    for end in (_furthest(changed, -reach), _furthest(changed, reach)):
        if end != 0:
            found: Any = minimize_scalar(
                refitted,
                bounds=(min(end, 0.0), max(end, 0.0)),
                method="bounded",
                options={"xatol": SEARCHED_TO},
            )
            if found.fun < lowest_v:
                best, lowest_v = float(found.x), float(found.fun)
    if best == 0:
        return None
    exact_v = _best_of(changed(best), starts).rmse_v
    return (best, exact_v) if exact_v < refinement.rmse_v else None


def _furthest(changed: Callable[[float], Problem], end: float) -> float:
    """How far a change can go to one side before the state of charge leaves the OCV curve."""

    def is_possible(change: float) -> bool:
        try:
            changed(change)
        except InputError:
            return False
        return True

    if is_possible(end):
        return end
    inside, outside = 0.0, end
    for _ in range(10):
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if is_possible(middle) else (inside, middle)
    return inside


def _spread_starts(refinement: Refinement) -> list[CircuitParameters]:
    """The refined circuit and others with their time constants all over the box.

    With another SOC the answer may be far from the refined one, which may sit at a bound.
    """
    circuit = refinement.parameters
    low, high = refinement.search.problem.bounds.tau_limits_s
    places = np.arange(1, circuit.pairs + 1) / (circuit.pairs + 1)
    starts = [circuit]
    for span in np.linspace(0.4, 1.2, STARTS - 1):
        taus = low * (high / low) ** (span * places)
        c = tuple(float(tau) / r for tau, r in zip(taus, circuit.r, strict=True))
        starts.append(replace(circuit, c=c))
    return starts


def _with_courses(
    problem: Problem,
    circuit: str,
    *,
    soc_shift: float = 0.0,
    capacity_ah: float | None = None,
) -> Problem:
    """The same problem with its records made ready otherwise. Raises `InputError` where the state
    of charge then leaves the OCV curve."""
    cell = replace(problem.cell, capacity_ah=capacity_ah or problem.cell.capacity_ah)
    prepared_records = tuple(
        prepare_record(
            prepared.record,
            cell,
            circuit,
            replace(
                problem.window,
                initial_soc=prepared.initial_soc + soc_shift,
                rest_current_a=prepared.rest_current_a,
            ),
        )
        for prepared in problem.prepared_records
    )
    return replace(problem, cell=cell, prepared_records=prepared_records)


def _ordinal(number: int) -> str:
    return {2: "second", 3: "third", 4: "fourth"}[number]
