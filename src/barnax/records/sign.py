"""The sign of a file's current, decided from its data.

Column names promise a sign and break the promise (A123 files with Battery Data Format names are
discharge-positive), so they only count if the data say nothing.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ..errors import counted
from ..notices import Notice, raise_first_error
from ..settings import AutoSign
from .counters import cosine
from .dialects import CHARGE, DISCHARGE, PLAIN
from .logger import Decision
from .record import runs
from .samples import MORE, Samples, few, voltage_noise_v
from .table import notice_at


def decide_sign(samples: Samples, given: AutoSign, file: str) -> tuple[Decision, list[Notice]]:
    """The file's sign of the current, and notices about the decision.

    Raises InputError if the given sign contradicts strong evidence.
    """
    shown = _from_data(samples)
    if given == "auto":
        make, column = samples.dialect, samples.columns["current"]
        value = column.sign or make.sign
        names = f"the data do not tell, and {make.name} column names usually mean {value}"
        decision = shown or Decision(value, "assumed", names)
        if decision.strength != "strong" and (column.sign or make.is_sign_certain):
            says = f"{make.name} instruments write it so"
            says = f"'{column.header}' says so" if column.sign else says
            is_against = column.sign and decision.value != value
            reason = f"{says}, although {decision.reason}" if is_against else says
            decision = Decision(value, "weak" if is_against else "strong", reason)
        return decision, _doubts(samples, decision)
    if shown is None:
        return Decision(given, "given", "given by the user; the data do not show it"), []
    if shown.value == given:
        return Decision(given, "given", f"given by the user, and {shown.reason}"), []
    values = {"found": shown.value, "strength": shown.strength, "reason": shown.reason}
    against = Notice("sign.against-data", {"given": given, **values})
    raise_first_error([against], file)
    return Decision(given, "given", f"given by the user, although {shown.reason}"), [against]


def _from_data(samples: Samples) -> Decision | None:
    """The sign that the evidence favors; None without evidence.

    The record as a whole, in which lags do not matter, is used if single tests leave doubt or
    contradict.
    """
    looks = _at_current_steps, _under_sustained_current, _of_counters, _of_states
    evidence = [one for look in looks if (one := look(samples)) is not None]
    sign, whole = _weighed(evidence), _over_the_record(samples)
    if whole is None or (sign and sign.strength == "strong" and sign.value == whole.value):
        return sign
    return _weighed([whole, *evidence], whole.value if whole.strength == "strong" else "")


def _weighed(evidence: Sequence[Decision], value: str = "") -> Decision | None:
    """The given sign, or that of most of the evidence.

    If both sides weigh the same, the first one decides: the voltage is physics, the counters are
    names.
    """
    if not evidence:
        return None
    weight = {CHARGE: 0, DISCHARGE: 0}
    for look in evidence:
        weight[look.value] += 2 if look.strength == "strong" else 1
    value = value or max((look.value for look in evidence), key=lambda sign: weight[sign])
    against = [look for look in evidence if look.value != value]
    more = 2 * weight[value] - sum(weight.values())
    is_strong = more >= 2 and not any(look.strength == "strong" for look in against)
    reason = "; ".join(look.reason for look in evidence if look.value == value)
    if against:
        reason += "; against it: " + "; ".join(look.reason for look in against)
    return Decision(value, "strong" if is_strong else "weak", reason)


def _evidence(agreement: float, is_strong: bool | np.bool_, words: str) -> Decision:
    """The evidence of one test, from its agreement with a charge-positive current."""
    value = CHARGE if agreement > 0 else DISCHARGE
    return Decision(value, "strong" if is_strong else "weak", words)


def _doubts(samples: Samples, sign: Decision) -> list[Notice]:
    """Notices of a sign that is doubtful, or differs from what the column names mean."""
    column, make = samples.columns["current"], samples.dialect
    promised = column.sign or make.sign
    values: dict[str, str | None] = {"sign": sign.value, "reason": sign.reason}
    if sign.strength in ("weak", "assumed"):
        code, values = "sign.doubtful", values | {"strength": sign.strength}
    elif (column.sign or make is not PLAIN) and sign.value != promised:
        code, header = "sign.unusual", column.header if column.sign else None
        values |= {"column": header, "dialect": make.name, "promised": promised}
    else:
        return []
    at, _ = step_votes(samples)
    return [notice_at(samples, int(at[0]) + 1 if len(at) else 0, code, **values)]


# A current of one sign, apart from its noise. With a signed current hardly any step contradicts the
# others; with magnitudes some do.
_NEVER_SHARE, _FEWEST_DENIALS, _DENIED_SHARE = 0.01, 3, 0.02


def examine_direction(samples: Samples) -> Samples:
    """The samples with a signed current, and the source of its sign.

    A tester may print the current without its sign and the direction in another column. Without
    that, it is an error if the voltage shows both charge and discharge.
    """
    current_a, state = samples.current_a, samples.state
    peak_a = samples.peak_a
    if min(-current_a.min(), current_a.max()) > _NEVER_SHARE * peak_a or peak_a == 0:
        return samples
    name = samples.header("current")
    if state is not None and np.any((current_a != 0) & ((state == 1) | (state == -1))):
        # In any other state, the previous one determines the direction.
        last = np.maximum.accumulate(np.where(np.abs(state) == 1, np.arange(len(state)), -1))
        direction = np.where(last >= 0, -state[last], 1)
        note = Notice("sign.by-state", {"column": name, "state": samples.header("state")})
        return samples.having(current=np.abs(current_a) * direction).noting(note)
    _, votes = step_votes(samples)
    rising, falling = int(np.sum(votes > 0)), int(np.sum(votes < 0))
    if min(rising, falling) < max(_FEWEST_DENIALS, _DENIED_SHARE * len(votes)):
        return samples
    never = "negative" if current_a.max() > 0 else "positive"
    at = int(np.argmax(np.abs(current_a)))
    return samples.telling(at, "sign.none", never=never, rising=rising, falling=falling)


def step_votes(samples: Samples) -> tuple[Int[np.ndarray, "steps"], Float[np.ndarray, "steps"]]:
    """The clear current steps, with +1 for each at which the file's current raises the voltage."""
    at = samples.steps
    at = at[np.abs(samples.answer_v[at]) > 6 * samples.noise_v]
    return at, np.sign(samples.step_a[at] * samples.answer_v[at])


