"""The tester's ampere-hour counters, joined where a counter starts again."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
from jaxtyping import Bool, Float

Charge = Float[np.ndarray, "samples"]
Increments = Float[np.ndarray, "intervals"]
Loaded = Bool[np.ndarray, "intervals"]

# A smaller fall of a counter is rounding; a larger one is a reset.
_ROUNDING, _LOW = 1e-3, 0.5
# Counted and integrated charge are compared over the loads within blocks of intervals, because in a
# drive cycle the current switches between samples, and at rest a counter may include a load that
# was not logged. They agree within this share and this many quanta; that many have to.
_BLOCKS, _NEAR, _QUANTA, _AGREEING = 200, 0.1, 2.0, 0.5
# Number of values whose decimals are examined.
_ENOUGH = 100_000
# Correlation of block sums that are proportional.
_PROPORTIONAL = 0.995

# Share of the counted charge, and of the smallest count, that an interval has to hide to count as
# skipped; this much of it has to persist in the samples around it.
_SKIPPED, _QUANTUM, _BESIDE, _LASTING = 1e-2, 5.0, 20, 0.5


@dataclass(frozen=True, eq=False)
class Counters:
    """The tester's ampere-hour counters, as far as the file has them.

    `charged_ah` and `discharged_ah` only increase, except for resets; `net_ah` follows the file's
    sign of the current, or no sign at all, because names such as "Capacity" have many meanings.
    """

    charged_ah: Charge | None = None
    discharged_ah: Charge | None = None
    net_ah: Charge | None = None

    @property
    def written(self) -> list[Charge]:
        """The counters in the file."""
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
        """The resolution of the coarsest counter: its last printed decimal place."""
        moving = [values for values in self.written if values.any()]
        return max(map(decimal_step, moving), default=0.0)

    def increments_ah(self, *, with_net: bool) -> Increments | None:
        """Ah counted in each interval, charge positive; zero where a counter was reset.

        None without counters. With `with_net`, a net counter is used if the other two are missing;
        its sign is then the file's.
        """
        counters = (self.charged_ah, 1), (self.discharged_ah, -1)
        parts = [way * np.maximum(np.diff(ah), 0) for ah, way in counters if ah is not None]
        if not parts and with_net and self.net_ah is not None:
            parts = [np.diff(self.net_ah)]
        return reduce(np.add, parts) if parts else None

    def magnitudes_ah(self) -> Increments | None:
        """Ah counted in each interval by a single unsigned counter that restarts."""
        if self.net_ah is None or len(self.written) > 1 or self.net_ah.min() < 0:
            return None
        gained_ah = np.diff(self.net_ah)
        falls = gained_ah < -_ROUNDING * self.net_ah.max()
        is_anew = self.net_ah[1:] < _LOW * self.net_ah[:-1]
        return _joined(self.net_ah)[0] if falls.any() and is_anew[falls].mean() > 0.5 else None

    def charge_ah(self, integrated_ah: Increments, is_loaded: Loaded) -> Charge | None:
        """The net charge by the counters, with the sign of `integrated_ah`, from where they began.

        `integrated_ah` is the charge by integration of each interval, `is_loaded` where it shows a
        load. Counters that restart with a step or a cycle are joined; an unsigned counter takes the
        current's sign, and says nothing about charge before the first sample. None if the file has
        no counter, or one that does not count.
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
                # Its count before the reset is not included.
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
        """The integral as a multiple of the charge that a single net counter counted, if it is
        equal in every part.

        None without such a counter, or if the two are not proportional.
        """
        if self.both or self.net_ah is None:
            return None
        for _, counted_ah, _ in self._candidates(integrated_ah):
            blocks_ah, summed_ah = _in_blocks(is_loaded, counted_ah, integrated_ah)
            if abs(cosine(blocks_ah, summed_ah)) > _PROPORTIONAL:
                return float(np.sqrt(np.sum(summed_ah**2) / np.sum(blocks_ah**2)))
        return None

    def _candidates(self, integrated_ah: Increments) -> Iterator[tuple[float, Increments, Loaded]]:
        """Possible meanings of the counters, the simplest first: their first value, increments and
        resets."""
        if self.both:
            (into_ah, is_into), (out_ah, is_out) = map(_joined, self.both)
            begun_ah = float(self.both[0][0] - self.both[1][0])
            yield begun_ah, into_ah - out_ah, is_into | is_out
        if self.both or self.net_ah is None:
            return
        steps_ah = np.diff(self.net_ah)
        # A counter set to zero has since counted at most the charge of its interval.
        flow_ah = np.abs(integrated_ah)
        flow_ah = np.maximum(flow_ah, np.append(flow_ah[1:], 0)) + _QUANTA * self.quantum_ah
        is_anew = (np.abs(self.net_ah[1:]) <= flow_ah) & (np.abs(steps_ah) > 2 * flow_ah)
        yield float(self.net_ah[0]), np.where(is_anew, self.net_ah[1:], steps_ah), is_anew
        # The first count of a new step has the direction of that step, whatever the hold of the
        # interval.
        direction = np.sign(integrated_ah)
        shrinks = np.abs(self.net_ah[1:]) < np.abs(self.net_ah[:-1])
        count_sign = np.where(shrinks | (direction == 0), np.append(direction[1:], 0), direction)
        gained_ah, is_anew = _joined(np.abs(self.net_ah))
        yield 0.0, gained_ah * count_sign, is_anew


