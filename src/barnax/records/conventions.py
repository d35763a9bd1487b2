"""The file's conventions, decided from its data: the sign of the current, and its hold.

Column names promise a sign and break the promise (A123 files with Battery Data Format names are
discharge-positive), so they count only where the data say nothing. Testers that log a sample at
the end of its interval (Arbin) prove it by their own ampere-hour counters: the increments follow
the current of the interval's last sample.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from ..errors import InputError
from .record import Decision, Hold, voltage_noise_v
from .rests import runs
from .samples import Counters, Samples


def counted_increments_ah(
    counters: Counters, *, with_net: bool
) -> Float[np.ndarray, "intervals"] | None:
    """Ah counted in each interval, charge positive; zero where a counter was reset.

    None without counters. `with_net` accepts a net counter where the other two are missing; its
    sign is then the file's own.
    """
    parts = []
    if counters.charged_ah is not None:
        parts.append(np.maximum(np.diff(counters.charged_ah), 0))
    if counters.discharged_ah is not None:
        parts.append(-np.maximum(np.diff(counters.discharged_ah), 0))
    if not parts and with_net and counters.net_ah is not None:
        parts.append(np.diff(counters.net_ah))
    return np.sum(parts, axis=0) if parts else None


def counter_quantum_ah(counters: Counters) -> float:
    """What the coarsest counter resolves, in Ah: the decimal place to which it was printed."""
    written = (counters.charged_ah, counters.discharged_ah, counters.net_ah)
    return max((_decimal_place(counter) for counter in written if counter is not None), default=0.0)


def _decimal_place(values: Float[np.ndarray, "samples"]) -> float:
    """The coarsest power of ten of which all values are multiples, to single precision."""
    for digits in range(9):
        scaled = values * 10.0**digits
        if np.all(np.abs(scaled - np.round(scaled)) <= 1e-6 * (1 + np.abs(scaled))):
            return 10.0**-digits
    return 0.0


CHARGE, DISCHARGE = "charge-positive", "discharge-positive"
Sign = Literal["charge-positive", "discharge-positive"]

PROMISED: dict[str, Sign] = {
    "Battery Data Format": CHARGE,
    "Arbin": CHARGE,
    "PyBaMM": DISCHARGE,
    "plain": CHARGE,
}


@dataclass(frozen=True)
class Evidence:
    """What one look at the data says: +1 charge-positive, -1 discharge-positive."""

    vote: int
    is_strong: bool
    words: str

    @property
    def weight(self) -> int:
        return self.vote * (2 if self.is_strong else 1)


def decide_sign(samples: Samples, given: Sign | Literal["auto"]) -> tuple[Decision, list[str]]:
    """The file's sign of current, and warnings about how it was found.

    Raises InputError when a sign is given against strong evidence.
    """
    found = _from_data(samples)
    if given == "auto":
        return found or _from_names(samples)
    if found is None:
        return Decision(given, "given", "given by the user; the data say nothing"), []
    decision, _ = found
    if decision.value == given:
        return Decision(given, "given", f"given by the user, and {decision.reason}"), []
    if decision.strength == "strong":
        raise InputError(
            f"{samples.file}: the sign was given as {given}, but the data are {decision.value}: "
            f"{decision.reason}. Leave --current-sign at auto, or give {decision.value} "
            "(--ocv-current-sign and --validate-current-sign for those records)."
        )
    warning = (
        f"the sign was given as {given}, against weak evidence for {decision.value}: "
        f"{decision.reason}"
    )
    return Decision(given, "given", f"given by the user, although {decision.reason}"), [warning]


def _from_names(samples: Samples) -> tuple[Decision, list[str]]:
    value = PROMISED[samples.dialect]
    reason = f"the data do not tell, and {samples.dialect} column names usually mean {value}"
    warning = f"the sign of the current is assumed {value}: {reason}; see --current-sign"
    return Decision(value, "assumed", reason), [warning]


def _from_data(samples: Samples) -> tuple[Decision, list[str]] | None:
    """The sign that the evidence favors, or None where there is none.

    Where the looks weigh the same on either side, the first decides: the voltage is physics, the
    counters are names.
    """
    looks = (_at_current_steps(samples), _under_sustained_current(samples), _of_counters(samples))
    evidence = [look for look in looks if look is not None]
    if not evidence:
        return None
    total = sum(look.weight for look in evidence)
    vote = int(np.sign(total)) or evidence[0].vote
    value = CHARGE if vote > 0 else DISCHARGE
    against = [look for look in evidence if look.vote == -vote]
    is_strong = abs(total) >= 2 and not any(look.is_strong for look in against)
    reason = "; ".join(look.words for look in evidence if look.vote == vote)
    if against:
        reason += "; against it: " + "; ".join(look.words for look in against)
    warnings = []
    if not is_strong:
        warnings.append(
            f"the sign of the current is taken as {value} on weak evidence ({reason}); "
            "see --current-sign"
        )
    if samples.dialect != "plain" and value != PROMISED[samples.dialect]:
        warnings.append(
            f"{samples.dialect} column names mean {PROMISED[samples.dialect]} currents, but the "
            f"data are {value}: {reason}"
        )
    return Decision(value, "strong" if is_strong else "weak", reason), warnings


def _at_current_steps(samples: Samples) -> Evidence | None:
    """A cell's resistance lifts its voltage when the charging current steps up."""
    step_a, step_v = np.diff(samples.current_a), np.diff(samples.voltage_v)
    is_step = np.abs(step_a) > 0.1 * np.max(np.abs(samples.current_a))
    noise_v = voltage_noise_v(step_v, ~is_step)
    is_clear = is_step & (np.abs(step_v) > 6 * noise_v)
    clear = _agreement(step_a[is_clear] * step_v[is_clear])
    every = _agreement(step_a[is_step] * step_v[is_step])
    # Where few of the steps are clear, the current may be noise and the clear ones chance.
    is_clear_strong = clear.share >= 0.85 and clear.count >= max(3, 0.2 * is_step.sum())
    # Small steps among relaxations stand out only by their number: four sigma of a fair coin.
    is_every_strong = every.share >= 0.7 and (2 * every.share - 1) * every.count**0.5 >= 4
    chosen = every if is_every_strong and not is_clear_strong else clear
    if chosen.count == 0 or chosen.share < 0.7:
        return None
    moves = "rises" if chosen.vote > 0 else "falls"
    return Evidence(
        chosen.vote,
        is_strong=is_clear_strong or is_every_strong,
        words=(
            f"the voltage {moves} with the current at {round(chosen.share * chosen.count)} of "
            f"{chosen.count} steps"
        ),
    )


