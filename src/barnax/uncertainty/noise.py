"""The noise behind a fit's residuals: its strength and its correlation times.

Voltage errors of a battery model are correlated over hundreds of seconds, so that 20,000 samples
contain no more information than a few dozen would. Here they are modeled as stationary noise: a
white part and parts whose correlation decays exponentially, with times from one sampling interval
to a quarter of the record. The parts' variances are fitted to the autocovariance of the residuals,
nonnegative, up to lags of half the record, each lag weighted by the joint scatter of the
autocovariances under the noise of a plain fit (generalized least squares; Aitken, 1936). With
several records the longest sets these times, and none is correlated with another.

A fit follows slow noise and so leaves too little of it in its residuals. This is undone: instead of
each part's autocovariance, its expected value after the projection I - Q Q' onto the residuals is
fitted (to first order in the parameters). Long correlations are otherwise understated, by a quarter
and more at a tenth of the record. The size of a part that the fit has followed almost wholly is not
determined: it is shrunk toward zero, as by a prior whose deviation is `LARGEST_PART` times the
residuals' variance (Hoerl and Kennard, 1970).
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy.fft import irfft, rfft
from scipy.linalg import get_lapack_funcs
from scipy.optimize import nnls

from ..metrics import t_quantile

# Correlation times per decade, up to this share of the record, and lags per octave, up to that
# share: twice as many change the intervals by less than their own spread between records.
TIMES_PER_DECADE = 3
LONGEST_TIME = 1 / 4
LAGS_PER_OCTAVE = 2
LONGEST_LAG = 1 / 2
LARGEST_PART = 6.0
# The scatter of the autocovariances is computed from a noise that is itself uncertain: each gets an
# additional error of this share of its own, and of the largest error, so that none counts as known.
SHARE_OF_ERROR, OF_LARGEST = 0.3, 0.01
# A lag with less than this share of the pairs of samples of an even clock has less weight.
FEW_PAIRS = 1 / 2
# Noises drawn if samples come in bursts, and the most slots that they are drawn in.
DRAWS = 100
MAX_DRAWN = 2**17
# Clocks with more intervals per record than this are read in coarser slots.
MAX_SLOTS = 2**19


@dataclass(frozen=True, eq=False)
class Noise:
    """A fitted noise, and its effect on the coordinates of a projection.

    `correlation_s` holds each part's correlation time, 0 for the white one, `variance_v2` its
    variance. `spread_v2` is the covariance of Q' u, u being the noise and Q the projection's
    orthonormal columns. `autocorrelation` is that of the residuals, at `lags_s`.
    """

    correlation_s: Float[np.ndarray, "parts"]
    variance_v2: Float[np.ndarray, "parts"]
    lags_s: Float[np.ndarray, "lags"]
    autocorrelation: Float[np.ndarray, "lags"]
    parts_spread: Float[np.ndarray, "parts columns columns"]
    _design: Float[np.ndarray, "bins parts"]
    _whitening: Float[np.ndarray, "bins bins"]
    _scatter_v4: Float[np.ndarray, "bins bins"]
    _edges: Int[np.ndarray, "edges"]
    _counts: Float[np.ndarray, "slots"]
    _autocovariance: Float[np.ndarray, "slots"]
    _columns: Float[np.ndarray, "slots columns"]
    _padded: int

    @cached_property
    def spread_v2(self) -> Float[np.ndarray, "columns columns"]:
        return np.tensordot(self.variance_v2, self.parts_spread, axes=1)

    def reach(
        self, direction: Float[np.ndarray, "columns"], beside: float = 0.0, most: float = 1e6
    ) -> tuple[float, float, float]:
        """The standard error of `direction` . Q' u with another variance `beside` added to the
        noise's, half its interval, and its degrees of freedom (Satterthwaite, 1946), limited."""
        of_noise = float(direction @ self.spread_v2 @ direction)
        variance = of_noise + beside
        more = (variance / of_noise) ** 2 if of_noise > 0 else math.inf
        freedom = max(1.0, min(more * self.degrees_of_freedom(direction), most))
        error = math.sqrt(max(variance, 0.0))
        return error, t_quantile(freedom) * error, freedom

    def correlation_time_s(self, interval_s: float) -> float:
        """The integrated autocorrelation time: over it, the noise is worth one sample."""
        total = float(self.variance_v2.sum())
        if total == 0:
            return interval_s
        # The sum of exp(-|lag| / time) over all lags is coth(interval / 2 time).
        with np.errstate(divide="ignore"):
            sums = 1 / np.tanh(interval_s / (2 * self.correlation_s))
        return interval_s * float(self.variance_v2 @ sums) / total

    def degrees_of_freedom(self, direction: Float[np.ndarray, "columns"]) -> float:
        """Degrees of freedom of the variance of `direction` . Q' u.

        Satterthwaite (1946): twice its square over its own variance. That of a linear function of
        the autocovariances is known unless samples come in bursts and the fit has followed much of
        the little there is: then noises are drawn and fitted again.
        """
        shares = np.einsum("i,pij,j->p", direction, self.parts_spread, direction)
        variance = float(shares @ self.variance_v2)
        if variance <= 0:
            return math.inf
        if self._is_bursty:
            drawn = self._drawn @ shares
            return 2 * float(np.mean(drawn) ** 2 / np.var(drawn))
        used = shares[self.variance_v2 > 0]
        return 2 * variance**2 / float(used @ self._uncertainty @ used)

    @property
    def _is_bursty(self) -> bool:
        """True if samples effectively fill less than half of not too many slots."""
        counts = self._counts
        is_uneven = counts.sum() ** 2 < len(counts) / 2 * (counts @ counts)
        return is_uneven and len(counts) <= MAX_DRAWN

    @cached_property
    def _uncertainty(self) -> Float[np.ndarray, "used used"]:
        """The covariance of the variances of the parts in use."""
        rows = _with_prior(self._whitening @ self._design)[:, self.variance_v2 > 0]
        by_bin = np.linalg.pinv(rows)[:, : len(self._whitening)] @ self._whitening
        return by_bin @ self._scatter_v4 @ by_bin.T

    @cached_property
    def _drawn(self) -> Float[np.ndarray, "draws parts"]:
        """The parts' variances refitted to the residuals of noises drawn like this one."""
        rng, white_v2 = np.random.default_rng(0), self.variance_v2[0]
        counts, columns, unit_v2 = self._counts, self._columns, self.variance_v2.sum()
        correlated = np.append(self._autocovariance[0] - white_v2, self._autocovariance[1:])
        amplitude = np.sqrt(np.maximum(_mirrored_spectrum(correlated, self._padded), 0.0))
        white = np.sqrt(white_v2 * counts)
        mean = columns / np.maximum(counts, 1.0)[:, None]
        # White noise moves the coordinates by its sums in slots and by its variation within them.
        values, vectors = np.linalg.eigh(self.parts_spread[0] - columns.T @ mean)
        within = vectors * np.sqrt(white_v2 * np.maximum(values, 0.0))
        drawn = np.empty((DRAWS, len(self.variance_v2)))
        for row in drawn:
            noise = irfft(amplitude * rfft(rng.normal(size=self._padded)), self._padded)
            sums = counts * noise[: len(counts)] + white * rng.normal(size=len(counts))
            followed = mean.T @ sums + within @ rng.normal(size=len(values))
            power = np.abs(rfft(sums - columns @ followed, self._padded)) ** 2
            measured = _binned(irfft(power, self._padded)[: len(counts)], self._edges)
            row[:] = unit_v2 * _variances(self._design, measured / unit_v2, self._whitening)
        return drawn


