"""The search box in physical units: its defaults, the user's changes, and fixed values."""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from .cell.circuit import MOST_PAIRS, RATE
from .errors import InputError
from .records.limits import LONGEST_NAME, cut

RESISTANCES = tuple(f"R{index} [Ohm]" for index in range(MOST_PAIRS + 1))
# Each pair is bounded in its time constant or in its capacitance.
PAIRS = tuple((f"tau{pair} [s]", f"C{pair} [F]") for pair in range(1, MOST_PAIRS + 1))
# From a hysteresis that a whole discharge hardly turns to one that turns within a sample.
RATE_RANGE = (1.0, 1e4)
# The time that dotted names take to read grows with the square of their length.
LARGEST_FILE = 16_000
Range = tuple[float, float]


@dataclass(frozen=True)
class Bounds:
    """Lower and upper bound of R0, every pair's R and its tau or its C, and of gamma.

    `fixed` holds values that are not searched. Names are PyBaMM's, with their units. Where a pair
    is bounded or fixed in C, its R C still stays within `tau_limits_s`: faster or slower than
    that the record cannot show it.
    """

    ranges: Mapping[str, Range]
    tau_limits_s: Range
    fixed: Mapping[str, float] = field(default_factory=dict)
    pairs: int = 2

    @classmethod
    def default(
        cls,
        capacity_ah: float,
        interval_s: float,
        duration_s: float,
        *,
        pairs: int = 2,
        has_rate: bool = False,
    ) -> "Bounds":
        """0.1 to 200 mohm at 2 Ah, scaled to the capacity; tau from half an interval to all.

        `interval_s` is the median sampling interval, `duration_s` the scored duration: faster
        or slower than these a time constant cannot be seen. All pairs share one box. The rate of
        a dynamic hysteresis, `has_rate`, runs over `RATE_RANGE`.
        """
        scale = 2.0 / capacity_ah
        resistance = (1e-4 * scale, 0.2 * scale)
        tau = (interval_s / 2, max(duration_s, interval_s))
        ranges = dict.fromkeys(RESISTANCES[: pairs + 1], resistance)
        ranges |= {PAIRS[pair][0]: tau for pair in range(pairs)}
        if has_rate:
            ranges[RATE] = RATE_RANGE
        return cls(ranges, tau, pairs=pairs)

    @property
    def has_rate(self) -> bool:
        return RATE in self.ranges or RATE in self.fixed

    @property
    def names(self) -> tuple[str, ...]:
        """Every name that can be bounded or fixed."""
        names = [*RESISTANCES[: self.pairs + 1]]
        names += [name for pair in PAIRS[: self.pairs] for name in pair]
        return (*names, RATE) if self.has_rate else tuple(names)

    def with_changes(
        self, ranges: Mapping[str, Range], fixed: Mapping[str, float], source: str
    ) -> "Bounds":
        """These bounds with the user's ranges and fixed values in place.

        Raises `InputError` for an unknown name, a range that is reversed or not positive, and
        for both tau and C of one pair; `source` says where the change came from.
        """
        changed = dict(self.ranges)
        for name, (low, high) in ranges.items():
            self._require_known(name, source)
            if not (0 < low < high < math.inf):
                raise InputError(
                    f"{source}: the bounds of {name!r} are [{low}, {high}]; they must be positive "
                    "and the lower one smaller than the upper one"
                )
        for name, value in fixed.items():
            self._require_known(name, source)
            if not 0 < value < math.inf:
                raise InputError(
                    f"{source}: {name!r} cannot be fixed at {value}; give a positive value"
                )
            if name in ranges:
                raise InputError(f"{source}: {name!r} is both bounded and fixed; give one of them")
        for tau, capacitance in PAIRS[: self.pairs]:
            chosen = [name for name in (tau, capacitance) if name in ranges or name in fixed]
            if len(chosen) == 2:
                raise InputError(
                    f"{source}: give {tau!r} or {capacitance!r}, not both; one follows from the "
                    "other and the resistance"
                )
            for name in chosen:
                changed.pop(tau, None)
                changed.pop(capacitance, None)
                if name in ranges:
                    changed[name] = ranges[name]
        for name in (*RESISTANCES[: self.pairs + 1], RATE):
            if name in ranges:
                changed[name] = ranges[name]
            elif name in fixed:
                changed.pop(name)
        for pair, (_, capacitance) in enumerate(PAIRS[: self.pairs]):
            if capacitance in ranges or capacitance in fixed:
                self._narrow_resistance(changed, fixed, pair, source)
        return Bounds(changed, self.tau_limits_s, dict(fixed), self.pairs)

    def _narrow_resistance(
        self, ranges: dict[str, Range], fixed: Mapping[str, float], pair: int, source: str
    ) -> None:
        """Leave only resistances with which some allowed C gives a tau that can be seen."""
        resistance, capacitance = RESISTANCES[pair + 1], PAIRS[pair][1]
        value = fixed.get(capacitance)
        low_f, high_f = (value, value) if value is not None else ranges[capacitance]
        held = fixed.get(resistance)
        low, high = (held, held) if held is not None else ranges[resistance]
        low, high = max(low, self.tau_limits_s[0] / high_f), min(high, self.tau_limits_s[1] / low_f)
        if low > high:
            raise InputError(
                f"{source}: with these {resistance!r} and {capacitance!r} the time constant R C "
                f"leaves {self.tau_limits_s[0]:.4g} to {self.tau_limits_s[1]:.4g} s, what the "
                "record can show; widen one of them"
            )
        if held is None:
            ranges[resistance] = (low, high)

    @property
    def pairs_are_alike(self) -> bool:
        """Whether all RC pairs have the same box, so that swapping them stays inside."""
        if self.fixed.keys() - {RESISTANCES[0], RATE}:
            return False
        return len({self._pair(index) for index in range(self.pairs)}) == 1

    def second_name(self, index: int) -> str:
        """The name that bounds or fixes pair `index` beside its resistance."""
        return next(name for name in PAIRS[index] if name in self.ranges or name in self.fixed)

    def _require_known(self, name: str, source: str) -> None:
        if name not in self.names:
            raise InputError(
                f"{source}: {cut(name, LONGEST_NAME)!r} is not a parameter of this circuit; there "
                f"are {', '.join(self.names)}"
            )

    def _pair(self, index: int) -> tuple[Range, str, Range]:
        name = self.second_name(index)
        kind = "tau" if name.startswith("tau") else "C"
        return self.ranges[RESISTANCES[index + 1]], kind, self.ranges[name]