@dataclass(frozen=True)
class _Agreement:
    """Which way most products point by their sum, and the share of their number that agrees."""

    vote: int
    share: float
    count: int


def _agreement(product: Float[np.ndarray, "steps"]) -> _Agreement:
    product = product[product != 0]
    if not len(product):
        return _Agreement(0, 0.0, 0)
    vote = 1 if product.sum() > 0 else -1
    return _Agreement(vote, float(np.mean(product * vote > 0)), len(product))


def _under_sustained_current(samples: Samples) -> Evidence | None:
    """A steady charging current lifts the voltage; weighed by how far it moves."""
    current, voltage = samples.current_a, samples.voltage_v
    peak = np.max(np.abs(current))
    is_loaded = np.abs(current) > 0.05 * peak
    is_steady = (
        is_loaded[1:] & is_loaded[:-1] & (np.abs(np.diff(current)) < 0.05 * np.abs(current[1:]))
    )
    noise_v = voltage_noise_v(np.diff(voltage), np.ones(len(voltage) - 1, bool))
    first, last_interval = runs(is_steady)
    last = last_interval + 1
    # Eight intervals keep single relaxations out; what moves less than the noise is no trend.
    is_long = last - first >= 8
    first, last = first[is_long], last[is_long]
    move_v = voltage[last] - voltage[first]
    is_clear = np.abs(move_v) > 6 * noise_v
    signed_v = (move_v * np.sign(current[first]))[is_clear]
    total = float(np.abs(signed_v).sum())
    if total == 0:
        return None
    vote = 1 if signed_v.sum() > 0 else -1
    share = float(np.sum(np.maximum(signed_v * vote, 0))) / total
    if share < 0.75:
        return None
    moves = "rises" if vote > 0 else "falls"
    return Evidence(
        vote,
        is_strong=share >= 0.9 and total >= 0.1,
        words=(
            f"under sustained positive current the voltage {moves} "
            f"({share:.0%} of {total:.3g} V over {int(is_clear.sum())} stretches)"
        ),
    )


def _of_counters(samples: Samples) -> Evidence | None:
    """The tester's own counters say which current it calls a charge."""
    counted_ah = counted_increments_ah(samples.counters, with_net=False)
    if counted_ah is None:
        return None
    mean_a = (samples.current_a[1:] + samples.current_a[:-1]) / 2
    integrated_ah = mean_a * np.diff(samples.time_s) / 3600
    product = counted_ah * integrated_ah
    size = float(np.sqrt(np.sum(counted_ah**2) * np.sum(integrated_ah**2)))
    if size == 0:
        return None
    cosine = float(product.sum()) / size
    if abs(cosine) < 0.3:
        return None
    words = "agree with the current's sign" if cosine > 0 else "run against the current's sign"
    return Evidence(
        1 if cosine > 0 else -1,
        is_strong=abs(cosine) > 0.7,
        words=f"the tester's charge and discharge counters {words} (correlation {cosine:.2f})",
    )


