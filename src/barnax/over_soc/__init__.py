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
    Reversal,
    TemperatureFit,
    fit_temperatures,
    group_by_temperature,
    measured_near,
    require_temperature,
    tables_near,
)

__all__ = [
    "HELD_GAMMA",
    "CrossValidation",
    "FitWarning",
    "LeftOut",
    "NodeInterval",
    "Reversal",
    "SocErrors",
    "TableFit",
    "TableSettings",
    "TemperatureFit",
    "beyond_visited",
    "errors_on",
    "evaluate_tables",
    "expected_rmse_v",
    "fit_tables",
    "fit_temperatures",
    "group_by_temperature",
    "measured_near",
    "require_temperature",
    "simulate_tables",
    "tables_near",
]
