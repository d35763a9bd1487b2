"""Options of a user, apart from the data: types, defaults, and the meaning of each option.

`Job` has all of them by these names; the command line derives its options from them, and their help
from the lines of `Args`. Nothing heavy is loaded here."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from .errors import InputError, choices_in, require_choice, require_number, require_positive

AutoSign = Literal["auto", "charge-positive", "discharge-positive"]
AutoHold = Literal["auto", "forward", "backward", "centered"]
OcvFit = Literal["polynomial", "interpolated"]
HysteresisFit = Literal["continuous", "independent"]
Over = Literal["soc", "soc,temperature"]
# Quantities besides SOC on which resistances depend.
Follow = Literal[
    "auto", "none", "temperature", "heating", "current", "direction", "temperature,current",
    "heating,current", "temperature,direction", "heating,direction", "current,direction",
    "temperature,current,direction", "heating,current,direction",
]  # fmt: skip
Trust = Literal["none", "basic", "full"]
# Sources of the state of charge at a start that was not given.
SocSource = Literal[
    "full end", "empty end", "full voltage", "counters", "rest elsewhere", "own full charge",
    "own span", "registered", "fitted", "given earlier",
]  # fmt: skip
OVER_TEMPERATURE: Over = "soc,temperature"
# Limits of a search: requests too large for a computer's memory are rejected before any work.
LIMITS = {
    "seeds": (0, 100_000),
    "population": (4, 100_000),
    "iterations": (1, 10_000_000),
    "key": (0, 2**32 - 1),
}
# Closer below 20 % SOC, where resistances rise, and extending below the lowest SOC of any record:
# tables that end at 0 would bend everything above.
NODES: tuple[float, ...] = (
    *(-0.05, -0.03, -0.015, 0.0, 0.025, 0.05, 0.1, 0.15, 0.2),
    *(0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0),
)
# Validation changes by 0.2 mV over four decades of this: it only ties nodes that no sample visits.
ROUGHNESS = 1e-4
RESISTANCE_RIDGE, VOLTAGE_RIDGE = 1e-9, 1e-7
# Blocks are assigned to the folds in turn, and are short: 400 s of a discharge hold out SOC that no
# other sample visits, and on 78 training sets led to choices three to four times as bad.
FOLDS, BLOCK_S = 5, 100.0


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The circuit and how to search for it.

    Args:
        model: Fit this circuit, with constants: two RC pairs with switched (iso-rc), no (so-rc) or
            dynamic (esc) hysteresis; takacs has loops after a turn; 1rc, 3rc and 4rc have one,
            three and four pairs and no hysteresis; +diffusion adds a finite Warburg element, as in
            1rc+diffusion. The default is the circuit that best predicts held-out blocks, with
            constants or tables over SOC.
        method: Optimizer: ibmo, ibmo-centered, pso or any other that "barnax optimizers" lists.
        objective: How the search computes errors: scan simulates every sample, compressed reduces
            the record once; auto is compressed if the bounds allow it, in compare scan. Reported
            errors are always computed by scan.
        coordinates: Search R and C themselves, as in the paper (rc), or logarithms of R and tau
            (log).
        seeds: Independent runs of the optimizer (30; 0 for the cells of a fleet, which rely on the
            global optimum).
        population: Candidates per generation (30).
        iterations: Generations (500).
        key: Random key (0); the same key gives the same result.
        over: Always fit tables over SOC: of the resistances and an OCV correction; with
            temperature, one set of tables per temperature, with shared time constants.

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
        require_choice("over", self.over, (*choices_in(Over), None))


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Reading of files: the sign of the current, its sampling, columns, cells in series.

    Args:
        current_sign: Sign of current in the records: charge-positive, discharge-positive, or auto
            (decided from the data).
        ocv_current_sign: Sign of current in the OCV tests.
        validate_current_sign: Sign of current in the validation records.
        current_hold: How long each current value holds: until the next sample (forward), from the
            previous one (backward), about half of both (centered: means, or a load that changes
            between samples), or auto (decided from the data).
        voltage_lag: Lag of the voltage behind the current of its row in seconds, negative if it is
            ahead; estimated from the data by default, 0 takes the rows as logged. FILE=S is for one
            record; repeatable.
        columns: Names of columns that are not recognized:
            time=NAME:UNIT,current=NAME:UNIT,voltage=NAME, with a unit if the name has none.
        series: Cells in series, for packs and modules: the voltage is divided by it.
    """

    current_sign: AutoSign = "auto"
    ocv_current_sign: AutoSign = "auto"
    validate_current_sign: AutoSign = "auto"
    current_hold: AutoHold = "auto"
    voltage_lag: float | str | Sequence[str] | Mapping[str, float] | None = None
    columns: Mapping[str, str] | str = ""
    series: int = 1

    @property
    def of_tables(self) -> dict[str, Any]:
        """Columns and cells in series, as passed to readers of files."""
        return {"columns": self.columns, "series": self.series}

    @property
    def lags_s(self) -> dict[str, float]:
        """Lags of voltages by the name of the record, "" for all others."""
        given = [] if self.voltage_lag is None else self.voltage_lag
        if not isinstance(given, Mapping):
            several = [given] if isinstance(given, str | float | int) else given
            # A file's name may hold commas and equality signs.
            parts = (str(text).rpartition("=") for text in several)
            given = {name: lag_s for name, _, lag_s in parts}
        lags_s = {}
        for name, lag in given.items():
            try:
                lags_s[name] = float(lag)
            except ValueError:
                lags_s[name] = math.nan
            if not math.isfinite(lags_s[name]):
                how = "write it like 0.3, or FILE=0.3 for one of the records"
                raise InputError(f"`voltage_lag` {str(lag)!r}: {how}")
        return lags_s

    def of_record(self, name: str, role: str = "identification") -> dict[str, Any]:
        """Sign, hold and lag of a record of that name and role, as passed to readers and checks."""
        signs = {"OCV test": self.ocv_current_sign, "validation": self.validate_current_sign}
        lags_s = self.lags_s
        how = {"current_hold": self.current_hold, "voltage_lag": lags_s.get(name, lags_s.get(""))}
        return {"current_sign": signs.get(role, self.current_sign), **how}


