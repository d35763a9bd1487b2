"""The search for a test: a pattern over the state of charge, changed while that gains.

A test goes down the state of charge in stretches. Each has some blocks, a move at constant current
that takes what charge is left, and a rest; rests share the time that is left of all. How many
stretches and blocks of each kind there are, how fast moves go, and which part of the state of
charge gets more of blocks and rests is the pattern. Every change of it is predicted as a whole
test, transients and slow errors and all: block by block, rests would look worth little.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import jax
import numpy as np
from jaxtyping import Array, Float

from .blocks import Block
from .information import HALF_95, OVERSHOT, Believed, Normal, columns_along, information_of
from .protocol import Limits, Step, move, sampled

# Widths over wished ones to a number: what a design lowers.
Criterion = Callable[[Float[np.ndarray, "wishes"]], float]
# Rests are multiples of this.
INTERVAL_S = 2.0
# Tests are predicted on samples apart by this share of the fastest time constant, within limits.
SHARE_OF_TAU, FINEST_S, COARSEST_S = 1 / 4, 1.0, 4.0
# Equal parts of the state of charge, and how a pattern is changed: by these factors, up to so many
# changes at once, with so many stretches.
PARTS, FACTOR, SHARE_FACTOR = 4, 1.35, 1.6
MOST_CHANGES, MANY = 3, 2**30
FEWEST, MOST = 4, 40
# What currents of a few digits may miss.
ROUNDED_SOC = 1e-4
# The rest that a test starts with, and the shortest of the others.
SETTLE_S, SHORTEST_REST_S = 300.0, 10.0


def worst_first(ratios: Float[np.ndarray, "wishes"]) -> float:
    """The mean of the fourth powers: mostly the widest, and never blind to the others.

    >>> worst_first(np.array([1.0, 1.0])), worst_first(np.array([2.0, 0.0]))
    (1.0, 8.0)
    """
    return float(np.mean(ratios**4))


@dataclass(frozen=True)
class Wish:
    """Half a 95 % interval that is wanted of a value: relative, in V for an OCV."""

    place: int
    half: float


@dataclass(frozen=True, eq=False)
class OnDrive:
    """The RMSE in V that is wanted on a drive cycle, and the mean product of columns along that. It
    counts as much as all wishes of one table do."""

    wanted_v: float
    normal: Normal


@dataclass(frozen=True)
class Pattern:
    """The makeup of a test: stretches, the rate of moves, how many blocks of each kind, and the
    weights of equal parts of the state of charge, from full to empty."""

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
        """The numbers of the blocks of every stretch: each kind evenly, by the density."""
        upper = np.cumsum(self.density)
        found: list[list[int]] = [[] for _ in range(self.stretches)]
        for block, count in enumerate(self.counts):
            at = (np.arange(count) + 0.5) / max(count, 1)
            for place in np.searchsorted(upper, at).tolist():
                found[min(place, self.stretches - 1)].append(block)
        return found

    def fewer(self, share: float) -> "Pattern":
        """The pattern with so much of every kind of block."""
        return replace(self, counts=tuple(math.floor(share * count) for count in self.counts))

    @property
    def changes(self) -> int:
        """Number of single changes."""
        return 2 * (2 + len(self.counts) + PARTS)

    def changed(self, number: int) -> "Pattern | None":
        """The pattern with one thing more or less; None where it cannot be less."""
        place, is_less = divmod(number, 2)
        some = max(1, self.stretches // 2) * (-1 if is_less else 1)
        if place == 0:
            stretches = round(self.stretches / FACTOR if is_less else self.stretches * FACTOR)
            counts = tuple(round(count * stretches / self.stretches) for count in self.counts)
            is_usual = FEWEST <= stretches <= MOST
            return replace(self, stretches=stretches, counts=counts) if is_usual else None
        if place == 1:
            return replace(self, move_c=self.move_c / FACTOR if is_less else self.move_c * FACTOR)
        own = place - 2
        if own < PARTS:
            weights = [*self.weights]
            weights[own] *= 1 / SHARE_FACTOR if is_less else SHARE_FACTOR
            return replace(self, weights=tuple(weights))
        counts = [*self.counts]
        if is_less and not counts[own - PARTS]:
            return None
        counts[own - PARTS] = max(counts[own - PARTS] + some, 0)
        return replace(self, counts=tuple(counts))


@dataclass(frozen=True, eq=False)
class Found:
    """A pattern, the logarithm of its criterion, and its widths over the wished ones."""

    pattern: Pattern
    value: float
    ratios: Float[np.ndarray, "wishes"]

    def is_within(self, share: float) -> bool:
        """True where every width is at most so much of the wished one."""
        return float(np.max(self.ratios)) <= share


@dataclass(frozen=True, eq=False)
class Choice:
    """All that a search chooses from, and what it is to reach.

    `last` are steps that end every test; a discharge among them takes what charge is left.
    """

    believed: Believed
    limits: Limits
    blocks: Sequence[Block]
    wishes: Sequence[Wish]
    criterion: Criterion
    high_soc: float
    low_soc: float
    drive: OnDrive | None = None
    last: tuple[Step, ...] = ()

    @cached_property
    def _allowed(self) -> Callable[[float, float], tuple[float, float]]:
        """`Limits.allowed`, of stretches that come again and again."""
        return cache(partial(self.limits.allowed, self.believed))

    def steps(self, pattern: Pattern, hours: float) -> list[Step] | None:
        """The whole test; None where it takes longer, or blocks too much charge."""
        capacity_ah = self.believed.cell.capacity_ah
        # Where pieces dipped under the lowest state of charge that is known, it ends higher.
        is_held = bool(self.last) or self.believed.planned_soc[0] > 0
        end_soc = self.low_soc + self.limits.beyond_soc * is_held
        ends = np.linspace(self.high_soc, end_soc, pattern.stretches + 1).tolist()
        stretches, taken_ah = [], 0.0
        for high, low, blocks in zip(ends, ends[1:], pattern.dealt(), strict=False):
            discharge_a, charge_a = self._allowed(high, low)
            steps = [
                Step(self.blocks[block].name, *pair)
                for block in blocks
                for pair in self.blocks[block].pairs(discharge_a, charge_a)
            ]
            taken_ah += sum(step.duration_s * step.current_a for step in steps) / 3600
            left_ah = (self.high_soc - low) * capacity_ah - taken_ah
            # Above what is emptied slowly, no piece goes below the last stretch.
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
            own_s = float(math.floor(rest_s * share / INTERVAL_S) * INTERVAL_S)
            rest = Step("rest", own_s if own_s >= SHORTEST_REST_S else 0.0, 0.0)
            whole += [*steps, rest]
        return [step for step in (*whole, *last) if step.duration_s > 0]

    def ratios(self, steps: Sequence[Step]) -> Float[np.ndarray, "wishes"]:
        """Every wished value's width over the wished one, as a whole test is predicted."""
        fastest_s = SHARE_OF_TAU * self.believed.tables.tau_s[0]
        interval_s = min(max(fastest_s, FINEST_S), COARSEST_S)
        current_a = sampled(steps, interval_s)
        columns, _ = columns_along(self.believed, current_a, self.high_soc, interval_s)
        whole = information_of(self.believed, columns, interval_s) + self.believed.told_before
        inverse = whole.inverse(self.believed)
        places = [wish.place for wish in self.wishes]
        variance = np.diag(whole.covariance(self.believed, inverse))[places]
        wished = np.array([wish.half for wish in self.wishes]) * self.believed.units[places]
        widths = HALF_95 * np.sqrt(np.maximum(variance, 0.0)) / wished
        if self.drive is None:
            return widths
        on_drive = whole.left_on(self.believed, inverse, self.drive.normal) / self.drive.wanted_v
        return np.append(widths, [on_drive] * max(1, len(widths)))

    def searched(
        self, hours: float, key: Array, predictions: int, *starts: Pattern, until: float = 0.0
    ) -> Found | None:
        """The best test of so many hours that changes of the best of some patterns lead to, one to
        three at a time, or the first whose widths are all at most `until` times the wished ones;
        None where each of the patterns takes longer."""
        best = None
        for start in starts:
            found = self._predicted(start, hours)
            if found is not None and (best is None or found.value < best.value):
                best = found
            if best is not None and best.is_within(until):
                return best
        seen = set(starts)
        for own_key in jax.random.split(key, predictions):
            if best is None or best.is_within(until):
                break
            pattern = best.pattern
            drawn = jax.random.randint(own_key, (MOST_CHANGES + 1,), 0, MANY)
            count, *numbers = np.asarray(drawn).tolist()
            for number in numbers[: 1 + count % MOST_CHANGES]:
                pattern = pattern.changed(number % pattern.changes) or pattern
            if pattern in seen:
                continue
            seen.add(pattern)
            other = self._predicted(pattern, hours)
            if other is not None and other.value < best.value:
                best = other
        return best

    def _predicted(self, pattern: Pattern, hours: float) -> Found | None:
        steps = self.steps(pattern, hours)
        if steps is None:
            return None
        ratios = self.ratios(steps)
        return Found(pattern, math.log(self.criterion(ratios)), ratios)