def _at_current_steps(samples: Samples) -> Decision | None:
    """A cell's resistance raises the voltage when the charging current steps up, or several rows
    later if the voltage is late."""
    noise_v = voltage_noise_v(few(samples.answer_v, MORE)[~few(samples.is_step, MORE)])
    at = samples.steps
    step_v = samples.answer_v[at]
    product = samples.step_a[at] * step_v
    vote, share, count = clear = _agreement(product[np.abs(step_v) > 6 * noise_v])
    # If few of the steps are clear, the current may be noise, and the clear ones chance.
    is_strong = share >= 0.85 and count >= max(3, 0.2 * len(at))
    if not is_strong:
        every = vote, share, count = _agreement(product)
        # Small steps during relaxation are significant only by their number: four sigma of a fair
        # coin.
        is_strong = share >= 0.7 and (2 * share - 1) * count**0.5 >= 4
        vote, share, count = every if is_strong else clear
    steps = f"{round(share * count)} of {count} steps"
    words = f"the voltage {_moves(vote)} with the current at {steps}"
    return _evidence(vote * share, is_strong, words) if share >= 0.7 else None


def _moves(agreement: float) -> str:
    return "rises" if agreement > 0 else "falls"


def _agreement(product: Float[np.ndarray, "steps"]) -> tuple[int, float, int]:
    """The sign of the products' sum, the share that agrees, and their number."""
    product = product[product != 0]
    vote = 1 if product.sum() > 0 else -1
    return vote, float(np.sum(product * vote > 0)) / max(len(product), 1), len(product)


