"""Which column of a table holds which quantity, and in what unit.

A column name is an alias and a unit, in any of the usual spellings: Battery Data Format labels
("Current / A") and machine names ("current_ampere"), PyBaMM ("Current [A]"), Arbin
("Current(A)"), BioLogic ("I/mA"), and plain names ("current"), whose unit is then assumed.
"""

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Unit:
    """A unit: its value times `factor` plus `offset` is in the quantity's base unit."""

    symbol: str
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Quantity:
    """A quantity, its aliases from the most to the least specific, and its units, its own first.

    Aliases and unit keys are lower case with blanks for underscores. `examples` are names to give
    a column. `foreign` words are what the quantity is called in other languages: not accepted, but
    pointed to.
    """

    name: str
    aliases: tuple[str, ...]
    units: Mapping[str, Unit]
    examples: tuple[str, ...]
    foreign: tuple[str, ...] = ()

    @property
    def base_unit(self) -> Unit:
        return next(iter(self.units.values()))

    @property
    def is_required(self) -> bool:
        return self.name in NEEDED


# What no record can do without, by the quantities' names.
NEEDED = frozenset({"time", "current", "voltage"})
# Aliases that carry their unit in themselves.
_SELF_EXPLAINING = {
    "seconds",
    "amps",
    "mamps",
    "volts",
    "amp-hr",
    "mamp-hr",
    "chgah",
    "disah",
    "ma",
    "mv",
}


def _units(spellings: Mapping[Unit, str]) -> dict[str, Unit]:
    return {name: unit for unit, names in spellings.items() for name in names.split("|")}


def _quantity(
    name: str, units: Mapping[str, Unit], aliases: str, examples: str, foreign: str = ""
) -> Quantity:
    words = (tuple(filter(None, each.split("|"))) for each in (aliases, examples, foreign))
    names, labels, elsewhere = words
    return Quantity(name, names, units, labels, elsewhere)


_SECONDS = _units(
    {
        Unit("s"): "s|sec|secs|second|seconds|秒",
        Unit("ms", 1e-3): "ms|msec|millisecond|milliseconds",
        Unit("min", 60.0): "min|mins|minute|minutes|分|分钟",
        Unit("h", 3600.0): "h|hr|hrs|hour|hours|小时",
        Unit("d", 86400.0): "d|day|days",
    }
)
_AMPERES = _units(
    {
        Unit("A"): "a|amp|amps|ampere|amperes|安",
        Unit("mA", 1e-3): "ma|毫安|milliamp|milliamps|milliampere|milliamperes",
        Unit("uA", 1e-6): "ua|microamp|microamps|microampere|microamperes",
    }
)
_VOLTS = _units(
    {Unit("V"): "v|volt|volts|v vs. ref.|伏", Unit("mV", 1e-3): "mv|millivolt|millivolts"}
)
_AMPERE_HOURS = _units(
    {
        Unit("Ah"): "ah|a.h|a·h|a h|ahr|a-hr|amp-hr|ampere hour|amp hour|amp hours|安时",
        Unit("mAh", 1e-3): "mah|ma.h|ma·h|ma h|mahr|mamp-hr|milliampere hour|milliamp hour|毫安时",
    }
)
_DEGREES = _units(
    {
        Unit("degC"): "degc|deg c|c|°c|oc|celsius|celcius|degree celsius|degrees celsius",
        Unit("K", 1.0, -273.15): "k|kelvin",
        Unit("degF", 5 / 9, -160 / 9): "degf|deg f|f|°f|fahrenheit",
    }
)
_COUNTS = _units({Unit("1"): "1|dimensionless|unitless"})
_FRACTIONS = _units({Unit("1"): "1|-", Unit("%", 0.01): "%|percent|pct"})

