"""Sums and ratios of parameters, which the data often know far better than their members."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from .covariance import Estimate, Uncertainty, direction_of
from .linearization import Linearization
from .wording import symbol, with_unit

# A combination is worth telling where its interval is this much narrower than its members'.
SHARPER = 1 / 3


def sum_of(
    names: Sequence[str], values: dict[str, float], near: Linearization, sure: Uncertainty
) -> Estimate:
    """Some resistances together in ohm, with the interval of the sum."""
    total = sum(values[name] for name in names)
    direction = sum(values[name] / total * direction_of(name, near)[0] for name in names)
    label = " + ".join(symbol(name) for name in names)
    return sure.of(f"{label} [Ohm]", total, np.asarray(direction))


def is_sharper(total: Estimate, members: list[Estimate]) -> bool:
    """Whether the total is known far better than any of its members."""
    errors = [each.relative_error for each in members if each.relative_error is not None]
    if total.low is None or total.relative_error is None or len(errors) < len(members):
        return False
    return total.relative_error < SHARPER * min(errors)


def sharper_words(
    names: Sequence[str], values: dict[str, float], near: Linearization, sure: Uncertainty
) -> str:
    """What to append on a sum of resistances or a capacitance among `names` known far better."""
    found = []
    resistances = [name for name in names if name.startswith("R")]
    for size in range(2, len(resistances) + 1):
        for members in combinations(sorted(resistances), size):
            total = sum_of(members, values, near, sure)
            if is_sharper(total, [sure[name] for name in members]):
                found.append(total)
    for name in resistances:
        pair = name[1]
        members = [name, f"tau{pair} [s]"]
        if members[1] in names and is_sharper(sure[f"C{pair} [F]"], [sure[m] for m in members]):
            found.append(sure[f"C{pair} [F]"])
    if not found:
        return ""
    best = min(found, key=lambda each: each.relative_error)
    return f"; what they have in common, {symbol(best.name)}, is determined{value_words(best)}"


def value_words(estimate: Estimate) -> str:
    """The value with its interval, to append to a sentence."""
    value = with_unit(estimate.name, estimate.value)
    if estimate.low is None or estimate.high is None:
        return f" ({value})"
    low, high = (with_unit(estimate.name, end) for end in (estimate.low, estimate.high))
    return f" ({value}, between {low} and {high})"
