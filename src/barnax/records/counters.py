"""The tester's own ampere-hours, joined where a counter starts again."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
from jaxtyping import Bool, Float

Charge = Float[np.ndarray, "samples"]
Increments = Float[np.ndarray, "intervals"]
Loaded = Bool[np.ndarray, "intervals"]

# A smaller fall of a counter is rounding; a larger one begins it anew.
_ROUNDING, _LOW = 1e-3, 0.5
# Counted and integrated charge are compared over the loads of blocks of intervals, for inside a
# drive cycle the current switches between samples, and at rest a counter may tell of what was not
# logged. They agree within this share and so many quanta; so many must.
_BLOCKS, _NEAR, _QUANTA, _AGREEING = 200, 0.1, 2.0, 0.5
# The number of values whose decimals are looked at.
_ENOUGH = 100_000
# The correlation of block sums that are proportional.
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
    def written(self) -> list[Charge]:
        """The counters that the file has."""
        counters = self.charged_ah, self.discharged_ah, self.net_ah
        return [counter for counter in counters if counter is not None]

    @property
    def both(self) -> tuple[Charge, ...]:
        """The counters of charge in and out; empty unless the file has both."""
        if self.charged_ah is None or self.discharged_ah is None:
            return ()
        return self.charged_ah, self.discharged_ah

    @cached_property
    def quantum_ah(self) -> float:
        """The resolution of the coarsest counter: the decimal place to which it was printed."""
        moving = [values for values in self.written if values.any()]
        return max(map(decimal_step, moving), default=0.0)

    def increments_ah(self, *, with_net: bool) -> Increments | None:
        """Ah counted in each interval, charge positive; zero where a counter was reset.

        None without counters. `with_net` accepts a net counter where the other two are missing;
        its sign is then the file's own.
        """
        counters = (self.charged_ah, 1), (self.discharged_ah, -1)
        parts = [way * np.maximum(np.diff(ah), 0) for ah, way in counters if ah is not None]
        if not parts and with_net and self.net_ah is not None:
            parts = [np.diff(self.net_ah)]
        return reduce(np.add, parts) if parts else None

    def magnitudes_ah(self) -> Increments | None:
        """Ah counted in each interval by a lone counter without a sign that begins anew."""
        if self.net_ah is None or len(self.written) > 1 or self.net_ah.min() < 0:
            return None
        gained_ah = np.diff(self.net_ah)
        falls = gained_ah < -_ROUNDING * self.net_ah.max()
        is_anew = self.net_ah[1:] < _LOW * self.net_ah[:-1]
        return _joined(self.net_ah)[0] if falls.any() and is_anew[falls].mean() > 0.5 else None

    def charge_ah(self, integrated_ah: Increments, is_loaded: Loaded) -> Charge | None:
        """The net charge by the counters, signed as `integrated_ah` is, from where they began.

        That is the charge by integration of the intervals, `is_loaded` where a load shows in it.
        Counters that begin anew with a step or a cycle are joined; one that counts without a sign
        takes the current's, and tells nothing of what came before the first sample. None where the
        file has none, or one that does not count.
        """
        if not self.written:
            return None
        summed_ah, flowed_ah = _in_blocks(is_loaded, integrated_ah, np.abs(integrated_ah))
        least_ah = _QUANTA * self.quantum_ah
        best, most = None, _AGREEING
        for begun_ah, counted_ah, is_anew in self._candidates(integrated_ah):
            (blocks_ah,) = _in_blocks(is_loaded, counted_ah)
            sign = float(np.sign(inner(blocks_ah, summed_ah))) or 1.0
            apart_ah = np.abs(sign * blocks_ah - summed_ah)
            moves = np.maximum(apart_ah, flowed_ah) > least_ah
            agrees = (apart_ah <= _NEAR * flowed_ah + least_ah)[moves]
            if len(agrees) and agrees.mean() > most:
                # What it counted before it began anew is not in it.
                is_less = is_anew & (np.abs(counted_ah) < np.abs(integrated_ah))
                counted_ah = np.where(is_less, integrated_ah, sign * counted_ah)
                best, most = (sign * begun_ah, counted_ah), float(agrees.mean())
            if most == 1:
                break
        if best is None:
            return None
        begun_ah, counted_ah = best
        return np.cumsum(np.concatenate([[begun_ah], counted_ah]))

    def net_ratio(self, integrated_ah: Increments, is_loaded: Loaded) -> float | None:
        """The integral as a multiple of what a lone net counter counted, in every part alike.

        None where there is no such counter, or where they are not proportional.
        """
        if self.both or self.net_ah is None:
            return None
        for _, counted_ah, _ in self._candidates(integrated_ah):
            blocks_ah, summed_ah = _in_blocks(is_loaded, counted_ah, integrated_ah)
            if abs(cosine(blocks_ah, summed_ah)) > _PROPORTIONAL:
                return float(np.sqrt(np.sum(summed_ah**2) / np.sum(blocks_ah**2)))
        return None

    def _candidates(self, integrated_ah: Increments) -> Iterator[tuple[float, Increments, Loaded]]:
        """Readings of what the counters mean, the plainest first.

        That is their first value, what they gain, and where they begin anew.
        """
        if self.both:
            (into_ah, is_into), (out_ah, is_out) = map(_joined, self.both)
            begun_ah = float(self.both[0][0] - self.both[1][0])
            yield begun_ah, into_ah - out_ah, is_into | is_out
        if self.both or self.net_ah is None:
            return
        steps_ah = np.diff(self.net_ah)
        # One set to nothing counted no more since than flows in its interval.
        flow_ah = np.abs(integrated_ah)
        flow_ah = np.maximum(flow_ah, np.append(flow_ah[1:], 0)) + _QUANTA * self.quantum_ah
        is_anew = (np.abs(self.net_ah[1:]) <= flow_ah) & (np.abs(steps_ah) > 2 * flow_ah)
        yield float(self.net_ah[0]), np.where(is_anew, self.net_ah[1:], steps_ah), is_anew
        # What a new step counts is of its own direction, whatever the hold says of the interval.
        direction = np.sign(integrated_ah)
        shrinks = np.abs(self.net_ah[1:]) < np.abs(self.net_ah[:-1])
        count_sign = np.where(shrinks | (direction == 0), np.append(direction[1:], 0), direction)
        gained_ah, is_anew = _joined(np.abs(self.net_ah))
        yield 0.0, gained_ah * count_sign, is_anew


def skipped_ah(charge_ah: Charge, held_ah: Increments, max_ah: Increments) -> Increments | None:
    """The charge counted in each interval beyond `held_ah`, where it is much and lasts.

    `charge_ah` is the counted net charge, `held_ah` what the record's current makes of each
    interval, and `max_ah` what can pass in it at most. Zero elsewhere, and None where nothing was
    skipped: a logger left out a load, or its beginning. A counter that lags behind or stands still
    catches up, and one that is coarse moves by its quantum.
    """
    moving_ah = np.abs(np.diff(charge_ah))
    least_ah = _SKIPPED * float(np.ptp(charge_ah))
    beyond_ah = np.diff(charge_ah) - held_ah
    if not np.any(np.abs(beyond_ah) > least_ah):
        return None
    least_ah = max(least_ah, _QUANTUM * float(moving_ah[moving_ah > 0].min(initial=np.inf)))
    apart_ah = charge_ah - np.concatenate([np.zeros(1), np.cumsum(held_ah)])
    # What it counts at once is of all the time for which it stood still.
    moved = np.where(moving_ah > 0, np.arange(1, len(moving_ah) + 1), 0)
    since = np.append(0, np.maximum.accumulate(moved)[:-1])
    low_ah, high_ah = np.minimum(beyond_ah, 0), np.maximum(beyond_ah, 0)
    excess_ah = np.clip(apart_ah[1:] - apart_ah[since], low_ah, high_ah)
    is_far = (np.abs(excess_ah) > least_ah) & (moving_ah > 0) & (moving_ah <= max_ah)
    hidden_ah = np.zeros_like(held_ah)
    for at in np.flatnonzero(is_far).tolist():
        before = np.median(apart_ah[max(since[at] - _BESIDE, 0) : since[at] + 1])
        after = np.median(apart_ah[at + 1 : at + 2 + _BESIDE])
        if (after - before) / excess_ah[at] > _LASTING:
            hidden_ah[at] = excess_ah[at]
    return hidden_ah if hidden_ah.any() else None


def inner(ones: Float[np.ndarray, "n"], others: Float[np.ndarray, "n"]) -> float:
    """Their inner product, without the threads of BLAS, which spin on after so little work."""
    return float(np.einsum("i,i", ones, others))


def cosine(ones: Float[np.ndarray, "n"], others: Float[np.ndarray, "n"]) -> float:
    """Their cosine; zero where one of them is zero."""
    size = float(np.sqrt(np.sum(ones**2) * np.sum(others**2)))
    return float(np.sum(ones * others)) / size if size else 0.0


def _in_blocks(is_loaded: Loaded, *values: Increments) -> list[Float[np.ndarray, "blocks"]]:
    """The sums of the intervals under load in each block of intervals."""
    starts = np.unique(np.linspace(0, len(is_loaded), _BLOCKS, endpoint=False, dtype=int))
    return [np.add.reduceat(np.where(is_loaded, value, 0.0), starts) for value in values]


def _joined(counter_ah: Charge) -> tuple[Increments, Loaded]:
    """The counts of each interval of a counter that only grows, and where it began anew."""
    gained_ah = np.diff(counter_ah)
    is_anew = gained_ah < -_ROUNDING * counter_ah.max()
    return np.where(is_anew, counter_ah[1:], np.maximum(gained_ah, 0)), is_anew


def gain_ah(counter_ah: Charge) -> float:
    """By how much a counter grew, resets left out."""
    return float(np.sum(np.maximum(np.diff(counter_ah), 0)))


def decimal_step(values: Charge) -> float:
    """The coarsest power of ten of which all values are multiples, to single precision."""
    # An evenly spaced subset of more values gives the same.
    values = values[:: 1 + len(values) // _ENOUGH]
    for digits in range(9):
        scaled = np.abs(values) * 10.0**digits
        # Of a coin cell's few microampere-hours none is near a whole number for being small.
        if np.all(np.abs(scaled - np.round(scaled)) <= 1e-6 * (min(1, scaled.max()) + scaled)):
            return 10.0**-digits
    return 0.0
