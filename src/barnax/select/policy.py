"""The one rule by which a richer circuit is better than a simpler one.

Samples are held out in short blocks, five folds over all records together. S_b is the mean square
of the held-out errors of block b, S_k that of all samples of band k of SOC. With B blocks and K
bands the loss is

    L = 1 / (2 B) sum_b log S_b + 1 / (2 K) sum_k log S_k

so that no single block or range of SOC dominates it. A richer circuit is better if it lowers L by
more than `standard_errors` times the standard error of the blocks' paired differences, each band's
to first order (the delta method). Chosen by experiment: `benchmarks/choice.py`.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..fit.cross_validation import HeldOut
from ..fit.flat_ocv import DISTINCT_RATES


@dataclass(frozen=True)
class Policy:
    """The numbers of the rule.

    Args:
        standard_errors: Required gain of a richer circuit in standard errors of that gain.
        least_gain: Least gain in addition: 1.5 % of the error does not justify another circuit.
        least_gain_of_hysteresis: Least gain of a hysteresis, a tenth of the error, with an OCV
            test: its gap is in part the polarization of its sweeps.
        floor_v: Added to every error, because voltmeters do not resolve it.
        least_span_soc: Over less SOC than this, nodes contain no information about the cell.
        widest: Widest interval of a law's numbers, in decades.
        fastest_rate: A hysteresis that turns faster, within 1 % SOC, cannot be distinguished from
            resistances that fall with the current.
        slowest_rate: One that turns more slowly than this, over 10 % SOC, cannot be distinguished
            from a fitted OCV.
    """

    standard_errors: float = 1.5
    least_gain: float = 0.03
    least_gain_of_hysteresis: float = 0.2
    floor_v: float = 1e-4
    least_span_soc: float = 0.3
    widest: float = 1.0
    fastest_rate: float = 0.95 * DISTINCT_RATES[1]
    slowest_rate: float = 1.05 * DISTINCT_RATES[0]

    def gain(self, simpler: HeldOut, richer: HeldOut) -> "Gain":
        """The reduction of the loss by a richer circuit."""
        is_block = simpler.counts[:, 0] > 0
        counts = simpler.counts[is_block]
        one_v2, other_v2 = (
            loss.squares_v2[is_block] + counts * self.floor_v**2 for loss in (simpler, richer)
        )
        by_block = np.log(one_v2[:, 0] / other_v2[:, 0])
        seen = counts.any(axis=0)
        sums_v2 = one_v2[:, seen].sum(axis=0), other_v2[:, seen].sum(axis=0)
        value = np.mean(by_block) / 2 + np.mean(np.log(sums_v2[0] / sums_v2[1])) / 2
        # The contribution of every block, its share of a band's sum of squares.
        shares = one_v2[:, seen] / sums_v2[0] - other_v2[:, seen] / sums_v2[1]
        adds = by_block / 2 + len(by_block) * np.mean(shares, axis=1) / 2
        error = np.std(adds, ddof=1) / math.sqrt(len(adds)) if len(adds) > 1 else math.inf
        return Gain(float(value), float(error))

    def is_better(self, gain: "Gain") -> bool:
        """True if a richer circuit is preferred."""
        return gain.value > max(self.standard_errors * gain.standard_error, self.least_gain)


@dataclass(frozen=True)
class Gain:
    """The reduction of a loss relative to another, in logarithms of a mean square; its standard
    error."""

    value: float
    standard_error: float
