"""What kind of test a record is, told by its sweeps, its current steps and how far they reach."""

import re
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..cell.soc_axis import Sweep
from .check_input import CheckInput

Kind = Literal[
    "OCV test", "slow sweep", "pulse test", "drive cycle", "capacity test", "charge", "nothing"
]

# Current steps that an identification wants, and the interval that still shows what follows one.
STEPS, FINE_S = 20, 10.5
# Steps that reach over less of the capacity, or the bulk time of a steep end, say little.
LEAST_SHARE, STEEP_S = 0.05, 20.0
# Of the steps so much lies between the ends of their reach; a few may stand apart.
_REACH = (0.05, 0.95)
# Pulses and rests alone make two steps a point; an HPPC test has pulses of its own beside them.
_STEPS_A_POINT = 3
# A discharge that passes so much of all the charge was one of a capacity test.
_MOST = 0.8
_NAMED_DEGC = re.compile(r"(?<![\d.])(-?\d{1,2}(?:\.\d+)?)[ _]?(?:degC|deg_?C|°C)(?![a-zA-Z])")


@dataclass(frozen=True)
class Traits:
    """Numbers of a record that tell what it can serve as.

    `steps` are those of the current that are sampled finely enough; they reach over `reach_ah` of
    charge and last `reach_s`. `steep_v` is the travel of the voltage where the cell stands at a
    steep end throughout, else zero. `temperature_degc` is the column's median, else the one in the
    name, else None.
    """

    sweeps: tuple[Sweep, ...]
    steps: int
    reach_ah: float
    reach_s: float
    span_ah: float
    charged_ah: float
    discharged_ah: float
    longest_discharge_ah: float
    interval_s: float
    steep_v: float
    temperature_degc: float | None

    @property
    def is_slow(self) -> bool:
        """Whether all that it holds are slow sweeps."""
        return bool(self.sweeps) and all(sweep.kind == "slow" for sweep in self.sweeps)

    def kind(self, capacity_ah: float | None) -> Kind:
        """What it is, of a cell of that capacity."""
        if self.sweeps:
            points = sum(len(sweep.points) - 1 for sweep in self.sweeps)
            has_pulses = self.steps >= max(STEPS, _STEPS_A_POINT * points)
            return "slow sweep" if self.is_slow else "pulse test" if has_pulses else "OCV test"
        if not self.lacks(capacity_ah):
            return "drive cycle"
        whole_ah = capacity_ah or self.span_ah
        if self.steep_v or self.span_ah < LEAST_SHARE * whole_ah:
            return "nothing"
        if self.longest_discharge_ah > _MOST * whole_ah:
            return "capacity test"
        return "charge" if self.charged_ah > self.discharged_ah else "nothing"

    def lacks(self, capacity_ah: float | None, fewest: int = STEPS) -> str:
        """What it lacks to identify or validate a circuit on, in words; nothing if it is fit."""
        if self.is_slow:
            return "a slow sweep does not show what follows a step of current"
        if self.steep_v:
            return (
                f"the cell stands at a steep end: {self.span_ah:.3g} Ah move its voltage by "
                f"{self.steep_v:.2g} V"
            )
        if capacity_ah is not None and self.span_ah < LEAST_SHARE * capacity_ah:
            share = 100 * self.span_ah / capacity_ah
            return f"it moves {self.span_ah:.3g} Ah, {share:.2g} % of the capacity"
        if self.steps < fewest:
            return f"{self.steps} current steps sampled finely enough; {fewest} are wanted"
        # Without a capacity a dither gives itself away by how often it turns.
        whole_ah = capacity_ah or self.charged_ah + self.discharged_ah
        if self.reach_ah < LEAST_SHARE * whole_ah:
            share = 100 * self.reach_ah / whole_ah
            of = "the capacity" if capacity_ah else "what it passes"
            return (
                f"its {self.steps} current steps lie within {self.reach_ah:.2g} Ah, {share:.2g} % "
                f"of {of}"
            )
        return ""


def traits_of(given: CheckInput) -> Traits:
    """The numbers that tell the kind of a record."""
    record = given.record
    fine = np.flatnonzero(given.is_step & (record.interval_s <= FINE_S))
    discharged_ah = record.discharged_ah
    reach_ah = reach_s = 0.0
    if len(fine):
        reach_ah = float(np.ptp(np.quantile(discharged_ah[fine], _REACH)))
        reach_s = float(record.time_s[fine[-1] + 1] - record.time_s[fine[0]])
    loaded_s = record.interval_s[~given.is_rested[1:]]
    bulk_s, travel_v = given.samples.bulk_time
    # The deepest point below the highest one before it: charge taken out without going back up.
    out_ah = discharged_ah - np.minimum.accumulate(discharged_ah)
    return Traits(
        sweeps=() if isinstance(given.sweeps, str) else tuple(given.sweeps),
        steps=len(fine),
        reach_ah=reach_ah,
        reach_s=reach_s,
        span_ah=given.span_ah,
        charged_ah=given.charged_ah,
        discharged_ah=given.discharged_ah,
        longest_discharge_ah=float(out_ah.max()),
        interval_s=float(np.median(loaded_s)) if len(loaded_s) else np.inf,
        steep_v=travel_v if 0 < bulk_s < STEEP_S else 0.0,
        temperature_degc=_temperature_degc(given),
    )


def _temperature_degc(given: CheckInput) -> float | None:
    measured = given.record.temperature_degc
    if measured is not None and np.isfinite(measured).any():
        return float(np.nanmedian(measured))
    named = _NAMED_DEGC.search(given.record.name)
    return float(named[1]) if named else None
