"""The conventions of a file's current, decided from its data: its sign, and its hold.

Column names promise a sign and break the promise (A123 files with Battery Data Format names are
discharge-positive), so they count only where the data say nothing.

The hold says whether a sample's current flowed in the interval after it or before it. Testers that
log a sample at the end of its interval (Arbin) prove it by their own ampere-hour counters: the
increments follow the current of the interval's last sample. A column that holds the mean current
of the interval before the row says so by its name.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from ..errors import InputError, counted
from .columns import Column
from .counters import inner
from .dialects import CHARGE, DISCHARGE, PLAIN, Sign
from .findings import Finding, found_at
from .record import Decision, Hold, runs
from .samples import Samples, some, voltage_noise_v


@dataclass(frozen=True)
class Evidence:
    """What one look at the data says: +1 charge-positive, -1 discharge-positive."""

    vote: int
    is_strong: bool
    words: str

    @property
    def weight(self) -> int:
        return self.vote * (2 if self.is_strong else 1)


def decide_sign(
    samples: Samples, given: Sign | Literal["auto"], file: str
) -> tuple[Decision, list[Finding]]:
    """The file's sign of current, and what is to be said of how it was found.

    Raises InputError when a sign is given against strong evidence.
    """
    found = _from_data(samples)
    if given == "auto":
        value = samples.dialect.sign
        names = (
            f"the data do not tell, and {samples.dialect.name} column names usually mean {value}"
        )
        decision = found or Decision(value, "assumed", names)
        return decision, _doubts(samples, decision)
    if found is None:
        return Decision(given, "given", "given by the user; the data do not show it"), []
    if found.value == given:
        return Decision(given, "given", f"given by the user, and {found.reason}"), []
    what = f"the sign was given as {given}, but the data are {found.value}"
    if found.strength == "strong":
        raise InputError(
            f"{file}: {what}: {found.reason}; leave `current_sign` at 'auto', or give "
            f"'{found.value}' (`ocv_current_sign` and `validate_current_sign` for those records)."
        )
    decision = Decision(given, "given", f"given by the user, although {found.reason}")
    return decision, [Finding("warning", f"{what} on weak evidence: {found.reason}")]


def _from_data(samples: Samples) -> Decision | None:
    """The sign that the evidence favors, or None where there is none.

    Where the looks weigh the same on either side, the first decides: the voltage is physics, the
    counters are names.
    """
    looks = (
        _at_current_steps(samples),
        _under_sustained_current(samples),
        _of_counters(samples),
        _of_states(samples),
    )
    evidence = [look for look in looks if look is not None]
    if not evidence:
        return None
    total = sum(look.weight for look in evidence)
    vote = int(np.sign(total)) or evidence[0].vote
    against = [look for look in evidence if look.vote == -vote]
    is_strong = abs(total) >= 2 and not any(look.is_strong for look in against)
    reason = "; ".join(look.words for look in evidence if look.vote == vote)
    if against:
        reason += "; against it: " + "; ".join(look.words for look in against)
    return Decision(CHARGE if vote > 0 else DISCHARGE, "strong" if is_strong else "weak", reason)


def _doubts(samples: Samples, sign: Decision) -> list[Finding]:
    """A sign that is doubtful, or another than the columns' names mean."""
    at, _ = step_votes(samples)
    start = int(at[0]) + 1 if len(at) else 0
    promised = samples.dialect.sign
    if sign.strength in ("weak", "assumed"):
        strength = "weak" if sign.strength == "weak" else "no"
        what = f"the current is taken as {sign.value} on {strength} evidence: {sign.reason}"
        remedy = f"say so: `current_sign='{sign.value}'`"
    elif samples.dialect != PLAIN and sign.value != promised:
        names = f"but {samples.dialect.name} names mean {promised}"
        what = f"the current is {sign.value}, {names}: {sign.reason}"
        remedy = (
            f"barnax turns it, other programs may not: say `current_sign='{sign.value}'`, or turn "
            "its sign in the file"
        )
    elif sign.value == DISCHARGE and samples.dialect == PLAIN:
        return [found_at(samples, start, "note", f"the current is {sign.value}: {sign.reason}")]
    else:
        return []
    return [found_at(samples, start, "warning", what, remedy)]


