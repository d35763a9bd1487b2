"""What a circuit would be if a logger sampled the current otherwise, by the closed form.

On an even clock a pair R, tau answers in its sample by R w and is one of R q under a current that
flows after it; with a = exp(-T / tau), w is 0 and q is 1 there, 1 - a and a under one that flowed
before it; between these where it is a share of both.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..cell import CircuitParameters
from ..cell.elements import rungs_of
from ..records import Hold
from ..records.record import EARLIER_SHARE
from .exponentials import AT_ONCE
from .prepared import PreparedRecord
from .reference import simulate_circuit

# A pair that leaves less of itself after a sample is not seen under a current that flowed before.
GONE = 0.02
# A pair faster than this is part of R0, however fast the log.
FASTEST_TAU_S = 2.0
# Of the voltage step at a current step, R0 is at least this share: what a sampling interval lets
# pairs add is less, even of a minute.
LEAST_SHARE = 1 / 3
# Circuits fitted with the other sampling have moved R0 by up to so much more than the closed form.
SHORT = 0.15


def other_sampling(sampling: str) -> Hold:
    """The sampling that is tried beside one that is assumed."""
    return "backward" if sampling == "forward" else "forward"


def resampled_share(prepared: PreparedRecord) -> float | None:
    """The charge that the simulated part of a record would span with the other sampling, as a share
    of what it does; None where its sampling is not only assumed."""
    record, hold = prepared.record, prepared.record.hold
    other = replace(record, hold=replace(hold, value=other_sampling(hold.value)))
    other_ah, span_ah = (np.ptp(one.discharged_ah[prepared.span]) for one in (other, record))
    return float(other_ah / span_ah) if hold.strength == "assumed" and span_ah else None


@dataclass(frozen=True)
class Resampling:
    """The change of a circuit under the other sampling of the current, where one is only assumed.

    Attributes:
        r0_ohm: By how much R0 would be more.
        shares: By what share of itself the resistance of every RC pair would be more.
    """

    r0_ohm: float
    shares: Mapping[str, float]

    @property
    def most_ohm(self) -> float:
        """By how much R0 would be more at most: the closed form is of the first order."""
        return (1 + SHORT) * self.r0_ohm


def assumed_in(records: Sequence[PreparedRecord]) -> PreparedRecord | None:
    """The first record whose sampling is only assumed."""
    assumed = (one for one in records if one.record.hold.strength == "assumed")
    return next(assumed, None)


def least_r0_share(records: Sequence[PreparedRecord]) -> float:
    """The least share of R0 that may be without a pair; 1 where the samples would show it.

    A pair that is over before the next sample answers to a current that flowed before its own as R0
    does, unless it is so fast that it counts as R0 anyway. Under a current that is known to flow
    after its sample, R0 answers before any pair.
    """
    for prepared in records:
        hold = prepared.record.hold
        is_before_pairs = hold.value == "forward" and hold.strength != "assumed"
        if is_before_pairs or math.exp(-prepared.dense_interval_s / FASTEST_TAU_S) > GONE:
            return 1.0
    return LEAST_SHARE


def resampling(
    records: Sequence[PreparedRecord], circuit: CircuitParameters, ohm: Mapping[str, float]
) -> Resampling | None:
    """The change by the other sampling; None where that of all records is known.

    Args:
        records: Those that the circuit was fitted to.
        circuit: Its elements and time constants.
        ohm: The resistance of every element by name.
    """
    prepared = assumed_in(records)
    if prepared is None:
        return None
    sampling, interval_s = prepared.record.hold.value, prepared.median_interval_s
    other = other_sampling(sampling)
    moved_ohm = shift_ohm(sampling, other, circuit, ohm, interval_s)
    moved_ohm += source_shift_ohm(sampling, other, prepared, circuit)
    return Resampling(moved_ohm, resistance_shares(sampling, other, circuit, interval_s))


def means_shifts_ohm(
    records: Sequence[PreparedRecord], circuit: CircuitParameters, ohm: Mapping[str, float]
) -> tuple[float, ...]:
    """Possible errors of R0 where rows are taken for means, whose current is half that of the
    interval before and half that of the one after: as it would be for a current that stood still in
    each of them, to either side, for what it does in them is not known."""
    prepared = assumed_in(records) or records[0]
    sampling = prepared.record.hold.value
    if sampling != "centered":
        return ()
    moved_ohm = shift_ohm(sampling, "means", circuit, ohm, prepared.median_interval_s)
    return moved_ohm, -moved_ohm


def shift_ohm(
    sampling: str,
    other: str,
    circuit: CircuitParameters,
    ohm: Mapping[str, float],
    interval_s: float,
) -> float:
    """By how much R0 would be another.

    Args:
        sampling: That with which the circuit was fitted.
        other: Another, or "means": of a current that stood still in each row.
        circuit: Its elements and time constants.
        ohm: The resistance of every element by name.
        interval_s: That of the clock.
    """
    pairs = rungs_of(circuit.elements)
    # Of a mixture, what is far faster than the sampling moves to R0 as a whole.
    least = math.exp(-AT_ONCE) if all(pair.share == 1 for pair in pairs) else 0.5
    moved_ohm = 0.0
    for pair in pairs:
        kept = max(math.exp(-interval_s / (circuit.tau_s[pair.element] * pair.ratio)), least)
        first, others = _answer(sampling, kept), _answer(other, kept)
        whole_ohm = ohm[circuit.names[pair.element].resistance] * pair.share
        moved_ohm += whole_ohm * (first[0] - first[1] / others[1] * others[0])
    return moved_ohm


def source_shift_ohm(
    sampling: str, other: str, prepared: PreparedRecord, circuit: CircuitParameters
) -> float:
    """By how much R0 would be another for what an interval's charge moves of the OCV and of a
    hysteresis that follows it: a sample's current takes this out before it shows in the sample. It
    is the regression of that voltage's steps on the current that flows meanwhile."""
    before = {"forward": 0.0, "centered": 1 - EARLIER_SHARE, "backward": 1.0}
    if prepared.hysteresis_amplitude_v is None:
        # A hysteresis that switches with the current does so whatever flowed before.
        source_v = prepared.cell.average_ocv_v(prepared.soc)
    else:
        still = {name: 1e-9 * np.asarray(circuit.tables[name]) for name in circuit.resistances}
        source_v = simulate_circuit(prepared, circuit.with_tables(still))
    is_usual = np.diff(prepared.time_s) < 1.5 * prepared.median_interval_s
    steps_v, flowing_a = np.diff(source_v)[is_usual], prepared.held_a[:-1][is_usual]
    flowing_a = flowing_a - flowing_a.mean()
    ohm = -(steps_v @ flowing_a) / max(flowing_a @ flowing_a, np.finfo(float).tiny)
    return float(ohm * (before[sampling] - before[other]))


def resistance_shares(
    sampling: str, other: str, circuit: CircuitParameters, interval_s: float
) -> dict[str, float]:
    """By what share of itself the resistance of every RC pair would be more, under which it answers
    alike in later samples. Not of elements of several pairs."""
    shares = {}
    for pair in rungs_of(circuit.elements):
        kept = math.exp(-interval_s / (circuit.tau_s[pair.element] * pair.ratio))
        first, others = (_answer(each, kept)[1] for each in (sampling, other))
        # What is gone within a sample shows in no later one.
        if pair.share == 1 and others > GONE:
            shares[circuit.names[pair.element].resistance] = first / others - 1
    return shares


def _answer(sampling: str, kept: float) -> tuple[float, float]:
    """A pair's answer in its own sample, and what it is under a current that flows after it,
    as shares of it; `kept` is what an interval leaves of it."""
    if sampling == "centered":
        first = (1 - EARLIER_SHARE) * (1 - kept)
        return first, 1 - first
    if sampling == "means":
        later = (1 - kept) / -math.log(kept) if 0 < kept < 1 else 1 - kept
        return 1 - later, later
    return (0.0, 1.0) if sampling == "forward" else (1 - kept, kept)
