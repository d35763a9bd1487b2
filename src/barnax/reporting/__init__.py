"""Reports of an identification, a comparison or a check: HTML, Markdown, or a terminal's text.

A report is first a `Document`, made from results alone; `to_html`, `to_markdown` and `to_terminal`
say the same. Every sentence is made here, from numbers. Nothing here writes a file.
"""

from .comparison import comparison_document
from .document import Document, Picture
from .identification import identification_document
from .illustrations import comparison_illustrations, identification_illustrations, is_always
from .render import paper_files, picture_suffix, report_files, to_html, to_markdown

__all__ = [
    "Document",
    "Picture",
    "comparison_document",
    "comparison_illustrations",
    "identification_document",
    "identification_illustrations",
    "is_always",
    "paper_files",
    "picture_suffix",
    "report_files",
    "to_html",
    "to_markdown",
]
