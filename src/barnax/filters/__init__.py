"""Kalman filters on an identified circuit: what a battery manager would know of its cell."""

from .innovations import Innovations, examine_innovations, mean_bounds
from .kalman import Kind, run_filter
from .model import Drive, ErrorModel, Estimate, FilterModel, make_model

__all__ = [
    "Drive",
    "ErrorModel",
    "Estimate",
    "FilterModel",
    "Innovations",
    "Kind",
    "examine_innovations",
    "make_model",
    "mean_bounds",
    "run_filter",
]