# A current of one sign, but for its noise. Of signed currents hardly any step contradicts the
# others; of magnitudes some do.
_NEVER_SHARE, _FEWEST_DENIALS, _DENIED_SHARE = 0.01, 3, 0.02


def examine_direction(samples: Samples) -> tuple[Samples, list[Finding]]:
    """The samples with a current that has a sign, and what gave it one.

    A tester may print the current without its sign, and the direction beside it. Without that, an
    error where the cell is both charged and discharged by its voltage.
    """
    current_a, state = samples.current_a, samples.state
    peak_a = samples.peak_a
    if min(-current_a.min(), current_a.max()) > _NEVER_SHARE * peak_a or peak_a == 0:
        return samples, []
    name = samples.header("current")
    if state is not None and np.any((current_a != 0) & ((state == 1) | (state == -1))):
        begins = np.append(0, np.flatnonzero(state[1:] != state[:-1]) + 1)
        words = state[begins]
        # Of other states the one before tells.
        told = np.maximum.accumulate(np.where(np.abs(words) == 1, np.arange(len(words)), -1))
        directions = np.where(told >= 0, -words[told], 1)
        direction = np.repeat(directions, np.diff(begins, append=len(state)))
        what = f"'{name}' has no sign; '{samples.header('state')}' tells what discharges"
        signed = samples.having(current=np.abs(current_a) * direction)
        return signed, [Finding("note", what, is_told=True)]
    _, votes = step_votes(samples)
    rising, falling = int(np.sum(votes > 0)), int(np.sum(votes < 0))
    if min(rising, falling) < max(_FEWEST_DENIALS, _DENIED_SHARE * len(votes)):
        return samples, []
    never = "negative" if current_a.max() > 0 else "positive"
    what = (
        f"the current is never {never}, yet it lifts the voltage at {rising} of its steps and "
        f"lowers it at {falling}: the column has no sign"
    )
    remedy = "export the signed current, or turn its sign in the steps that discharge"
    at = int(np.argmax(np.abs(current_a)))
    return samples, [found_at(samples, at, "error", what, remedy)]


def step_votes(
    samples: Samples,
) -> tuple[Int[np.ndarray, "steps"], Float[np.ndarray, "steps"]]:
    """The clear current steps, and for each +1 where the file's current raises the voltage."""
    at = samples.steps
    at = at[np.abs(samples.step_v[at]) > 6 * samples.noise_v]
    return at, np.sign(samples.step_a[at] * samples.step_v[at])


def _at_current_steps(samples: Samples) -> Evidence | None:
    """A cell's resistance lifts its voltage when the charging current steps up."""
    noise_v = voltage_noise_v(some(samples.step_v)[~some(samples.is_step)])
    at = samples.steps
    step_v = samples.step_v[at]
    product = samples.step_a[at] * step_v
    vote, share, count = clear = _agreement(product[np.abs(step_v) > 6 * noise_v])
    # Where few of the steps are clear, the current may be noise and the clear ones chance.
    is_strong = share >= 0.85 and count >= max(3, 0.2 * len(at))
    if not is_strong:
        vote, share, count = _agreement(product)
        # Small steps among relaxations stand out only by their number: four sigma of a fair coin.
        is_strong = share >= 0.7 and (2 * share - 1) * count**0.5 >= 4
        vote, share, count = (vote, share, count) if is_strong else clear
    if count == 0 or share < 0.7:
        return None
    moves = "rises" if vote > 0 else "falls"
    words = f"the voltage {moves} with the current at {round(share * count)} of {count} steps"
    return Evidence(vote, is_strong, words)


def _agreement(product: Float[np.ndarray, "steps"]) -> tuple[int, float, int]:
    """Which way most products point by their sum, the share that agrees, and their number."""
    product = product[product != 0]
    if not len(product):
        return 0, 0.0, 0
    vote = 1 if product.sum() > 0 else -1
    return vote, float(np.mean(product * vote > 0)), len(product)


def _under_sustained_current(samples: Samples) -> Evidence | None:
    """A steady charging current lifts the voltage; weighed by how far it moves."""
    current, voltage = samples.current_a, samples.voltage_v
    magnitude = np.abs(current)
    is_loaded = magnitude > 0.05 * samples.peak_a
    is_steady = np.abs(samples.step_a) < 0.05 * magnitude[1:]
    is_steady &= is_loaded[1:] & is_loaded[:-1]
    noise_v = voltage_noise_v(some(samples.step_v))
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
    words = (
        f"under sustained positive current the voltage {moves} "
        f"({share:.0%} of {total:.3g} V in {counted(int(is_clear.sum()), 'run')})"
    )
    return Evidence(vote, share >= 0.9 and total >= 0.1, words)


