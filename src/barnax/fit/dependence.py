"""Resistances that depend on the cell's temperature, its self-heating, the current or its
direction.

The numbers of a `Dependence` have no grid as time constants have. One Gauss-Newton step from zero
estimates what each could gain; further steps are in the logarithms of the numbers and of all time
constants, with the best tables at each.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from ..cell import Dependence
from ..cell.dependence import BETA, CHARGE, KAPPA, ONSET, Usual, arrhenius_beta, heat_of
from ..errors import InputError
from ..execution import in_float64
from ..model.box_least_squares import least_in_box
from ..model.descent import LogScales
from ..model.prepared import PreparedRecord
from ..model.reference import errors_along
from .intervals import jacobian_blocks, with_penalty
from .objective import Solution, TableObjective
from .table_problem import find_best, reduced_objective

# Temperatures that vary by less than this determine no dependence on them.
LEAST_SPREAD_K = 1.0
# A first step has to promise more than this share of sqrt(J). A hysteresis that the records hardly
# excite looks like resistances that differ slightly with the direction.
PROMISING = {"temperature": 0.01, "heating": 0.01, "current": 0.01, "direction": 0.3}
# Self-heating is tried with these time constants, and this exponent at its largest.
HEATING_TAUS_S, TRIED_EXPONENT = (300.0, 1000.0, 3000.0), 0.3
# Ratio of resistances on charge to those on discharge that is tried, and its inverse.
TRIED_RATIO = 1.2
# The least share of the charge in either direction for records to distinguish the two.
LEAST_SHARE = 0.01
# Limits of the first step, in multiples of the trial: it extrapolates a straight line.
FEWEST, MOST = 0.05, 4.0
# Maximum number of steps, the gain as a share of J that ends them, the largest move of a logarithm
# in one step, and the part of a step that is tried again after one uphill.
ROUNDS, SETTLED, FURTHEST, BACK = 6, 1e-3, 1.0, 0.3
# Long records are thinned to about this many samples per step.
ENOUGH = 20_000


def laws_for(prepared_records: Sequence[PreparedRecord]) -> tuple[str, ...]:
    """The resistance laws beyond SOC that the records can determine.

    Within one record a cell gets warmer and emptier together, so its self-heating needs several
    records, and so does the current if no temperature is measured. With an OCV test a switched
    hysteresis looks like resistances that differ with the direction.
    """
    is_measured = _spread_k(prepared_records) >= LEAST_SPREAD_K
    kinds = ("temperature", "current") if is_measured else ("heating", "current")
    kinds = kinds if is_measured or len(prepared_records) > 1 else ()
    return (*kinds, "direction") if prepared_records[0].cell.ocv_is_fitted else kinds


def with_requested_dependence(
    objective: TableObjective, best: Solution
) -> tuple[TableObjective, Solution]:
    """The objective and solution with the laws that `resistances_follow` names."""
    asked = objective.settings.resistances_follow
    for what in asked.split(",") if asked not in ("auto", "none") else ():
        if (proposed := propose(objective, best, what, is_asked=True)) is not None:
            records = [record.with_dependence(proposed[0]) for record in objective.prepared_records]
            objective = reduced_objective(records, objective.settings, objective.ranges)
            best = find_best(objective)
    return objective, best


@in_float64
def propose(
    objective: TableObjective, best: Solution, what: str, is_asked: bool = False
) -> tuple[Dependence, LogScales] | None:
    """A further dependence of resistances, from the best tables without it, and the logarithms of
    the time constants with it.

    `what` is "temperature" if it was measured, "heating", "current" or "direction". None if a first
    step promises too little, unless the dependence is asked for.

    Raises `InputError` if a temperature dependence is asked for and no temperature was measured.
    """
    records = objective.prepared_records
    law = records[0].dependence
    trials = [_joined(law, trial) for trial in _trials(records, what, is_asked)]
    if not trials:
        return None
    normal = _Normal.of(objective, best, trials)
    at, scales = normal.solved(best.log_scales, best.active_set), len(best.log_scales)
    others = [*range(scales + len(objective.numbers))]
    _, without = normal.step(at, others)
    promised = []
    for index, trial in enumerate(trials):
        step, gain = normal.step(at, [*others, len(others) + index])
        if is_asked or (step[-1] > 0 and gain - without > 2 * PROMISING[what] * at.objective_v2):
            promised.append((gain - without, float(step[-1]), trial))
    if not promised:
        return None
    _, share, tried = max(promised, key=lambda promise: promise[0])
    return refine_dependence(objective, at, _scaled(tried, min(max(share, FEWEST), MOST), what))


def _trials(records: Sequence[PreparedRecord], what: str, is_asked: bool) -> list[Dependence]:
    """Dependences of moderate strength to try."""
    if what == "current":
        largest_a = max(float(np.max(np.abs(prepared.current_a))) for prepared in records)
        return [Dependence(onset_a=largest_a)]
    if what == "direction":
        flows_both_ways = _least_share(records) >= LEAST_SHARE
        if is_asked and not flows_both_ways:
            raise InputError(
                f"{records[0].record.name}: hardly a current flows in one of the directions, which "
                "tells no difference between them; leave 'direction' out of `resistances_follow`"
            )
        ratios = (TRIED_RATIO, 1 / TRIED_RATIO) if flows_both_ways else ()
        return [Dependence(charge_ratio=ratio) for ratio in ratios]
    if what == "heating":
        trials = []
        for tau_s in HEATING_TAUS_S:
            heats_a2 = [
                heat_of(one.record.time_s, one.record.interval_current_a, tau_s)[one.span]
                for one in records
            ]
            heat_a2 = np.concatenate(heats_a2)
            kappa_per_a2 = TRIED_EXPONENT / max(float(np.max(heat_a2)), 1e-12)
            of_heat = {"heating_tau_s": tau_s, "reference_a2": float(np.mean(heat_a2))}
            trials.append(Dependence(kappa_per_a2=kappa_per_a2, **of_heat))
        return trials
    for prepared in records if is_asked else ():
        if prepared.measured_degc is None:
            raise InputError(
                f"{prepared.record.name}: has no column of temperatures that resistances could "
                "follow; name it 'Temperature [degC]', or use `resistances_follow` 'heating'"
            )
    if not is_asked and _spread_k(records) < LEAST_SPREAD_K:
        return []
    # Includes the temperature of the tables if they are for several temperatures.
    degc = [one.temperature_degc for one in records if one.temperature_degc is not None]
    middle_degc = float(np.mean(degc))
    return [Dependence(beta_per_k=arrhenius_beta(middle_degc), reference_degc=middle_degc)]


def _least_share(records: Sequence[PreparedRecord]) -> float:
    """The share of the charge moved in the direction with the smaller share."""
    held_a = np.concatenate([prepared.held_a for prepared in records])
    charged = -float(np.sum(held_a[held_a < 0])) / max(float(np.sum(np.abs(held_a))), 1e-300)
    return min(charged, 1 - charged)


def _spread_k(records: Sequence[PreparedRecord]) -> float:
    """The largest range of the measured temperature within a record in K; zero if a record has
    none."""
    measured = [one.measured_degc for one in records if one.measured_degc is not None]
    return max(float(np.ptp(degc)) for degc in measured) if len(measured) == len(records) else 0.0


def _joined(law: Dependence | None, other: Dependence) -> Dependence:
    """The combination of both dependences."""
    if law is None:
        return other
    reference_degc = law.reference_degc if BETA in law.numbers else other.reference_degc
    reference_a2 = law.reference_a2 or other.reference_a2
    joined = other.with_numbers(law.numbers)
    return replace(joined, reference_degc=reference_degc, reference_a2=reference_a2)


def _scaled(tried: Dependence, share: float, what: str) -> Dependence:
    """The trial scaled to `share` times its strength."""
    name = {"temperature": BETA, "heating": KAPPA, "current": ONSET, "direction": CHARGE}[what]
    number = tried.numbers[name]
    if what == "direction":
        return tried.with_numbers({name: number**share})
    times = share**-0.5 if name == ONSET else share
    return tried.with_numbers({name: times * number})


def refine_dependence(
    objective: TableObjective, start: Solution, first: Dependence
) -> tuple[Dependence, LogScales]:
    """The dependence at which Gauss-Newton steps end, in its numbers and all time constants, and
    the logarithms of these."""
    axes, names = objective.axes, list(first.numbers)
    count, open_ended = len(axes), [np.inf] * len(names)
    low = np.array([*(axis.low for axis in axes), *np.negative(open_ended)])
    high = np.array([*(axis.high for axis in axes), *open_ended])
    scales = np.array([*start.log_scales, *map(math.log, first.numbers.values())])
    priors = [first.usual.get(name, Usual(0.0, 1.0, 0.0)) for name in names]
    pull = np.array([*[0.0] * count, *(number.pull for number in priors)])
    usual = np.array([*start.log_scales, *(number.logarithm for number in priors)])
    best, best_v2, solution, step = first, math.inf, start, np.zeros(len(scales))
    for _ in range(ROUNDS):
        tried = np.clip(scales + step, low, high)
        numbers = dict(zip(names, np.exp(tried[count:]).tolist(), strict=True))
        law = first.with_numbers(numbers)
        # The factors do not contain the dependence yet.
        records = [prepared.with_dependence(law) for prepared in objective.prepared_records]
        here = replace(objective, prepared_records=records)
        log_scales = tuple(tried[:count].tolist())
        normal = _Normal.of(here, replace(solution, log_scales=log_scales))
        now = normal.solved(log_scales, solution.active_set)
        now_v2 = now.objective_v2 * math.exp(float(pull @ (tried - usual) ** 2))
        if now_v2 >= best_v2:
            step = BACK * step
            continue
        is_settled = best_v2 - now_v2 < SETTLED * now_v2
        best, best_v2, solution, scales = law, now_v2, now, tried
        pull_v2 = now.objective_v2 * pull
        step, gain = normal.step(now, range(len(scales)), pull_v2, pull_v2 * (scales - usual))
        step = np.clip(step, -FURTHEST, FURTHEST)
        if is_settled or gain < SETTLED * now_v2:
            break
    return best, solution.log_scales


@dataclass(frozen=True, eq=False)
class _Normal:
    """Mean products of an objective's columns of tables, of slopes, and of the base error.

    The slopes are with respect to all scales and a dependence's numbers, then the differences made
    by trials.
    """

    objective: TableObjective
    products: Float[np.ndarray, "columns columns"]

    @classmethod
    def of(
        cls, objective: TableObjective, solution: Solution, trials: Sequence[Dependence] = ()
    ) -> "_Normal":
        products, samples = np.zeros(()), 0
        every = 1 + objective.reduced.scored // ENOUGH
        tables = objective.tables_at(solution)

        def differences(index: int) -> Float[np.ndarray, "scored trials"]:
            prepared = objective.prepared_records[index]
            without_v = errors_along(prepared, tables)
            moved = [
                errors_along(prepared, replace(tables, dependence=trial)) - without_v
                for trial in trials
            ]
            return np.stack(moved, axis=1)[prepared.scored]

        further = differences if trials else None
        for columns, base, _ in jacobian_blocks(objective, solution, further=further, every=every):
            rows = np.column_stack([columns, base])
            products = products + rows.T @ rows
            samples += len(rows)
        return cls(objective, products / samples)

    def solved(self, log_scales: tuple[float, ...], active_set: Int[np.ndarray, "_"]) -> Solution:
        """The best tables at these scales; their errors are not computed."""
        objective, to_tables = self.objective, self.objective.to_tables
        block = slice(len(to_tables))
        normal = to_tables.T @ self.products[block, block] @ to_tables + objective.penalty_normal
        gradient = to_tables.T @ self.products[block, -1]
        x, active_set = least_in_box(normal, gradient, *objective.box, active_set)
        objective_v2 = float(self.products[-1, -1] + x @ (2 * gradient + normal @ x))
        values = objective.values_of(x)
        return Solution(log_scales, active_set, objective_v2, values, x, np.empty(0))

    def step(
        self,
        at: Solution,
        slopes: Sequence[int],
        pull: Float[np.ndarray, "slopes"] | float = 0.0,
        pulled: Float[np.ndarray, "slopes"] | float = 0.0,
    ) -> tuple[Float[np.ndarray, "slopes"], float]:
        """The best step along some slopes, with all tables readjusted within their bounds, and the
        reduction of J that it promises. `pull` is half the curvature of any term added to J, and
        `pulled` half its slope."""
        directions = self.objective.free_directions(at)
        count, free = directions.shape
        chosen = np.zeros((len(self.products) - 1, free + len(slopes)))
        chosen[:count, :free] = directions
        chosen[count + np.array(slopes, int), free + np.arange(len(slopes))] = 1.0
        values = np.concatenate(at.values)
        stiff = with_penalty(self.objective, self.products[:-1, :-1], np.eye(len(chosen)))
        error = stiff[:, :count] @ values + self.products[:-1, -1]
        normal, slope = chosen.T @ stiff @ chosen, chosen.T @ error
        normal[np.arange(free, len(normal)), np.arange(free, len(normal))] += pull
        slope[free:] += pulled
        scale = np.sqrt(np.diag(normal))
        scale = np.where(scale > 0, scale, 1.0)
        moved = np.linalg.lstsq(normal / np.outer(scale, scale), -slope / scale, 1e-12)[0] / scale
        return moved[free:], float(-slope @ moved)
