"""Figures of results: each function takes a result and returns a matplotlib `Figure`.

Nothing is shown or written, and neither pyplot nor the global style is touched: write a figure
with its own `savefig`. Within `column_width()` they fit a journal's column. Importing this
package loads matplotlib, but not JAX.
"""

from .cell import plot_ocv, plot_pulse_resistances, plot_pulses
from .cells import plot_cell_life, plot_fleet_life, plot_pack
from .error import plot_error, plot_soc_replay
from .search import plot_compared_convergence, plot_compared_parameters, plot_convergence
from .soc_tables import plot_over_temperature, plot_tables
from .style import column_width
from .summary import plot_summary
from .voltage import plot_design, plot_voltage

__all__ = [
    "column_width",
    "plot_cell_life",
    "plot_compared_convergence",
    "plot_compared_parameters",
    "plot_convergence",
    "plot_design",
    "plot_error",
    "plot_fleet_life",
    "plot_ocv",
    "plot_over_temperature",
    "plot_pack",
    "plot_pulse_resistances",
    "plot_pulses",
    "plot_soc_replay",
    "plot_summary",
    "plot_tables",
    "plot_voltage",
]
