"""The quantities of a record and of an OCV table: their names and units."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

# The voltage of one cell of any lithium chemistry lies within this range.
CELL_RANGE_V = (0.5, 6.0)


@dataclass(frozen=True)
class Unit:
    """A unit: a value times `factor` plus `offset` is in the quantity's base unit.

    `spelled` has its spellings, in lower case, separated by bars.
    """

    symbol: str
    spelled: str = ""
    factor: float = 1.0
    offset: float = 0.0
    words: str = ""

    def to_base(self, values: Any) -> Any:
        """Values in this unit, converted to the base unit."""
        is_base = (self.factor, self.offset) == (1, 0)
        return values if is_base else values * self.factor + self.offset


@dataclass(frozen=True)
class Quantity:
    """A quantity with its units, the default first, and its aliases from the most to the least
    specific.

    Aliases ("cell current|current|i") and keys of units are in lower case with blanks for
    underscores; "programmdauer=ms" gives the unit if the name states none. `examples` are suggested
    names of columns. `foreign` are names in other languages: not accepted, but pointed out.
    """

    name: str
    units: Mapping[str, Unit]
    spelled: str = ""
    examples: tuple[str, ...] = ()
    foreign: tuple[str, ...] = ()

    @cached_property
    def aliases(self) -> Mapping[str, str]:
        """Each alias with its unit if the name states none; empty for the default."""
        pairs = (alias.partition("=") for alias in filter(None, self.spelled.split("|")))
        return {alias: stated for alias, _, stated in pairs}

    @cached_property
    def beginnings(self) -> tuple[str, ...]:
        """Every name of a column that could hold the quantity begins with one of these."""
        return tuple(self.aliases)

    @property
    def base_unit(self) -> Unit:
        return next(iter(self.units.values()))

    def name_in(self, symbol: str) -> str | None:
        """A name for its column in this unit; None without an example."""
        return f"{self.examples[0].partition(' / ')[0]} / {symbol}" if self.examples else None


# The quantities that every record needs, by name.
NEEDED = frozenset({"time", "current", "voltage"})


def _units(*units: Unit) -> dict[str, Unit]:
    """Units by their spellings."""
    return {name: unit for unit in units for name in unit.spelled.split("|")}


_SECONDS = _units(
    Unit("s", "s|sec|secs|second|seconds|sekunden|秒|초", words="seconds"),
    Unit("ms", "ms|msec|millisecond|milliseconds", 1e-3, words="milliseconds"),
    Unit("us", "us|usec|microsecond|microseconds", 1e-6, words="microseconds"),
    Unit("ns", "ns|nsec|nanosecond|nanoseconds", 1e-9, words="nanoseconds"),
    Unit("min", "min|mins|minute|minutes|minuten|分|分钟|분", 60.0, words="minutes"),
    Unit("h", "h|hr|hrs|hour|hours|stunden|std|小时|時間|시간", 3600.0, words="hours"),
    Unit("d", "d|day|days", 86400.0, words="days"),
)
_MILLI = "milliamp|milliamps|milliampere|milliamperes"
_AMPERES = _units(
    Unit("A", "a|amp|amps|ampere|amperes|安", words="amperes"),
    Unit("mA", f"ma|毫安|{_MILLI}", 1e-3, words="milliamperes"),
    Unit("uA", "ua|microamp|microamps|microampere|microamperes", 1e-6, words="microamperes"),
)
_VOLTS = _units(
    Unit("V", "v|volt|volts|v vs. ref.|伏"), Unit("mV", "mv|millivolt|millivolts", 1e-3)
)
_OF_MAH = "mah|ma.h|ma·h|ma h|mahr|mamp-hr|milliampere hour|milliamp hour|毫安时"
_AMPERE_HOURS = _units(
    Unit("Ah", "ah|a.h|a·h|a h|ahr|a-hr|amp-hr|ampere hour|amp hour|amp hours|安时"),
    Unit("mAh", _OF_MAH, 1e-3, words="milliampere-hours"),
)
KELVIN = Unit("K", "k|kelvin", offset=-273.15)
FAHRENHEIT = Unit("degF", "degf|deg f|f|°f|fahrenheit", 5 / 9, -160 / 9)
_DEGREES = _units(
    Unit("degC", "degc|deg c|c|°c|oc|celsius|celcius|degree celsius|degrees celsius"),
    KELVIN,
    FAHRENHEIT,
)
_COUNTS = _units(Unit("1", "1|dimensionless|unitless"))
_FRACTIONS = _units(Unit("1", "1|-"), Unit("%", "%|percent|pct", 0.01))

QUANTITIES: tuple[Quantity, ...] = (
    Quantity(
        "time",
        _SECONDS,
        "test time|testtime|total time|tottime|cumulative time|elapsed time|time|seconds|t|"
        "time of day|clock time|zeit|uhrzeit|总时间|總時間|测试时间|測試時間|时间|"
        "経過時間|総時間|試験時間|総経過時間|時間|총시간|시험시간|경과시간|시간",
        ("Test Time / s", "test_time_second"),
        ("temps", "tiempo", "tempo"),
    ),
    # A clock that restarts with each step, and the time of day: used if there is no test clock.
    Quantity(
        "step time",
        _SECONDS,
        "step time|steptime|relative time|过程时间|ステップ時間|스텝시간",
        ("Step Time / s",),
    ),
    Quantity(
        "date",
        _SECONDS,
        "date time|datetime|unix time|time stamp|timestamp|date and time|date|"
        "datum/uhrzeit|datum uhrzeit|zeitstempel|datum|日時|日付時刻|日付|날짜|일시",
        ("Date Time", "Unix Time / s"),
    ),
    Quantity(
        "current",
        _AMPERES,
        "cell current|channel current|current|pack current|battery current|current measured|"
        "cur|amps|we(1).current|i|ma=mA|strom|电流|電流|전류",
        ("Current / A", "current_ampere"),
        ("courant", "corriente", "corrente"),
    ),
    Quantity("charge of the interval", _AMPERE_HOURS),
    Quantity(
        "voltage",
        _VOLTS,
        "terminal voltage|cell voltage|channel voltage|voltage|voltage measured|potential|volts|"
        "ecell|ewe|working electrode|working electrode vs. nhe|we(1).potential|u|v|mv=mV|"
        "spannung|zellspannung|电压|電壓|電圧|전압",
        ("Voltage / V", "voltage_volt"),
        ("tension", "voltaje", "tensione"),
    ),
    Quantity(
        "temperature",
        _DEGREES,
        "surface temperature|surface temperature t1|cell temperature|temperature cell|"
        "battery temperature|temperature|aux temperature|"
        "aux temperature 1|aux1 temperature|temperature t1|temperature 1|temperature measured|temp|"
        "t1|t|ambient temperature|temperatur|電池温度|温度|溫度|온도",
        ("Surface Temperature / degC", "Ambient Temperature / degC"),
    ),
    Quantity(
        "step",
        _COUNTS,
        "step index|step|step id|stepid|step number|step no|stepno|ns|step count|schritt|"
        "schritt nr|schritt nr.|schrittnummer|ステップ|ステップ番号|ステップno|스텝|스텝번호",
        ("Step Index / 1",),
    ),
    Quantity(
        "cycle",
        _COUNTS,
        "cycle index|cycle count|cycle|cycle number|totcycle|"
        "zyklus|サイクル|サイクル番号|サイクル数|사이클",
        ("Cycle Count / 1",),
    ),
    Quantity(
        "state",
        _COUNTS,
        "state|step type|md|status|step name|mode|step mode|step state|"
        "zustand|modus|betriebsart|状态|狀態|状態|モード|상태|모드",
        ("Step Type / 1",),
    ),
    Quantity(
        "charging capacity",
        _AMPERE_HOURS,
        "charging capacity|schedule charging capacity|charge capacity|q charge|chgah",
        ("Charging Capacity / Ah",),
    ),
    Quantity(
        "discharging capacity",
        _AMPERE_HOURS,
        "discharging capacity|schedule discharging capacity|discharge capacity|q discharge|disah",
        ("Discharging Capacity / Ah",),
    ),
    Quantity(
        "net capacity",
        _AMPERE_HOURS,
        "net capacity|step net capacity|capacity|容量",
        ("Net Capacity / Ah", "Capacity(Ah)"),
    ),
)

QUANTITY_OF = {quantity.name: quantity for quantity in QUANTITIES}

# What a table of OCV over SOC has instead: SOC, and one voltage or one for each direction.
OCV_QUANTITIES: tuple[Quantity, ...] = (
    Quantity("SOC", _FRACTIONS, "state of charge|soc", ("SOC [-]", "SOC / %")),
    Quantity(
        "OCV", _VOLTS, "open circuit voltage|ocv|voltage|volts|u|v", ("OCV [V]", "Voltage / V")
    ),
    *(
        Quantity(
            f"{word} OCV",
            _VOLTS,
            "|".join(
                f"{way} ocv|ocv {way}|{way} open circuit voltage|open circuit voltage {way}|"
                f"{way} voltage|voltage {way}"
                for way in (word, word.replace("charge", "charging"))
            ),
            (f"{word} OCV [V]",),
        )
        for word in ("charge", "discharge")
    ),
)