@dataclass(frozen=True, kw_only=True)
class CellSettings:
    """The way from OCV tests to curves.

    Args:
        ocv_capacity: Capacity in Ah, if the OCV test does not run from full to empty.
        ocv_fit: OCV curves: interpolated (PCHIP, the default), or a polynomial of degree 7.
        hysteresis_fit: Hysteresis segments: continuous (they meet at the knots) or independent.
    """

    ocv_capacity: float | None = None
    ocv_fit: OcvFit | None = None
    hysteresis_fit: HysteresisFit = "continuous"

    @property
    def of_curves(self) -> dict[str, Any]:
        """Capacity and fits, as passed to `characterize`."""
        how = {"ocv_fit": self.ocv_fit or "interpolated", "hysteresis_fit": self.hysteresis_fit}
        return {"ocv_capacity_ah": self.ocv_capacity, **how}


@dataclass(frozen=True, kw_only=True)
class Scope:
    """The reach of a run.

    Args:
        setup: Repeat the set-up of a paper: li2023 is iso-rc alone on an OCV polynomial, as in Li
            et al. (2023).
        trust: How closely to examine the answer: basic gives intervals, identifiability and
            residuals; full also gives profile likelihoods.
    """

    setup: Literal["li2023"] | None = None
    trust: Trust = "basic"


