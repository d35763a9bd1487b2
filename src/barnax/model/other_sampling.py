"""The circuit that would be identified if a logger sampled the current differently, in closed form.

On an even clock, a pair R, tau responds in its sample by R w and looks like R q under a current
that flows after the sample. With a = exp(-T / tau), w is 0 and q is 1 in that case, 1 - a and a
under a current that flowed before the sample; and in between if it is a share of both.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..cell import CircuitParameters
from ..cell.elements import Rung, rungs_of
from ..records import Hold
from ..records.record import EARLIER_SHARE
from .exponentials import AT_ONCE
from .prepared import PreparedRecord
from .reference import simulate_circuit

# A pair that leaves less than this share of its response after a sample is invisible under a
# current that flowed before.
GONE = 0.02
# A pair faster than this is part of R0, however fast the log.
FASTEST_TAU_S = 2.0
# R0 is at least this share of the voltage step at a current step: the contribution of pairs within
# a sampling interval is less, even with a minute.
LEAST_SHARE = 1 / 3
# Circuits fitted with the other sampling have moved R0 by up to this share more than the closed
# form.
SHORT = 0.15


def other_sampling(sampling: str) -> Hold:
    """The alternative to an assumed sampling."""
    return "backward" if sampling == "forward" else "forward"


def resampled_share(prepared: PreparedRecord) -> float | None:
    """The charge that the simulated part of a record would span with the other sampling, as a share
    of the actual span; None if its sampling is not merely assumed."""
    record, hold = prepared.record, prepared.record.hold
    other = replace(record, hold=replace(hold, value=other_sampling(hold.value)))
    other_ah, span_ah = (np.ptp(one.discharged_ah[prepared.span]) for one in (other, record))
    return float(other_ah / span_ah) if hold.strength == "assumed" and span_ah else None


@dataclass(frozen=True)
class Resampling:
    """The change of a circuit under the other sampling of the current, if the sampling is merely
    assumed.

    Attributes:
        r0_ohm: Increase of R0.
        shares: Relative increase of the resistance of every RC pair.
    """

    r0_ohm: float
    shares: Mapping[str, float]

    @property
    def most_ohm(self) -> float:
        """The largest increase of R0: the closed form is first-order."""
        return (1 + SHORT) * self.r0_ohm


def assumed_in(records: Sequence[PreparedRecord]) -> PreparedRecord | None:
    """The first record whose sampling is merely assumed."""
    assumed = (one for one in records if one.record.hold.strength == "assumed")
    return next(assumed, None)


def least_r0_share(records: Sequence[PreparedRecord]) -> float:
    """The least possible R0 over the identified one, if that hides a pair; 1 if samples would
    resolve it.

    A pair that ends before the next sample responds like R0 to a current that flowed before its
    sample, unless it is so fast that it counts as R0 anyway. Under a current known to flow after
    its sample, R0 responds before any pair.
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
    """The change with the other sampling; None if that of all records is known.

    Args:
        records: The records that the circuit was fitted to.
        circuit: Elements and time constants.
        ohm: The resistance of every element by name.
    """
    prepared = assumed_in(records)
    if prepared is None:
        return None
    other = other_sampling(prepared.record.hold.value)
    moved_ohm = shift_ohm(prepared, other, circuit, ohm)
    moved_ohm += source_shift_ohm(prepared, other, circuit)
    return Resampling(moved_ohm, resistance_shares(prepared, other, circuit))


def means_shifts_ohm(
    records: Sequence[PreparedRecord], circuit: CircuitParameters, ohm: Mapping[str, float]
) -> tuple[float, ...]:
    """Possible errors of R0 if rows are taken for means, whose current is half that of the interval
    before and half that of the one after: the change for a current that was constant in each of
    them, in either direction, because its course within a row is unknown."""
    prepared = assumed_in(records) or records[0]
    if prepared.record.hold.value != "centered":
        return ()
    moved_ohm = shift_ohm(prepared, "means", circuit, ohm)
    return moved_ohm, -moved_ohm


