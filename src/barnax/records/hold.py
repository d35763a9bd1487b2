"""When a sample's current flowed: in the interval after it, the one before it, or half of both.

Testers that log a sample at the end of its interval (Arbin) can be recognized by their ampere-hour
counters: the increments follow the current of the interval's last sample. A column with the mean
current of the interval before the row has a name that says so.

The rows of a slow log are means over their intervals or instantaneous samples, if the load changes
between them. With instantaneous samples the charge between them is unknown, so the voltage drifts
away from the logged current and stays there: the differences between rows that a circuit leaves are
innovations. With means the charge is right, and what remains is independent for each row, as noise
is: its differences have a correlation of -1/2 with the next.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ..errors import counted
from ..settings import AutoHold
from .counters import inner
from .lag import lagged
from .logger import SOMETIMES, Decision, Logger, SamplingEvidence, SlowRows
from .record import Record
from .samples import STEADY_SHARE, Samples, changes_through_values_between

Increments = Float[np.ndarray, "intervals"]
Rows = Float[np.ndarray, "rows"]
# Ah of intervals: as counted, and by the current of their last and their first sample.
Ledger = Float[np.ndarray, "3 intervals"]

# In a drive cycle that beats against the log, several dozen intervals in a row can look like either
# hold, so all intervals have to agree far better than those at changes of step.
_AT_CHANGES = {"fewest": 2, "margin": 0.5}
_ANYWHERE = {"fewest": 20, "margin": 0.05}
# One change of step is no proof, but is better evidence than the make of the file.
_AT_ONE = {"fewest": 1, "margin": 0.2}
_AGREEING = 0.8
# The share of intervals that may contain an undetected reset of a counter.
_FALLS = 0.05
# A log is slow from this interval on. A current differs from its neighbor if by this share of the
# largest.
_SLOW_S, _ALONE_SHARE = 2.5, 0.05


def decide_hold(evidence: SamplingEvidence, given: AutoHold, logger: Logger | None) -> Decision:
    """The record's hold: as given, else by its counters, else that of its logger."""
    if given == "auto":
        return (logger or Logger.of([evidence])).sampling(evidence)
    reason, proof = "given by the user", evidence.proof
    if proof is not None and proof.value != given:
        reason += f", although {proof.reason}"
    return Decision(given, "given", reason)


def sampled(record: Any, loggers: Mapping[tuple[str, ...], Logger]) -> Any:
    """The record with the sampling of its logger, unless it has stronger evidence of its own;
    anything but a record is returned unchanged."""
    evidence = record.evidence if isinstance(record, Record) else None
    logger = loggers.get(evidence.header) if evidence else None
    if evidence is None or logger is None:
        return record
    is_open = record.hold.strength == "assumed" or (record.hold.strength == "weak" and logger.proof)
    return replace(record, hold=logger.sampling(evidence)) if is_open else record


def sampled_as(record: Record, others: Sequence[Record]) -> Record:
    """The record with the sampling that the voltages of other records of its logger have decided,
    if its own is only assumed."""
    for other in others:
        is_decided = other.hold.strength == "weak" and record.hold.strength == "assumed"
        headers = [one.evidence and one.evidence.header for one in (record, other)]
        if is_decided and None not in headers and headers[0] == headers[1]:
            return replace(record, hold=other.hold)
    return record


def evidence_of(samples: Samples, name: str) -> SamplingEvidence:
    """The evidence of a record's samples about its logger."""
    proof, column = _from_counters(samples), samples.columns["current"]
    # "<I>/mA", or the charge of each interval.
    is_mean = column.header.startswith("<") or column.quantity.name == "charge of the interval"
    says = f"{samples.dialect.name} testers log a sample at its interval's end"
    says = f"'{column.header}' is the mean current since the row before" if is_mean else says
    is_open = proof is None or (is_mean and proof.strength != "strong")
    if is_open and (is_mean or samples.dialect.logs_at_end):
        proof = Decision("backward", "weak", says)
    return SamplingEvidence(samples.table.header.names, name, proof, slow_rows(samples))


