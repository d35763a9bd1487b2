"""A report as one HTML file, and as Markdown."""

import base64
import unicodedata
from functools import cache, partial
from pathlib import PurePosixPath
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from .document import Bullets, Document, Listing, Paragraph, Picture, Table
from .markdown import code_block, escape_markdown, table_lines

KINDS = {
    "paragraph": Paragraph,
    "bullets": Bullets,
    "listing": Listing,
    "table": Table,
    "picture": Picture,
}
SUFFIXES = {"image/png": ".png", "image/svg+xml": ".svg"}
# Letters that cannot be seen, or that turn the text around: file names may hold them.
UNSEEN = {"Cc", "Cf", "Cs"}


def to_html(document: Document) -> str:
    """One file that needs no other, no network and no scripts.

    >>> "<h1>A &lt; B</h1>" in to_html(Document("A < B", "", ()))
    True
    """
    return _templates(for_html=True).get_template("report.html").render(document=document)


def to_markdown(document: Document, figures: str = "figures") -> str:
    """The same as GitHub's Markdown; its images are looked for in the folder `figures`.

    They are the document's `pictures`, each under its name and `picture_suffix`.
    """
    template = _templates(for_html=False).get_template("report.md")
    text = template.render(document=document, figures=PurePosixPath(figures))
    return text.rstrip("\n") + "\n"


def picture_suffix(picture: Picture) -> str:
    """The suffix of a picture's file."""
    return SUFFIXES[picture.media_type]


@cache
def _templates(for_html: bool) -> Environment:
    templates = Environment(
        loader=PackageLoader("barnax.reporting"),
        autoescape=for_html,
        undefined=StrictUndefined,
        finalize=_seen,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    templates.tests |= {name: partial(_is, kind=kind) for name, kind in KINDS.items()}
    templates.filters |= {
        "data_uri": _data_uri,
        "suffix": picture_suffix,
        "md": escape_markdown,
        "md_table": table_lines,
        "code_block": code_block,
    }
    return templates


def _is(block: Any, kind: type) -> bool:
    return isinstance(block, kind)


def _data_uri(picture: Picture) -> str:
    return f"data:{picture.media_type};base64,{base64.b64encode(picture.content).decode()}"


def _seen(value: Any) -> Any:
    """A text without letters that cannot be seen or stored; line ends stay."""
    if not isinstance(value, str) or value.isprintable():
        return value
    cleaned = "".join(
        "\N{REPLACEMENT CHARACTER}"
        if unicodedata.category(letter) in UNSEEN and letter not in "\n\t"
        else letter
        for letter in value
    )
    # What is safe already, and so a string of another class, stays so.
    return type(value)(cleaned)
