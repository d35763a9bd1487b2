"""A fleet over its life: smooth trends with intervals, and the cells that depart from them."""

from .ageing import QUANTITIES, SHIFT, Fault, Life, Trend, life_of

__all__ = ["QUANTITIES", "SHIFT", "Fault", "Life", "Trend", "life_of"]