QUANTITIES: tuple[Quantity, ...] = (
    _quantity(
        "time",
        _SECONDS,
        "test time|testtime|total time|tottime|cumulative time|elapsed time|time|seconds|t",
        "Test Time / s|test_time_second",
        "zeit|temps|tiempo|tempo|时间",
    ),
    # A clock that starts again with each step, and the time of day: where there is no test clock.
    _quantity("step time", _SECONDS, "step time|steptime|relative time", "Step Time / s"),
    _quantity(
        "date",
        _SECONDS,
        "date time|datetime|unix time|time stamp|timestamp|date and time|date",
        "Unix Time / s",
    ),
    _quantity(
        "current",
        _AMPERES,
        "cell current|channel current|current|current measured|cur|amps|we(1).current|i|ma=mA",
        "Current / A|current_ampere",
        "strom|courant|corriente|corrente|电流",
    ),
    _quantity("charge of the interval", _AMPERE_HOURS, "", ""),
    _quantity(
        "voltage",
        _VOLTS,
        "terminal voltage|cell voltage|channel voltage|voltage|voltage measured|potential|volts|"
        "ecell|ewe|working electrode|working electrode vs. nhe|we(1).potential|u|v|mv=mV",
        "Voltage / V|voltage_volt",
        "spannung|tension|voltaje|tensione|电压",
    ),
    _quantity(
        "temperature",
        _DEGREES,
        "surface temperature|surface temperature t1|cell temperature|temperature cell|"
        "battery temperature|temperature|aux temperature|"
        "aux temperature 1|aux1 temperature|temperature t1|temperature 1|temperature measured|temp|"
        "t1|t|ambient temperature",
        "Surface Temperature / degC|Ambient Temperature / degC",
    ),
    _quantity(
        "step",
        _COUNTS,
        "step index|step|step id|stepid|step number|step no|stepno|ns|step count",
        "Step Index / 1",
    ),
    _quantity(
        "cycle", _COUNTS, "cycle index|cycle count|cycle|cycle number|totcycle", "Cycle Count / 1"
    ),
    _quantity(
        "state",
        _COUNTS,
        "state|step type|md|status|step name|mode|step mode|step state",
        "Step Type / 1",
    ),
    _quantity(
        "charging capacity",
        _AMPERE_HOURS,
        "charging capacity|schedule charging capacity|charge capacity|q charge|chgah",
        "Charging Capacity / Ah",
    ),
    _quantity(
        "discharging capacity",
        _AMPERE_HOURS,
        "discharging capacity|schedule discharging capacity|discharge capacity|q discharge|disah",
        "Discharging Capacity / Ah",
    ),
    _quantity(
        "net capacity",
        _AMPERE_HOURS,
        "net capacity|step net capacity|capacity",
        "Net Capacity / Ah|Capacity(Ah)",
    ),
)

_BRANCH = (
    "{0} ocv|ocv {0}|{0} open circuit voltage|open circuit voltage {0}|{0} voltage|voltage {0}|"
)
# What a table of OCV over SOC holds instead: SOC, and one voltage or one for each direction.
OCV_QUANTITIES: tuple[Quantity, ...] = (
    _quantity("SOC", _FRACTIONS, "state of charge|soc", "SOC [-]|SOC / %"),
    _quantity("OCV", _VOLTS, "open circuit voltage|ocv|voltage|volts|u|v", "OCV [V]|Voltage / V"),
    *(
        _quantity(
            f"{word} OCV",
            _VOLTS,
            _BRANCH.format(word) + _BRANCH.format(word.replace("charge", "charging")),
            f"{word} OCV [V]",
        )
        for word in ("charge", "discharge")
    ),
)


# A unit stands behind a slash, # or comma, in brackets, or after a blank (machine names); Arbin
# numbers its auxiliary channels behind the bracket.
_UNIT = re.compile(
    r"^(?:\s*[/\[(#]\s*|\s*,\s*\(?|\s+(?:in\s+)?)(?P<unit>[^\])]*?)\s*(?:[\])]\s*\d*)?$"
)
# "h:min:s.ms", "h min s.ms", "Hours in hh:mm:ss.xxx", "mm:ss" and "ss.xxx" are forms of seconds.
_CLOCK_FORM = re.compile(r".*\bh+[: ]m.*|m+:s.*|s+\.x+")

# Comparing spellings is slow, and no tester writes so many columns.
_COMPARED_NAMES = 1000


@dataclass(frozen=True)
class Column:
    """A column found: its place in the table, its name as written, and its unit.

    `is_unit_assumed` says that the name gives no unit and the quantity's own was taken.
    """

    index: int
    header: str
    quantity: Quantity
    unit: Unit
    is_unit_assumed: bool


def find_columns(header: Sequence[str], quantities: Sequence[Quantity]) -> dict[str, Column]:
    """The column of each quantity that the header names, by the quantity's name.

    Where several columns could hold one quantity, the more specific alias wins, then the column
    that states its unit, then the first of two equal names.
    """
    found: dict[str, Column] = {}
    names = {name: index for index, name in reversed(list(enumerate(header)))}
    normals = {name: normal(name).replace("<", "").replace(">", "") for name in names}
    for quantity in quantities:
        matches = (_match(index, name, normals[name], quantity) for name, index in names.items())
        candidates = [match for match in matches if match is not None]
        if candidates:
            _, found[quantity.name] = min(
                candidates, key=lambda match: (match[0], match[1].is_unit_assumed, match[1].index)
            )
    return found


