"""The quantities of a record, the names testers give them, and their units."""

from collections.abc import Mapping
from dataclasses import dataclass, field


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
