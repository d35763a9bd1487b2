"""Which column of a table holds which quantity, and in what unit.

A column name is an alias and a unit, in any of the usual spellings: Battery Data Format labels
("Current / A") and machine names ("current_ampere"), PyBaMM ("Current [A]"), Arbin
("Current(A)"), BioLogic ("I/mA"), and plain names ("current"), whose unit is then assumed.
"""

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True)
class Unit:
    """A unit: its value times `factor` plus `offset` is in the quantity's base unit."""

    symbol: str
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Quantity:
    """A quantity, its aliases from the most to the least specific, and its units.

    Aliases and unit keys are lower case with blanks for underscores. `self_explaining` aliases
    carry their unit in themselves ("seconds"). `foreign` words are what the quantity is called in
    other languages: not accepted, but pointed to.
    """

    name: str
    base_unit: Unit
    aliases: tuple[str, ...]
    units: Mapping[str, Unit]
    examples: tuple[str, ...]
    is_required: bool = False
    needs_unit: bool = True
    self_explaining: frozenset[str] = field(default_factory=frozenset)
    foreign: tuple[str, ...] = ()


def _spelled(spellings: Mapping[Unit, str]) -> dict[str, Unit]:
    return {name: unit for unit, names in spellings.items() for name in names.split("|")}


_SECOND, _AMPERE, _VOLT = Unit("s"), Unit("A"), Unit("V")
_AMPERE_HOUR, _CELSIUS, _ONE = Unit("Ah"), Unit("degC"), Unit("1")

_TIME_UNITS = _spelled(
    {
        _SECOND: "s|sec|secs|second|seconds",
        Unit("ms", 1e-3): "ms|msec|millisecond|milliseconds",
        Unit("min", 60.0): "min|mins|minute|minutes",
        Unit("h", 3600.0): "h|hr|hrs|hour|hours",
        Unit("d", 86400.0): "d|day|days",
    }
)
_CURRENT_UNITS = _spelled(
    {
        _AMPERE: "a|amp|amps|ampere|amperes",
        Unit("mA", 1e-3): "ma|milliamp|milliamps|milliampere|milliamperes",
        Unit("uA", 1e-6): "ua|microamp|microamps|microampere|microamperes",
    }
)
_VOLTAGE_UNITS = _spelled(
    {
        _VOLT: "v|volt|volts",
        Unit("mV", 1e-3): "mv|millivolt|millivolts",
    }
)
_CAPACITY_UNITS = _spelled(
    {
        _AMPERE_HOUR: "ah|a.h|a h|ampere hour|amp hour|amp hours",
        Unit("mAh", 1e-3): "mah|ma.h|ma h|milliampere hour|milliamp hour",
    }
)
_TEMPERATURE_UNITS = _spelled(
    {
        _CELSIUS: "degc|deg c|c|°c|celsius|degree celsius|degrees celsius",
        Unit("K", 1.0, -273.15): "k|kelvin",
        Unit("degF", 5 / 9, -160 / 9): "degf|deg f|f|°f|fahrenheit",
    }
)

