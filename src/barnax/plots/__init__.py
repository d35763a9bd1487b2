"""Figures of results: each function takes a result and returns a matplotlib `Figure`.

Nothing is shown or written, and neither pyplot nor the global style is touched: write a figure
with its own `savefig`. Importing this package loads matplotlib, but not JAX.
"""

from .compared_convergence import plot_compared_convergence
from .compared_errors import plot_compared_errors
from .compared_parameters import plot_compared_parameters
from .compared_voltages import plot_compared_voltages
from .condition import plot_condition
from .convergence import plot_convergence
from .error import plot_error
from .hysteresis import plot_hysteresis
from .landscape import plot_landscape
from .ocv import plot_ocv
from .voltage import plot_voltage

__all__ = [
    "plot_compared_convergence",
    "plot_compared_errors",
    "plot_compared_parameters",
    "plot_compared_voltages",
    "plot_condition",
    "plot_convergence",
    "plot_error",
    "plot_hysteresis",
    "plot_landscape",
    "plot_ocv",
    "plot_voltage",
]
