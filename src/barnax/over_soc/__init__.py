"""Circuits with tables over SOC: identified, proved, and checked on held-out blocks."""

from .fit import CrossValidation, FitWarning, NodeInterval, SocErrors, TableFit, fit_tables
from .settings import TableSettings
from .simulate import evaluate_tables, simulate_tables

__all__ = [
    "CrossValidation",
    "FitWarning",
    "NodeInterval",
    "SocErrors",
    "TableFit",
    "TableSettings",
    "evaluate_tables",
    "fit_tables",
    "simulate_tables",
]
