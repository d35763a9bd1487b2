"""`barnax.design`: the next test of a cell, and what it is predicted to tell."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import jax
import numpy as np

from ..blas import one_blas_thread
from ..bundled import bundled_file
from ..errors import InputError
from ..records import read_record
from ..results import Result
from ..schema import ARRAY, Document, Part
from .belief import WINDOW_V, believed_of_chemistry, believed_of_result
from .blocks import Block, candidate_blocks
from .information import Believed, Width, columns_along, information_of, widths_of
from .protocol import INTERVAL_S, Limits, Step, hppc_steps, move, sampled, voltage_along
from .search import Choice, Chosen, Criterion, Wish, worst_first

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HIGH_SOC, LOW_SOC = 1.0, 0.05
# Where tables are wanted.
WANTED_SOC = (0.1, 0.9)
WANTED = {"R0": 0.02, "R1": 0.1, "R2": 0.1, "OCV": 10e-3}
LEAST_HOURS, MAX_HOURS = 0.5, 3.0
# What empties a cell whose OCV is not known, and the rest after it.
EMPTYING_C, LAST_REST_S = 0.2, 900.0
BISECTIONS, ADJUSTMENTS = 3, 8
# How much of a width counts for reaching a wish: rounding.
REACHED = 1.005
DEFAULT_C = (1.0, 0.5)
# Usual tests last half a day, and are looked at in so many seconds.
REFERENCE_S = 2.0


class Predicted(Part):
    """The test as it is believed to go, at both ends of every step.

    Attributes:
        time_s: Time.
        current_a: Current.
        voltage_v: Voltage.
        low_v: The lowest that it may be.
        high_v: The highest that it may be.
        soc: State of charge.
    """

    time_s: Annotated[np.ndarray, ARRAY]
    current_a: Annotated[np.ndarray, ARRAY]
    voltage_v: Annotated[np.ndarray, ARRAY]
    low_v: Annotated[np.ndarray, ARRAY]
    high_v: Annotated[np.ndarray, ARRAY]
    soc: Annotated[np.ndarray, ARRAY]


class Reference(Part):
    """What a usual test would take and tell.

    Attributes:
        name: What it is.
        hours: Its duration.
        widths: What it is predicted to tell.
    """

    name: str
    hours: float
    widths: tuple[Width, ...]


class Design(Document):
    """A test to run next.

    Attributes:
        capacity_ah: Capacity that it is for.
        limits: What it keeps: voltages, and rates in 1/h of the capacity.
        temperature_degc: Temperature that it is for, None where nothing was said.
        wanted: Half the 95 % intervals that were asked for, by table: relative, in V for an OCV.
        is_reached: Whether all of them are predicted to be reached.
        hours: Its duration, from the rest after the full charge on.
        steps: All steps of constant current, in order.
        widths: What it is predicted to tell.
        references: Usual tests with the same currents, in comparison.
        predicted: How it is believed to go.
        initial_soc: State of charge at its start.
        finds_ocv: Whether the OCV is found by the test too.
        noise: Correlation times in s and standard deviations in V of the error it reckons with.
        key: Random key.
    """

    capacity_ah: float
    limits: Limits
    temperature_degc: float | None
    wanted: dict[str, float]
    is_reached: bool
    hours: float
    steps: tuple[Step, ...]
    widths: tuple[Width, ...]
    references: tuple[Reference, ...]
    predicted: Predicted
    initial_soc: float
    finds_ocv: bool
    noise: tuple[tuple[float, float], ...]
    key: int

    what: ClassVar[str] = "barnax design"
    remedy: ClassVar[str] = "give the folder or the design.json that barnax design wrote"

    @classmethod
    def load(cls, path: str | Path) -> "Design":
        """The design in a folder, or in its `design.json`."""
        path = Path(path)
        return cls.from_json(path / "design.json" if path.is_dir() else path)

    def of_table(self, name: str, widths: Sequence[Width] | None = None) -> tuple[Width, ...]:
        """The widths of a table, such as "R0", where it is wanted."""
        low, high = WANTED_SOC
        return tuple(
            each
            for each in (self.widths if widths is None else widths)
            if each.name.startswith(f"{name} [") or each.name.startswith(f"{name} correction")
            if each.soc is not None and low <= each.soc <= high
        )

    @property
    def pieces(self) -> list[tuple[str, list[Step]]]:
        """Neighboring steps of one piece together."""
        return [(name, [*steps]) for name, steps in groupby(self.steps, lambda each: each.block)]

    def figure(self) -> "Figure":
        """Current, voltage and state of charge as they are predicted."""
        from ..display import hook

        return hook("Design.figure")(self)


def design(
    result: Result | str | Path | None = None,
    *,
    capacity: float | None = None,
    chemistry: str = "nmc",
    max_hours: float = MAX_HOURS,
    want: Mapping[str, float] | None = None,
    low_voltage: float | None = None,
    high_voltage: float | None = None,
    max_discharge: float | Sequence[tuple[float, float]] | None = None,
    max_charge: float | Sequence[tuple[float, float]] | None = None,
    temperature: float | None = None,
    blocks: Sequence[Block] | None = None,
    criterion: Criterion = worst_first,
    key: int = 0,
) -> Design:
    """The test to run next: the shortest that narrows the intervals to what is wanted, or the best
    of the time that is given.

    Args:
        result: What is known of the cell: a result, or the folder of one. None: nothing but
            capacity and chemistry, and the test finds the OCV too.
        capacity: Capacity in Ah; by default that of the result.
        chemistry: nmc or lfp: what is believed of a cell without a result, and its voltages.
        max_hours: The longest that it may take.
        want: Half the 95 % interval wanted of R0, R1, R2 (relative) and OCV (in V), from 10 to 90 %
            of the state of charge.
        low_voltage: Lowest voltage; by default that of the chemistry.
        high_voltage: Highest voltage.
        max_discharge: Largest discharge in 1/h of the capacity, or pairs of state of charge and
            rate; by default 1, with a result what its records reached.
        max_charge: Largest charge, likewise; by default 0.5, or half the largest discharge.
        temperature: Temperature of the test in degC, for a result over temperature.
        blocks: What it is composed of; by default `candidate_blocks`.
        criterion: What is lowered, a function of the widths over the wanted ones.
        key: Random key of the blocks that are random; the same key gives the same test.

    Raises `InputError` for limits that leave no room, for wishes of what is not there, and as
    `Result.load` does.

    >>> import barnax
    >>> found = barnax.design(capacity=2.0, max_hours=1.6)
    >>> found.hours <= 1.6, found.steps[0]
    (True, Step(block='rest', duration_s=300.0, current_a=0.0))
    """
    if isinstance(result, str | Path):
        result = Result.load(result)
    if result is None:
        if capacity is None:
            raise InputError("a test needs a `capacity` in Ah, or the result of earlier records")
        believed = believed_of_chemistry(chemistry, capacity)
        rates = DEFAULT_C
    else:
        believed = believed_of_result(result, temperature)
        if capacity is not None:
            believed = replace(believed, cell=replace(believed.cell, capacity_ah=capacity))
        chemistry = "lfp" if believed.cell.has_flat_ocv else "nmc"
        peaks_a = [each.peak_current_a or 0.0 for each in result.of_role("identification")]
        rates = (
            max(peaks_a) / believed.cell.capacity_ah,
            max(peaks_a) / believed.cell.capacity_ah / 2,
        )
    usual_v = WINDOW_V.get(chemistry, WINDOW_V["nmc"])
    limits = Limits(
        usual_v[0] if low_voltage is None else low_voltage,
        usual_v[1] if high_voltage is None else high_voltage,
        rates[0] if max_discharge is None else max_discharge,
        rates[1] if max_charge is None else max_charge,
    )
    blocks = candidate_blocks(jax.random.key(key), drive_levels()) if blocks is None else blocks
    wishes, wanted = _wishes(believed, want)
    choice = Choice(believed, limits, tuple(blocks), wishes, criterion, HIGH_SOC, LOW_SOC)
    with one_blas_thread():
        planned = _planned(choice, max_hours)
    widths = _widths(believed, planned.steps)
    low, high = WANTED_SOC
    largest_a, charged_a = (
        max((way * step.current_a for step in planned.steps), default=0.0) for way in (1, -1)
    )
    return Design(
        capacity_ah=believed.cell.capacity_ah,
        limits=limits,
        temperature_degc=temperature,
        wanted=wanted,
        is_reached=all(
            each.after <= REACHED * wanted[name]
            for each in widths
            if (name := _short(each.name)) in wanted
            and each.soc is not None
            and low <= each.soc <= high
        ),
        hours=sum(step.duration_s for step in planned.steps) / 3600,
        steps=tuple(planned.steps),
        widths=widths,
        references=tuple(
            Reference(
                name=name,
                hours=sum(step.duration_s for step in steps) / 3600,
                widths=_widths(believed, steps, REFERENCE_S),
            )
            for name, steps in (
                ("HPPC", hppc_steps(believed.cell.capacity_ah, largest_a, charged_a)),
                ("drive cycle", _drive_steps(believed.cell.capacity_ah, largest_a)),
            )
        ),
        predicted=planned.predicted,
        initial_soc=HIGH_SOC,
        finds_ocv=believed.settings.ocv_nodes is not None,
        noise=tuple(believed.noise),
        key=key,
    )


def _short(name: str) -> str:
    """How a table is called in a wish."""
    return re.split(r"[ \[]", name)[0]


def _wishes(
    believed: Believed, want: Mapping[str, float] | None
) -> tuple[list[Wish], dict[str, float]]:
    """The wishes by place, and by table. Raises `InputError` for what the test cannot find."""
    names = dict.fromkeys(_short(name) for name, soc in believed.names if soc is not None)
    if believed.settings.ocv_nodes is None:
        names.pop("OCV")
    for name, half in (want or {}).items():
        if name not in names:
            raise InputError(f"`want` {name!r}: the test can narrow {', '.join(names)}")
        if not 0 < half < math.inf:
            raise InputError(f"`want` {name}={half:g} must be positive")
    wanted = {name: WANTED.get(name, 0.1) for name in names} if want is None else dict(want)
    low, high = WANTED_SOC
    return [
        Wish(place, wanted[_short(name)])
        for place, (name, soc) in enumerate(believed.names)
        if soc is not None and low <= soc <= high and _short(name) in wanted
    ], wanted


@dataclass(frozen=True, eq=False)
class _Planned:
    steps: list[Step]
    predicted: Predicted


def _planned(choice: Choice, max_hours: float) -> _Planned:
    """The shortest test that reaches the wishes, or the best of the time, within all limits."""
    emptying = _emptying(choice.believed)
    spare = max_hours - sum(step.duration_s for step in emptying) / 3600
    shortest = choice.hours(Chosen(((),) * len(choice.segments)))
    if not shortest <= spare:
        least = shortest + max_hours - spare
        raise InputError(
            f"`max_hours` {max_hours:g}: going through the state of charge alone takes "
            f"{least:.2f} h with these limits; give more time, or a larger `max_discharge`"
        )
    best = choice.search(spare)
    longest = choice.hours(best)
    if _reaches(choice, best):
        for _ in range(BISECTIONS):
            middle = (shortest + longest) / 2
            other = choice.search(middle)
            if _reaches(choice, other):
                best, longest = other, choice.hours(other)
            else:
                shortest = middle
    for _ in range(ADJUSTMENTS):
        steps = [*choice.steps(best), *emptying]
        predicted, beyond_v = _simulated(choice, steps, len(steps) - len(emptying))
        if beyond_v <= 0:
            return _Planned(steps, predicted)
        margin_v = choice.limits.margin_v + beyond_v + 1e-3
        choice = replace(choice, limits=replace(choice.limits, margin_v=margin_v))
    raise InputError(
        f"no test stays between {choice.limits.low_v:g} and {choice.limits.high_v:g} V in the "
        "worst case; widen `low_voltage` and `high_voltage`, or lower `max_discharge` and "
        "`max_charge`"
    )


def _reaches(choice: Choice, chosen: Chosen) -> bool:
    """Whether the test as a whole reaches all wishes."""
    steps = [*choice.steps(chosen), *_emptying(choice.believed)]
    columns, _ = columns_along(choice.believed, sampled(steps), choice.high_soc)
    return float(np.max(choice.ratios(information_of(choice.believed, columns)))) <= 1


def _emptying(believed: Believed) -> list[Step]:
    """What shows the lower end of an OCV that is not known."""
    if believed.settings.ocv_nodes is None:
        return []
    capacity_ah = believed.cell.capacity_ah
    empties = move("to empty", LOW_SOC * capacity_ah, EMPTYING_C * capacity_ah)
    return [empties, Step("last rest", LAST_REST_S, 0.0)]


def _simulated(choice: Choice, steps: Sequence[Step], counted: int) -> tuple[Predicted, float]:
    """The test as it goes, and by how much the worst case of the counted steps leaves a limit."""
    believed, limits, current_a = choice.believed, choice.limits, sampled(steps)
    voltage_v, soc = voltage_along(believed, current_a, choice.high_soc)
    low_v, _ = voltage_along(believed, current_a, choice.high_soc, -1)
    high_v, _ = voltage_along(believed, current_a, choice.high_soc, 1)
    ends = np.cumsum([round(step.duration_s / INTERVAL_S) for step in steps])
    counts = np.arange(len(current_a)) <= ends[counted - 1]
    # The rest of a full cell is at its highest voltage, and no test's doing.
    charges = counts & (current_a < 0)
    beyond_v = max(
        float(np.max(np.where(counts, limits.low_v - low_v, -math.inf))),
        float(np.max(np.where(charges, high_v - limits.high_v, -math.inf))),
    )
    at = np.stack([np.append(0, ends[:-1]), ends - 1], axis=1).ravel()
    time_s = INTERVAL_S * np.stack([np.append(0, ends[:-1]), ends], axis=1).ravel()
    drawn = {
        "current_a": current_a,
        "voltage_v": voltage_v,
        "low_v": low_v,
        "high_v": high_v,
        "soc": soc,
    }
    rounded = {name: np.round(values[at], 5) for name, values in drawn.items()}
    return Predicted(time_s=time_s, **rounded), beyond_v


def _widths(
    believed: Believed, steps: Sequence[Step], interval_s: float = INTERVAL_S
) -> tuple[Width, ...]:
    columns, _ = columns_along(believed, sampled(steps, interval_s), HIGH_SOC, interval_s)
    return widths_of(believed, information_of(believed, columns, interval_s))


def drive_levels() -> np.ndarray:
    """The bundled drive cycle, a level every second."""
    current_a = read_record(bundled_file("validation")).current_a
    return current_a / current_a.max()


def _drive_steps(capacity_ah: float, largest_a: float) -> list[Step]:
    """The bundled drive cycles with such a largest current, from full until empty."""
    current_a = read_record(bundled_file("identification")).current_a
    current_a = current_a / current_a.max() * largest_a
    whole = np.tile(current_a, 3)
    soc = 1 - np.cumsum(whole) / 3600 / capacity_ah
    last = int(np.argmax(soc < LOW_SOC)) or len(whole)
    return [Step("drive cycle", REFERENCE_S, float(each)) for each in whole[:last:2]]