@dataclass(frozen=True, kw_only=True)
class TableOptions:
    """Tables over SOC: their nodes, weights, proof and cross-validation.

    The objective is the mean squared error plus, for each table x, w^2 (`roughness` times the sum
    of its squared second differences plus a ridge times the sum of its squares). For resistances w
    is the capacity in Ah over 1 h, so in A; for voltages w is 1. Second differences are taken over
    node numbers, not SOC.

    Args:
        nodes: States of charge at which tables have a value: 17, from -0.05 to 1.
        ocv_nodes: Nodes of an OCV that is fitted without an OCV test.
        ocv_correction: Fit a table that corrects the OCV, or not.
        rising_ocv: Let the corrected OCV only rise with SOC, as the OCV of a cell does, or leave
            the correction free.
        half_hysteresis: Fit the amplitude of a dynamic hysteresis as a table, instead of using half
            the hysteresis voltage; needs records in both directions.
        roughness: Weight of the tables' second differences.
        resistance_ridge: Weight of squared resistances.
        voltage_ridge: Weight of squared voltages.
        proved_share: A fit is certified if its sqrt(J) is proved to be within this share of the
            lowest.
        max_boxes: Largest number of boxes of time constants for the proof; 0 means no proof.
        resistances_follow: What resistances depend on besides SOC: the measured temperature, the
            cell's heating by its current, the current (Butler and Volmer), its direction, or none;
            auto takes those that lower the held-out errors.
        keep_starts: Keep every record's start and capacity as given; by default those of several
            records of one cell are adjusted by a few tenths of a percent.
        folds: Folds of the cross-validation, blocks held out in turn; 0 means none.
        block_s: Longest held-out block in s; shorter if a record has fewer than five per fold.
    """

    nodes: tuple[float, ...] = NODES
    ocv_nodes: tuple[float, ...] | None = None
    ocv_correction: bool = True
    rising_ocv: bool = True
    half_hysteresis: bool = False
    roughness: float = ROUGHNESS
    resistance_ridge: float = RESISTANCE_RIDGE
    voltage_ridge: float = VOLTAGE_RIDGE
    proved_share: float = 0.01
    max_boxes: int = 1000
    resistances_follow: Follow = "auto"
    keep_starts: bool = False
    folds: int = FOLDS
    block_s: float = BLOCK_S


def _pair(text: str) -> tuple[float, float]:
    low, high = map(float, text.split(","))
    return low, high


# Values known about a record, as options and tables give them: the corresponding field of a
# `Window`, the parser of its text (`ValueError` if it is invalid), and an example.
WINDOW_OPTIONS: dict[str, tuple[str, Callable[[str], Any], str]] = {
    "capacity": ("capacity_ah", float, "5"),
    "temperature": ("temperature_degc", float, "25"),
    "start_time": ("start_time_s", float, "5"),
    "start_after_step": ("start_after_step", int, "5"),
    "initial_soc": ("initial_soc", float, "0.9"),
    "initial_direction": ("initial_direction", int, "-1"),
    "score_steps": ("score_steps", lambda text: tuple(map(int, text.split(","))), "7,8"),
    "score_from": ("score_from_s", float, "5"),
    "score_to": ("score_to_s", float, "5"),
    "score_soc": ("score_soc", _pair, "0.1,1"),
    "rest_current": ("rest_current_a", float, "5"),
}

# A temperature outside this range is in another unit, or from a missing sensor.
CELL_DEGC = (-100.0, 200.0)


def is_temperature(degc: float) -> bool:
    """True if it may be a cell's temperature.

    >>> is_temperature(25.0), is_temperature(298.15)
    (True, False)
    """
    return CELL_DEGC[0] < degc < CELL_DEGC[1]


# Largest shift of a validation record's start, to determine its benefit.
MAX_MOVED_SOC = 0.03


@dataclass(frozen=True)
class Registration:
    """A record's start and capacity from other records of the cell or its OCV test, or its start
    from the fit of the circuit, with 95 % intervals, and the values given before. SOC is scaled so
    that the given values are right on average; with other records, intervals are on that axis. An
    offset of the current shared by the records is in A, discharge positive, with its standard
    error; `follows` has the names of a `Dependence`, and `given_sd` is the standard error of
    `given_soc`."""

    given: "Window"
    given_soc: float
    given_capacity_ah: float
    given_source: Literal["given", "rested voltage"] | SocSource
    soc_low: float
    soc_high: float
    capacity_low_ah: float
    capacity_high_ah: float
    by: Literal["records", "OCV test", "circuit"] = "records"
    offset_a: float | None = None
    offset_error_a: float | None = None
    follows: Mapping[str, float | None] | None = None
    given_sd: float = 0.0

    @property
    def origin(self) -> "Registration":
        """The first registration of a record, before others moved it again."""
        earlier = self.given.registration
        return self if earlier is None else earlier.origin


