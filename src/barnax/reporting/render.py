"""A report as a single HTML file, and as Markdown that is readable as text."""

import base64
import hashlib
import re
import unicodedata
from collections.abc import Iterable
from functools import cache, partial
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from rich.cells import cell_len

from ..plots import Kind, encode
from .bytecode import KeptTemplates
from .document import Bullets, Page, Paragraph, Picture, ReportTable

# Markdown's special characters. Brackets count only if a link could follow, and underscores only at
# the edge of a word: units and file names are full of them.
SPECIAL = re.compile(r"[\\`*<|~$]|\](?=[(\[:])|(?<![^\W_])_|_(?![^\W_])")
# The start of a line that would become a list, heading, quotation or rule.
LEADING = re.compile(r"^(\d*)(>|[-+.)=#](?=[\s=#>-]|$))")
OPTION = re.compile(r"(?<![\w!-])--[a-z][a-z-]*")


def escape_markdown(text: str) -> str:
    """Text that no Markdown reader takes as markup, on one line.

    >>> print(escape_markdown("a_b.csv [mV] | *c*"))
    a_b.csv [mV] \\| \\*c\\*
    """
    escaped = SPECIAL.sub(r"\\\g<0>", " ".join(text.split())).replace("&", "&amp;")
    return LEADING.sub(r"\1\\\2", escaped)


def table_lines(table: ReportTable) -> str:
    """A table whose columns are aligned in the source too."""
    columns = []
    for index, column in enumerate(table.columns):
        cells = [escape_markdown(row[index]) for row in table.rows]
        best = [(number, index) in table.best for number in range(len(cells))]
        cells = [f"**{cell}**" if bold else cell for cell, bold in zip(cells, best, strict=True)]
        head, is_number = escape_markdown(column.head), column.role == "number"
        width = max(3, cell_len(head), *map(cell_len, cells))
        rule = "-" * (width - is_number) + ":" * is_number
        blanks = [(cell, " " * (width - cell_len(cell))) for cell in (head, rule, *cells)]
        columns.append([blank + cell if is_number else cell + blank for cell, blank in blanks])
    return "\n".join(f"| {' | '.join(line)} |" for line in zip(*columns, strict=True))


BLOCKS = (Paragraph, Bullets, ReportTable, Picture)
# Resolution of the rasterized parts of a vector figure.
PAPER_DPI = 600
MEDIA_TYPES = {".png": "image/png", ".svg": "image/svg+xml"}
# Invisible letters, and those that reverse the text: file names may contain them.
UNSEEN = {"Cc", "Cf", "Cs"}


def to_html(document: Page) -> str:
    """One file that needs no other file and no network, and is complete without scripts.

    If a picture has a live form, the page has one script, which its policy allows by hash.

    >>> "<h1>A &lt; B</h1>" in to_html(Page("A < B", "", ()))
    True
    """
    script, allowed = "", ""
    if any(picture.live for picture in document.pictures):
        script = _script()
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        allowed = f"; script-src 'sha256-{digest}'"
    template = _templates(for_html=True).get_template("report.html")
    return template.render(document=document, script=script, allowed=allowed)


@cache
def _script() -> str:
    """uPlot, and the code that draws the report's figures with it."""
    templates = _templates(for_html=True)
    assert templates.loader is not None
    names = ("uPlot.iife.min.js", "report.js")
    return "\n".join(templates.loader.get_source(templates, name)[0] for name in names)


def to_markdown(document: Page) -> str:
    """The document as GitHub's Markdown; its images are expected in the folder figures.

    They are the document's `pictures`, each under its name and suffix.
    """
    template = _templates(for_html=False).get_template("report.md")
    return template.render(document=document).rstrip("\n") + "\n"


def to_fragment(document: Page) -> str:
    """The document as HTML without a head or style, for a notebook."""
    return _templates(for_html=True).get_template("fragment.html").render(document=document)


def paper_files(drawn: Iterable[Picture]) -> dict[str, bytes]:
    """Figures drawn within `column_width`, as PDF and SVG by their paths in the results folder."""
    kinds: tuple[Kind, ...] = ("pdf", "svg")
    return {
        f"figures/paper/{picture.name}.{kind}": encode(picture.figure, kind, PAPER_DPI)
        for picture in drawn
        for kind in kinds
    }


@cache
def _templates(for_html: bool) -> Environment:
    templates = Environment(
        loader=PackageLoader("barnax.reporting"),
        autoescape=for_html,
        undefined=StrictUndefined,
        finalize=_seen,
        bytecode_cache=KeptTemplates(),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    templates.tests |= {kind.__name__.lower(): partial(_is, kind=kind) for kind in BLOCKS}
    templates.filters |= {
        "data_uri": _data_uri,
        "breakable": _breakable,
        "options_whole": _with_options_whole,
        "md": escape_markdown,
        "md_table": table_lines,
    }
    return templates


def _breakable(text: str) -> Markup:
    """The text as HTML; a long file name may break after dots, dashes and underscores."""
    return Markup(re.sub(r"(?<=\w{4}[._-])(?=\w)", "<wbr>", str(escape(_seen(text)))))


def _with_options_whole(text: str) -> Markup:
    """The text as HTML, without line breaks inside an option such as --current-hold."""
    return Markup(OPTION.sub(r'<span class="option">\g<0></span>', str(escape(_seen(text)))))


def _is(block: Any, kind: type) -> bool:
    return isinstance(block, kind)


def _data_uri(picture: Picture) -> str:
    return f"data:{MEDIA_TYPES[picture.suffix]};base64,{base64.b64encode(picture.content).decode()}"


def _seen(value: Any) -> Any:
    """A text without letters that cannot be seen or stored; line ends remain."""
    if not isinstance(value, str) or value.isprintable():
        return value
    cleaned = "".join(
        "\N{REPLACEMENT CHARACTER}"
        if unicodedata.category(letter) in UNSEEN and letter not in "\n\t"
        else letter
        for letter in value
    )
    # Keeps the class, because `Markup` is safe already.
    return type(value)(cleaned)
