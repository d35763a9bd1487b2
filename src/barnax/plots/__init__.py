"""Figures of results: each function takes a result and returns a matplotlib `Figure`.

Nothing is shown or written, and neither pyplot nor the global style is touched: write a figure
with its own `savefig`. Importing this package loads matplotlib, but not JAX.
"""

from .convergence import plot_convergence
from .error import plot_error
from .hysteresis import plot_hysteresis
from .ocv import plot_ocv
from .voltage import plot_voltage

__all__ = ["plot_convergence", "plot_error", "plot_hysteresis", "plot_ocv", "plot_voltage"]
