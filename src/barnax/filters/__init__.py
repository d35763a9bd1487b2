"""Kalman filters on an identified circuit: what a battery manager would know of its cell."""

from .kalman import Kind, run_filter
from .model import Drive, ErrorModel, Filtered, FilterModel, make_model

__all__ = ["Drive", "ErrorModel", "FilterModel", "Filtered", "Kind", "make_model", "run_filter"]
