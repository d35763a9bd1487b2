"""Circuits with tables over SOC: identified, proved, and checked on held-out blocks."""

from .cross_validation import CrossValidation, SocErrors
from .fit import (
    HELD_GAMMA,
    FitWarning,
    TableFit,
    beyond_visited,
    errors_on,
    expected_rmse_v,
    fit_tables,
)
from .intervals import NodeInterval
from .settings import TableSettings
from .simulate import evaluate_tables, simulate_tables
from .temperature import (
    LeftOut,
    OverTemperature,
    Reversal,
    TableFits,
    fit_temperatures,
    group_by_temperature,
    require_temperature,
    require_temperatures,
)

__all__ = [
    "HELD_GAMMA",
    "CrossValidation",
    "FitWarning",
    "LeftOut",
    "NodeInterval",
    "OverTemperature",
    "Reversal",
    "SocErrors",
    "TableFit",
    "TableFits",
    "TableSettings",
    "beyond_visited",
    "errors_on",
    "evaluate_tables",
    "expected_rmse_v",
    "fit_tables",
    "fit_temperatures",
    "group_by_temperature",
    "require_temperature",
    "require_temperatures",
    "simulate_tables",
]
