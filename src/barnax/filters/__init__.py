"""Kalman filters on an identified circuit: what a battery manager would know of its cell."""

from .kalman import Kind, run_filter
from .model import Drive, ErrorModel, Estimate, FilterModel, make_model

__all__ = ["Drive", "ErrorModel", "Estimate", "FilterModel", "Kind", "make_model", "run_filter"]
