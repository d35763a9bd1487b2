"""Whether a sample's current flowed in the interval after it or before it.

Testers that log a sample at the end of its interval (Arbin) prove it by their own ampere-hour
counters: the increments follow the current of the interval's last sample.
"""

from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from .counters import counted_increments_ah
from .record import Decision, Hold
from .samples import Samples

Increments = Float[np.ndarray, "intervals"]

# Fewer telling intervals than these prove nothing, whatever their residuals.
_FEWEST_STEP_CHANGES, _FEWEST_INTERVALS = 2, 20


def decide_hold(samples: Samples, given: Hold | Literal["auto"]) -> Decision:
    """The record's hold: given, else proved by the counters, else by whose file it is."""
    proof = _from_counters(samples)
    if given != "auto":
        reason = "given by the user"
        if proof is not None and proof.value != given:
            reason += f", although {proof.reason}"
        return Decision(given, "given", reason)
    if proof is not None:
        return proof
    if samples.dialect == "Arbin":
        return Decision("backward", "weak", "Arbin testers log a sample at its interval's end")
    return Decision(
        "forward",
        "assumed",
        "no counters prove otherwise; see --current-hold for testers that "
        "log a sample at the end of its interval",
    )


def _from_counters(samples: Samples) -> Decision | None:
    """The hold under which the current integrates to the tester's counters, with clear margin.

    Where the tester's step number changes, the current switches in time with the log, so these
    intervals decide. Inside a step that plays a drive cycle, the current switches on a clock of
    its own and anywhere between two samples, which proves neither hold; such intervals are asked
    only where the file has no step changes that tell.
    """
    ledger = _ledger(samples)
    if ledger is None:
        return None
    counted_ah, backward_ah, forward_ah, tells = ledger
    fraction = _fraction_backward(counted_ah[tells], backward_ah[tells], forward_ah[tells])
    places = [(tells, _FEWEST_INTERVALS, "intervals")]
    if samples.step is not None:
        at_change = tells & (np.diff(samples.step) != 0)
        places.insert(0, (at_change, _FEWEST_STEP_CHANGES, "changes of step"))
    for chosen, fewest, words in places:
        count = int(chosen.sum())
        if count < fewest:
            continue
        backward = _rms(counted_ah[chosen] - backward_ah[chosen])
        forward = _rms(counted_ah[chosen] - forward_ah[chosen])
        better, worse = sorted((backward, forward))
        if better > 0.5 * worse:
            continue
        value, end = ("backward", "last") if backward < forward else ("forward", "first")
        reason = (
            f"at {count} {words} the tester's Ah counters follow the current of the interval's "
            f"{end} sample (off by {1e3 * better:.2g} mAh, by {1e3 * worse:.2g} mAh with the other)"
        )
        if 0.25 < fraction < 0.75:
            reason += (
                f"; over all intervals the last sample's current flowed for {fraction:.0%} of the "
                "time, so that inside its steps the record fits neither hold well"
            )
        return Decision(value, "strong", reason)
    return None


def _ledger(
    samples: Samples,
) -> tuple[Increments, Increments, Increments, Bool[np.ndarray, "intervals"]] | None:
    """Ah an interval as counted, by the last and by the first sample's current, and where to ask.

    An interval tells where the two currents differ by more than the counter resolves, and where
    no counter was reset.
    """
    counted_ah = counted_increments_ah(samples.counters, with_net=True)
    if counted_ah is None or not counted_ah.any():
        return None
    interval_h = np.diff(samples.time_s) / 3600
    backward_ah = samples.current_a[1:] * interval_h
    forward_ah = samples.current_a[:-1] * interval_h
    # The counters' own sign may be opposite to the file's.
    if np.sum(counted_ah * (backward_ah + forward_ah)) < 0:
        counted_ah = -counted_ah
    quantum_ah = np.min(np.abs(counted_ah[counted_ah != 0]))
    largest_ah = np.maximum(np.abs(backward_ah), np.abs(forward_ah))
    difference_ah = np.abs(backward_ah - forward_ah)
    is_reset = np.abs(counted_ah) > 2 * largest_ah + quantum_ah
    # A hundredth of the record's largest step of charge keeps the noise of the current out.
    floor_ah = max(2 * quantum_ah, 0.01 * float(np.max(largest_ah)))
    return counted_ah, backward_ah, forward_ah, ~is_reset & (difference_ah > floor_ah)


def _fraction_backward(
    counted_ah: Increments, backward_ah: Increments, forward_ah: Increments
) -> float:
    """The share of an interval for which its last sample's current flowed, by least squares."""
    difference_ah = backward_ah - forward_ah
    size = float(np.sum(difference_ah**2))
    return float(np.sum((counted_ah - forward_ah) * difference_ah)) / size if size else 0.0


def _rms(values: Increments) -> float:
    return float(np.sqrt(np.mean(values**2)))
