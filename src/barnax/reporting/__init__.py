"""Reports of an identification, a comparison, a fleet or a check: every sentence and table.

A report is first a `Page`, made from results alone; `to_html`, `to_markdown` and `to_terminal`
render it. Nothing here writes a file. Its modules are imported on first use, since most load JAX.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
