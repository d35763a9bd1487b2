"""`barnax.design`: the next test of a cell, and its predicted intervals."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import jax
import numpy as np

from ..blas import one_blas_thread
from ..errors import InputError
from ..results import Result
from .information import (
    DRIVE,
    OVERSHOT,
    Name,
    Prior,
    Width,
    information_of,
    widths_of,
)
from .prior import HELD_V, UNKNOWN_LOW_SOC, prior_of
from .protocol import (
    COARSE_S,
    INTERVAL_S,
    LOW_SOC,
    Block,
    Limits,
    Rate,
    Step,
    candidate_blocks,
    drive_levels,
    drive_steps,
    hours_of,
    hppc_steps,
    move,
    sampled,
    voltage_limits_of,
)
from .search import LONGER, MOST_HOURS, Criterion, SearchSetup, is_reached_in, planned, worst_first
from .stored import (
    WANTED_SOC,
    Design,
    Predicted,
    Reference,
    Span,
    inside,
    is_enough,
    is_within,
    short,
)

# Further resistances are wanted as R2 is.
WANTED = {"R0": 0.02, "R1": 0.2, "R2": 0.3, "OCV": 15e-3}
# The RMSE wanted on a drive cycle, as a multiple of the RMSE that a fit leaves.
WANTED_ON_DRIVE = 1.5
MAX_HOURS = 3.0
# Usual tests have the currents that are allowed at these states of charge.
MIDDLE_SOC = (0.6, 0.4)
# Rate that empties a cell with an unknown OCV, and the rest after it.
EMPTYING_C, LAST_REST_S = 0.33, 300.0
# A test spans at least this much SOC: a table has a node in it.
LEAST_SPAN_SOC = 0.1
# Half an interval at each node of each table.
Halves = Iterable[tuple[Name, float]]


def design(
    result: Result | Prior | str | Path | None = None,
    *,
    capacity: float | None = None,
    chemistry: str | None = None,
    max_hours: float | None = None,
    want: Mapping[str, float] | Literal["hppc"] | None = None,
    low_voltage: float | None = None,
    high_voltage: float | None = None,
    max_discharge: Rate | None = None,
    max_charge: Rate | None = None,
    max_warming: float | None = None,
    temperature: float | None = None,
    blocks: Sequence[Block] | None = None,
    criterion: Criterion = worst_first,
    key: int = 0,
    starts: int = 1,
) -> Design:
    """The test to run next: the shortest that narrows the intervals as wanted and predicts a drive
    cycle as well as wanted, or the best one in the given time.

    Args:
        result: Existing knowledge of the cell: a result, the folder of one, or a prior. None: only
            capacity and chemistry, and the test identifies the OCV too. The records of a result
            count, and are to be identified together with the test's, if their files still exist.
        capacity: Capacity in Ah; by default that of the result.
        chemistry: nmc or lfp: the prior of a cell without a result (by default nmc); with a result,
            the source of its voltage limits, and of the OCV beyond the measured range of SOC, if a
            full charge is identified. Without it, the test stays within that range.
        max_hours: Longest duration; by default 3, and no test at all, with no steps, if the earlier
            records already determine what is wanted.
        want: Half the 95 % interval wanted of R0, R1, R2 (relative) and OCV (in V), from 10 to 90 %
            of the state of charge, and the RMSE on a drive cycle (`drive`, in V; by default one and
            a half times that of the records). "hppc" wants the intervals predicted for an HPPC with
            the same currents.
        low_voltage: Lowest voltage; by default that of the chemistry.
        high_voltage: Highest voltage.
        max_discharge: Largest discharge in 1/h of the capacity, or pairs of state of charge and
            rate; by default 1, or with a result the largest in its records.
        max_charge: Largest charge, likewise; by default 0.5, or half the largest discharge.
        max_warming: Largest rise of the temperature in K in the worst case, in moving air.
        temperature: Temperature of the test in degC, for a result over temperature.
        blocks: Pieces of the test other than moves and rests; by default `candidate_blocks`.
        criterion: Objective to minimize, a function of the widths over the wanted ones; the error
            on the drive cycle, over the wanted one, comes last, as often as there are widths.
        key: Random key of blocks and searches; the same key gives the same test.
        starts: Number of searches, of which the best test is taken.

    Raises `InputError` for limits that leave no room, for targets that do not apply, and as
    `Result.load` does.

    >>> import barnax
    >>> found = barnax.design(capacity=2.0, max_hours=1.6)
    >>> found.hours <= 1.6, found.steps[0]
    (True, Step(block='rest', duration_s=300.0, current_a=0.0))
    """
    is_asked = max_hours is not None
    max_hours = MAX_HOURS if max_hours is None else max_hours
    if not 0 < max_hours <= MOST_HOURS:
        raise InputError(f"`max_hours` {max_hours:g} must be above 0, and {MOST_HOURS:g} at most")
    if (want is not None and not want) or (blocks is not None and not blocks) or starts < 1:
        raise InputError(
            "a test needs something to `want`, some blocks, and one start of its search"
        )
    prior = prior_of(result, capacity, chemistry, temperature)
    window_v = voltage_limits_of(prior.cell, prior.typical)
    limits = Limits(
        window_v[0] if low_voltage is None else low_voltage,
        window_v[1] if high_voltage is None else high_voltage,
        prior.rates_c[0] if max_discharge is None else max_discharge,
        prior.rates_c[1] if max_charge is None else max_charge,
        max_warming,
    )
    low_soc, high_soc = _span(prior)
    _check_start(prior, high_soc, limits.high_v)
    wanted_soc = max(WANTED_SOC[0], low_soc), min(WANTED_SOC[1], high_soc)
    targets, wanted = targets_of(prior, None if want == "hppc" else want, wanted_soc)
    random_key = jax.random.key(key)
    blocks = candidate_blocks(random_key, drive_levels()) if blocks is None else blocks
    capacity_ah = prior.cell.capacity_ah
    largest_a, charged_a = limits.allowed(prior, *np.clip(MIDDLE_SOC, low_soc, high_soc))
    usual = {
        "HPPC": hppc_steps(capacity_ah, largest_a, charged_a, high_soc, low_soc),
        "drive cycle": drive_steps(capacity_ah, largest_a, high_soc, low_soc),
    }
    cycle = prior.loaded(sampled(usual["drive cycle"], COARSE_S), high_soc, COARSE_S)
    on_drive = information_of(prior, replace(cycle, scored=cycle.soc >= WANTED_SOC[0]))
    drive = on_drive.normal / on_drive.samples

    def left_by(steps: Sequence[Step], interval_s: float = INTERVAL_S) -> tuple[Width, ...]:
        test = prior.loaded(sampled(steps, interval_s), high_soc, interval_s)
        return widths_of(prior, information_of(prior, test), drive)

    references = tuple(
        Reference(name=name, hours=hours_of(steps), widths=left_by(steps, COARSE_S))
        for name, steps in usual.items()
    )
    if want == "hppc":
        medians = _medians(_halves(references[0].widths), _names(prior), wanted_soc)
        targets, wanted = targets_of(prior, medians, wanted_soc)
    choice = SearchSetup(
        prior, limits, tuple(blocks), targets, criterion, high_soc, low_soc,
        drive if DRIVE in wanted else None, wanted.get(DRIVE, 0.0),
        _emptying(prior, limits, low_soc),
    )  # fmt: skip

    def reaches(steps: Sequence[Step]) -> bool:
        halves = inside(_halves(left_by(steps)), wanted_soc)
        return all(_are_enough(name, halves[name], half) for name, half in wanted.items())

    before = widths_of(prior, drive=drive)
    already = _already(prior, _halves(before), wanted, wanted_soc)
    is_needed = len(already) < len(wanted)
    plan, is_reached, longer, needed = None, True, None, None
    if is_asked or is_needed:
        with one_blas_thread():
            # If the targets are met without a test, no test counts as short.
            is_short = reaches if is_needed else lambda steps: False
            plan = planned(choice, max_hours, random_key, starts, is_short)
            is_reached = reaches(plan.steps)
            if not is_reached and max_hours < MOST_HOURS:
                longer = min(LONGER * max_hours, MOST_HOURS)
                needed = longer if is_reached_in(longer, plan, random_key, reaches) else None
    steps = () if plan is None else tuple(plan.steps)
    return Design(
        capacity_ah=capacity_ah,
        limits=limits,
        temperature_degc=temperature,
        wanted=wanted,
        is_reached=is_reached,
        hours=hours_of(steps),
        steps=steps,
        widths=left_by(steps) if steps else before,
        references=references,
        predicted=Predicted.none() if plan is None else plan.predicted,
        initial_soc=high_soc,
        start_v=prior.start_v,
        wanted_soc=wanted_soc,
        hours_searched=longer,
        hours_needed=needed,
        finds_ocv=prior.finds_ocv,
        earlier=tuple(prepared.record.name for prepared in prior.earlier),
        untold=prior.untold,
        error=prior.error,
        already=already,
        printed=_medians(prior.printed.items(), wanted, wanted_soc),
        beyond=prior.beyond,
        follows=prior.follows,
        key=key,
    )


def _span(prior: Prior) -> Span:
    """The lowest and the highest state of charge of a test: those at which the OCV is known, less
    the excursion of pieces and of an uncertain start below them.

    Raises `InputError` if that leaves too little.
    """
    low_soc, high_soc = prior.planned_soc
    usual_soc = UNKNOWN_LOW_SOC if prior.finds_ocv else LOW_SOC
    end_soc = max(usual_soc, low_soc + OVERSHOT + prior.start_reach_soc)
    if high_soc - end_soc < LEAST_SPAN_SOC:
        whole = "with `chemistry` nmc or lfp it goes from full to empty, with a typical OCV beyond"
        if prior.start_v is not None:
            whole = "identify again with a longer record, or with `initial_soc` and `capacity`"
        raise InputError(
            f"the result knows the OCV from {100 * low_soc:.0f} to {100 * high_soc:.0f} % SOC, too "
            f"little for a test; {whole}"
        )
    return end_soc, high_soc


def _check_start(prior: Prior, high_soc: float, high_v: float) -> None:
    """Raise `InputError` if the OCV at the start of a test is above its highest voltage."""
    at = np.array([high_soc])
    # A charge held at a voltage ends there, however uncertain the OCV is.
    is_held = high_soc == 1 or prior.start_v is not None
    start_v = float((prior.ocv_v(at) if is_held else prior.ocv_end_v(at, 1))[0])
    if start_v <= high_v + HELD_V * is_held:
        return
    if high_soc == 1 and prior.typical:
        soc = np.linspace(0.0, 1.0, 1001)
        reached = 100 * float(soc[prior.ocv_v(soc) <= high_v].max(initial=0.0))
        raise InputError(
            f"`high_voltage` {high_v:g} V: the test starts full, which in a typical "
            f"{prior.typical.upper()} cell is an OCV of {start_v:.3f} V; {high_v:g} V is "
            f"reached at {reached:.3g} % SOC. Give at least {start_v:.3f} V if the cell's data "
            "sheet allows, or the result of a record that starts where you charge to"
        )
    raise InputError(
        f"`high_voltage` {high_v:g} V: the test starts at {100 * high_soc:.0f} % SOC, where the "
        f"OCV {'is' if is_held else 'may be'} {start_v:.3f} V; raise it if the cell's data sheet "
        "allows"
    )


def _names(prior: Prior) -> list[str]:
    """The names that `want` may contain."""
    names = dict.fromkeys(map(short, prior.tables_of_names))
    if not prior.finds_ocv:
        names.pop("OCV")
    return [*names, DRIVE]


def targets_of(
    prior: Prior, want: Mapping[str, float] | None, wanted_soc: Span
) -> tuple[dict[int, float], dict[str, float]]:
    """The targets by the index of an unknown, and by table.

    Raises `InputError` for anything that the test cannot identify.
    """
    names = _names(prior)
    for name, half in (want or {}).items():
        if name not in names:
            raise InputError(f"`want` {name!r}: the test can narrow {', '.join(names)}")
        if not 0 < half < 1:
            raise InputError(f"`want` {name}={half:g} must be above 0, and under 1 (100 % or 1 V)")
    usual = {**WANTED, DRIVE: WANTED_ON_DRIVE * prior.error.rmse_v}
    wanted = {name: usual.get(name, WANTED["R2"]) for name in names} if want is None else dict(want)
    targets = {
        index: wanted[short(name)]
        for index, (name, soc) in enumerate(prior.names)
        if is_within(soc, wanted_soc) and short(name) in wanted
    }
    reached = {DRIVE, *(short(prior.names[index][0]) for index in targets)}
    if lacking := [name for name in wanted if name not in reached]:
        low, high = (100 * soc for soc in wanted_soc)
        raise InputError(
            f"`want` {', '.join(lacking)}: no node lies from {low:.0f} to {high:.0f} % SOC, where "
            "the test is; identify again with more `nodes`"
        )
    return targets, wanted


def _emptying(prior: Prior, limits: Limits, low_soc: float) -> tuple[Step, ...]:
    """The steps that reach the lower end of an unknown OCV, if the test comes near it."""
    is_near = low_soc <= UNKNOWN_LOW_SOC and prior.start_v is None
    if not (prior.finds_ocv and is_near):
        return ()
    capacity_ah, rest = prior.cell.capacity_ah, Step("last rest", LAST_REST_S, 0.0)
    rates_a, _ = limits.rates_a(capacity_ah, np.linspace(0.0, low_soc, 11))
    rate_a = min(EMPTYING_C * capacity_ah, float(np.min(rates_a)))
    return (move("to empty", low_soc * capacity_ah, rate_a), rest) if rate_a > 0 else (rest,)


def _halves(widths: Iterable[Width]) -> Halves:
    return (((width.name, width.soc), width.after) for width in widths)


def _are_enough(name: str, halves: Iterable[float], wanted: float) -> bool:
    return all(is_enough(name, half, wanted) for half in halves)


def _already(
    prior: Prior, before: Halves, wanted: Mapping[str, float], wanted_soc: Span
) -> tuple[str, ...]:
    """The names that the earlier records determine as well as wanted, throughout the wanted range:
    as a design counts them, and by the standard errors of their own fit."""
    counted = ((name, max(half, prior.half_widths.get(name, 0.0))) for name, half in before)
    halves = inside(counted, wanted_soc)
    nodes = inside(((name, 0.0) for name in (*prior.names, (DRIVE, None))), wanted_soc)
    whole = [name for name in wanted if len(halves[name]) == len(nodes[name])]
    return tuple(name for name in whole if _are_enough(name, halves[name], wanted[name]))


def _medians(halves: Halves, names: Iterable[str], wanted_soc: Span) -> dict[str, float]:
    """The median of every table in the wanted range, and of the error on a drive cycle."""
    by_name = inside(halves, wanted_soc)
    return {name: float(np.median(by_name[name])) for name in names if by_name[name]}