# Full-width brackets, and a degree in one letter.
_WIDE = str.maketrans({"（": "(", "）": ")", "℃": "°c"})


def normal(name: str) -> str:
    """The name in lower case, with blanks for underscores, and u for micro."""
    plain = name.replace("µ", "u").replace("μ", "u").translate(_WIDE).lstrip("~# \ufeff")
    return re.sub(r"[\s_]+", " ", plain).strip().lower()


def unit_of(quantity: Quantity, text: str) -> Unit | None:
    """The unit of the quantity that the text spells, if it does."""
    spelled = normal(text).replace("^", "")
    if quantity.base_unit.symbol == "s" and _CLOCK_FORM.fullmatch(spelled):
        return quantity.base_unit
    # A lost degree sign is still one of Celsius.
    spelled = re.sub("[?\ufffdº]", "°", spelled)
    return quantity.units.get(spelled) or quantity.units.get(spelled.rstrip("."))


def named_column(header: Sequence[str], quantity: Quantity, given: str) -> Column | None:
    """The column that the user names, as "NAME" or "NAME:unit"; None where the header lacks it.

    Without a unit, the one at the end of the name holds, or the quantity's own.
    """
    name, _, spelled = given.rpartition(":")
    unit = unit_of(quantity, spelled) if name else None
    places = {normal(each): index for index, each in reversed(list(enumerate(header)))}
    if unit is None or normal(given) in places:
        name, unit = given, None
    if normal(name) not in places:
        return None
    index = places[normal(name)]
    if unit is not None:
        return Column(index, header[index], quantity, unit, is_unit_assumed=False)
    return _with_its_unit(index, header[index], quantity)


def _with_its_unit(index: int, name: str, quantity: Quantity) -> Column:
    """The column with the unit in brackets or behind a slash at its name's end, if any."""
    stated = re.search(r"[/\[(]\s*([^/\[\]()]*?)\s*[\])]?\s*$", normal(name))
    unit = unit_of(quantity, stated[1]) if stated else None
    return Column(index, name, quantity, unit or quantity.base_unit, unit is None)


def _match(index: int, name: str, plain: str, quantity: Quantity) -> tuple[int, Column] | None:
    """Rank of the alias that the name is (0 is the most specific), and the column it names.

    An alias such as "programmdauer=ms" has that unit where the name states none.
    """
    for rank, spelling in enumerate(quantity.aliases):
        alias, _, stated = spelling.partition("=")
        if plain == alias:
            # A bare T is a temperature to some and a time to others; a bare t is a time.
            if alias == "t" and not stated and (name.strip() != "t" or quantity.name != "time"):
                continue
            unit = quantity.units[stated.lower()] if stated else quantity.base_unit
            is_plain = "1" in quantity.units or alias in _SELF_EXPLAINING
            return rank, Column(index, name, quantity, unit, is_unit_assumed=not is_plain)
        if plain.startswith(alias) and (rest := _UNIT.match(plain[len(alias) :])):
            unit = unit_of(quantity, rest["unit"])
            if unit is not None:
                return rank, Column(index, name, quantity, unit, is_unit_assumed=False)
    return None


def likely_names(quantity: Quantity, header: Sequence[str]) -> list[str]:
    """Names in the header that may mean the quantity although they are not accepted for it.

    They contain an alias, are spelled nearly like one, or mean it in another language.
    """
    long = [alias for alias in quantity.aliases if len(alias) > 2 and "=" not in alias]
    likely = []
    for name in header[:_COMPARED_NAMES]:
        plain = normal(name)
        words = re.split(r"[\[(/]", plain)[0].strip()
        is_inside = any(word in plain for word in (*long, *quantity.foreign))
        if is_inside or difflib.get_close_matches(words, long, 1, 0.7):
            likely.append(name)
    return likely


def likely_column(quantity: Quantity, header: Sequence[str]) -> Column | None:
    """The only column that may hold the quantity, with the unit at its name's end, if any."""
    names = likely_names(quantity, header)
    if len(names) != 1:
        return None
    return _with_its_unit(list(header).index(names[0]), names[0], quantity)
