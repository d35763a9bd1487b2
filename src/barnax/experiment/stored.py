"""A designed test as stored: its steps, and its predicted intervals."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, TypeVar

import numpy as np
from jaxtyping import Float
from pydantic import Field

from ..cell.dependence import BETA, CHARGE, KAPPA, ONSET, Dependence
from ..display import hook
from ..fit.node_interval import NodeInterval
from ..metrics import NORMAL_95
from ..records import Hold, Record
from ..schema import ARRAY, Document, Part
from .information import DRIVE, Name, ResidualModel, Width
from .protocol import INTERVAL_S, Limits, Step, bends

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# A sample within this time of the end of a step is at it; this many of them, and all of them up to
# this share, determine how a current is sampled.
ON_TIME_S, FEWEST_MET, CLEARLY = 0.05, 10, 0.1
# Range of SOC in which tables are wanted.
WANTED_SOC = (0.1, 0.9)
Span = tuple[float, float]
Value = TypeVar("Value")


def short(name: str) -> str:
    """The name of a table as a target.

    >>> short("R0 [Ohm]"), short("OCV correction [V]")
    ('R0', 'OCV')
    """
    return name.split()[0]


def is_within(soc: float | None, wanted_soc: Span) -> bool:
    return soc is not None and wanted_soc[0] <= soc <= wanted_soc[1]


def inside(values: Iterable[tuple[Name, Value]], wanted_soc: Span) -> dict[str, list[Value]]:
    """The values at nodes within the wanted range, and of the error on a drive cycle, by table."""
    by_name = defaultdict[str, list[Value]](list)
    for (name, soc), value in values:
        if short(name) == DRIVE or is_within(soc, wanted_soc):
            by_name[short(name)].append(value)
    return by_name


def is_enough(name: str, half: float, wanted: float) -> bool:
    """True if half an interval is as wanted, both rounded as displayed: a percentage with two
    digits, a voltage in hundredths of a mV.

    >>> is_enough("R0", 0.0204, 0.02), is_enough("R0", 0.0206, 0.02), is_enough("OCV", 15e-3, 15e-3)
    (True, False, True)
    """
    form = ".5f" if name in ("OCV", DRIVE) else ".2g"
    return float(f"{half:{form}}") <= float(f"{wanted:{form}}")


def halves_of(interval: NodeInterval) -> tuple[float, float] | None:
    """Half an interval of a fit as a design counts it: the part that more samples would narrow, and
    as printed. None if it is not determined."""
    scale = interval.value if interval.name.startswith(("R", "tau")) else 1.0
    if interval.low is None or interval.high is None or not scale > 0:
        return None
    half = NORMAL_95 * interval.standard_error + abs(interval.bias) / 2
    return half / scale, (interval.high - interval.low) / 2 / scale


def followed(dependence: Dependence | None) -> tuple[str, ...]:
    """The quantities besides SOC on which resistances depend, in words."""
    words = {ONSET: "the current", CHARGE: "its direction", KAPPA: "the cell's own heat"}
    words |= {BETA: "the temperature"}
    numbers = {} if dependence is None else dependence.numbers
    return tuple(word for name, word in words.items() if numbers.get(name))


class Predicted(Part):
    """The predicted test: both ends of every step, and the bends of the voltage in between.

    Attributes:
        time_s: Time.
        current_a: Current.
        voltage_v: Voltage.
        low_v: Lowest possible voltage.
        high_v: Highest possible voltage.
        soc: State of charge.
        warming_k: Largest temperature rise of the cell, in moving air.
    """

    time_s: Annotated[np.ndarray, ARRAY]
    current_a: Annotated[np.ndarray, ARRAY]
    voltage_v: Annotated[np.ndarray, ARRAY]
    low_v: Annotated[np.ndarray, ARRAY]
    high_v: Annotated[np.ndarray, ARRAY]
    soc: Annotated[np.ndarray, ARRAY]
    warming_k: float

    @classmethod
    def of(
        cls, steps: Sequence[Step], warming_k: float, **by_second: Float[np.ndarray, "seconds"]
    ) -> "Predicted":
        """The traces of a test whose current, voltages and SOC are given every second."""
        ends = np.cumsum([round(step.duration_s / INTERVAL_S) for step in steps])
        starts = np.append(0, ends[:-1])
        voltages_v = np.stack([by_second[name] for name in ("voltage_v", "low_v", "high_v")])
        of_steps = [bends(voltages_v, *span) for span in zip(starts, ends - 1, strict=True)]
        at = np.concatenate(of_steps)
        # The last value of a step is held until the next step, so that jumps are drawn vertical.
        is_last = np.cumsum([len(drawn) for drawn in of_steps]) - 1
        time_s = INTERVAL_S * at
        time_s[is_last] = INTERVAL_S * ends
        drawn = {name: np.round(values[at], 5) for name, values in by_second.items()}
        return cls(time_s=time_s, warming_k=warming_k, **drawn)

    @classmethod
    def none(cls) -> "Predicted":
        """Empty traces."""
        signals = [name for name in cls.model_fields if name != "warming_k"]
        return cls(warming_k=0.0, **dict.fromkeys(signals, np.empty(0)))


class Reference(Part):
    """Duration and information of a usual test, for comparison.

    Attributes:
        name: Name of the test.
        hours: Its duration.
        widths: Predicted intervals.
    """

    name: str
    hours: float
    widths: tuple[Width, ...]


class Design(Document):
    """A test to run next.

    Attributes:
        capacity_ah: Capacity of the cell.
        limits: Limits of the test: voltages, and rates in 1/h of the capacity.
        temperature_degc: Temperature of the test, None if not given.
        wanted: Half the 95 % intervals wanted, by table: relative, in V for an OCV.
        is_reached: Whether all of them are predicted to be reached.
        hours: Its duration, from the rest at its start on.
        steps: All steps of constant current, in order.
        widths: Predicted intervals.
        references: Usual tests with the same currents, for comparison.
        predicted: Predicted course.
        initial_soc: State of charge at its start.
        start_v: OCV that brings the cell there, if full is not identified.
        wanted_soc: Range of the state of charge in which the intervals are wanted.
        hours_searched: The longer duration that was searched if they are not reached; None if there
            is no longer test.
        hours_needed: That duration if a test of it would reach them.
        finds_ocv: Whether the test also gives the OCV.
        earlier: The records that count, and are to be identified together with the test's.
        untold: Reason why those of the result do not count.
        error: The assumed error of a fit.
        already: Names whose targets the earlier records reach.
        printed: Half the intervals that the result prints, medians by table.
        beyond: Causes of wider intervals that no test removes: "hold" for both holds of the
            current, "pair" for a pair that R0 may hide.
        follows: Quantities besides SOC on which the result's resistances depend, which the
            prediction ignores.
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
    earlier: tuple[str, ...]
    error: ResidualModel
    key: int
    untold: str = ""
    start_v: float | None = None
    wanted_soc: tuple[float, float] = WANTED_SOC
    hours_searched: float | None = None
    hours_needed: float | None = None
    already: tuple[str, ...] = ()
    printed: dict[str, float] = Field(default_factory=dict)
    beyond: tuple[str, ...] = ()
    follows: tuple[str, ...] = ()

    what: ClassVar[str] = "barnax design"
    remedy: ClassVar[str] = "give the folder or the design.json that barnax design wrote"

    @classmethod
    def load(cls, path: str | Path) -> "Design":
        """The design in a folder, or in its `design.json`."""
        path = Path(path)
        return cls.from_json(path / "design.json" if path.is_dir() else path)

    @property
    def is_needed(self) -> bool:
        """False if the earlier records determine what is wanted, and no duration was requested:
        then there is no test."""
        return bool(self.steps)

    def sampling_of(self, record: Record) -> Hold | None:
        """The side of its samples on which the current of the test's own record flowed.

        If the current flows after its sample, a sample at the end of a step has the current of the
        next step. None if there are too few such samples, or the record does not begin with the
        test or belongs to another.
        """
        time_s, steps_a = record.time_s, np.array([step.current_a for step in self.steps])
        ends_s = np.cumsum([step.duration_s for step in self.steps])
        at = np.minimum(np.searchsorted(time_s, ends_s - ON_TIME_S), len(time_s) - 1)[:-1]
        is_met = (np.abs(time_s[at] - ends_s[:-1]) < ON_TIME_S) & (np.diff(steps_a) != 0)
        if abs(time_s[0]) > np.median(np.diff(time_s)) or is_met.sum() < FEWEST_MET:
            return None
        shares = (record.current_a[at] - steps_a[:-1])[is_met] / np.diff(steps_a)[is_met]
        for value, sampling in enumerate(("backward", "forward")):
            if np.mean(np.abs(shares - value) < CLEARLY) > 1 - CLEARLY:
                return sampling
        return None

    def of_table(self, name: str, widths: Sequence[Width] | None = None) -> tuple[Width, ...]:
        """The widths of a table, such as "R0", in the wanted range."""
        chosen = self.widths if widths is None else widths
        named = (((width.name, width.soc), width) for width in chosen)
        return tuple(inside(named, self.wanted_soc)[name])

    @property
    def pieces(self) -> list[tuple[str, list[Step]]]:
        """Neighboring steps of one piece together."""
        return [(name, [*steps]) for name, steps in groupby(self.steps, lambda step: step.block)]

    def figure(self) -> "Figure":
        """Predicted current, voltage and state of charge."""
        return hook("Design.figure")(self)
