"""The search box: bounds in physical units."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float

from ..cell.elements import RC, ElementNames, alike, get_element, names_of
from ..cell.parameters import OHMIC, RATE
from ..errors import LONGEST_NAME, InputError, cut

# From a hysteresis that hardly turns in a full discharge to one that turns within a sample.
RATE_RANGE = (1.0, 1e4)
# No cell has values beyond these, and numbers would under- and overflow; by unit.
ALLOWED = {"Ohm": (1e-9, 1e6), "s": (1e-6, 1e9), "F": (1e-6, 1e12), RATE: (1e-3, 1e6)}
Range = tuple[float, float]
# The search coordinates, and the way errors are computed: from every sample, or a small factor.
Scale = Literal["rc", "log"]
SCALES: tuple[Scale, ...] = ("rc", "log")
Kind = Literal["scan", "compressed"]
KINDS: tuple[Kind, ...] = ("scan", "compressed")


@dataclass(frozen=True)
class Bounds:
    """Lower and upper bound of R0, every element's R and its tau or its C, and of gamma.

    `fixed` holds values that are not searched. Names are PyBaMM's, with their units. If an RC pair
    is bounded or fixed in C, its R C still stays within `tau_limits_s`: the record cannot resolve
    faster or slower pairs.
    """

    ranges: Mapping[str, Range]
    tau_limits_s: Range
    fixed: Mapping[str, float] = field(default_factory=dict)
    elements: tuple[str, ...] = (RC.name,) * 2

    @classmethod
    def default(
        cls,
        capacity_ah: float,
        interval_s: float,
        duration_s: float,
        *,
        elements: tuple[str, ...] = (RC.name,) * 2,
        has_rate: bool = False,
    ) -> "Bounds":
        """0.1 to 200 mohm at 2 Ah, scaled to the capacity; tau from half an interval to the
        duration.

        `interval_s` is the median sampling interval, `duration_s` the scored duration: a time
        constant outside these cannot be resolved; for an element of several RC pairs this applies
        to the slowest. All RC pairs share one box. The rate of a dynamic hysteresis, `has_rate`,
        has the range `RATE_RANGE`.
        """
        scale = 2.0 / capacity_ah
        resistance = (1e-4 * scale, 0.2 * scale)
        tau = (interval_s / 2, max(duration_s, interval_s))
        box = cls({}, tau, elements=elements)
        ranges = dict.fromkeys(box.resistances, resistance)
        ranges |= {names.tau: box.limits_s(index) for index, names in enumerate(box.element_names)}
        if has_rate:
            ranges[RATE] = RATE_RANGE
        return replace(box, ranges=ranges)

    @property
    def pairs(self) -> int:
        """Number of elements, RC pairs mostly."""
        return len(self.elements)

    @cached_property
    def element_names(self) -> tuple[ElementNames, ...]:
        return names_of(self.elements)

    @cached_property
    def resistances(self) -> tuple[str, ...]:
        """The names of the resistances, R0 first."""
        return (OHMIC, *(element.resistance for element in self.element_names))

    def limits_s(self, index: int) -> Range:
        """Time constants of an element whose slowest RC pair that matters the record can
        resolve."""
        low, high = self.tau_limits_s
        slowest = get_element(self.elements[index]).slowest_ratio
        return low / slowest, high / slowest

    @property
    def has_rate(self) -> bool:
        return RATE in self.ranges or RATE in self.fixed

    @property
    def names(self) -> tuple[str, ...]:
        """Every name that can be bounded or fixed."""
        names = [*self.resistances]
        names += [name for names in self.element_names for name in names[1:] if name is not None]
        return (*names, RATE) if self.has_rate else tuple(names)

    def with_changes(
        self, ranges: Mapping[str, Range], fixed: Mapping[str, float], source: str
    ) -> "Bounds":
        """These bounds with the user's ranges and fixed values applied.

        Raises `InputError` for an unknown name, a range that is reversed or not positive, and for
        both tau and C of one pair; `source` names the origin of the change in messages.
        """
        for name in (*ranges, *fixed):
            if name not in self.names:
                raise InputError(
                    f"{source}: {cut(name, LONGEST_NAME)!r} is not a parameter of this circuit; "
                    f"there are {', '.join(self.names)}"
                )
        for name, (low, high) in ranges.items():
            if not (0 < low < high < math.inf):
                raise InputError(
                    f"{source}: the bounds of {name!r} are [{low}, {high}]; they must be positive "
                    "and the lower one smaller than the upper one"
                )
            if name in fixed:
                raise InputError(f"{source}: {name!r} is both bounded and fixed; give one of them")
        for name, value in fixed.items():
            if not 0 < value < math.inf:
                raise InputError(
                    f"{source}: {name!r} cannot be fixed at {value}; give a positive value"
                )
        for name, ends in [*ranges.items(), *((name, (fixed[name],)) for name in fixed)]:
            _require_allowed(name, ends, source)
        chosen = ranges.keys() | fixed.keys()
        changed = dict(self.ranges)
        for _, tau, capacitance in self.element_names:
            if capacitance is None:
                continue
            if {tau, capacitance} <= chosen:
                raise InputError(
                    f"{source}: give {tau!r} or {capacitance!r}, not both; one follows from the "
                    "other and the resistance"
                )
            if {tau, capacitance} & chosen:
                changed.pop(tau, None)
                changed.pop(capacitance, None)
        changed = {name: limits for name, limits in changed.items() if name not in fixed}
        changed |= {name: ranges[name] for name in self.names if name in ranges}
        box = replace(self, ranges=changed, fixed=dict(fixed))
        for names in self.element_names:
            if names.capacitance in chosen:
                low, high = box._visible_resistances(names, source)
                if names.resistance in changed:
                    changed[names.resistance] = low, high
        return box

    def _visible_resistances(self, names: ElementNames, source: str) -> Range:
        """The resistances with which some allowed C gives a tau that can be resolved."""
        resistance, _, capacitance = names
        (low, high), (low_f, high_f) = self.range_of(resistance), self.range_of(str(capacitance))
        low, high = max(low, self.tau_limits_s[0] / high_f), min(high, self.tau_limits_s[1] / low_f)
        if low > high:
            raise InputError(
                f"{source}: with these {resistance!r} and {capacitance!r} the time constant R C is "
                f"outside {self.tau_limits_s[0]:.4g} to {self.tau_limits_s[1]:.4g} s, the range "
                "that the record can show; widen one of them"
            )
        return low, high

    @property
    def interchangeable_pairs(self) -> int:
        """Number of RC pairs, the first ones, that can be swapped within the box: all, or none."""
        pairs = alike(self.elements)
        names = self.element_names[:pairs]
        if self.fixed.keys() & {name for each in names for name in each}:
            return 0
        seconds = [self.second_name(index) for index in range(pairs)]
        boxes = {
            (self.ranges[each.resistance], second == each.tau, self.ranges[second])
            for each, second in zip(names, seconds, strict=True)
        }
        return pairs if len(boxes) == 1 else 0

    def second_name(self, index: int) -> str:
        """The name that bounds or fixes element `index` in addition to its resistance."""
        _, tau, capacitance = self.element_names[index]
        return tau if tau in self.ranges or tau in self.fixed else str(capacitance)

    def range_of(self, name: str) -> Range:
        """Least and greatest value of a bounded or fixed parameter."""
        value = self.fixed.get(name)
        return self.ranges[name] if value is None else (value, value)

    def tau_range_s(self, pair: int) -> Range:
        """Time constants of an element that some allowed R and C give."""
        resistance, tau, _ = self.element_names[pair]
        second = self.second_name(pair)
        if second == tau:
            return self.range_of(tau)
        r_low, r_high = self.range_of(resistance)
        c_low, c_high = self.range_of(second)
        low, high = self.tau_limits_s
        return max(low, r_low * c_low), min(high, r_high * c_high)

    @property
    def gamma_range(self) -> Range | None:
        return self.range_of(RATE) if self.has_rate else None

    def resistance_box(
        self, tau_s: Float[np.ndarray, "pairs *points"]
    ) -> tuple[Float[np.ndarray, "resistances *points"], Float[np.ndarray, "resistances *points"]]:
        """Least and greatest R0, R1, ... at these time constants: a bounded C bounds R too."""
        ends = np.array([self.range_of(name) for name in self.resistances])
        low, high = (np.stack([np.full(tau_s.shape[1:], end) for end in side]) for side in ends.T)
        for pair, (_, _, capacitance) in enumerate(self.element_names):
            if capacitance is not None and self.second_name(pair) == capacitance:
                c_low, c_high = self.range_of(capacitance)
                low[pair + 1] = np.maximum(low[pair + 1], tau_s[pair] / c_high)
                high[pair + 1] = np.minimum(high[pair + 1], tau_s[pair] / c_low)
        # A fixed C leaves one value, whose ends rounding may reverse.
        return low, np.maximum(low, high)


def _require_allowed(name: str, ends: Sequence[float], source: str) -> None:
    """Raise `InputError` if a value is impossible for any cell."""
    unit = name.rpartition("[")[2].rstrip("]")
    low, high = ALLOWED[unit]
    for value in ends:
        if not low <= value <= high:
            raise InputError(
                f"{source}: {name!r} of {value:g} is none of any cell; give values from {low:g} "
                f"to {high:g}{'' if unit == RATE else ' ' + unit}"
            )