QUANTITIES: tuple[Quantity, ...] = (
    Quantity(
        "time",
        _SECOND,
        ("test time", "total time", "elapsed time", "time", "seconds", "t"),
        _TIME_UNITS,
        ("Test Time / s", "test_time_second", "Time [s]", "Test_Time(s)", "time"),
        is_required=True,
        self_explaining=frozenset({"seconds"}),
        foreign=("zeit", "temps", "tiempo", "tempo", "时间"),
    ),
    Quantity(
        "current",
        _AMPERE,
        ("current", "amps", "i"),
        _CURRENT_UNITS,
        ("Current / A", "current_ampere", "Current [A]", "Current(A)", "current"),
        is_required=True,
        self_explaining=frozenset({"amps"}),
        foreign=("strom", "courant", "corriente", "corrente", "电流"),
    ),
    Quantity(
        "voltage",
        _VOLT,
        ("terminal voltage", "cell voltage", "voltage", "volts", "ecell", "u", "v"),
        _VOLTAGE_UNITS,
        ("Voltage / V", "voltage_volt", "Voltage [V]", "Voltage(V)", "voltage"),
        is_required=True,
        self_explaining=frozenset({"volts"}),
        foreign=("spannung", "tension", "voltaje", "tensione", "电压"),
    ),
    Quantity(
        "temperature",
        _CELSIUS,
        (
            "surface temperature",
            "cell temperature",
            "battery temperature",
            "temperature",
            "aux temperature",
            "aux temperature 1",
            "temperature t1",
            "temp",
            "t",
            "ambient temperature",
        ),
        _TEMPERATURE_UNITS,
        ("Surface Temperature / degC", "Ambient Temperature / degC", "Temperature [degC]"),
    ),
    Quantity(
        "step",
        _ONE,
        ("step index", "step", "step id", "step number", "ns", "step count"),
        {"1": _ONE},
        ("Step Index / 1", "Step Count / 1", "Step_Index"),
        needs_unit=False,
    ),
    Quantity(
        "charging capacity",
        _AMPERE_HOUR,
        ("charging capacity", "charge capacity", "q charge", "chgah"),
        _CAPACITY_UNITS,
        ("Charging Capacity / Ah", "Charge_Capacity(Ah)"),
        self_explaining=frozenset({"chgah"}),
    ),
    Quantity(
        "discharging capacity",
        _AMPERE_HOUR,
        ("discharging capacity", "discharge capacity", "q discharge", "disah"),
        _CAPACITY_UNITS,
        ("Discharging Capacity / Ah", "Discharge_Capacity(Ah)"),
        self_explaining=frozenset({"disah"}),
    ),
    Quantity(
        "net capacity",
        _AMPERE_HOUR,
        ("net capacity", "capacity"),
        _CAPACITY_UNITS,
        ("Net Capacity / Ah", "Capacity(Ah)"),
    ),
)

_FRACTION_UNITS = _spelled({_ONE: "1|-", Unit("%", 0.01): "%|percent|pct"})
_BRANCHES = {"charge OCV": ("charge", "charging"), "discharge OCV": ("discharge", "discharging")}

# What a table of OCV over SOC holds instead: SOC, and one voltage or one for each direction.
OCV_QUANTITIES: tuple[Quantity, ...] = (
    Quantity(
        "SOC",
        _ONE,
        ("state of charge", "soc"),
        _FRACTION_UNITS,
        ("SOC [-]", "SOC / %"),
        needs_unit=False,
    ),
    Quantity(
        "OCV",
        _VOLT,
        ("open circuit voltage", "ocv", "voltage", "volts", "u", "v"),
        _VOLTAGE_UNITS,
        ("OCV [V]", "Voltage / V"),
        self_explaining=frozenset({"volts"}),
    ),
    *(
        Quantity(
            name,
            _VOLT,
            tuple(
                alias
                for word in words
                for voltage in ("ocv", "open circuit voltage", "voltage")
                for alias in (f"{word} {voltage}", f"{voltage} {word}")
            ),
            _VOLTAGE_UNITS,
            (f"{name} [V]",),
        )
        for name, words in _BRANCHES.items()
    ),
)


Dialect = Literal["Battery Data Format", "Arbin", "PyBaMM", "plain"]

# A unit stands behind a slash, in brackets, or after a blank (machine names); Arbin numbers its
# auxiliary channels behind the bracket.
_UNIT = re.compile(r"^(?:\s*[/\[(]\s*|\s+(?:in\s+)?)(?P<unit>[^\])]*?)\s*(?:[\])]\s*\d*)?$")
_ARBIN = {"test time(s)", "step index", "current(a)", "voltage(v)"}
_BDF = {"test time / s", "current / a", "voltage / v"}
_BDF_MACHINE = {"test time second", "current ampere", "voltage volt"}

# Comparing spellings is slow, and no tester writes so many columns.
_COMPARED_NAMES = 1000


# What no record can do without, by the quantities' names.
NEEDED = frozenset(quantity.name for quantity in QUANTITIES if quantity.is_required)


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