def read_bounds(path: Path) -> dict[str, Range]:
    """Ranges from the `[bounds]` table of a TOML file: `"R0 [Ohm]" = [0.001, 0.1]`.

    Raises `InputError` where the file cannot be read or says something else.
    """
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
        if len(content) > LARGEST_FILE:
            raise InputError(f"{path}: is larger than any file of bounds ({LARGEST_FILE} bytes)")
        document = tomllib.loads(content.decode("utf-8"))
    except OSError as problem:
        raise InputError(
            f"{path}: cannot be read ({problem.strerror or problem}); give --bounds a TOML file"
        ) from problem
    except InputError:
        raise
    except (ValueError, RecursionError) as problem:
        # No TOML, no text, or an integer of more digits than Python turns into one.
        reason = cut(str(problem), LONGEST_NAME)
        raise InputError(f"{path}: is not a TOML file ({reason})") from problem
    table = document.get("bounds")
    if not isinstance(table, dict) or len(document) != 1:
        raise InputError(
            f'{path}: must hold one table, [bounds], with lines like "R0 [Ohm]" = [0.001, 0.1]'
        )
    return {
        name: _range_of(value, f"{path}: {cut(name, LONGEST_NAME)!r}")
        for name, value in table.items()
    }


def _range_of(value: object, place: str) -> Range:
    ends = value if isinstance(value, list) else []
    is_pair = len(ends) == 2 and all(type(end) in (int, float) for end in ends)
    try:
        if is_pair:
            return float(ends[0]), float(ends[1])
        shown = cut(repr(value), LONGEST_NAME)
    except OverflowError as problem:
        raise InputError(f"{place} holds a number beyond all bounds") from problem
    # Tables in tables are as deep as their names are long; digits may be too many to show.
    except (ValueError, RecursionError):
        shown = f"a {type(value).__name__}"
    raise InputError(f"{place} must be two numbers, [lower, upper]; it is {shown}")


def parse_fixed(texts: list[str]) -> dict[str, float]:
    """Fixed values from options such as `C1 [F]=500`. Raises `InputError` where one is not so."""
    fixed = {}
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        if name in fixed:
            raise InputError(f"--fix {text!r}: {name!r} is fixed twice; give one value")
        try:
            fixed[name] = float(value)
        except ValueError as problem:
            raise InputError(
                f'--fix {text!r}: write a name and a number, such as "C1 [F]=500"'
            ) from problem
    return fixed