# At most this many parts of the record, each of this many samples, are compared. The charge passed
# is that of the largest current over this many hours; it moves the voltage this far, and explains
# this share of it, the second of which is strong.
_PARTS, _PART, _FEWEST_PARTS = 100, 20, 10
_PASSED_H, _MOVED_V, _EXPLAINS = 0.05, 0.1, (0.8, 0.9)


def _over_the_record(samples: Samples) -> Decision | None:
    """Charge that enters the cell raises the voltage at equal current, however late it is
    logged."""
    count = min(_PARTS, len(samples) // _PART)
    charge_ah = np.cumsum((samples.begun_ah + samples.ended_ah) / 2)
    if count < _FEWEST_PARTS or np.ptp(charge_ah) < _PASSED_H * samples.peak_a:
        return None
    edges = np.linspace(0, len(charge_ah), count + 1).astype(int)[:-1]
    lengths = np.diff(edges, append=len(charge_ah))
    current_a, mean_v, charge_ah = (
        np.add.reduceat(values[-len(charge_ah) :], edges) / lengths
        for values in (samples.current_a, samples.voltage_v, charge_ah)
    )
    table = np.column_stack([current_a, np.ones(count)])
    means = np.column_stack([mean_v, charge_ah])
    rest_v, rest_ah = (means - table @ np.linalg.lstsq(table, means)[0]).T
    agreement = cosine(rest_v, rest_ah)
    if not agreement:
        return None
    moved_v = np.ptp(charge_ah) * abs(rest_v @ rest_ah) / np.sum(rest_ah**2)
    if abs(agreement) < _EXPLAINS[0] or moved_v < _MOVED_V:
        return None
    moves = f"{_moves(agreement)} by {moved_v:.2g} V"
    words = f"over the whole record the voltage {moves} with the charge"
    return _evidence(agreement, abs(agreement) > _EXPLAINS[1], words)


def _under_sustained_current(samples: Samples) -> Decision | None:
    """A steady charging current raises the voltage; weighted by the change."""
    current, voltage = samples.current_a, samples.voltage_v
    magnitude = np.abs(current)
    is_loaded = magnitude > 0.05 * samples.peak_a
    is_steady = np.abs(samples.step_a) < 0.05 * magnitude[1:]
    is_steady &= is_loaded[1:] & is_loaded[:-1]
    noise_v = voltage_noise_v(few(samples.step_v, MORE))
    first, last_interval = runs(is_steady)
    last = last_interval + 1
    # Eight intervals exclude single relaxations; a change smaller than the noise is not a trend.
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
    many = f"{share:.0%} of {total:.3g} V in {counted(int(is_clear.sum()), 'run')}"
    words = f"under sustained positive current the voltage {_moves(vote)} ({many})"
    return _evidence(vote * share, share >= 0.9 and total >= 0.1, words)


def _of_counters(samples: Samples) -> Decision | None:
    """The tester's counters say which current it calls a charge."""
    counted_ah = samples.counters.increments_ah(with_net=False)
    if counted_ah is None:
        return None
    agreement = cosine(counted_ah, (samples.begun_ah + samples.ended_ah) / 2)
    if abs(agreement) < 0.3:
        return None
    how = "agree with" if agreement > 0 else "run against"
    sign = f"the current's sign (correlation {agreement:.2f})"
    words = f"the tester's charge and discharge counters {how} {sign}"
    return _evidence(agreement, abs(agreement) > 0.7, words)


def _of_states(samples: Samples) -> Decision | None:
    """The file's words for the steps."""
    if samples.state is None:
        return None
    votes = -np.sign(samples.current_a) * np.where(np.abs(samples.state) == 1, samples.state, 0)
    agreement = float(votes.sum()) / max(np.count_nonzero(votes), 1)
    sign, column = "positive" if agreement > 0 else "negative", samples.header("state")
    words = f"the current is {sign} where '{column}' says that the cell is charged"
    return _evidence(agreement, True, words) if abs(agreement) >= 0.8 else None