def _of_counters(samples: Samples) -> Evidence | None:
    """The tester's own counters say which current it calls a charge."""
    counted_ah = samples.counters.increments_ah(with_net=False)
    if counted_ah is None:
        return None
    integrated_ah = (samples.begun_ah + samples.ended_ah) / 2
    product = counted_ah * integrated_ah
    size = float(np.sqrt(np.sum(counted_ah**2) * np.sum(integrated_ah**2)))
    cosine = float(product.sum()) / size if size else 0.0
    if abs(cosine) < 0.3:
        return None
    how = "agree with" if cosine > 0 else "run against"
    words = f"{how} the current's sign (correlation {cosine:.2f})"
    return Evidence(
        1 if cosine > 0 else -1,
        abs(cosine) > 0.7,
        f"the tester's charge and discharge counters {words}",
    )


def _of_states(samples: Samples) -> Evidence | None:
    """The file's own words for what a step does."""
    if samples.state is None:
        return None
    ins, outs = samples.state == -1, samples.state == 1
    rises, falls = samples.current_a > 0, samples.current_a < 0
    alike = np.count_nonzero((ins & rises) | (outs & falls))
    against = np.count_nonzero((ins & falls) | (outs & rises))
    if not alike + against:
        return None
    mean = (alike - against) / (alike + against)
    if abs(mean) < 0.8:
        return None
    how = "is positive where" if mean > 0 else "is negative where"
    words = f"the current {how} '{samples.header('state')}' says that the cell is charged"
    return Evidence(1 if mean > 0 else -1, True, words)


Increments = Float[np.ndarray, "intervals"]

# Inside a drive cycle that beats against the log, some dozens of intervals in a row can look like
# either hold, so the intervals at large must agree far better than the changes of step.
_AT_CHANGES = {"fewest": 2, "margin": 0.5}
_ANYWHERE = {"fewest": 20, "margin": 0.05}
# One change of step proves nothing, but is better evidence than whose file it is.
_AT_ONE = {"fewest": 1, "margin": 0.2}
_AGREEING = 0.8
# So many intervals may hold a fall of a counter that was not seen as one.
_FALLS = 0.05


@dataclass(frozen=True)
class _Ledger:
    """Ah an interval: as counted, and by its last and its first sample's current."""

    counted_ah: Increments
    backward_ah: Increments
    forward_ah: Increments

    def at(self, chosen: Bool[np.ndarray, "intervals"] | Int[np.ndarray, "chosen"]) -> "_Ledger":
        return _Ledger(self.counted_ah[chosen], self.backward_ah[chosen], self.forward_ah[chosen])

    def fractions(self) -> Increments:
        """The share of each interval for which its last sample's current flowed."""
        return (self.counted_ah - self.forward_ah) / (self.backward_ah - self.forward_ah)


def decide_hold(samples: Samples, given: Hold | Literal["auto"]) -> Decision:
    """The record's hold: given, else by the counters, else by what the column or the make is."""
    found = _from_counters(samples)
    column = samples.columns["current"]
    if _is_mean(column) and (found is None or found.strength != "strong"):
        words = f"'{column.header}' is the mean current since the row before"
        found = Decision("backward", "weak", words)
    if given != "auto":
        reason = "given by the user"
        if found is not None and found.value != given:
            reason += f", although {found.reason}"
        return Decision(given, "given", reason)
    if found is not None:
        return found
    if samples.dialect.logs_at_end:
        words = f"{samples.dialect.name} testers log a sample at its interval's end"
        return Decision("backward", "weak", words)
    reason = (
        "no counters prove otherwise; `current_hold='backward'` is for testers that log a sample "
        "at the end of its interval"
    )
    return Decision("forward", "assumed", reason)


def _is_mean(column: Column) -> bool:
    """Whether a column of currents holds means over intervals: "<I>/mA", or the charge of each."""
    return column.header.startswith("<") or column.quantity.name == "charge of the interval"