def _from_counters(samples: Samples) -> Decision | None:
    """The hold with which the current integrates to the tester's counters, by a clear margin.

    At a change of the tester's step number the current switches in time with the log, so these
    intervals decide. Within a step that plays a drive cycle, the current switches on its own clock,
    anywhere between two samples, which proves neither hold; such intervals are used only if the
    file has no informative changes of step. If these prove nothing either, a single change of step
    decides, unless the other intervals contradict it.
    """
    telling, indices = _ledger(samples)
    apart_ah = np.abs(telling[1] - telling[2])
    if not apart_ah.any():
        return None
    # As shares, because the squares of absurd charges overflow.
    weight = (apart_ah / apart_ah.max()) ** 2
    fraction = float(np.average(_fractions(telling), weights=weight))
    step = np.zeros(len(samples)) if samples.step is None else samples.step
    at_changes = telling[:, step[indices + 1] != step[indices]]
    decision = _verdict(at_changes, "change", **_AT_CHANGES)
    decision = decision or _verdict(telling, "interval", **_ANYWHERE)
    if decision is None:
        lone = _verdict(at_changes, "change", **_AT_ONE)
        is_alike = lone is not None and (fraction > 0.5) == (lone.value == "backward")
        return replace(lone, strength="weak") if lone is not None and is_alike else None
    if not 0.25 < fraction < 0.75:
        return decision
    reason = (
        f"{decision.reason}; over all intervals the last sample's current flowed for "
        f"{fraction:.0%} of the time, so that inside its steps neither sampling agrees with the "
        "counters"
    )
    return replace(decision, reason=reason)


def _fractions(ledger: Ledger) -> Increments:
    """The share of each interval in which the current of its last sample flowed."""
    counted_ah, backward_ah, forward_ah = ledger
    return (counted_ah - forward_ah) / (backward_ah - forward_ah)


def _verdict(ledger: Ledger, word: str, *, fewest: int, margin: float) -> Decision | None:
    """The hold that these intervals prove, if any.

    Its residual has to be below `margin` times the other's, and most single intervals have to
    agree, because one large interval proves nothing.
    """
    count = ledger.shape[1]
    if count < fewest:
        return None
    backward, forward = map(_spread, ledger[0] - ledger[1:])
    hold, which = ("backward", "last") if backward < forward else ("forward", "first")
    better, worse = sorted((backward, forward))
    agreeing = float(np.mean((_fractions(ledger) > 0.5) == (hold == "backward")))
    if better > margin * worse or agreeing < _AGREEING:
        return None
    changes = counted(count, word) + (" of step" if word == "change" else "")
    reason = (
        f"at {changes} the tester's Ah counters follow the current of the interval's {which} "
        f"sample (off by {1e3 * better:.2g} mAh, by {1e3 * worse:.2g} mAh with the other)"
    )
    return Decision(hold, "strong", reason)


def _ledger(samples: Samples) -> tuple[Ledger, Int[np.ndarray, "telling"]]:
    """The ampere-hours of the informative intervals, and their indices.

    An interval is informative if its two currents differ by far more than the resolution of the
    counters, and no counter was reset.
    """
    counters, quantum_ah = samples.counters, samples.counters.quantum_ah
    counted_ah = counters.magnitudes_ah()
    is_unsigned = counted_ah is not None
    if counted_ah is None:
        counted_ah = counters.increments_ah(with_net=True)
    if counted_ah is None or not counted_ah.any():
        return np.zeros((3, 0)), np.zeros(0, int)
    moved_ah = samples.ended_ah, samples.begun_ah
    if is_unsigned:
        moved_ah = tuple(map(np.abs, moved_ah))
    backward_ah, forward_ah = moved_ah
    # The sign of the counters may be opposite to the file's.
    if inner(counted_ah, backward_ah) + inner(counted_ah, forward_ah) < 0:
        counted_ah = -counted_ah
    largest_ah = max(max(charge_ah.max(), -charge_ah.min()) for charge_ah in moved_ah)
    # A hundredth of the record's largest step of charge excludes noise of the current.
    floor_ah = max(5 * quantum_ah, 0.01 * float(largest_ah))
    apart_ah = backward_ah - forward_ah
    indices = np.flatnonzero((apart_ah > floor_ah) | (apart_ah < -floor_ah))
    ledger = np.stack([charge_ah[indices] for charge_ah in (counted_ah, backward_ah, forward_ah)])
    is_reset = np.abs(ledger[0]) > 2 * np.abs(ledger[1:]).max(axis=0) + quantum_ah
    for counter_ah in (counters.charged_ah, counters.discharged_ah):
        if counter_ah is not None:
            is_reset |= counter_ah[indices + 1] < counter_ah[indices]
    return ledger[:, ~is_reset], indices[~is_reset]


def _spread(values: Increments) -> float:
    """The RMS without the largest few values: a net counter that restarts near zero hides the
    reset."""
    smallest = np.sort(np.abs(values))[: len(values) - int(_FALLS * len(values))]
    return float(np.sqrt(np.mean(smallest**2)))


