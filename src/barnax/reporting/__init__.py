"""Reports of an identification, a comparison or a check: HTML, Markdown, or a terminal's text.

A report is first a `Document`, made from results alone; `to_html`, `to_markdown` and `to_terminal`
say the same. Every sentence is made here, from numbers. Nothing here writes a file. Names are
imported on first use: a few lines need no figures.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
