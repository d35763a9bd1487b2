"""The tester's own ampere-hours, joined where a counter starts again."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cached_property, reduce

import numpy as np
from jaxtyping import Float

Charge = Float[np.ndarray, "samples"]
Increments = Float[np.ndarray, "intervals"]

# A smaller fall of a counter is rounding; a larger one begins it anew.
_ROUNDING, _LOW = 1e-3, 0.5
# Counted and integrated charge are compared over blocks of intervals, for inside a drive cycle the
# current switches between samples. They agree within this share and so many quanta; so many must.
_BLOCKS, _NEAR, _QUANTA, _AGREEING = 200, 0.1, 2.0, 0.5
# Of so many values the decimals are looked at.
_ENOUGH = 100_000
# What proportional block sums correlate by.
_PROPORTIONAL = 0.995

# Of the counted charge, and of the smallest count, what an interval must hide to have been skipped;
# so much of it must last over the samples beside it.
_SKIPPED, _QUANTUM, _BESIDE, _LASTING = 1e-2, 5.0, 20, 0.5


@dataclass(frozen=True, eq=False)
class Counters:
    """The tester's own ampere-hours, as far as the file has them.

    `charged_ah` and `discharged_ah` only grow, but for resets; `net_ah` follows the file's own
    sign of current, or nothing at all: names such as "Capacity" mean many things.
    """

    charged_ah: Charge | None = None
    discharged_ah: Charge | None = None
    net_ah: Charge | None = None

    @property
    def written(self) -> dict[str, Charge]:
        """The counters that the file has, by name."""
        named = {each.name: getattr(self, each.name) for each in fields(self)}
        return {name: values for name, values in named.items() if values is not None}

    @property
    def both(self) -> tuple[Charge, ...]:
        """What was counted in and out; nothing unless the file has both."""
        if self.charged_ah is None or self.discharged_ah is None:
            return ()
        return self.charged_ah, self.discharged_ah

    @cached_property
    def quantum_ah(self) -> float:
        """What the coarsest counter resolves: the decimal place to which it was printed."""
        moving = [values for values in self.written.values() if values.any()]
        return max(map(_decimal_place, moving), default=0.0)

    def increments_ah(self, *, with_net: bool) -> Increments | None:
        """Ah counted in each interval, charge positive; zero where a counter was reset.

        None without counters. `with_net` accepts a net counter where the other two are missing;
        its sign is then the file's own.
        """
        parts = []
        if self.charged_ah is not None:
            parts.append(np.maximum(np.diff(self.charged_ah), 0))
        if self.discharged_ah is not None:
            parts.append(-np.maximum(np.diff(self.discharged_ah), 0))
        if not parts and with_net and self.net_ah is not None:
            parts.append(np.diff(self.net_ah))
        return reduce(np.add, parts) if parts else None

    def magnitudes_ah(self) -> Increments | None:
        """Ah counted in each interval by a lone counter without a sign that begins anew."""
        if self.net_ah is None or len(self.written) > 1 or self.net_ah.min() < 0:
            return None
        gained_ah = np.diff(self.net_ah)
        falls = gained_ah < -_ROUNDING * self.net_ah.max()
        is_anew = self.net_ah[1:] < _LOW * self.net_ah[:-1]
        return _joined(self.net_ah) if falls.any() and is_anew[falls].mean() > 0.5 else None

    def charge_ah(self, integrated_ah: Increments) -> Charge | None:
        """The net charge by the counters, signed as `integrated_ah` is, from where they began.

        That is the charge by integration of the intervals. Counters that begin anew with a step or
        a cycle are joined; one that counts without a sign takes the current's, and tells nothing
        of what came before the first sample. None where the file has none, or one that does not
        count.
        """
        if not self.written:
            return None
        starts = np.unique(np.linspace(0, len(integrated_ah), _BLOCKS, endpoint=False, dtype=int))
        summed_ah = np.add.reduceat(integrated_ah, starts)
        flowed_ah = np.add.reduceat(np.abs(integrated_ah), starts)
        least_ah = _QUANTA * self.quantum_ah
        best, most = None, _AGREEING
        for begun_ah, counted_ah in self._candidates(integrated_ah):
            sign = float(np.sign(inner(counted_ah, integrated_ah))) or 1.0
            apart_ah = np.abs(sign * np.add.reduceat(counted_ah, starts) - summed_ah)
            moves = np.maximum(apart_ah, flowed_ah) > least_ah
            agrees = (apart_ah <= _NEAR * flowed_ah + least_ah)[moves]
            if len(agrees) and agrees.mean() > most:
                best, most = (sign, begun_ah, counted_ah), float(agrees.mean())
            if most == 1:
                break
        if best is None:
            return None
        sign, begun_ah, counted_ah = best
        charge_ah = np.concatenate([[begun_ah], counted_ah])
        charge_ah *= sign
        return np.cumsum(charge_ah, out=charge_ah)

    def net_ratio(self, integrated_ah: Increments) -> float | None:
        """How many times what a lone net counter counted the integral is, in every part alike.

        None where there is no such counter, or where they are not proportional.
        """
        if self.both or self.net_ah is None:
            return None
        starts = np.unique(np.linspace(0, len(integrated_ah), _BLOCKS, endpoint=False, dtype=int))
        summed_ah = np.add.reduceat(integrated_ah, starts)
        for _, counted_ah in self._candidates(integrated_ah):
            blocks_ah = np.add.reduceat(counted_ah, starts)
            size = float(np.sqrt(np.sum(blocks_ah**2) * np.sum(summed_ah**2)))
            if size and abs(float(np.sum(blocks_ah * summed_ah))) > _PROPORTIONAL * size:
                return float(np.sqrt(np.sum(summed_ah**2) / np.sum(blocks_ah**2)))
        return None

    def _candidates(self, integrated_ah: Increments) -> Iterator[tuple[float, Increments]]:
        """What the counters may mean, the plainest first: their first value, and what they gain."""
        if self.both:
            charged_ah, discharged_ah = self.both
            begun_ah = float(charged_ah[0] - discharged_ah[0])
            yield begun_ah, _joined(charged_ah) - _joined(discharged_ah)
        if self.both or self.net_ah is None:
            return
        steps_ah, begun_ah = np.diff(self.net_ah), float(self.net_ah[0])
        yield begun_ah, steps_ah
        # One that a new step sets to nothing counted nothing there.
        yield begun_ah, np.where(self.net_ah[1:] == 0, 0.0, steps_ah)
        shrinks = np.abs(self.net_ah[1:]) < np.abs(self.net_ah[:-1])
        yield begun_ah, np.where(shrinks, self.net_ah[1:], steps_ah)
        # What a new step counts is of its own direction, whatever the hold says of the interval.
        direction = np.sign(integrated_ah)
        own = np.where(shrinks | (direction == 0), np.append(direction[1:], 0), direction)
        yield 0.0, _joined(np.abs(self.net_ah)) * own


def skipped_ah(charge_ah: Charge, begun_ah: Increments, ended_ah: Increments) -> Increments | None:
    """What the tester counted in intervals that the samples on both sides of them do not explain.

    `charge_ah` is the counted net charge, `begun_ah` and `ended_ah` what each interval's first and
    last current make of it. Zero elsewhere, and None where nothing was skipped: a logger left
    out a load. A counter that only lags behind catches up within some samples, and one that is
    coarse moves by its quantum.
    """
    counted_ah = np.diff(charge_ah)
    least_ah = _SKIPPED * float(np.ptp(charge_ah))
    # What is far from both is far from one of them, and few are.
    places = np.flatnonzero(np.abs(counted_ah - begun_ah) > least_ah)
    if not len(places):
        return None
    moving_ah = np.abs(counted_ah)
    least_ah = max(least_ah, _QUANTUM * float(moving_ah[moving_ah > 0].min(initial=np.inf)))
    ends_ah = np.sort([begun_ah[places], ended_ah[places]], axis=0)
    excess_ah = counted_ah[places] - np.clip(counted_ah[places], *ends_ah)
    is_far = np.abs(excess_ah) > least_ah
    places, excess_ah = places[is_far], excess_ah[is_far]
    if not len(places):
        return None
    apart_ah = charge_ah - np.concatenate([np.zeros(1), np.cumsum(begun_ah)])
    found_ah = np.zeros_like(counted_ah)
    for place, own_ah in zip(places.tolist(), excess_ah.tolist(), strict=True):
        before = np.median(apart_ah[max(place - _BESIDE, 0) : place + 1])
        after = np.median(apart_ah[place + 1 : place + 2 + _BESIDE])
        if (after - before) / own_ah > _LASTING:
            found_ah[place] = own_ah
    return found_ah if found_ah.any() else None


def inner(ones: Float[np.ndarray, "n"], others: Float[np.ndarray, "n"]) -> float:
    """Their inner product, without the threads of BLAS, which spin on after so little work."""
    return float(np.einsum("i,i", ones, others))


def _joined(counter_ah: Charge) -> Increments:
    """What a counter that only grows, and begins anew, counted in each interval."""
    gained_ah = np.diff(counter_ah)
    is_anew = gained_ah < -_ROUNDING * counter_ah.max()
    return np.where(is_anew, counter_ah[1:], np.maximum(gained_ah, 0))


def gain_ah(counter_ah: Charge) -> float:
    """By how much a counter grew, resets left out."""
    return float(np.sum(np.maximum(np.diff(counter_ah), 0)))


def _decimal_place(values: Charge) -> float:
    """The coarsest power of ten of which all values are multiples, to single precision."""
    # Of more values a share tells the same.
    values = values[:: 1 + len(values) // _ENOUGH]
    for digits in range(9):
        scaled = np.abs(values) * 10.0**digits
        # Of a coin cell's few microampere-hours none is near a whole number for being small.
        if np.all(np.abs(scaled - np.round(scaled)) <= 1e-6 * (min(1, scaled.max()) + scaled)):
            return 10.0**-digits
    return 0.0
