"""Words from templates: macros as sentences, and templates as whole documents.

A template of `templates/words` makes lines whose beginning says what they are:

    = the title of a document     # a section     - a sentence of a list     ! a warning of a list
    : a sentence with its head    & a pattern of figures' names, each shown where it first matches
    ^ the caption of a table      ~ no caption, and no line below the heads
    | heads, a rule and rows, as in a Markdown table: `---:` is the rule of numbers, `:--` of a
      column that stays next to the previous one

Anything else is a paragraph, before the first section the summary.

A line that begins with a space continues the one above, and blank lines are ignored. A value is on
one line and in one cell, whatever it contains, so that a file's name is no markup; only `| lines`
inserts the lines of a macro. Functions of `words.py` are filters and functions of every template.
"""

from collections.abc import Iterable, Iterator, Sequence
from fnmatch import fnmatchcase
from functools import cache
from inspect import isfunction
from itertools import groupby
from operator import itemgetter
from statistics import median
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from ..cell import dependence
from ..cell.elements import alike
from ..cell.parameters import OCV
from ..cell.soc_axis import ABOVE_SOC
from ..notices import sentences_of
from ..settings import MAX_MOVED_SOC
from . import words
from .bytecode import KeptTemplates
from .document import (
    Block,
    Bullets,
    Entries,
    Page,
    Paragraph,
    Picture,
    ReportTable,
    Role,
    Section,
    column,
    parameter_heads,
)

MARKS = "=#-!:&^~|"
# Stands for a bar in a value, which does not end the cell.
BAR = "\ue001"
# The type of a column by its rule.
RULES: dict[str, Role] = {"---": "text", "---:": "number", ":--": "text", ":--:": "number"}
# Constants of the numerics in sentences, by name.
CONSTANTS = {
    "ABOVE_SOC": ABOVE_SOC,
    "MAX_MOVED_SOC": MAX_MOVED_SOC,
    "NOTHING": words.NOTHING,
    "OCV": OCV,
}
CONSTANTS |= {name: getattr(dependence, name) for name in ("BETA", "KAPPA", "ONSET", "CHARGE")}
# Thresholds for a sentence: low SOC with most of the squared error, a band with a notable share of
# it, and an adjustment of a start, or an SOC beyond the ends, larger than negligible.
CONSTANTS |= {"MOST": 0.5, "NOTABLE": 0.2, "MOVED_SOC": 5e-5, "BEYOND_SOC": 0.005}
# A smaller relative adjustment of a start or a capacity changes no answer.
CONSTANTS |= {"HARDLY_MOVED": 1e-3}
# A 95 % band that covers less often is overconfident; a flat OCV at fewer samples does not matter.
CONSTANTS |= {"TRUSTED_BAND": 0.9, "FLAT_SHARE": 0.05}
# Resistances differ notably if the cell is this much warmer.
CONSTANTS |= {"WARM_K": 10.0}
CONSTANTS |= {"SAME": words.SAME}
# Moving a start is worth a line if it lowers the error by more than this share.
CONSTANTS |= {"APART": 0.1}


class Made(str):
    """Lines that a macro made."""

    __slots__ = ()


def document(template: str, pictures: Iterable[Picture] = (), **facts: Any) -> Page:
    """The document that a template makes of facts; `pictures` are those available to it.

    A section without blocks is left out. Raises jinja2's `UndefinedError` for missing facts.
    """
    return _document(_template(template).render(**facts), pictures)


def _document(text: str, pictures: Iterable[Picture] = ()) -> Page:
    title, summary, left = "", "", list(pictures)
    sections: list[tuple[str, list[Block]]] = []
    caption, is_bare = "", False
    for mark, group in groupby(_items(text), itemgetter(0)):
        texts = [text for _, text in group]
        if mark == "=":
            title = texts[0]
        elif mark == "#":
            sections += [(text, []) for text in texts]
        elif not sections:
            summary = " ".join(texts)
        elif mark == "&":
            placed = [one for one in left if any(fnmatchcase(one.name, each) for each in texts)]
            sections[-1][1].extend(placed)
            left = [one for one in left if one not in placed]
        elif mark in ("^", "~"):
            caption, is_bare = texts[-1], mark == "~"
        elif mark == "|":
            sections[-1][1].append(_table(caption, texts, is_bare))
        elif mark == "":
            sections[-1][1].extend(map(Paragraph, texts))
        else:
            items = tuple(texts)
            sections[-1][1].append(Entries(items) if mark == ":" else Bullets(items, mark == "!"))
    filled = (Section(name, tuple(parts)) for name, parts in sections if parts)
    return Page(title, summary, tuple(filled))