def skipped_ah(charge_ah: Charge, held_ah: Increments, max_ah: Increments) -> Increments | None:
    """The charge counted in each interval beyond `held_ah`, if it is large and persists.

    `charge_ah` is the counted net charge, `held_ah` each interval's charge by the record's current,
    and `max_ah` the largest possible charge in it. Zero elsewhere, and None if nothing was skipped.
    A logger may leave out a load, or its beginning, whereas a counter that lags or stops catches
    up, and a coarse one moves by its quantum.
    """
    moving_ah = np.abs(np.diff(charge_ah))
    least_ah = _SKIPPED * float(np.ptp(charge_ah))
    beyond_ah = np.diff(charge_ah) - held_ah
    if not np.any(np.abs(beyond_ah) > least_ah):
        return None
    least_ah = max(least_ah, _QUANTUM * float(moving_ah[moving_ah > 0].min(initial=np.inf)))
    apart_ah = charge_ah - np.concatenate([np.zeros(1), np.cumsum(held_ah)])
    # A jump covers all the time during which the counter stood still.
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
    """The inner product, without BLAS, whose threads keep spinning after so little work."""
    return float(np.einsum("i,i", ones, others))


def cosine(ones: Float[np.ndarray, "n"], others: Float[np.ndarray, "n"]) -> float:
    """The cosine of two vectors; zero if one of them is zero."""
    size = float(np.sqrt(np.sum(ones**2) * np.sum(others**2)))
    return float(np.sum(ones * others)) / size if size else 0.0


def _in_blocks(is_loaded: Loaded, *values: Increments) -> list[Float[np.ndarray, "blocks"]]:
    """The sums over the intervals under load in each block of intervals."""
    starts = np.unique(np.linspace(0, len(is_loaded), _BLOCKS, endpoint=False, dtype=int))
    return [np.add.reduceat(np.where(is_loaded, value, 0.0), starts) for value in values]


def _joined(counter_ah: Charge) -> tuple[Increments, Loaded]:
    """The increments in each interval of a counter that only increases, and where it restarted."""
    gained_ah = np.diff(counter_ah)
    is_anew = gained_ah < -_ROUNDING * counter_ah.max()
    return np.where(is_anew, counter_ah[1:], np.maximum(gained_ah, 0)), is_anew


def gain_ah(counter_ah: Charge) -> float:
    """The increase of a counter without its resets."""
    return float(np.sum(np.maximum(np.diff(counter_ah), 0)))


def decimal_step(values: Charge) -> float:
    """The largest power of ten of which all values are multiples, in single precision."""
    # An evenly spaced subset gives the same.
    values = values[:: 1 + len(values) // _ENOUGH]
    for digits in range(9):
        scaled = np.abs(values) * 10.0**digits
        # The few microampere-hours of a coin cell are not integers merely because they are small.
        if np.all(np.abs(scaled - np.round(scaled)) <= 1e-6 * (min(1, scaled.max()) + scaled)):
            return 10.0**-digits
    return 0.0
