"""Identify lithium-ion equivalent-circuit parameters, and know how good the answer is.

Names are imported on first use: importing barnax loads no JAX, sets nothing and touches no
device. The public names are listed in `__init__.pyi`.
"""

import lazy_loader

__version__ = "0.2.0"
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
