"""What a user may choose, apart from the data: types, defaults, and what each option means.

`Job` has all of it, under the same names; the command line makes its options of these fields, and
their help of the lines of `Args`. Nothing heavy is loaded here.
"""

import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from .errors import InputError

AutoSign = Literal["auto", "charge-positive", "discharge-positive"]
AutoHold = Literal["auto", "forward", "backward"]
OcvFit = Literal["polynomial", "interpolated"]
HysteresisFit = Literal["continuous", "independent"]
Over = Literal["soc", "soc,temperature"]
Trust = Literal["none", "basic", "full"]
OVER_TEMPERATURE: Over = "soc,temperature"
# The section of a docstring that explains arguments.
ARGS = r"Args:\n((?:    .*(?:\n|$))+)"
# What a search may be asked for: more than fits a computer's memory is refused before any work.
LIMITS = {
    "seeds": (0, 100_000),
    "population": (4, 100_000),
    "iterations": (1, 10_000_000),
    "key": (0, 2**32 - 1),
}
# Closer below 20 % SOC, where resistances rise, and reaching below the lowest SOC of any record:
# tables that end at 0 bend all that lies above.
NODES: tuple[float, ...] = (
    *(-0.05, -0.03, -0.015, 0.0, 0.025, 0.05, 0.1, 0.15, 0.2),
    *(0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0),
)
# Validation moves by 0.2 mV over four decades of this: it only ties nodes that no sample visits.
ROUGHNESS = 1e-4
RESISTANCE_RIDGE, VOLTAGE_RIDGE = 1e-9, 1e-7
# Blocks go to the folds in turn, so that no fold lacks a whole range of SOC.
FOLDS, BLOCK_S = 5, 400.0


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The circuit and how to search for it.

    Args:
        model: The circuit. None: so-rc, iso-rc and esc are weighed against each other and against
            tables over SOC, and what is best on held-out blocks is the answer.
        method: An optimizer of `OPTIMIZERS`.
        objective: The error, by simulation of every sample or from a reduced record; "auto" reduces
            the record where the bounds allow it.
        coordinates: A search over R and C ("rc"), or over logarithms of R and tau ("log").
        seeds: Runs of the optimizer; 0 leaves the global optimum.
        population: Candidates of a generation.
        iterations: Generations of a run.
        key: The key of all random numbers.
        over: Tables over SOC, or over SOC and temperature, whatever they gain.

    Raises `InputError` for a number out of range and an unknown `over`.
    """

    model: str | None = None
    method: str = "ibmo"
    objective: Literal["auto", "scan", "compressed"] = "auto"
    coordinates: Literal["rc", "log"] = "rc"
    seeds: int = 30
    population: int = 30
    iterations: int = 500
    key: int = 0
    over: Over | None = None

    def __post_init__(self) -> None:
        for name, (least, most) in LIMITS.items():
            value = getattr(self, name)
            if not least <= value <= most:
                raise InputError(f"`{name}` {value:,} must be between {least:,} and {most:,}")
        if self.over not in (None, "soc", OVER_TEMPERATURE):
            raise InputError(
                f"`over` {self.over!r} is not known; there are 'soc' and {OVER_TEMPERATURE!r}"
            )


@dataclass(frozen=True, kw_only=True)
class Reading:
    """The current of files: its sign and its sampling; "auto" decides from the data.

    A sign is "charge-positive" or "discharge-positive". A sample's current flows until the next
    sample ("forward") or since the previous one ("backward").

    Args:
        current_sign: The sign in records to identify on.
        ocv_current_sign: The sign in OCV tests.
        validate_current_sign: The sign in records to validate on.
        current_hold: When a sample's current flows, in all files.
        columns: Names of columns, as for `read_record`.
        series: How many cells are in series, as for `read_record`.
    """

    current_sign: AutoSign = "auto"
    ocv_current_sign: AutoSign = "auto"
    validate_current_sign: AutoSign = "auto"
    current_hold: AutoHold = "auto"
    columns: Mapping[str, str] | str = ""
    series: int = 1

    def options(self, role: str = "identification") -> dict[str, Any]:
        """Sign and hold of a file of that role, as `read_record` and `check_file` take them."""
        signs = {"OCV test": self.ocv_current_sign, "validation": self.validate_current_sign}
        sign = signs.get(role, self.current_sign)
        return {"current_sign": sign, "current_hold": self.current_hold}


@dataclass(frozen=True, kw_only=True)
class CellSettings:
    """How OCV tests become curves.

    Args:
        ocv_capacity: Capacity in Ah in the OCV test, where that does not span full to empty.
        ocv_fit: The OCV curves: a monotone interpolation (PCHIP), the default, or a polynomial of
            degree seven.
        hysteresis_fit: Five segments of the hysteresis voltage, joined at the knots ("continuous")
            or each by itself ("independent").
    """

    ocv_capacity: float | None = None
    ocv_fit: OcvFit | None = None
    hysteresis_fit: HysteresisFit = "continuous"


@dataclass(frozen=True, kw_only=True)
class TableOptions:
    """Tables over SOC: their nodes, weights, proof and cross-validation.

    The objective is the mean squared error plus, for each table x, w^2 (`roughness` times the sum
    of its squared second differences plus a ridge times the sum of its squares). For resistances w
    is the capacity in Ah over 1 h, so in A; for voltages w is 1. Second differences are taken over
    node numbers, not SOC.

    Args:
        nodes: States of charge at which tables have a value.
        ocv_correction: Also fit a table that is added to the OCV.
        rising_ocv: OCV and correction together rise with SOC, as the OCV of a cell does, between
            all nodes.
        half_hysteresis: Fit the amplitude of a dynamic hysteresis instead of using half the
            hysteresis voltage.
        roughness: The weight of second differences.
        resistance_ridge: The ridge of resistances.
        voltage_ridge: The ridge of voltages.
        proved_share: A fit is certified if its sqrt(J) is proved to be within this share of the
            lowest.
        most_cells: At most so many boxes of time constants for the proof; 0 means no proof.
        folds: Every so-many-th block is held out in turn for cross-validation; 0 means none.
        block_s: The length of a block, less for a record that has no five of them in a fold.
    """

    nodes: tuple[float, ...] = NODES
    ocv_correction: bool = True
    rising_ocv: bool = True
    half_hysteresis: bool = False
    roughness: float = ROUGHNESS
    resistance_ridge: float = RESISTANCE_RIDGE
    voltage_ridge: float = VOLTAGE_RIDGE
    proved_share: float = 0.01
    most_cells: int = 1000
    folds: int = FOLDS
    block_s: float = BLOCK_S


def explained(thing: Any) -> dict[str, str]:
    """What docstrings say of each argument of a function, or each field of a class and its bases.

    >>> explained(Settings)["seeds"]
    'Runs of the optimizer; 0 leaves the global optimum.'
    """
    found: dict[str, str] = {}
    for each in getattr(thing, "__mro__", (thing,)):
        section = re.search(ARGS, inspect.cleandoc(each.__doc__ or ""))
        entries = re.findall(r"    (\w+): (.*(?:\n {8}.*)*)", section[1] if section else "")
        found = {name: " ".join(text.split()) for name, text in entries} | found
    return found