def _responses(
    prepared: PreparedRecord, other: str, circuit: CircuitParameters, least: float = 0.0
) -> Iterator[tuple[Rung, tuple[float, float], tuple[float, float]]]:
    """Every RC pair with its `_response` by the record's sampling and by another; at least `least`
    of it is left after an interval."""
    for pair in rungs_of(circuit.elements):
        tau_s = circuit.tau_s[pair.element] * pair.ratio
        kept = max(math.exp(-prepared.median_interval_s / tau_s), least)
        yield pair, _response(prepared.record.hold.value, kept), _response(other, kept)


def shift_ohm(
    prepared: PreparedRecord, other: str, circuit: CircuitParameters, ohm: Mapping[str, float]
) -> float:
    """The change of R0 in ohm between samplings.

    Args:
        prepared: A record with the sampling with which the circuit was fitted.
        other: Another, or "means": of a current that was constant in each row.
        circuit: Elements and time constants.
        ohm: The resistance of every element by name.
    """
    # For a mixture, pairs far faster than the sampling move to R0 as a whole.
    is_mixed = any(pair.share != 1 for pair in rungs_of(circuit.elements))
    moved_ohm = 0.0
    least = 0.5 if is_mixed else math.exp(-AT_ONCE)
    for pair, first, others in _responses(prepared, other, circuit, least):
        whole_ohm = ohm[circuit.names[pair.element].resistance] * pair.share
        moved_ohm += whole_ohm * (first[0] - first[1] / others[1] * others[0])
    return moved_ohm


def source_shift_ohm(prepared: PreparedRecord, other: str, circuit: CircuitParameters) -> float:
    """The change of R0 in ohm due to the OCV, and a hysteresis that depends on it, moving with the
    charge of an interval: a sample's current removes that before it appears in the sample. It is
    the regression of that voltage's steps on the current that flows meanwhile."""
    before = {"forward": 0.0, "centered": 1 - EARLIER_SHARE, "backward": 1.0}
    if prepared.hysteresis_amplitude_v is None:
        # A hysteresis that switches with the current does so whatever current came before.
        source_v = prepared.cell.average_ocv_v(prepared.soc)
    else:
        still = {name: 1e-9 * np.asarray(circuit.tables[name]) for name in circuit.resistances}
        source_v = simulate_circuit(prepared, circuit.with_tables(still))
    is_usual = np.diff(prepared.time_s) < 1.5 * prepared.median_interval_s
    steps_v, flowing_a = np.diff(source_v)[is_usual], prepared.held_a[:-1][is_usual]
    flowing_a = flowing_a - flowing_a.mean()
    ohm = -(steps_v @ flowing_a) / max(flowing_a @ flowing_a, np.finfo(float).tiny)
    return float(ohm * (before[prepared.record.hold.value] - before[other]))


def resistance_shares(
    prepared: PreparedRecord, other: str, circuit: CircuitParameters
) -> dict[str, float]:
    """The relative increase of the resistance of every RC pair that gives the same response in
    later samples. Elements of several pairs are omitted."""
    shares = {}
    for pair, (_, first), (_, others) in _responses(prepared, other, circuit):
        # A response that ends within a sample appears in no later one.
        if pair.share == 1 and others > GONE:
            shares[circuit.names[pair.element].resistance] = first / others - 1
    return shares


def _response(sampling: str, kept: float) -> tuple[float, float]:
    """A pair's response in its own sample, and its apparent size under a current that flows after
    it, as shares of it; `kept` is the share left after an interval."""
    if sampling == "centered":
        first = (1 - EARLIER_SHARE) * (1 - kept)
        return first, 1 - first
    if sampling == "means":
        later = (1 - kept) / -math.log(kept) if 0 < kept < 1 else 1 - kept
        return 1 - later, later
    return (0.0, 1.0) if sampling == "forward" else (1 - kept, kept)
