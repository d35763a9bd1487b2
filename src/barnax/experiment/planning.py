"""The shortest test that reaches what is wanted, held within limits."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Array

from ..errors import InputError
from .protocol import INTERVAL_S, Limits, Step, bends, sampled, voltage_along, warming_of
from .search import ROUNDED_SOC, SETTLE_S, Choice, Found, Pattern
from .stored import Predicted

MOST_HOURS = 200.0
BISECTIONS, ADJUSTMENTS, SEARCHES = 6, 8, 3
# Tests that a search predicts, that one for a shorter test does, and the patterns of their start.
PREDICTIONS, FURTHER, STRETCHES, MOVE_C = 120, 60, (10, 18), 1.0
# A test is not made shorter by less than this share.
NEARLY_SHORTEST = 0.03
ROUNDED = 1.001
# Of a longer test's pieces, what shares a shorter one is tried with, and by how much of what is
# wanted it is reached well enough to look no further.
FEWER, WELL_REACHED = (0.6, 0.3), 0.97
# How much longer a test is looked at where none reaches what is wanted.
LONGER = 2
# By how much of the SOC a piece is first taken to leave its stretch.
LEAST_BEYOND = 0.01
# By how much more than a square law currents are lowered where they warm too much.
LESS_WARM = 0.95


@dataclass(frozen=True, eq=False)
class Plan:
    """A test that was found and keeps all limits: its steps, and how it goes."""

    choice: Choice
    found: Found
    steps: list[Step]
    predicted: Predicted


def planned(
    choice: Choice,
    max_hours: float,
    key: Array,
    starts: int,
    reaches: Callable[[Sequence[Step]], bool],
) -> Plan:
    """The shortest test that reaches the wishes, or the best of the time, within all limits."""
    best = None
    for _ in range(SEARCHES):
        best, choice = _kept(choice, _best(choice, max_hours, key, starts), max_hours)
        if best is not None:
            break
        # Smaller currents may not bring back the charge that the pieces take.
    if best is None:
        raise InputError(
            f"no test stays between {choice.limits.low_v:g} and {choice.limits.high_v:g} V in the "
            "worst case, or warms so little; widen `low_voltage` and `high_voltage`, allow more "
            f"{_warming_or(choice, '`max_hours`')}, or lower `max_discharge` and `max_charge`"
        )
    capacity_ah = best.choice.believed.cell.capacity_ah
    largest_a, _ = best.choice.limits.rates_a(capacity_ah, np.linspace(0.0, 1.0, 21))
    fast = _starts_of(best.choice, float(np.max(largest_a)) / capacity_ah)
    shortest, hours = _least_hours(best.choice, fast), max_hours
    for number in range(BISECTIONS if reaches(best.steps) else 0):
        if hours - shortest < NEARLY_SHORTEST * hours:
            break
        middle, own_key = (shortest + hours) / 2, jax.random.fold_in(key, number)
        # Pieces of a longer test may not fit: fewer of them, and what a fast pass starts from.
        pattern = best.found.pattern
        fewer = [pattern.fewer(share) for share in FEWER]
        shorter = best.choice.searched(
            middle, own_key, FURTHER, pattern, *fewer, *fast,
            until=WELL_REACHED,
        )  # fmt: skip
        plan = None if shorter is None else _kept(best.choice, shorter, middle)[0]
        if plan is not None and reaches(plan.steps):
            best, hours = plan, middle
        else:
            shortest = middle
    return best


def _kept(choice: Choice, found: Found, hours: float) -> tuple[Plan | None, Choice]:
    """A found test with its currents lowered until it keeps all limits, None where it cannot, and
    the choice with its limits tightened by that."""
    for _ in range(ADJUSTMENTS):
        steps = choice.steps(found.pattern, hours)
        if steps is None:
            break
        predicted, limits = _simulated(choice, steps)
        if limits == choice.limits:
            return Plan(choice, found, steps, predicted), choice
        choice = replace(choice, limits=limits)
    return None, choice


def is_reached_in(
    hours: float, plan: Plan, key: Array, reaches: Callable[[Sequence[Step]], bool]
) -> bool:
    """True where a test of so many hours is found that reaches what a shorter plan does not."""
    longer, _ = _kept(plan.choice, _best(plan.choice, hours, key, 1), hours)
    return longer is not None and reaches(longer.steps)


def _best(choice: Choice, max_hours: float, key: Array, starts: int) -> Found:
    """The best of several searches. Raises `InputError` where no test is so short."""
    patterns = _starts_of(choice)
    searches = [
        choice.searched(max_hours, jax.random.fold_in(key, number), PREDICTIONS, *patterns)
        for number in range(starts)
    ]
    found = min(filter(None, searches), key=lambda test: test.value, default=None)
    if found is not None:
        return found
    if choice.steps(Pattern(STRETCHES[0], MOVE_C, (0,) * len(choice.blocks)), MOST_HOURS) is None:
        rates_a, _ = choice.limits.rates_a(1.0, np.linspace(choice.low_soc, choice.high_soc, 21))
        if not np.min(rates_a) > 0:
            raise InputError(
                "`max_discharge`: a test discharges the cell, and 0 allows no discharge at some "
                "state of charge; give more"
            )
        raise InputError(
            f"between {choice.limits.low_v:g} and {choice.limits.high_v:g} V no discharge is "
            "possible at some state of charge in the worst case; lower `low_voltage`"
        )
    least_hours = _least_hours(choice, patterns)
    raise InputError(
        f"`max_hours` {max_hours:g}: one pass through the state of charge takes "
        f"{math.ceil(100 * least_hours) / 100:g} h without rests between its pieces; give more "
        f"time, or a larger {_warming_or(choice, '`max_discharge`')}"
    )


def _warming_or(choice: Choice, other: str) -> str:
    """The option that limits a test more than another: the warming, where it lowers currents."""
    return "`max_warming`" if choice.limits.share < 1 else other


def _starts_of(choice: Choice, move_c: float = MOVE_C) -> list[Pattern]:
    """The patterns that a search starts from: moves and rests alone, and with pieces of a kind."""
    kinds = len(choice.blocks)
    return [
        Pattern(stretches, move_c, tuple(stretches * (kind == own) for own in range(kinds)))
        for stretches in STRETCHES
        for kind in range(kinds, -1, -1)
    ]


def _least_hours(choice: Choice, patterns: Sequence[Pattern]) -> float:
    """How long the shortest of these tests takes without rests between its pieces."""
    taken_s = (
        sum(step.duration_s for step in steps if step.block != "rest") + SETTLE_S
        for pattern in patterns
        if (steps := choice.steps(pattern, MOST_HOURS)) is not None
    )
    return min(taken_s, default=math.inf) / 3600


def _simulated(choice: Choice, steps: Sequence[Step]) -> tuple[Predicted, Limits]:
    """The test as it goes, and the limits of the choice, tightened where its worst case leaves a
    voltage, warms too much, or has a current over what is named for its state of charge."""
    believed, limits, current_a = choice.believed, choice.limits, sampled(steps)
    voltage_v, soc = voltage_along(believed, current_a, choice.high_soc)
    low_v, _ = voltage_along(believed, current_a, choice.high_soc, -1)
    high_v, _ = voltage_along(believed, current_a, choice.high_soc, 1)
    ends = np.cumsum([round(step.duration_s / INTERVAL_S) for step in steps])
    counts = np.arange(len(current_a)) <= ends[len(steps) - len(choice.last) - 1]
    # The rest of a full cell is at its highest voltage, and no test's doing.
    charges = counts & (current_a < 0)
    beyond_v = max(
        float(np.max(np.where(counts, limits.low_v - low_v, -math.inf))),
        float(np.max(np.where(charges, high_v - limits.high_v, -math.inf))),
    )
    if beyond_v > 0:
        limits = replace(limits, margin_v=limits.margin_v + beyond_v + 1e-3)
    low_soc, high_soc = believed.planned_soc
    low_soc = choice.low_soc - ROUNDED_SOC if choice.last else low_soc
    if counts.any() and not (low_soc <= soc[counts].min() and soc[counts].max() <= high_soc + 1e-9):
        limits = replace(limits, beyond_soc=max(LEAST_BEYOND, 2 * limits.beyond_soc))
    discharge_a, charge_a = limits.rates_a(believed.cell.capacity_ah, soc)
    # A current holds until the next sample, by when its limit may have passed it a little.
    if np.any((current_a > ROUNDED * discharge_a) | (-current_a > ROUNDED * charge_a)):
        limits = replace(limits, beyond_soc=max(LEAST_BEYOND, 2 * limits.beyond_soc))
    worst_v = np.where(current_a > 0, low_v, high_v)
    worst_k = warming_of(believed, current_a, worst_v, soc)
    if limits.warming_k is not None and worst_k > limits.warming_k:
        share = LESS_WARM * math.sqrt(limits.warming_k / worst_k)
        limits = replace(limits, share=limits.share * share)
    voltages_v = np.stack([voltage_v, low_v, high_v])
    starts = np.append(0, ends[:-1])
    of_steps = [bends(voltages_v, *span) for span in zip(starts, ends - 1, strict=True)]
    at = np.concatenate(of_steps)
    # A step's last value is held until the next step, so that jumps are drawn upright.
    is_last = np.cumsum([len(own) for own in of_steps]) - 1
    time_s = INTERVAL_S * at
    time_s[is_last] = INTERVAL_S * ends
    drawn = {
        "current_a": current_a,
        "voltage_v": voltage_v,
        "low_v": low_v,
        "high_v": high_v,
        "soc": soc,
    }
    predicted = Predicted(
        time_s=time_s,
        **{name: np.round(values[at], 5) for name, values in drawn.items()},
        warming_k=warming_of(believed, current_a, voltage_v, soc),
    )
    return predicted, limits