def _from_counters(samples: Samples) -> Decision | None:
    """The hold under which the current integrates to the tester's counters, with clear margin.

    Where the tester's step number changes, the current switches in time with the log, so these
    intervals decide. Inside a step that plays a drive cycle, the current switches on a clock of
    its own and anywhere between two samples, which proves neither hold; such intervals are asked
    only where the file has no step changes that tell. Where these prove nothing either, a lone
    change of step decides, unless the other intervals are against it.
    """
    telling, places = _ledger(samples)
    if not len(places):
        return None
    weight = (telling.backward_ah - telling.forward_ah) ** 2
    fraction = float(np.average(telling.fractions(), weights=weight))
    step = np.zeros(len(samples)) if samples.step is None else samples.step
    at_changes = telling.at(step[places + 1] != step[places])
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
        f"{fraction:.0%} of the time, so that inside its steps the record fits neither hold well"
    )
    return replace(decision, reason=reason)


def _verdict(ledger: _Ledger, word: str, *, fewest: int, margin: float) -> Decision | None:
    """The hold that these intervals prove, if they do.

    Its residual must be below `margin` times the other's, and most intervals must agree, one by
    one: a large one alone proves nothing.
    """
    count = len(ledger.counted_ah)
    if count < fewest:
        return None
    backward = _spread(ledger.counted_ah - ledger.backward_ah)
    forward = _spread(ledger.counted_ah - ledger.forward_ah)
    hold, which = ("backward", "last") if backward < forward else ("forward", "first")
    better, worse = sorted((backward, forward))
    agreeing = float(np.mean((ledger.fractions() > 0.5) == (hold == "backward")))
    if better > margin * worse or agreeing < _AGREEING:
        return None
    places = counted(count, word) + (" of step" if word == "change" else "")
    reason = (
        f"at {places} the tester's Ah counters follow the current of the interval's {which} "
        f"sample (off by {1e3 * better:.2g} mAh, by {1e3 * worse:.2g} mAh with the other)"
    )
    return Decision(hold, "strong", reason)


def _ledger(samples: Samples) -> tuple[_Ledger, Int[np.ndarray, "telling"]]:
    """The ampere-hours of the intervals that tell, and their places.

    An interval tells where its two currents differ by far more than the counters resolve, and
    where no counter was reset.
    """
    counters, quantum_ah = samples.counters, samples.counters.quantum_ah
    counted_ah = counters.magnitudes_ah()
    is_unsigned = counted_ah is not None
    if counted_ah is None:
        counted_ah = counters.increments_ah(with_net=True)
    if counted_ah is None or not counted_ah.any():
        return _Ledger(*np.zeros((3, 0))), np.zeros(0, int)
    moved_ah = samples.ended_ah, samples.begun_ah
    if is_unsigned:
        moved_ah = tuple(map(np.abs, moved_ah))
    backward_ah, forward_ah = moved_ah
    # The counters' own sign may be opposite to the file's.
    if inner(counted_ah, backward_ah) + inner(counted_ah, forward_ah) < 0:
        counted_ah = -counted_ah
    largest_ah = max(max(own_ah.max(), -own_ah.min()) for own_ah in moved_ah)
    # A hundredth of the record's largest step of charge keeps the noise of the current out.
    floor_ah = max(5 * quantum_ah, 0.01 * float(largest_ah))
    apart_ah = backward_ah - forward_ah
    places = np.flatnonzero((apart_ah > floor_ah) | (apart_ah < -floor_ah))
    ledger = _Ledger(counted_ah, backward_ah, forward_ah).at(places)
    ends_ah = np.maximum(np.abs(ledger.backward_ah), np.abs(ledger.forward_ah))
    is_reset = np.abs(ledger.counted_ah) > 2 * ends_ah + quantum_ah
    for counter_ah in (counters.charged_ah, counters.discharged_ah):
        if counter_ah is not None:
            is_reset |= counter_ah[places + 1] < counter_ah[places]
    return ledger.at(~is_reset), places[~is_reset]


def _spread(values: Increments) -> float:
    """The RMS without the largest few: a net counter that begins anew near zero hides the fall."""
    smallest = np.sort(np.abs(values))[: len(values) - int(_FALLS * len(values))]
    return float(np.sqrt(np.mean(smallest**2)))
