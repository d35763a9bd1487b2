"""Whether the current has a sign, and keeps it throughout."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..records.findings import Finding, found_at
from ..records.samples import Samples
from ..records.sign import CHARGE, DISCHARGE, step_votes
from .check_input import CheckInput

# How many steps of either kind make a pattern, and how far each kind must agree.
_FEWEST, _AGREEING = 3, 0.9
# Both kinds of steps are there in earnest.
_MINORITY = 0.1
# A current that is never negative, but for its noise.
_NEVER_SHARE = 0.01

Votes = Float[np.ndarray, "steps"]


def find_turn(samples: Samples) -> tuple[Samples, list[Finding]]:
    """The samples in one sign throughout, and an error where it was another from a row on."""
    at, votes = step_votes(samples)
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
        "split the file here and give each part its own `current_sign`",
    )
    turned_a = np.concatenate([samples.current_a[:row], -samples.current_a[row:]])
    return replace(samples, current_a=turned_a), [finding]


def find_sign(given: CheckInput) -> Iterator[Finding]:
    """A current without a sign, of doubtful sign, or of another than its column's name means."""
    _, votes = step_votes(given.samples)
    unsigned = _unsigned(given, votes)
    if unsigned is not None:
        yield unsigned
    else:
        yield from given.sign_doubts


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
