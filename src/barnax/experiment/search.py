"""The choice of blocks: first alike at every state of charge, then exchanged one by one.

A test goes down the state of charge in segments. What the blocks of a segment do not take of its
charge, a move at constant current does, so that a block which discharges costs less time than its
own. Lowered is a criterion of the predicted widths over the wished ones. One block at a time would
start where nothing is determined and every gain is the same; so blocks are first added to all
segments at once, by their gain an hour, and then replaced, added and left out in single segments.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from .blocks import Block
from .information import (
    HALF_95,
    Believed,
    Information,
    Normal,
    columns_along,
    information_of,
    joined,
)
from .protocol import Limits, Step, move, sampled

# Widths over wished ones to a number: what a design lowers.
Criterion = Callable[[Float[np.ndarray, "wishes"]], float]
SEGMENT = 0.1
DRIVE_WEIGHT = 10
SWEEPS = 3
# A longer move tells no more than so many whole segments.
LONGEST_MOVE = 3.0
LEAST_GAIN = 1e-3
# By how much blocks may take a cell below the end of their segment, but for the last.
OVERSHOT = 0.05
SETTLE_S = 300.0
WARM_S = 600


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
    """The RMSE in V that is wanted on a drive cycle, and the mean of J'J along that. It counts as
    much as all wishes of one table do."""

    wanted_v: float
    normal: Normal


def rmse_along(normal: Normal, covariance: Normal) -> float:
    """The part in V of an RMSE that is due to what is not known, where the mean of J'J is this."""
    return math.sqrt(max(float(np.sum(covariance * normal)), 0.0))


@dataclass(frozen=True, eq=False)
class Segment:
    """A stretch of the state of charge, and what is allowed there."""

    high: float
    low: float
    discharge_a: float
    charge_a: float


@dataclass(frozen=True)
class Chosen:
    """Which blocks each segment has, by their number."""

    blocks: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, eq=False)
