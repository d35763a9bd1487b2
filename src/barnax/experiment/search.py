"""The shortest test that gives what is wanted: a pattern over the SOC, changed as long as it
improves.

A test goes down the state of charge in stretches. Each has some blocks, a move at constant current
that takes the remaining charge, and a rest; rests share the remaining time. The numbers of each,
the rate of moves, and the density of blocks and rests over the SOC are the pattern. Every change of
it is predicted as a whole test: block by block, rests would look worth little.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import jax
import numpy as np
from jaxtyping import Array, Float

from ..errors import InputError
from ..metrics import NORMAL_95
from .information import OVERSHOT, Normal, Prior, information_of
from .protocol import INTERVAL_S, Block, Limits, Step, move, sampled, voltage_along, warming_of
from .stored import Predicted

# From widths over wanted ones to a number: what a design minimizes; and whether a test reaches them
# all.
Criterion = Callable[[Float[np.ndarray, "wishes"]], float]
Reaches = Callable[[Sequence[Step]], bool]
# Tests are predicted with a sampling interval of this share of the fastest time constant, within
# limits.
SHARE_OF_TAU, FINEST_S, COARSEST_S = 1 / 4, 1.0, 4.0
# Equal parts of the state of charge, and the changes of a pattern: these factors, up to this many
# at once, and limits of the number of stretches.
PARTS, FACTOR, SHARE_FACTOR = 4, 1.35, 1.6
MOST_CHANGES, MANY = 3, 2**30
FEWEST, MOST = 4, 40
# SOC that currents with few digits may miss.
ROUNDED_SOC = 1e-4
# The rest at the start of a test, and the shortest of the others, which are multiples of the last.
SETTLE_S, SHORTEST_REST_S, REST_S = 300.0, 10.0, 2.0
# The longest test, and the factor for a longer one if none reaches what is wanted.
MOST_HOURS, LONGER = 200.0, 2
BISECTIONS, ADJUSTMENTS, SEARCHES = 6, 8, 3
# Tests predicted in a search, and in one for a shorter test, and the patterns at their start.
PREDICTIONS, FURTHER, STRETCHES, MOVE_C = 120, 60, (10, 18), 1.0
# A test is not shortened by less than this share.
NEARLY_SHORTEST, ROUNDED = 0.03, 1.001
# Shares of a longer test's pieces with which a shorter one is tried, and the ratio to the wanted
# widths that ends a search.
FEWER, WELL_REACHED = (0.6, 0.3), 0.97
# First assumed excursion of a piece from its stretch in SOC, and the factor by which currents that
# warm too much are lowered beyond a square law.
LEAST_BEYOND, LESS_WARM = 0.01, 0.95


def worst_first(ratios: Float[np.ndarray, "wishes"]) -> float:
    """The mean of the fourth powers: dominated by the widest, but sensitive to the others.

    >>> worst_first(np.array([1.0, 1.0])), worst_first(np.array([2.0, 0.0]))
    (1.0, 8.0)
    """
    return float(np.mean(ratios**4))


@dataclass(frozen=True)
class Pattern:
    """The makeup of a test: stretches, the rate of moves, the number of blocks of each kind, and
    the weights of equal parts of the state of charge, from full to empty."""

    stretches: int
    move_c: float
    counts: tuple[int, ...]
    weights: tuple[float, ...] = (1.0,) * PARTS

    @cached_property
    def density(self) -> Float[np.ndarray, "stretches"]:
        """Each stretch's share of blocks and rests."""
        middle = (np.arange(self.stretches) + 0.5) / self.stretches * PARTS
        weight = np.interp(middle, np.arange(PARTS) + 0.5, self.weights)
        return weight / weight.sum()

    def dealt(self) -> list[list[int]]:
        """The indices of the blocks in every stretch: each kind evenly, by the density."""
        upper = np.cumsum(self.density)
        dealt: list[list[int]] = [[] for _ in range(self.stretches)]
        for block, count in enumerate(self.counts):
            at = (np.arange(count) + 0.5) / max(count, 1)
            for stretch in np.searchsorted(upper, at).tolist():
                dealt[min(stretch, self.stretches - 1)].append(block)
        return dealt

    def fewer(self, share: float) -> "Pattern":
        """The pattern with this share of every kind of block."""
        return replace(self, counts=tuple(math.floor(share * count) for count in self.counts))

    def drawn(self, key: Array) -> "Pattern":
        """The pattern with one to three random changes."""
        count, *numbers = np.asarray(jax.random.randint(key, (MOST_CHANGES + 1,), 0, MANY)).tolist()
        pattern, changes = self, 2 * (2 + len(self.counts) + PARTS)
        for number in numbers[: 1 + count % MOST_CHANGES]:
            pattern = pattern.changed(number % changes) or pattern
        return pattern

    def changed(self, number: int) -> "Pattern | None":
        """The pattern with one element more or less; None if it cannot have less."""
        choice, is_less = divmod(number, 2)
        some = max(1, self.stretches // 2) * (-1 if is_less else 1)
        if choice == 0:
            stretches = round(self.stretches / FACTOR if is_less else self.stretches * FACTOR)
            counts = tuple(round(count * stretches / self.stretches) for count in self.counts)
            is_usual = FEWEST <= stretches <= MOST
            return replace(self, stretches=stretches, counts=counts) if is_usual else None
        if choice == 1:
            return replace(self, move_c=self.move_c / FACTOR if is_less else self.move_c * FACTOR)
        kind = choice - 2
        if kind < PARTS:
            weights = [*self.weights]
            weights[kind] *= 1 / SHARE_FACTOR if is_less else SHARE_FACTOR
            return replace(self, weights=tuple(weights))
        counts = [*self.counts]
        if is_less and not counts[kind - PARTS]:
            return None
        counts[kind - PARTS] = max(counts[kind - PARTS] + some, 0)
        return replace(self, counts=tuple(counts))


@dataclass(frozen=True, eq=False)
class Trial:
    """A pattern, the logarithm of its criterion, and its largest ratio of width to wanted width."""

    pattern: Pattern
    value: float
    widest: float


@dataclass(frozen=True, eq=False)
class SearchSetup:
    """The patterns, limits and targets of a search.

    `targets` are half the 95 % intervals wanted of unknowns, by their index: relative, in V for an
    OCV. With `drive`, the mean product of columns on a drive cycle, the RMSE there is to be
    `drive_v`. `last` are steps that end every test; one that discharges takes the remaining charge.
    """

    prior: Prior
    limits: Limits
    blocks: Sequence[Block]
    targets: Mapping[int, float]
    criterion: Criterion
    high_soc: float
    low_soc: float
    drive: Normal | None = None
    drive_v: float = 0.0
    last: tuple[Step, ...] = ()

    def warming_or(self, other: str) -> str:
        """The warming option if it limits currents, else another option that limits a test."""
        return "`max_warming`" if self.limits.share < 1 else other

    @cached_property
    def _allowed(self) -> Callable[[float, float], tuple[float, float]]:
        """`Limits.allowed`, cached for stretches that recur."""
        return cache(partial(self.limits.allowed, self.prior))

    def steps(self, pattern: Pattern, hours: float) -> list[Step] | None:
        """The whole test; None if it takes longer, or its blocks take too much charge."""
        capacity_ah = self.prior.cell.capacity_ah
        # If pieces went below the lowest known state of charge, it ends higher.
        is_held = bool(self.last) or self.prior.planned_soc[0] > 0
        end_soc = self.low_soc + self.limits.beyond_soc * is_held
        ends = np.linspace(self.high_soc, end_soc, pattern.stretches + 1).tolist()
        stretches, taken_ah = [], 0.0
        for high, low, blocks in zip(ends, ends[1:], pattern.dealt(), strict=False):
            discharge_a, charge_a = self._allowed(high, low)
            pieces = [self.blocks[block].steps(discharge_a, charge_a) for block in blocks]
            steps = list(itertools.chain(*pieces))
            taken_ah += sum(step.duration_s * step.current_a for step in steps) / 3600
            left_ah = (self.high_soc - low) * capacity_ah - taken_ah
            # Above a slow discharge to empty, no piece goes below the last stretch.
            over_soc = min(OVERSHOT, low - self.low_soc) if self.last else OVERSHOT
            if left_ah < -(over_soc + ROUNDED_SOC) * capacity_ah:
                return None
            if left_ah > 0:
                rate_a = min(pattern.move_c * capacity_ah, discharge_a)
                if rate_a <= 0:
                    return None
                steps.append(move("move", left_ah, rate_a))
                taken_ah += steps[-1].duration_s * steps[-1].current_a / 3600
            stretches.append(steps)
        first, left_ah = Step("rest", SETTLE_S, 0.0), self.high_soc * capacity_ah - taken_ah
        last = [
            move(step.block, left_ah, step.current_a) if step.current_a > 0 else step
            for step in self.last
        ]
        taken_s = sum(step.duration_s for steps in stretches for step in steps)
        rest_s = 3600 * hours - taken_s - sum(step.duration_s for step in (first, *last))
        if rest_s < 0:
            return None
        whole = [first]
        for steps, share in zip(stretches, pattern.density.tolist(), strict=True):
            piece_rest_s = float(math.floor(rest_s * share / REST_S) * REST_S)
            rest = Step("rest", piece_rest_s if piece_rest_s >= SHORTEST_REST_S else 0.0, 0.0)
            whole += [*steps, rest]
        return [step for step in (*whole, *last) if step.duration_s > 0]

    def ratios(self, steps: Sequence[Step]) -> Float[np.ndarray, "wishes"]:
        """Every width with a target over that target, predicted for the whole test."""
        fastest_s = SHARE_OF_TAU * self.prior.tables.tau_s[0]
        interval_s = min(max(fastest_s, FINEST_S), COARSEST_S)
        test = self.prior.loaded(sampled(steps, interval_s), self.high_soc, interval_s)
        whole = information_of(self.prior, test) + self.prior.information_before
        inverse = whole.inverse(self.prior)
        unknowns, halves = [*self.targets], np.array([*self.targets.values()])
        variance = np.diag(whole.covariance(self.prior, inverse))[unknowns]
        targets = halves * self.prior.units[unknowns]
        widths = NORMAL_95 * np.sqrt(np.maximum(variance, 0.0)) / targets
        if self.drive is None:
            return widths
        on_drive = whole.left_on(self.prior, inverse, self.drive) / self.drive_v
        return np.append(widths, [on_drive] * max(1, len(widths)))

    def searched(
        self, hours: float, key: Array, predictions: int, *starts: Pattern, until: float = 0.0
    ) -> Trial | None:
        """The best test of `hours` reached by changing the best of some patterns, one to three
        changes at a time, or the first whose widths are all at most `until` times the wanted ones;
        None if each of the patterns takes longer."""
        best, seen = None, set(starts)
        for start in starts:
            best = self._better(best, start, hours)
            if best is not None and best.widest <= until:
                return best
        for draw_key in jax.random.split(key, predictions):
            if best is None or best.widest <= until:
                break
            pattern = best.pattern.drawn(draw_key)
            if pattern not in seen:
                seen.add(pattern)
                best = self._better(best, pattern, hours)
        return best

    def _better(self, best: Trial | None, pattern: Pattern, hours: float) -> Trial | None:
        """The better of a test and one with another pattern, if that does not take longer."""
        steps = self.steps(pattern, hours)
        if steps is None:
            return best
        ratios = self.ratios(steps)
        value = math.log(self.criterion(ratios))
        is_better = best is None or value < best.value
        return Trial(pattern, value, float(np.max(ratios))) if is_better else best


@dataclass(frozen=True, eq=False)
class DesignPlan:
    """A test that keeps all limits: its steps and its predicted course."""

    choice: SearchSetup
    pattern: Pattern
    steps: list[Step]
    predicted: Predicted


def planned(
    choice: SearchSetup, max_hours: float, key: Array, starts: int, reaches: Reaches
) -> DesignPlan:
    """The shortest test that meets the targets, or the best in the time, within all limits."""
    best = None
    for _ in range(SEARCHES):
        best, choice = _kept(choice, _best(choice, max_hours, key, starts), max_hours)
        if best is not None:
            break
        # Lower currents may be unable to restore the charge that the pieces take.
    if best is None:
        raise InputError(
            f"no test stays between {choice.limits.low_v:g} and {choice.limits.high_v:g} V in the "
            "worst case, or warms so little; widen `low_voltage` and `high_voltage`, allow more "
            f"{choice.warming_or('`max_hours`')}, or lower `max_discharge` and `max_charge`"
        )
    largest_c, _ = best.choice.limits.rates_a(1.0, np.linspace(0.0, 1.0, 21))
    fast = _starts_of(best.choice, float(np.max(largest_c)))
    shortest, hours = _least_hours(best.choice, fast), max_hours
    for number in range(BISECTIONS if reaches(best.steps) else 0):
        if hours - shortest < NEARLY_SHORTEST * hours:
            break
        middle, draw_key = (shortest + hours) / 2, jax.random.fold_in(key, number)
        # The pieces of a longer test may not fit: fewer of them, and the starts of a fast search.
        patterns = [best.pattern, *map(best.pattern.fewer, FEWER), *fast]
        shorter = best.choice.searched(middle, draw_key, FURTHER, *patterns, until=WELL_REACHED)
        plan = None if shorter is None else _kept(best.choice, shorter, middle)[0]
        if plan is not None and reaches(plan.steps):
            best, hours = plan, middle
        else:
            shortest = middle
    return best


def _kept(choice: SearchSetup, trial: Trial, hours: float) -> tuple[DesignPlan | None, SearchSetup]:
    """A test with its currents lowered until it keeps all limits, None if it cannot, and the setup
    with its limits tightened accordingly."""
    for _ in range(ADJUSTMENTS):
        steps = choice.steps(trial.pattern, hours)
        if steps is None:
            break
        predicted, limits = _simulated(choice, steps)
        if limits == choice.limits:
            return DesignPlan(choice, trial.pattern, steps, predicted), choice
        choice = replace(choice, limits=limits)
    return None, choice


def is_reached_in(hours: float, plan: DesignPlan, key: Array, reaches: Reaches) -> bool:
    """True if a test of this many hours meets the targets that a shorter plan does not."""
    longer, _ = _kept(plan.choice, _best(plan.choice, hours, key, 1), hours)
    return longer is not None and reaches(longer.steps)


def _best(choice: SearchSetup, max_hours: float, key: Array, starts: int) -> Trial:
    """The best of several searches. Raises `InputError` if no test is this short."""
    patterns = _starts_of(choice)
    searches = [
        choice.searched(max_hours, jax.random.fold_in(key, number), PREDICTIONS, *patterns)
        for number in range(starts)
    ]
    best = min(filter(None, searches), key=lambda test: test.value, default=None)
    if best is not None:
        return best
    if choice.steps(Pattern(STRETCHES[0], MOVE_C, (0,) * len(choice.blocks)), MOST_HOURS) is None:
        rates_a, _ = choice.limits.rates_a(1.0, np.linspace(choice.low_soc, choice.high_soc, 21))
        if not np.min(rates_a) > 0:
            raise InputError(
                "`max_discharge`: a test discharges the cell, and 0 allows no discharge at some "
                "state of charge; give more"
            )
        raise InputError(
            f"between {choice.limits.low_v:g} and {choice.limits.high_v:g} V no discharge is "
            "possible at some state of charge in the worst case; lower `low_voltage`"
        )
    least_hours = _least_hours(choice, patterns)
    raise InputError(
        f"`max_hours` {max_hours:g}: one pass through the state of charge takes "
        f"{math.ceil(100 * least_hours) / 100:g} h without rests between its pieces; give more "
        f"time, or a larger {choice.warming_or('`max_discharge`')}"
    )


def _starts_of(choice: SearchSetup, move_c: float = MOVE_C) -> list[Pattern]:
    """The patterns at the start of a search: moves and rests alone, and with pieces of one kind."""
    kinds = len(choice.blocks)
    return [
        Pattern(stretches, move_c, tuple(stretches * (kind == number) for number in range(kinds)))
        for stretches in STRETCHES
        for kind in range(kinds, -1, -1)
    ]


def _least_hours(choice: SearchSetup, patterns: Sequence[Pattern]) -> float:
    """The duration of the shortest of these tests without rests between its pieces."""
    taken_s = (
        sum(step.duration_s for step in steps if step.block != "rest") + SETTLE_S
        for pattern in patterns
        if (steps := choice.steps(pattern, MOST_HOURS)) is not None
    )
    return min(taken_s, default=math.inf) / 3600


def _simulated(choice: SearchSetup, steps: Sequence[Step]) -> tuple[Predicted, Limits]:
    """The predicted course of the test, and the limits of the setup, tightened if its worst case
    leaves a voltage limit, warms too much, or has a current above that given for its state of
    charge."""
    prior, limits, current_a = choice.prior, choice.limits, sampled(steps)
    test = prior.loaded(current_a, choice.high_soc)
    soc, voltages_v = test.soc, (voltage_along(prior, test, worst) for worst in (0, -1, 1))
    voltage_v, low_v, high_v = voltages_v
    loaded = steps[: len(steps) - len(choice.last)]
    counts = np.arange(len(current_a)) <= sum(round(s.duration_s / INTERVAL_S) for s in loaded)
    # The rest of a full cell is at its highest voltage, and not caused by the test.
    charges = counts & (current_a < 0)
    under_v, over_v = counts * (limits.low_v - low_v), charges * (high_v - limits.high_v)
    beyond_v = float(np.max([under_v, over_v]))
    if beyond_v > 0:
        limits = replace(limits, margin_v=limits.margin_v + beyond_v + 1e-3)
    low_soc, high_soc = prior.planned_soc
    low_soc = choice.low_soc - ROUNDED_SOC if choice.last else low_soc
    is_outside = counts & ((soc < low_soc) | (soc > high_soc + 1e-9))
    discharge_a, charge_a = limits.rates_a(prior.cell.capacity_ah, soc)
    # A current is held until the next sample, by when it may have passed its limit slightly.
    is_above = (current_a > ROUNDED * discharge_a) | (-current_a > ROUNDED * charge_a)
    for is_beyond in (is_outside, is_above):
        if np.any(is_beyond):
            limits = replace(limits, beyond_soc=max(LEAST_BEYOND, 2 * limits.beyond_soc))
    worst_k = warming_of(prior, current_a, np.where(current_a > 0, low_v, high_v), soc)
    if limits.warming_k is not None and worst_k > limits.warming_k:
        share = LESS_WARM * math.sqrt(limits.warming_k / worst_k)
        limits = replace(limits, share=limits.share * share)
    predicted = Predicted.of(
        steps, warming_of(prior, current_a, voltage_v, soc),
        current_a=current_a, voltage_v=voltage_v, low_v=low_v, high_v=high_v, soc=soc,
    )  # fmt: skip
    return predicted, limits
