"""Reports of an identification or a comparison: one self-contained HTML file, or Markdown.

A report is first a `Document`, made from results alone; `to_html` and `to_markdown` say the same
in both forms. Nothing here writes a file.
"""

from .comparison import comparison_document
from .document import Document, Picture
from .identification import identification_document
from .illustrations import comparison_illustrations, identification_illustrations
from .render import picture_suffix, to_html, to_markdown

__all__ = [
    "Document",
    "Picture",
    "comparison_document",
    "comparison_illustrations",
    "identification_document",
    "identification_illustrations",
    "picture_suffix",
    "to_html",
    "to_markdown",
]
