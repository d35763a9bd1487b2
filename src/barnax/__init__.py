"""Identification of lithium-ion equivalent-circuit parameters, with an assessment of the answer.

Names are imported on first use: importing barnax loads no JAX, sets nothing and touches no device.
The public names are listed in `__init__.pyi`.
"""

import lazy_loader

from .display import HOOKS

__version__ = "1.0.0rc1"
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
HOOKS |= {
    "Result.load": "barnax.reopening:loaded",
    "Result.evaluations": "barnax.reopening:reopened",
    "Result.validate": "barnax.reopening:validated",
    "Result.simulate": "barnax.simulation:simulate_frame",
    "Result.figure": "barnax.reporting.illustrations:figure_of",
    "Result.report": "barnax.reporting.identification:report_of",
    "Result.to_frame": "barnax.reporting.parameters:parameters_frame",
    "Result._repr_html_": "barnax.reporting.identification:fragment_of",
    "Design.figure": "barnax.plots:plot_design",
    "SocReplay.figure": "barnax.plots:plot_soc_replay",
    "SocReplay._repr_png_": "barnax.plots:encode",
}