def fit_noise(
    error_v: Float[np.ndarray, "samples"],
    columns: Float[np.ndarray, "samples columns"],
    time_s: Float[np.ndarray, "samples"],
    longest_s: float | None = None,
    max_slots: int = MAX_SLOTS,
) -> Noise:
    """The noise that left `error_v` as residuals of a least-squares fit.

    `columns` are orthonormal and span all that the fit could follow. Samples may be uneven and have
    gaps: time is read in slots of the median interval, empty without a sample. `longest_s` is the
    duration of the longest of several records on one clock, further apart than that; without it all
    is one record.
    """
    slots = Slots.of(time_s, longest_s, max_slots)
    (noise,) = fit_gathered(
        slots,
        counts=slots.gathered(time_s, np.ones(len(time_s))),
        errors_v=slots.gathered(time_s, error_v[:, None]),
        columns=slots.gathered(time_s, columns),
        squares_v2=np.array([error_v @ error_v]),
    )
    return noise


@dataclass(frozen=True)
class Slots:
    """Even slots of time in which samples are gathered; the longest record has `reach` of them.

    A clock finer than `max_slots` is read in coarser ones.
    """

    start_s: float
    slot_s: float
    count: int
    reach: int

    @classmethod
    def of(
        cls,
        time_s: Float[np.ndarray, "samples"],
        longest_s: float | None = None,
        max_slots: int = MAX_SLOTS,
    ) -> "Slots":
        """The slots of a clock."""
        interval_s = float(np.median(np.diff(time_s), overwrite_input=True))
        slot_s = max(interval_s, (time_s[-1] - time_s[0]) / (max_slots - 1))
        count = int(np.floor((time_s[-1] - time_s[0]) / slot_s + 0.5)) + 1
        reach = count if longest_s is None else min(math.floor(longest_s / slot_s + 0.5) + 1, count)
        return cls(float(time_s[0]), float(slot_s), count, reach)

    def gathered(
        self, time_s: Float[np.ndarray, "samples"], values: Float[np.ndarray, "samples *columns"]
    ) -> Float[np.ndarray, "slots *columns"]:
        """The sums of the samples' values in every slot, for rising times."""
        slot = np.floor((time_s - self.start_s) / self.slot_s + 0.5).astype(int)
        first = np.flatnonzero(np.diff(slot, prepend=-1))
        sums = np.zeros((self.count, *values.shape[1:]))
        is_single = len(first) == len(values)
        sums[slot[first]] = values if is_single else np.add.reduceat(values, first, axis=0)
        return sums