# Time constants of pairs in rows, and SOC nodes of R0 and of the OCV.
_TAUS, _R0_NODES, _OCV_NODES = (1.0, 3.0, 10.0, 30.0), 5, 11
# No circuit follows a cell that is nearly empty or full; in between, each column needs this many
# rows.
_INSIDE, _FEWEST = (0.15, 0.98), 3
# Innovations are estimated over this many rows at a time, as shares of the noise.
_BLOCK, _SHARES = 64, np.concatenate([[0.0], np.geomspace(1e-3, 1e2, 40)])


def slow_rows(samples: Samples) -> SlowRows | None:
    """The evidence of a slow record's rows; None if its load seldom changes from row to row."""
    if samples.interval_s < _SLOW_S:
        return None
    # Samples under load, and those whose current differs from that of both neighbors.
    is_changed = np.abs(samples.step_a) > _ALONE_SHARE * samples.peak_a
    is_loaded = np.abs(samples.current_a[1:-1]) > STEADY_SHARE * samples.peak_a
    is_alone = is_changed[1:] & is_changed[:-1] & is_loaded
    loaded, alone = int(np.sum(is_loaded)), int(np.sum(is_alone))
    through = changes_through_values_between(samples.current_a)
    if not through and alone <= SOMETIMES * loaded:
        return None
    shown = loaded, alone, through
    charge_ah = np.append(0.0, np.cumsum(samples.held_ah("centered")))
    # Charging raises the voltage, whatever its sign in the file.
    charge_ah *= np.sign(np.cov(charge_ah, samples.voltage_v)[0, 1])
    left = _left_v(samples.current_a, samples.voltage_v, charge_ah)
    if left is None:
        return SlowRows(*shown)
    left_v, moved_v = left
    rows = len(left_v)
    correlation = float(np.mean(left_v[1:] * left_v[:-1]) / np.mean(left_v**2))
    return SlowRows(*shown, rows, rows * correlation, rows * _innovation(left_v, moved_v))


def _left_v(current_a: Rows, voltage_v: Rows, charge_ah: Rows) -> tuple[Rows, Rows] | None:
    """Residuals of the voltage's differences after R0 and OCV over SOC and pairs, and the
    differences."""
    moved_v = np.diff(voltage_v)
    if not np.ptp(charge_ah) > 0:
        return None
    soc = (charge_ah - charge_ah.min()) / np.ptp(charge_ah)
    between = (soc[1:] + soc[:-1]) / 2
    columns = [np.diff(current_a) * hat for hat in _hats(between, 0.0, _R0_NODES)]
    for rows in _TAUS:
        answer = np.diff(lagged(current_a, rows))
        columns += [answer, answer * between] if rows < _TAUS[2] else [answer]
    columns += [np.diff(hat) for hat in _hats(soc, 0.1, _OCV_NODES)[1:]]
    columns += [current_a[1:], current_a[:-1], np.ones(len(between))]
    table = np.column_stack(columns)
    is_inside = (between > _INSIDE[0]) & (between < _INSIDE[1])
    if np.count_nonzero(is_inside) < _FEWEST * table.shape[1]:
        return None
    table, moved_v = table[is_inside], moved_v[is_inside]
    table = table / np.maximum(np.sqrt(np.mean(table**2, axis=0)), 1e-12)
    left_v = moved_v - table @ np.linalg.lstsq(table, moved_v, rcond=1e-10)[0]
    return (left_v, moved_v) if np.any(left_v) else None


def _hats(at: Rows, first: float, nodes: int) -> list[np.ndarray]:
    """Columns of a table over SOC that is linear between even nodes."""
    knots = np.linspace(first, 1.0, nodes)
    return [np.maximum(1 - np.abs(at - node) / (knots[1] - knots[0]), 0.0) for node in knots]


def _innovation(left_v: Rows, moved_v: Rows) -> float:
    """The innovations of the voltage as a share of its changes, in the median block.

    The maximum of Whittle's likelihood of a random walk plus white noise.
    """
    shares = []
    blocks = max(len(left_v) // _BLOCK, 1)
    parts = (np.array_split(values_v, blocks) for values_v in (left_v, moved_v))
    for left, moved in zip(*parts, strict=True):
        power = np.abs(np.fft.rfft(left)[1:]) ** 2 / len(left)
        frequency = 2 * np.pi * np.arange(1, len(power) + 1) / len(left)
        shape = _SHARES[:, None] + 2 * (1 - np.cos(frequency))
        noise = np.mean(power / shape, axis=1)
        likely = -np.sum(np.log(shape), axis=1) - len(power) * np.log(np.maximum(noise, 1e-300))
        best = int(np.argmax(likely))
        shares.append(np.sqrt(_SHARES[best] * noise[best]) / max(float(np.std(moved)), 1e-12))
    return float(np.median(shares))
