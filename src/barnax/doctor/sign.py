"""The sign of the current: whether it has one, keeps it, and is what its name promises."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from ..records.sign import CHARGE, DISCHARGE, PROMISED
from .case import Case
from .finding import Finding

# How many steps of either kind make a pattern, and how far each kind must agree.
_FEWEST, _AGREEING = 3, 0.9
# Both kinds of steps are there in earnest.
_MINORITY = 0.2
# A current that is never negative, but for its noise.
_NEVER_SHARE = 0.01


def find_sign(case: Case) -> Iterator[Finding]:
    """A current without a sign, with two, or with another than its column's name means."""
    samples, sign = case.samples, case.record.sign
    reason = sign.reason.partition(";")[0]
    at, votes = _votes(case)
    disorder = _unsigned(case, votes) or _turned(case, at, votes)
    if disorder is not None:
        yield disorder
        return
    start = int(at[0]) + 1 if len(at) else 0
    if sign.strength in ("weak", "assumed"):
        strength = {"weak": "weak evidence", "assumed": "no evidence"}[sign.strength]
        what = f"the current is taken as {sign.value} on {strength}: {reason}"
        yield case.at(start, "warning", what, f"say so: --current-sign {sign.value}")
        return
    promised = PROMISED[samples.dialect]
    if samples.dialect != "plain" and sign.value != promised:
        yield case.at(
            start,
            "warning",
            f"the current is {sign.value}, but {samples.dialect} names mean {promised}: {reason}",
            f"barnax turns it, other programs may not: --current-sign {sign.value}, or turn its "
            "sign in the file",
        )
    elif sign.value == DISCHARGE and samples.dialect == "plain":
        yield case.at(start, "note", f"the current is {sign.value}: {reason}")


def _votes(case: Case) -> tuple[np.ndarray, Float[np.ndarray, "steps"]]:
    """The clear current steps, and for each +1 where the file's current raises the voltage."""
    step_a = np.diff(case.samples.current_a)
    is_clear = case.is_step & (np.abs(case.step_v) > 6 * case.noise_v)
    at = np.flatnonzero(is_clear)
    return at, np.sign(step_a[at] * case.step_v[at])


def _unsigned(case: Case, votes: Float[np.ndarray, "steps"]) -> Finding | None:
    """An error where the current never changes its sign although the cell is charged too."""
    current_a = case.samples.current_a
    if min(-current_a.min(), current_a.max()) > _NEVER_SHARE * case.peak_a:
        return None
    rising, falling = int(np.sum(votes > 0)), int(np.sum(votes < 0))
    if min(rising, falling) < max(_FEWEST, _MINORITY * len(votes)):
        return None
    never = "negative" if current_a.max() > 0 else "positive"
    return case.at(
        int(np.argmax(np.abs(current_a))),
        "error",
        f"the current is never {never}, yet it lifts the voltage at {rising} of its steps and "
        f"lowers it at {falling}: the column has no sign",
        "export the signed current, or turn its sign in the steps that discharge",
    )


def _turned(case: Case, at: np.ndarray, votes: Float[np.ndarray, "steps"]) -> Finding | None:
    """An error where the sign is one up to a row and the other from there on."""
    if len(votes) < 2 * _FEWEST:
        return None
    before = np.cumsum(votes)
    contrast = np.abs(before[:-1]) + np.abs(before[-1] - before[:-1])
    split = int(np.argmax(contrast)) + 1
    first, second = votes[:split], votes[split:]
    is_pattern = min(len(first), len(second)) >= _FEWEST and all(
        np.abs(part.mean()) >= 2 * _AGREEING - 1 for part in (first, second)
    )
    if not is_pattern or first.mean() * second.mean() > 0:
        return None
    kinds = [CHARGE if part.mean() > 0 else DISCHARGE for part in (first, second)]
    return case.at(
        int(at[split]) + 1,
        "error",
        f"the sign of the current turns here: {kinds[0]} at {len(first)} steps before, "
        f"{kinds[1]} at {len(second)} from here on",
        "split the file here and give each part its own --current-sign",
    )