def fit_gathered(
    slots: Slots,
    *,
    counts: Float[np.ndarray, "slots"],
    errors_v: Float[np.ndarray, "slots voltages"],
    columns: Float[np.ndarray, "slots columns"],
    squares_v2: Float[np.ndarray, "voltages"],
) -> list[Noise]:
    """The noise from sums over slots: the number of samples, and the sums of their errors and
    columns; one for each of several voltages that share the columns. `squares_v2` are the errors'
    sums of squares.
    """
    slot_s, reach, samples = slots.slot_s, slots.reach, float(counts.sum())
    padded = 1 << (2 * slots.count - 2).bit_length()
    lag = np.arange(slots.count)
    edges = _lag_edges(reach)
    count = max(1, math.ceil(TIMES_PER_DECADE * math.log10(max(reach * LONGEST_TIME, 2))))
    times = np.geomspace(1, max(reach * LONGEST_TIME, 2), count + 1)
    pairs = irfft(np.abs(rfft(counts, padded)) ** 2, padded)[: slots.count]

    def decay(time: float) -> Float[np.ndarray, "slots"]:
        return np.where(lag < reach, np.exp(-lag / time), 0.0)

    # Most slots of a clock that is fast in bursts are empty, and add nothing.
    filled = np.flatnonzero(counts)
    rows, gaps = columns[filled], np.diff(filled).astype(float)
    # Records are further apart than the longest is long.
    gaps[gaps >= reach] = np.inf
    width = columns.shape[1]
    spread = np.empty((len(times) + 1, width, width))
    spread[0] = np.eye(width)
    within = np.empty((len(edges) - 1, width, width))
    crossed = np.zeros((len(edges) - 1, len(times)))
    for index, column in enumerate(np.ascontiguousarray(columns.T)):
        smoothed = np.stack([summed(column[filled], gaps / time) for time in times])
        spread[1:, :, index] = smoothed @ rows
        apart = _at_lags(column, edges, filled)
        within[:, :, index] = apart @ rows
        crossed += apart @ (smoothed * counts[filled]).T
    white = -np.einsum("bii->b", within)
    white[0] += samples
    taken = np.einsum("bij,pij->bp", within, spread[1:]) - 2 * crossed
    of_parts = [_binned(pairs * decay(time), edges) for time in times]
    expected = np.column_stack([white, np.transpose(of_parts) + taken])

    # Every bin has the same weight, as the mean over its pairs, except for lags without a pair of
    # samples and for bins with few pairs on an uneven clock, which have less.
    total_pairs = _binned(pairs, edges)
    even_pairs = _binned((samples / slots.count) ** 2 * (slots.count - lag), edges)
    fewest = np.maximum(FEW_PAIRS * even_pairs, 0.5)
    weight = np.where(total_pairs > 0.5, 1 / np.maximum(total_pairs, fewest), 0.0)
    has_pairs = weight > 0

    def autocovariance_of(variance: Float[np.ndarray, "parts"]) -> Float[np.ndarray, "slots"]:
        by_lag = np.zeros(slots.count)
        by_lag[0] = variance[0]
        for part, time in zip(variance[1:], times, strict=True):
            by_lag += part * decay(time) if part else 0.0
        return by_lag

    def noise_of(error_v: Float[np.ndarray, "slots"], unit_v2: float) -> Noise:
        power = np.abs(rfft(error_v, padded)) ** 2
        measured = _binned(irfft(power, padded)[: slots.count], edges) / (unit_v2 or 1.0)
        whitening, scatter = np.diag(weight), np.zeros((len(weight), len(weight)))
        variance = _variances(expected, measured, whitening)
        if unit_v2 > 0:
            by_lag = autocovariance_of(variance)
            spectrum = np.maximum(_mirrored_spectrum(pairs * by_lag, padded), 0.0)
            scatter = _scatter(irfft(spectrum**2, padded), edges) / len(filled)
            weighed = weight[:, None] * scatter * weight
            diagonal = np.diag(weighed)
            weighed += np.diag(SHARE_OF_ERROR**2 * diagonal + OF_LARGEST**2 * diagonal.max())
            whitening = np.linalg.inv(np.linalg.cholesky(weighed)) * weight
            variance = _variances(expected, measured, whitening)
        return Noise(
            correlation_s=np.append(0.0, slot_s * times),
            variance_v2=unit_v2 * variance,
            lags_s=slot_s * (edges[:-1] + np.diff(edges) / 2 - 0.5)[has_pairs],
            autocorrelation=(measured * weight)[has_pairs],
            parts_spread=spread,
            _design=expected,
            _whitening=whitening,
            _scatter_v4=unit_v2**2 * scatter,
            _edges=edges,
            _counts=counts,
            _autocovariance=unit_v2 * autocovariance_of(variance),
            _columns=columns,
            _padded=padded,
        )

    units_v2 = (squares_v2 / samples).tolist()
    return [noise_of(*voltage) for voltage in zip(errors_v.T, units_v2, strict=True)]


