"""The sign of a file's current, decided from its data.

Column names promise a sign and break the promise (A123 files with Battery Data Format names are
discharge-positive), so they count only where the data say nothing.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError, counted
from .columns import Dialect
from .findings import Finding, found_at
from .record import Decision, runs
from .samples import Samples, voltage_noise_v

CHARGE, DISCHARGE = "charge-positive", "discharge-positive"
Sign = Literal["charge-positive", "discharge-positive"]

PROMISED: dict[Dialect, Sign] = {
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


def decide_sign(
    samples: Samples, given: Sign | Literal["auto"], file: str
) -> tuple[Decision, list[Finding]]:
    """The file's sign of current, and what is to be said of how it was found.

    Raises InputError when a sign is given against strong evidence.
    """
    found = _from_data(samples)
    if given == "auto":
        decision = found or _from_names(samples)
        return decision, _doubts(samples, decision)
    if found is None:
        return Decision(given, "given", "given by the user; the data say nothing"), []
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


def _from_names(samples: Samples) -> Decision:
    value = PROMISED[samples.dialect]
    reason = f"the data do not tell, and {samples.dialect} column names usually mean {value}"
    return Decision(value, "assumed", reason)


def _from_data(samples: Samples) -> Decision | None:
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
    if sign.strength in ("weak", "assumed"):
        strength = "weak" if sign.strength == "weak" else "no"
        what = f"the current is taken as {sign.value} on {strength} evidence: {sign.reason}"
        remedy = f"say so: `current_sign='{sign.value}'`"
        return [found_at(samples, start, "warning", what, remedy)]
    promised = PROMISED[samples.dialect]
    if samples.dialect != "plain" and sign.value != promised:
        what = (
            f"the current is {sign.value}, but {samples.dialect} names mean {promised}: "
            f"{sign.reason}"
        )
        remedy = (
            f"barnax turns it, other programs may not: say `current_sign='{sign.value}'`, or turn "
            "its sign in the file"
        )
        return [found_at(samples, start, "warning", what, remedy)]
    if sign.value == DISCHARGE and samples.dialect == "plain":
        return [found_at(samples, start, "note", f"the current is {sign.value}: {sign.reason}")]
    return []


def step_votes(
    samples: Samples,
) -> tuple[Int[np.ndarray, "steps"], Float[np.ndarray, "steps"]]:
    """The clear current steps, and for each +1 where the file's current raises the voltage."""
    step_a, step_v = samples.step_a, samples.step_v
    at = np.flatnonzero(samples.is_step & (np.abs(step_v) > 6 * samples.noise_v))
    return at, np.sign(step_a[at] * step_v[at])


def _at_current_steps(samples: Samples) -> Evidence | None:
    """A cell's resistance lifts its voltage when the charging current steps up."""
    step_a, step_v, is_step = samples.step_a, samples.step_v, samples.is_step
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
            f"({share:.0%} of {total:.3g} V in {counted(int(is_clear.sum()), 'run')})"
        ),
    )


def _of_counters(samples: Samples) -> Evidence | None:
    """The tester's own counters say which current it calls a charge."""
    counted_ah = samples.counters.increments_ah(with_net=False)
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
