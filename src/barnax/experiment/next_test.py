"""`barnax.design`: the next test of a cell, and what it is predicted to tell."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import jax
import numpy as np
from jaxtyping import Array

from ..blas import one_blas_thread
from ..errors import InputError
from ..results import Result
from .belief import believed_of, window_of
from .blocks import Block, candidate_blocks
from .information import Believed, Normal, Width, columns_along, information_of, widths_of
from .protocol import (
    COARSE_S,
    HIGH_SOC,
    INTERVAL_S,
    LOW_SOC,
    Limits,
    Step,
    bends,
    drive_levels,
    drive_steps,
    hppc_steps,
    move,
    sampled,
    voltage_along,
    warming_of,
)
from .search import Choice, Criterion, Found, OnDrive, Pattern, Wish, worst_first
from .stored import (
    DRIVE,
    WANTED_SOC,
    Design,
    Predicted,
    Reference,
    is_wanted,
    short,
    wanted_of,
)

# Of further resistances what is wanted of R2.
WANTED = {"R0": 0.02, "R1": 0.2, "R2": 0.3, "OCV": 15e-3}
# Of the RMSE that a fit leaves, what is wanted on a drive cycle.
WANTED_ON_DRIVE = 1.5
MAX_HOURS, MOST_HOURS = 3.0, 200.0
# Where a cell's OCV is not known, loads end here: under 10 % SOC a voltage may fall unforeseen (1C
# took a PyBaMM cell 0.9 V under its limit at 8 %). What empties it then, and the rest after it.
UNKNOWN_LOW_SOC = 0.1
EMPTYING_C, LAST_REST_S = 0.33, 300.0
BISECTIONS, ADJUSTMENTS = 4, 8
# Tests that a search predicts, and the patterns that it starts from.
PREDICTIONS, STRETCHES, MOVE_C = 120, (10, 18), 1.0
# How much of a width counts for reaching a wish: rounding.
REACHED = 1.005
ROUNDED = 1.001
# By how much of the SOC a piece is first taken to leave its stretch.
LEAST_BEYOND = 0.01
# By how much more than a square law currents are lowered where they warm too much.
LESS_WARM = 0.95


def design(
    result: Result | Believed | str | Path | None = None,
    *,
    capacity: float | None = None,
    chemistry: str = "nmc",
    max_hours: float = MAX_HOURS,
    want: Mapping[str, float] | Literal["hppc"] | None = None,
    low_voltage: float | None = None,
    high_voltage: float | None = None,
    max_discharge: float | Sequence[tuple[float, float]] | None = None,
    max_charge: float | Sequence[tuple[float, float]] | None = None,
    max_warming: float | None = None,
    temperature: float | None = None,
    blocks: Sequence[Block] | None = None,
    criterion: Criterion = worst_first,
    key: int = 0,
    starts: int = 1,
) -> Design:
    """The test to run next: the shortest that narrows the intervals to what is wanted and predicts
    a drive cycle as well as is wanted, or the best of the time that is given.

    Args:
        result: What is known of the cell: a result, the folder of one, or what is believed in its
            place. None: nothing but capacity and chemistry, and the test finds the OCV too. The
            records of a result count, and are to be identified with the test's, where they are
            still found.
        capacity: Capacity in Ah; by default that of the result.
        chemistry: nmc or lfp: what is believed of a cell without a result, and its voltages.
        max_hours: The longest that it may take.
        want: Half the 95 % interval wanted of R0, R1, R2 (relative) and OCV (in V), from 10 to 90 %
            of the state of charge, and the RMSE on a drive cycle (`drive`, in V; by default one and
            a half times that of the records). "hppc" wants what an HPPC of the same currents is
            predicted to tell.
        low_voltage: Lowest voltage; by default that of the chemistry.
        high_voltage: Highest voltage.
        max_discharge: Largest discharge in 1/h of the capacity, or pairs of state of charge and
            rate; by default 1, with a result what its records reached.
        max_charge: Largest charge, likewise; by default 0.5, or half the largest discharge.
        max_warming: By how many K at most the worst case may warm the cell, in moving air.
        temperature: Temperature of the test in degC, for a result over temperature.
        blocks: What it is composed of beside moves and rests; by default `candidate_blocks`.
        criterion: What is lowered, a function of the widths over the wanted ones; the error on the
            drive cycle, over the wanted one, comes last, as often as there are widths.
        key: Random key of blocks and searches; the same key gives the same test.
        starts: How many searches the best test is taken of.

    Raises `InputError` for limits that leave no room, for wishes of what is not there, and as
    `Result.load` does.

    >>> import barnax
    >>> found = barnax.design(capacity=2.0, max_hours=1.6)
    >>> found.hours <= 1.6, found.steps[0]
    (True, Step(block='rest', duration_s=300.0, current_a=0.0))
    """
    if not 0 < max_hours <= MOST_HOURS:
        raise InputError(f"`max_hours` {max_hours:g} must be above 0, and {MOST_HOURS:g} at most")
    if (want is not None and not want) or (blocks is not None and not blocks) or starts < 1:
        raise InputError(
            "a test needs something to `want`, some `blocks`, and one start of its search"
        )
    believed = believed_of(result, capacity, chemistry, temperature)
    window_v = window_of(believed.cell)
    limits = Limits(
        window_v[0] if low_voltage is None else low_voltage,
        window_v[1] if high_voltage is None else high_voltage,
        believed.rates_c[0] if max_discharge is None else max_discharge,
        believed.rates_c[1] if max_charge is None else max_charge,
        max_warming,
    )
    wishes, wanted = wishes_of(believed, None if want == "hppc" else want)
    random_key = jax.random.key(key)
    blocks = candidate_blocks(random_key, drive_levels()) if blocks is None else blocks
    capacity_ah = believed.cell.capacity_ah
    largest_a, charged_a = limits.allowed(believed, 0.6, 0.4)
    usual = {
        "HPPC": hppc_steps(capacity_ah, largest_a, charged_a),
        "drive cycle": drive_steps(capacity_ah, largest_a),
    }
    on_drive, soc = columns_along(
        believed, sampled(usual["drive cycle"], COARSE_S), HIGH_SOC, COARSE_S
    )
    on_drive = on_drive[soc >= WANTED_SOC[0]]
    normal = on_drive.T @ on_drive / len(on_drive)
    references = tuple(
        Reference(name=name, hours=_hours(steps), widths=_widths(believed, steps, normal, COARSE_S))
        for name, steps in usual.items()
    )
    if want == "hppc":
        wishes, wanted = wishes_of(believed, _medians(believed, references[0].widths))
    drive = OnDrive(wanted[DRIVE], normal) if DRIVE in wanted else None
    low_soc = LOW_SOC if believed.settings.ocv_nodes is None else UNKNOWN_LOW_SOC
    choice = Choice(
        believed, limits, tuple(blocks), wishes, criterion, HIGH_SOC, low_soc, drive,
        _emptying(believed, limits, low_soc),
    )  # fmt: skip
    with one_blas_thread():
        steps, predicted = _planned(choice, max_hours, random_key, starts)
    widths = _widths(believed, steps, normal)
    return Design(
        capacity_ah=capacity_ah,
        limits=limits,
        temperature_degc=temperature,
        wanted=wanted,
        is_reached=all(
            width.after <= REACHED * half
            for name, half in wanted.items()
            for width in wanted_of(name, widths)
        ),
        hours=_hours(steps),
        steps=tuple(steps),
        widths=widths,
        references=references,
        predicted=predicted,
        initial_soc=HIGH_SOC,
        finds_ocv=believed.settings.ocv_nodes is not None,
        earlier=tuple(record.name for record in believed.earlier),
        untold=believed.untold,
        error=believed.error,
        key=key,
    )


def _hours(steps: Sequence[Step]) -> float:
    return sum(step.duration_s for step in steps) / 3600


def _names(believed: Believed) -> list[str]:
    """The names that can be wished."""
    names = dict.fromkeys(map(short, believed.tables_of_names))
    if believed.settings.ocv_nodes is None:
        names.pop("OCV")
    return [*names, DRIVE]


def wishes_of(
    believed: Believed, want: Mapping[str, float] | None
) -> tuple[list[Wish], dict[str, float]]:
    """The wishes by place, and by table. Raises `InputError` for what the test cannot find."""
    names = _names(believed)
    for name, half in (want or {}).items():
        if name not in names:
            raise InputError(f"`want` {name!r}: the test can narrow {', '.join(names)}")
        if not 0 < half < 1:
            raise InputError(f"`want` {name}={half:g} must be above 0, and under 1 (100 % or 1 V)")
    usual = {**WANTED, DRIVE: WANTED_ON_DRIVE * believed.error.rmse_v}
    wanted = {name: usual.get(name, WANTED["R2"]) for name in names} if want is None else dict(want)
    return [
        Wish(place, wanted[short(name)])
        for place, (name, soc) in enumerate(believed.names)
        if is_wanted(soc) and short(name) in wanted
    ], wanted


def _medians(believed: Believed, widths: Sequence[Width]) -> dict[str, float]:
    """The median width of every table where it is wanted, and the error on a drive cycle."""
    return {
        name: float(np.median([width.after for width in own]))
        for name in _names(believed)
        if (own := wanted_of(name, widths))
    }


def _planned(
    choice: Choice, max_hours: float, key: Array, starts: int
) -> tuple[list[Step], Predicted]:
    """The shortest test that reaches the wishes, or the best of the time, within all limits, and
    how it goes."""
    best, hours = _best(choice, max_hours, key, starts), max_hours
    shortest = 0.0
    for number in range(BISECTIONS if best.is_reached else 0):
        middle, own_key = (shortest + hours) / 2, jax.random.fold_in(key, number)
        other = choice.searched(middle, own_key, PREDICTIONS // BISECTIONS, best.pattern)
        if other is not None and other.is_reached:
            best, hours = other, middle
        else:
            shortest = middle
    for _ in range(ADJUSTMENTS):
        steps = choice.steps(best.pattern, hours)
        if steps is None:
            # Smaller currents may not bring back the charge that the pieces take.
            best, hours = _best(choice, max_hours, key, starts), max_hours
            continue
        predicted, limits = _simulated(choice, steps)
        if limits == choice.limits:
            return steps, predicted
        choice = replace(choice, limits=limits)
    raise InputError(
        f"no test stays between {choice.limits.low_v:g} and {choice.limits.high_v:g} V in the "
        "worst case, or warms so little; widen `low_voltage` and `high_voltage`, allow more "
        "`max_hours`, or lower `max_discharge` and `max_charge`"
    )


def _best(choice: Choice, max_hours: float, key: Array, starts: int) -> Found:
    """The best of several searches. Raises `InputError` where no test is so short."""
    kinds = len(choice.blocks)
    patterns = [
        Pattern(stretches, MOVE_C, tuple(stretches * (kind == own) for own in range(kinds)))
        for stretches in STRETCHES
        for kind in range(kinds + 1)
    ]
    searches = [
        choice.searched(max_hours, jax.random.fold_in(key, number), PREDICTIONS, *patterns)
        for number in range(starts)
    ]
    found = min(filter(None, searches), key=lambda one: one.value, default=None)
    if found is not None:
        return found
    if choice.steps(Pattern(STRETCHES[0], MOVE_C, (0,) * kinds), MOST_HOURS) is None:
        raise InputError(
            f"between {choice.limits.low_v:g} and {choice.limits.high_v:g} V no discharge is "
            "possible at some state of charge in the worst case; lower `low_voltage`"
        )
    raise InputError(
        f"`max_hours` {max_hours:g}: one pass through the state of charge with its rests alone "
        "takes longer; give more time, or a larger `max_discharge`"
    )


def _emptying(believed: Believed, limits: Limits, low_soc: float) -> tuple[Step, ...]:
    """The steps that show the lower end of an unknown OCV."""
    if believed.settings.ocv_nodes is None:
        return ()
    capacity_ah, rest = believed.cell.capacity_ah, Step("last rest", LAST_REST_S, 0.0)
    rates_a, _ = limits.rates_a(capacity_ah, np.linspace(0.0, low_soc, 11))
    rate_a = min(EMPTYING_C * capacity_ah, float(np.min(rates_a)))
    return (move("to empty", low_soc * capacity_ah, rate_a), rest) if rate_a > 0 else (rest,)


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


def _widths(
    believed: Believed, steps: Sequence[Step], drive: Normal, interval_s: float = INTERVAL_S
) -> tuple[Width, ...]:
    """The widths that a test leaves, and the RMSE on a drive cycle with it."""
    columns, _ = columns_along(believed, sampled(steps, interval_s), HIGH_SOC, interval_s)
    found = information_of(believed, columns, interval_s)
    alone, after = (
        whole.left_on(believed, whole.inverse(believed), drive)
        for whole in (found, found + believed.told_before)
    )
    return (*widths_of(believed, found), Width(f"{DRIVE} [V]", None, 0.0, alone, after, None))
