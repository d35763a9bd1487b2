"""Which sign a file gives to a charging current: decided from the data, with the reason.

Column names promise a sign and break the promise (A123 files with Battery Data Format names are
discharge-positive), so they count only where the data say nothing.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .counters import counted_increments_ah
from .noise import voltage_noise_v
from .record import Decision
from .samples import Samples
from .stretches import stretches

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
    first, last_interval = stretches(is_steady)
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