Increments = Float[np.ndarray, "intervals"]

# Inside a drive cycle that beats against the log, some dozens of intervals in a row can look like
# either hold, so the intervals at large must agree far better than the changes of step.
_AT_CHANGES = {"fewest": 2, "margin": 0.5}
_ANYWHERE = {"fewest": 20, "margin": 0.05}
_AGREEING = 0.8


@dataclass(frozen=True)
class _Ledger:
    """Ah an interval: as counted, and by its last and its first sample's current."""

    counted_ah: Increments
    backward_ah: Increments
    forward_ah: Increments

    def at(self, chosen: Bool[np.ndarray, "intervals"]) -> "_Ledger":
        return _Ledger(self.counted_ah[chosen], self.backward_ah[chosen], self.forward_ah[chosen])

    def fractions(self) -> Increments:
        """The share of each interval for which its last sample's current flowed."""
        return (self.counted_ah - self.forward_ah) / (self.backward_ah - self.forward_ah)


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
    everywhere, tells = _ledger(samples)
    if not tells.any():
        return None
    telling = everywhere.at(tells)
    weight = (telling.backward_ah - telling.forward_ah) ** 2
    fraction = float(np.average(telling.fractions(), weights=weight))
    decision = None
    if samples.step is not None:
        at_changes = everywhere.at(tells & (np.diff(samples.step) != 0))
        decision = _verdict(at_changes, "changes of step", **_AT_CHANGES)
    decision = decision or _verdict(telling, "intervals", **_ANYWHERE)
    if decision is not None and 0.25 < fraction < 0.75:
        reason = (
            f"{decision.reason}; over all intervals the last sample's current flowed for "
            f"{fraction:.0%} of the time, so that inside its steps the record fits neither hold "
            "well"
        )
        return replace(decision, reason=reason)
    return decision


def _verdict(ledger: _Ledger, words: str, *, fewest: int, margin: float) -> Decision | None:
    """The hold that these intervals prove, if they do.

    Its residual must be below `margin` times the other's, and most intervals must agree, one by
    one: a large one alone proves nothing.
    """
    count = len(ledger.counted_ah)
    if count < fewest:
        return None
    backward = _rms(ledger.counted_ah - ledger.backward_ah)
    forward = _rms(ledger.counted_ah - ledger.forward_ah)
    is_backward = backward < forward
    better, worse = sorted((backward, forward))
    agreeing = float(np.mean((ledger.fractions() > 0.5) == is_backward))
    if better > margin * worse or agreeing < _AGREEING:
        return None
    return Decision(
        "backward" if is_backward else "forward",
        "strong",
        f"at {count} {words} the tester's Ah counters follow the current of the interval's "
        f"{'last' if is_backward else 'first'} sample (off by {1e3 * better:.2g} mAh, by "
        f"{1e3 * worse:.2g} mAh with the other)",
    )


def _ledger(samples: Samples) -> tuple[_Ledger, Bool[np.ndarray, "intervals"]]:
    """Every interval's ampere-hours, and which intervals tell.

    An interval tells where its two currents differ by far more than the counters resolve, and
    where no counter was reset.
    """
    interval_h = np.diff(samples.time_s) / 3600
    backward_ah = samples.current_a[1:] * interval_h
    forward_ah = samples.current_a[:-1] * interval_h
    counted_ah = counted_increments_ah(samples.counters, with_net=True)
    if counted_ah is None or not counted_ah.any():
        nowhere = np.zeros(len(interval_h), bool)
        return _Ledger(np.zeros_like(interval_h), backward_ah, forward_ah), nowhere
    # The counters' own sign may be opposite to the file's.
    if np.sum(counted_ah * (backward_ah + forward_ah)) < 0:
        counted_ah = -counted_ah
    quantum_ah = counter_quantum_ah(samples.counters)
    largest_ah = np.maximum(np.abs(backward_ah), np.abs(forward_ah))
    is_reset = np.abs(counted_ah) > 2 * largest_ah + quantum_ah
    for counter_ah in (samples.counters.charged_ah, samples.counters.discharged_ah):
        if counter_ah is not None:
            is_reset |= np.diff(counter_ah) < 0
    # A hundredth of the record's largest step of charge keeps the noise of the current out.
    floor_ah = max(5 * quantum_ah, 0.01 * float(np.max(largest_ah)))
    tells = ~is_reset & (np.abs(backward_ah - forward_ah) > floor_ah)
    return _Ledger(counted_ah, backward_ah, forward_ah), tells


def _rms(values: Increments) -> float:
    return float(np.sqrt(np.mean(values**2)))