def _with_prior(design: Float[np.ndarray, "bins parts"]) -> Float[np.ndarray, "rows parts"]:
    """A weighted design with a row for each correlated part that draws it toward zero."""
    return np.vstack([design, np.eye(design.shape[1])[1:] / LARGEST_PART])


def _variances(
    design: Float[np.ndarray, "bins parts"],
    measured: Float[np.ndarray, "bins"],
    whitening: Float[np.ndarray, "bins bins"],
) -> Float[np.ndarray, "parts"]:
    """The parts' variances that best explain the autocovariances, none negative."""
    rows = _with_prior(whitening @ design)
    return nnls(rows, np.pad(whitening @ measured, (0, len(rows) - len(measured))))[0]


def _scatter(
    by_lag: Float[np.ndarray, "padded"], edges: Int[np.ndarray, "edges"]
) -> Float[np.ndarray, "bins bins"]:
    """The sums of q(l - m) + q(l + m) over the lags l of one bin and m of another.

    The autocovariances at l and m covary by that over the number of samples, q being the transform
    of the squared spectrum (Bartlett, 1946). Over bins it is the second difference of its second
    sum.
    """
    once = np.cumsum(by_lag[: 2 * edges[-1]]) - by_lag[0] / 2
    twice = np.append(0.0, np.cumsum(once))
    first, last = edges[:-1], edges[1:]

    def over(starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Over l of a bin and m from a start to before an end."""

        def at(lag: np.ndarray, other: np.ndarray) -> np.ndarray:
            return twice[np.abs(lag[:, None] - other)]

        return at(last, starts) - at(first, starts) - at(last, ends) + at(first, ends)

    return over(first, last) + over(1 - last, 1 - first)


def _lag_edges(reach: int) -> Int[np.ndarray, "edges"]:
    """First lag of every bin and the end of the last: 0, 1, 2, then ever wider."""
    last = max(int(reach * LONGEST_LAG), 2)
    edges = [0, 1]
    while edges[-1] < last:
        edges.append(math.ceil(edges[-1] * 2 ** (1 / LAGS_PER_OCTAVE) + 0.1))
    return np.array([*edges[:-1], last] if edges[-2] < last else edges[:-1])


def _binned(by_lag: np.ndarray, edges: np.ndarray) -> np.ndarray:
    return np.add.reduceat(by_lag[..., : edges[-1]], edges[:-1], axis=-1)


def summed(
    values: Float[np.ndarray, "samples *columns"], steps: Float[np.ndarray, "steps"]
) -> Float[np.ndarray, "samples *columns"]:
    """The sums of all values, weighted by exp(-distance); `steps` are the distances from each
    sample to the next.

    The inverse of that matrix is tridiagonal, and so are its factors L D L'.
    """
    diagonal = np.append(-1 / np.expm1(-2 * steps), 1.0)
    solve: Any = get_lapack_funcs("pttrs", (values,))
    return solve(diagonal, -np.exp(-steps), values)[0]


def _at_lags(
    values: Float[np.ndarray, "slots"],
    edges: Int[np.ndarray, "edges"],
    chosen: Int[np.ndarray, "chosen"],
) -> Float[np.ndarray, "bins chosen"]:
    """The mean of the values before and after each chosen slot at the lags of every bin, summed."""
    last = edges[-1]
    sums = np.append(0.0, np.cumsum(np.pad(values / 2, last)))
    within = np.empty((len(edges) - 1, len(chosen)))
    nearer = -values[chosen] / 2
    for index, edge in enumerate(edges[1:]):
        near = sums[chosen + (last + edge)] - sums[chosen + (last - edge + 1)]
        np.subtract(near, nearer, out=within[index])
        nearer = near
    return within


def _mirrored_spectrum(by_lag: np.ndarray, padded: int) -> np.ndarray:
    """The transform of a function of the absolute lag."""
    mirrored = np.zeros(padded)
    mirrored[: len(by_lag)] = by_lag
    mirrored[padded - len(by_lag) + 1 :] = by_lag[:0:-1]
    return rfft(mirrored).real
