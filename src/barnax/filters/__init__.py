"""Kalman filters on an identified circuit: the state that a battery manager would estimate."""

from .kalman import Kind, run_filter
from .model import Drive, ErrorModel, Filtered, FilterModel, make_model

__all__ = ["Drive", "ErrorModel", "FilterModel", "Filtered", "Kind", "make_model", "run_filter"]
