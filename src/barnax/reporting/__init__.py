"""Reports of an identification or a comparison: one self-contained HTML file, or Markdown.

A report is first a `Document`, made from results alone; `to_html` and `to_markdown` say the same
in both forms. Nothing here writes a file.
"""

from .document import Document, Picture
from .render import picture_suffix, to_html, to_markdown

__all__ = ["Document", "Picture", "picture_suffix", "to_html", "to_markdown"]
