"""The sign of the current: whether it has one, keeps it, and is what its name promises."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..records.conventions import CHARGE, DISCHARGE, PROMISED
from ..records.record import voltage_noise_v
from ..records.samples import Samples
from .check_input import STEADY_SHARE, STEP_SHARE, CheckInput
from .finding import Finding, found_at

# How many steps of either kind make a pattern, and how far each kind must agree.
_FEWEST, _AGREEING = 3, 0.9
# Both kinds of steps are there in earnest.
_MINORITY = 0.1
# A current that is never negative, but for its noise.
_NEVER_SHARE = 0.01

Votes = Float[np.ndarray, "steps"]


def examine_turn(samples: Samples) -> tuple[Samples, list[Finding]]:
    """The samples in one sign throughout, and an error where it was another from a row on."""
    at, votes = _votes(samples)
    if len(votes) < 2 * _FEWEST:
        return samples, []
    before = np.cumsum(votes)
    contrast = np.abs(before[:-1]) + np.abs(before[-1] - before[:-1])
    split = int(np.argmax(contrast)) + 1
    parts = votes[:split], votes[split:]
    is_turned = parts[0].mean() * parts[1].mean() < 0 and all(
        len(part) >= _FEWEST and np.abs(part.mean()) >= 2 * _AGREEING - 1 for part in parts
    )
    if not is_turned:
        return samples, []
    kinds = [CHARGE if part.mean() > 0 else DISCHARGE for part in parts]
    row = int(at[split]) + 1
    finding = found_at(
        samples,
        row,
        "error",
        f"the sign of the current turns here: {kinds[0]} at {len(parts[0])} steps before, "
        f"{kinds[1]} at {len(parts[1])} from here on",
        "split the file here and give each part its own --current-sign",
    )
    turned_a = np.concatenate([samples.current_a[:row], -samples.current_a[row:]])
    return replace(samples, current_a=turned_a), [finding]


def find_sign(given: CheckInput) -> Iterator[Finding]:
    """A current without a sign, of doubtful sign, or of another than its column's name means."""
    samples, sign = given.samples, given.record.sign
    at, votes = _votes(samples)
    unsigned = _unsigned(given, votes)
    if unsigned is not None:
        yield unsigned
        return
    reason = sign.reason.partition(";")[0]
    start = int(at[0]) + 1 if len(at) else 0
    if sign.strength in ("weak", "assumed"):
        strength = {"weak": "weak evidence", "assumed": "no evidence"}[sign.strength]
        what = f"the current is taken as {sign.value} on {strength}: {reason}"
        yield given.at(start, "warning", what, f"say so: --current-sign {sign.value}")
        return
    promised = PROMISED[samples.dialect]
    if samples.dialect != "plain" and sign.value != promised:
        yield given.at(
            start,
            "warning",
            f"the current is {sign.value}, but {samples.dialect} names mean {promised}: {reason}",
            f"barnax turns it, other programs may not: --current-sign {sign.value}, or turn its "
            "sign in the file",
        )
    elif sign.value == DISCHARGE and samples.dialect == "plain":
        yield given.at(start, "note", f"the current is {sign.value}: {reason}")


def _votes(samples: Samples) -> tuple[np.ndarray, Votes]:
    """The clear current steps, and for each +1 where the file's current raises the voltage."""
    step_a, step_v = np.diff(samples.current_a), np.diff(samples.voltage_v)
    peak_a = np.abs(samples.current_a).max()
    noise_v = voltage_noise_v(step_v, np.abs(step_a) < STEADY_SHARE * peak_a)
    at = np.flatnonzero((np.abs(step_a) > STEP_SHARE * peak_a) & (np.abs(step_v) > 6 * noise_v))
    return at, np.sign(step_a[at] * step_v[at])


def _unsigned(given: CheckInput, votes: Votes) -> Finding | None:
    """An error where the current never changes its sign although the cell is charged too."""
    current_a = given.samples.current_a
    if min(-current_a.min(), current_a.max()) > _NEVER_SHARE * given.peak_a:
        return None
    rising, falling = int(np.sum(votes > 0)), int(np.sum(votes < 0))
    if min(rising, falling) < max(_FEWEST, _MINORITY * len(votes)):
        return None
    never = "negative" if current_a.max() > 0 else "positive"
    return given.at(
        int(np.argmax(np.abs(current_a))),
        "error",
        f"the current is never {never}, yet it lifts the voltage at {rising} of its steps and "
        f"lowers it at {falling}: the column has no sign",
        "export the signed current, or turn its sign in the steps that discharge",
    )