@dataclass(frozen=True)
class Window:
    """The simulated and scored part of a record, and the knowledge about its start.

    Args:
        start_time_s: Time in the file at which the simulation starts.
        start_after_step: Start the simulation at the end of this step, where it last occurs.
        initial_soc: State of charge at the start, a fraction (default: from the rested voltage).
        score_steps: Score only these steps, such as 7,8.
        score_from_s: Score from this time on.
        score_to_s: Score up to this time.
        score_soc: Score only between these states of charge, such as 0.1,1.
        rest_current_a: Current below which the cell is at rest (default: C/100).
        initial_direction: Last direction before the start, if the record does not show it: +1
            charge, -1 discharge (default: both are tried).
        capacity_ah: Capacity when the record was measured (default: that of the OCV test).
        temperature_degc: Temperature in degC (default: the median of the record's column).
        soc_source: Source of `initial_soc`, if it was not given.
        registration: Start and capacity before registration.

    Raises `InputError` if these contradict each other.
    """

    start_time_s: float | None = None
    start_after_step: int | None = None
    initial_soc: float | None = None
    score_steps: tuple[int, ...] | None = None
    score_from_s: float | None = None
    score_to_s: float | None = None
    score_soc: tuple[float, float] | None = None
    rest_current_a: float | None = None
    initial_direction: Literal[-1, 1] | None = None
    capacity_ah: float | None = None
    temperature_degc: float | None = None
    soc_source: SocSource | None = None
    registration: Registration | None = None

    @property
    def unregistered(self) -> "Window":
        """A copy with start and capacity as they were given, before any registration."""
        return self if self.registration is None else self.registration.origin.given

    def __post_init__(self):
        for option, (name, *_) in WINDOW_OPTIONS.items():
            require_number(option, getattr(self, name), Window.__annotations__[name])
        for name in ("score_steps", "score_soc"):
            # As printed in a warning about the file.
            if isinstance(text := getattr(self, name), str):
                _, read, example = WINDOW_OPTIONS[name]
                try:
                    object.__setattr__(self, name, read(text))
                except ValueError:
                    raise InputError(f"`{name}` {text!r} is not as in {example}") from None
        if self.start_time_s is not None and self.start_after_step is not None:
            raise InputError("give `start_time` or `start_after_step`, not both")
        # A count from where the data show the SOC may go slightly beyond.
        is_given = self.initial_soc is not None and self.soc_source is None
        if is_given and not 0 <= (self.initial_soc or 0.0) <= 1:
            raise InputError(
                f"`initial_soc` {self.initial_soc} is not a fraction; state of charge runs from "
                "0 (empty) to 1 (full)"
            )
        if self.initial_direction not in (1, -1, None):
            raise InputError(
                f"`initial_direction` {self.initial_direction} is neither +1 (the cell was last "
                "charged) nor -1 (discharged)"
            )
        for name, value in (("rest_current", self.rest_current_a), ("capacity", self.capacity_ah)):
            require_positive(name, value)
        if not is_temperature(self.temperature_degc or 0.0):
            given = f"`temperature` {self.temperature_degc:g}"
            raise InputError(f"{given} is no cell's in degC; subtract 273.15 from kelvin")
        ends = self.score_soc
        if ends is not None and not (len(ends) == 2 and ends[0] < ends[1] and ends[0] < 1.5):
            given = ",".join(f"{end:g}" for end in ends)
            raise InputError(
                f"`score_soc` {given}: give the lower and the upper end, as fractions, as in 0.1,1"
            )
        from_s, to_s = self.score_from_s, self.score_to_s
        if from_s is not None and to_s is not None and to_s <= from_s:
            raise InputError(f"`score_to` {to_s} s must come after `score_from` {from_s} s")

    @property
    def is_chosen(self) -> bool:
        """True if it sets the start or the scored samples."""
        return self != Window(
            rest_current_a=self.rest_current_a,
            initial_direction=self.initial_direction,
            capacity_ah=self.capacity_ah,
            temperature_degc=self.temperature_degc,
        )