class Choice:
    """All that a search chooses from, and what it is to reach."""

    believed: Believed
    limits: Limits
    blocks: Sequence[Block]
    wishes: Sequence[Wish]
    criterion: Criterion
    high_soc: float
    low_soc: float
    drive: OnDrive | None = None
    move_c: float = 1.0

    @cached_property
    def segments(self) -> tuple[Segment, ...]:
        count = max(1, round((self.high_soc - self.low_soc) / SEGMENT))
        ends = np.linspace(self.high_soc, self.low_soc, count + 1).tolist()
        return tuple(
            Segment(high, low, *self.limits.allowed(self.believed, high, low))
            for high, low in pairwise(ends)
        )

    def steps_of(self, segment: Segment, block: int) -> list[Step]:
        own = self.blocks[block]
        currents = own.currents(segment.discharge_a, segment.charge_a)
        pairs = zip(own.durations_s, currents.tolist(), strict=True)
        return [Step(own.name, seconds, current_a) for seconds, current_a in pairs]

    @cached_property
    def taken_ah(self) -> Float[np.ndarray, "segments blocks"]:
        """What every block takes out of the cell in every segment."""
        return (
            np.array(
                [
                    [
                        sum(
                            step.duration_s * step.current_a
                            for step in self.steps_of(segment, block)
                        )
                        for block in range(len(self.blocks))
                    ]
                    for segment in self.segments
                ]
            )
            / 3600
        )

    @cached_property
    def gained(self) -> list[list[Information]]:
        """What every block tells in every segment, in its middle."""
        return [
            [
                self._alone(self.steps_of(segment, block), segment)
                for block in range(len(self.blocks))
            ]
            for segment in self.segments
        ]

    @cached_property
    def moves(self) -> list[Information]:
        """What going through a whole segment at constant current tells."""
        return [self._alone([self._move(each, 0.0)], each) for each in self.segments]

    def _move(self, segment: Segment, taken_ah: float) -> Step:
        """What takes the rest of a segment's charge; endless where blocks take too much of it."""
        capacity_ah = self.believed.cell.capacity_ah
        rest_ah = (segment.high - segment.low) * capacity_ah - taken_ah
        fastest_a = segment.discharge_a if rest_ah > 0 else segment.charge_a
        rate_a = min(self.move_c * capacity_ah, fastest_a)
        beyond = OVERSHOT if segment.low > self.low_soc else 0.0
        if rest_ah < -beyond * capacity_ah or rate_a <= 0:
            return Step("move", math.inf, 0.0)
        return move("move", rest_ah, rate_a)

    def _alone(self, steps: Sequence[Step], segment: Segment) -> Information:
        # Out of a load, as in the test: out of a rest, which only the first are, it tells more.
        capacity_ah = self.believed.cell.capacity_ah
        before_a = 0.0 if segment.high == self.high_soc else 0.5 * segment.discharge_a
        taken_ah = sum(step.duration_s * step.current_a for step in steps) / 3600
        start = (segment.high + segment.low) / 2 + taken_ah / 2 / capacity_ah
        start += WARM_S * before_a / 3600 / capacity_ah
        warm = [Step("move", WARM_S, before_a), *steps]
        columns, _ = columns_along(self.believed, sampled(warm), start)
        return information_of(self.believed, columns[WARM_S:-1])

    def hours(self, chosen: Chosen) -> float:
        return (SETTLE_S + sum(map(self._seconds, range(len(chosen.blocks)), chosen.blocks))) / 3600

    def _seconds(self, place: int, blocks: Sequence[int]) -> float:
        """How long a segment takes with these blocks."""
        return sum(self.blocks[n].duration_s for n in blocks) + self._move_s(place, blocks)

    def _move_s(self, place: int, blocks: Sequence[int]) -> float:
        taken_ah = float(sum(self.taken_ah[place, n] for n in blocks))
        return self._move(self.segments[place], taken_ah).duration_s

    def _steps(self, chosen: Chosen) -> Iterator[Step]:
        yield Step("rest", SETTLE_S, 0.0)
        for place, (segment, own) in enumerate(zip(self.segments, chosen.blocks, strict=True)):
            for block in own:
                yield from self.steps_of(segment, block)
            yield self._move(segment, float(sum(self.taken_ah[place, n] for n in own)))

    def steps(self, chosen: Chosen) -> list[Step]:
        """The whole test."""
        return [step for step in self._steps(chosen) if step.duration_s > 0]

    def information(self, chosen: Chosen) -> Information:
        """About what it tells, pieces taken for independent."""
        own = (self._within(place, blocks) for place, blocks in enumerate(chosen.blocks))
        return sum(own, self._rest)

    @cached_property
    def _rest(self) -> Information:
        columns, _ = columns_along(self.believed, np.zeros(int(SETTLE_S)), self.high_soc)
        return information_of(self.believed, columns)

    def _within(self, place: int, blocks: Sequence[int]) -> Information:
        """What blocks and the move of a segment tell."""
        whole = self.moves[place]
        seconds = min(self._move_s(place, blocks), LONGEST_MOVE * whole.samples)
        return sum((self.gained[place][n] for n in blocks), whole.scaled(seconds / whole.samples))

    def ratios(self, found: Information) -> Float[np.ndarray, "wishes"]:
        """Every wished value's width over the wished one."""
        covariance = joined(self.believed, found.covariance(self.believed)[0])
        variance = np.diag(covariance)[self._places]
        found_ratios = HALF_95 * np.sqrt(np.maximum(variance, 0.0)) / self._wished
        if self.drive is None:
            return found_ratios
        on_drive = rmse_along(self.drive.normal, covariance) / self.drive.wanted_v
        return np.append(found_ratios, [on_drive] * DRIVE_WEIGHT)

    @cached_property
    def _places(self) -> list[int]:
        return [wish.place for wish in self.wishes]

    @cached_property
    def _wished(self) -> Float[np.ndarray, "wishes"]:
        names, values = self.believed.names, self.believed.values
        scale = [values[n] if names[n][0].startswith("R") else 1.0 for n in self._places]
        return np.array([wish.half for wish in self.wishes]) * scale

    def value(self, found: Information) -> float:
        """The logarithm of the criterion."""
        return math.log(self.criterion(self.ratios(found)))

    def search(self, max_hours: float) -> Chosen:
        """The best choice that takes no longer."""
        chosen = Chosen(((),) * len(self.segments))
        value, hours = self.value(self.information(chosen)), self.hours(chosen)
        while True:
            # One block more in every segment.
            layers = []
            for block in range(len(self.blocks)):
                more = [tuple(sorted((*own, block))) for own in chosen.blocks]
                fits = [math.isfinite(self._seconds(*each)) for each in enumerate(more)]
                if not any(fits):
                    continue
                pairs = zip(fits, more, chosen.blocks, strict=True)
                other = Chosen(tuple(new if fit else own for fit, new, own in pairs))
                taken = self.hours(other)
                if taken <= max_hours:
                    its = self.value(self.information(other))
                    layers.append(((value - its) / max(taken - hours, 0.05), its, taken, other))
            rate, *best = max(layers, key=lambda each: each[0], default=(0.0,))
            if rate <= 0:
                break
            value, hours, chosen = best
        for _ in range(SWEEPS):
            before = value
            for place in range(len(self.segments)):
                value, chosen = self._exchanged(chosen, place, value, max_hours)
            if before - value < LEAST_GAIN * len(self.segments):
                break
        return chosen

    def _exchanged(
        self, chosen: Chosen, place: int, value: float, max_hours: float
    ) -> tuple[float, Chosen]:
        """The choice with one block of a segment replaced, added or left out, while that gains."""
        others = self.information(chosen) + self._within(place, chosen.blocks[place]).scaled(-1)
        spare_s = 3600 * (max_hours - self.hours(chosen))
        spare_s += self._seconds(place, chosen.blocks[place])
        for out in [None, *sorted({*chosen.blocks[place]})]:
            own = list(chosen.blocks[place])
            if out is not None:
                own.remove(out)
            for into in [None, *range(len(self.blocks))]:
                blocks = tuple(sorted(own if into is None else [*own, into]))
                if into == out or self._seconds(place, blocks) > spare_s:
                    continue
                its = self.value(others + self._within(place, blocks))
                if its < value - LEAST_GAIN:
                    all_blocks = (*chosen.blocks[:place], blocks, *chosen.blocks[place + 1 :])
                    value, chosen = its, Chosen(all_blocks)
        return value, chosen