def _table(caption: str, lines: Sequence[str], is_bare: bool) -> ReportTable:
    heads, rule, *rows = ([cell.strip() for cell in line.split("|")[:-1]] for line in lines)
    best = frozenset(
        (number, index)
        for number, row in enumerate(rows)
        for index, cell in enumerate(row)
        if cell.startswith("**")
    )
    cells = tuple(tuple(cell.strip("*").replace(BAR, "|") for cell in row) for row in rows)
    columns = (column(*one) for one in zip(heads, map(RULES.__getitem__, rule), strict=True))
    joined = frozenset(index for index, one in enumerate(rule) if one.startswith(":"))
    return ReportTable(caption, tuple(columns), cells, best, joined, is_bare)


def rendered(template: str, **facts: Any) -> str:
    """The text of a template as it is."""
    return _template(template).render(**facts).replace(BAR, "|")


def _macro(name: str, facts: Sequence[Any]) -> str:
    """The text of a macro, such as "starts.adjusted" of `starts.txt`."""
    template, _, macro = name.partition(".")
    return getattr(_template(template).module, macro)(*facts)


def blocks(name: str, *facts: Any) -> tuple[Block, ...]:
    """The blocks of a macro, such as its tables."""
    return tuple(
        block for part in _document(f"#\n{_macro(name, facts)}").sections for block in part.blocks
    )


def table(name: str, *facts: Any) -> ReportTable:
    """The one table of a macro."""
    (one,) = blocks(name, *facts)
    assert isinstance(one, ReportTable), f"{name} makes a table"
    return one


def sentences(name: str, *facts: Any) -> tuple[str, ...]:
    """The sentences of a macro."""
    return tuple(text for _, text in _items(_macro(name, facts)))


def wording(name: str, *facts: Any) -> str:
    """The text of a macro in one line."""
    return _on_one_line(_macro(name, facts)).strip().replace(BAR, "|")


def _items(text: str) -> Iterator[tuple[str, str]]:
    """The kinds of lines, by their first characters, and their texts."""
    items: list[tuple[str, list[str]]] = []
    for line in filter(str.strip, text.split("\n")):
        if line.startswith(" ") and items:
            items[-1][1].append(line.strip())
        elif line[0] in MARKS and line[1:2] in (" ", ""):
            items.append((line[0], [line[2:].strip()]))
        else:
            items.append(("", [line.strip()]))
    for mark, texts in items:
        whole = " ".join(filter(None, texts))
        yield mark, whole if mark == "|" else whole.replace(BAR, "|")


def _on_one_line(text: str) -> str:
    return " ".join(filter(None, map(str.strip, text.split("\n")))) if "\n" in text else text


def _in_one_cell(value: Any) -> Any:
    is_text = isinstance(value, str) and not isinstance(value, Made)
    return _on_one_line(value).replace("|", BAR) if is_text else value


def _headed(text: str, head: str) -> Made:
    """The sentences of a macro, each with its head."""
    return Made("\n".join(f": {head}: {sentence}" for _, sentence in _items(text)))


@cache
def _template(name: str) -> Any:
    return _templates().get_template(f"{name}.txt")


@cache
def _templates() -> Environment:
    templates = Environment(
        loader=PackageLoader("barnax.reporting", "templates/words"),
        undefined=StrictUndefined,
        finalize=_in_one_cell,
        bytecode_cache=KeptTemplates(),
    )
    functions = {name: value for name, value in vars(words).items() if isfunction(value)}
    functions |= {"median": median, "alike": alike, "parameter_heads": parameter_heads}
    templates.filters |= {
        **functions,
        "lines": Made,
        "headed": _headed,
        "sentences_of": sentences_of,
    }
    templates.globals.update({**functions, **CONSTANTS})  # pyrefly: ignore
    return templates