def find_columns(
    header: Sequence[str], quantities: Sequence[Quantity] = QUANTITIES
) -> dict[str, Column]:
    """The column of each quantity that the header names, by the quantity's name.

    Where several columns could hold one quantity, the more specific alias wins, then the column
    that states its unit, then the first of two equal names.
    """
    found: dict[str, Column] = {}
    names = {name: index for index, name in reversed(list(enumerate(header)))}
    normals = {name: _normal(name).replace("<", "").replace(">", "") for name in names}
    for quantity in quantities:
        candidates = []
        for name, index in names.items():
            match = _match(name, normals[name], quantity)
            if match is not None:
                rank, unit, assumed = match
                column = Column(index, name, quantity, unit, assumed)
                candidates.append((rank, assumed, index, column))
        if candidates:
            found[quantity.name] = min(candidates, key=lambda candidate: candidate[:3])[3]
    return found


def names_record(header: Sequence[str]) -> bool:
    """Whether the header names time, current and voltage."""
    return find_columns(header).keys() >= NEEDED


def is_ocv_table(header: Sequence[str]) -> bool:
    """Whether the header names SOC and a voltage, but no record."""
    ocv = find_columns(header, OCV_QUANTITIES).keys()
    return "SOC" in ocv and len(ocv) > 1 and not names_record(header)


def has_arbin_header(header: Sequence[str]) -> bool:
    """Whether the names are those of an Arbin channel sheet."""
    return {_tight(name) for name in header} >= _ARBIN


def dialect_of(header: Sequence[str]) -> Dialect:
    """Whose column names these are; some promise a sign, and Arbin's a hold."""
    names = {_normal(name) for name in header}
    if has_arbin_header(header):
        return "Arbin"
    if names >= _BDF or names >= _BDF_MACHINE:
        return "Battery Data Format"
    if "current [a]" in names:
        return "PyBaMM"
    return "plain"


def _normal(name: str) -> str:
    return re.sub(r"[\s_]+", " ", name.replace("µ", "u").replace("μ", "u")).strip().lower()


def _tight(name: str) -> str:
    return _normal(name).replace(" (", "(")


def _match(name: str, normal: str, quantity: Quantity) -> tuple[int, Unit, bool] | None:
    """Rank of the alias (0 is the most specific), the unit, and whether it is assumed."""
    for rank, alias in enumerate(quantity.aliases):
        if normal == alias:
            # A bare T is a temperature to some and a time to others; a bare t is a time.
            if alias == "t" and (name.strip() != "t" or quantity.name != "time"):
                continue
            is_unit_assumed = quantity.needs_unit and alias not in quantity.self_explaining
            return rank, quantity.base_unit, is_unit_assumed
        if normal.startswith(alias) and (rest := _UNIT.match(normal[len(alias) :])):
            unit = quantity.units.get(rest["unit"].replace("^", ""))
            if unit is not None:
                return rank, unit, False
    return None


def likely_names(quantity: Quantity, header: Sequence[str]) -> list[str]:
    """Names in the header that may mean the quantity although they are not accepted for it.

    They contain an alias, are spelled nearly like one, or mean it in another language.
    """
    long = [alias for alias in quantity.aliases if len(alias) > 2]
    likely = []
    for name in header[:_COMPARED_NAMES]:
        normal = _normal(name)
        words = re.split(r"[\[(/]", normal)[0].strip()
        if (
            any(alias in normal for alias in long)
            or any(word in normal for word in quantity.foreign)
            or difflib.get_close_matches(words, long, 1, 0.7)
        ):
            likely.append(name)
    return likely


def likely_column(quantity: Quantity, header: Sequence[str]) -> Column | None:
    """The only column that may hold the quantity, with the unit at its name's end, if any."""
    names = likely_names(quantity, header)
    if len(names) != 1:
        return None
    (name,) = names
    # The last word in brackets or behind a slash.
    stated = re.search(r"[/\[(]\s*([^/\[\]()]*?)\s*[\])]?\s*$", _normal(name))
    unit = quantity.units.get(stated[1]) if stated else None
    index = list(header).index(name)
    return Column(index, name, quantity, unit or quantity.base_unit, unit is None)
