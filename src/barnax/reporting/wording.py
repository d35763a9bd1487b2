"""Words from templates: macros as sentences, and templates as whole documents.

A template of `templates/words` makes lines, and how a line begins says what it is:

    = the title of a document     # a section     - a sentence of a list     ! a warning of a list
    : a sentence with its head    & a pattern of figures' names, each where it is first asked for
    ^ the caption of a table      ~ no caption, and no line below the heads
    | heads, a rule and rows, as Markdown writes a table: `---:` is the rule of numbers, `:--` that
      of a column that stays beside the one before it

and anything else a paragraph, before any section the summary.

A line that begins with a space goes on with the one above, and blank lines are nothing. A value is
on one line and in one cell, whatever it holds, so that a file's name is no markup; only `| lines`
puts in the lines of a macro. Words of `words.py` are filters and functions of every template.
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
# Stands for a bar in a value, which ends no cell.
BAR = "\ue001"
# What a column holds by its rule.
RULES: dict[str, Role] = {"---": "text", "---:": "number", ":--": "text", ":--:": "number"}
# What sentences say of the numerics, by name.
CONSTANTS = {
    "ABOVE_SOC": ABOVE_SOC,
    "MAX_MOVED_SOC": MAX_MOVED_SOC,
    "NOTHING": words.NOTHING,
    "OCV": OCV,
}
CONSTANTS |= {name: getattr(dependence, name) for name in ("BETA", "KAPPA", "ONSET", "CHARGE")}
# What is worth a sentence: low SOC with most of the squared error, a band with a notable share of
# it, and a start that was moved, or an SOC beyond the ends, by more than what nobody asks about.
CONSTANTS |= {"MOST": 0.5, "NOTABLE": 0.2, "MOVED_SOC": 5e-5, "BEYOND_SOC": 0.005}
# A start or a capacity that was adjusted by less, as a share, changes no answer.
CONSTANTS |= {"HARDLY_MOVED": 1e-3}
# A 95 % band that holds less often is overconfident; a flat OCV at fewer samples is no matter.
CONSTANTS |= {"TRUSTED_BAND": 0.9, "FLAT_SHARE": 0.05}
# By so much warmer, the resistances of a cell are others.
CONSTANTS |= {"WARM_K": 10.0}
CONSTANTS |= {"SAME": words.SAME}
# Moving a start is worth a line where it lowers the error by more than this share.
CONSTANTS |= {"APART": 0.1}


class Made(str):
    """Lines that a macro made."""

    __slots__ = ()


def document(template: str, pictures: Iterable[Picture] = (), **facts: Any) -> Page:
    """The document that a template makes of facts; `pictures` are those that it asks for.

    A section without blocks is left out. Raises jinja2's `UndefinedError` for facts that are not
    given.
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
    """The text of a template as it stands."""
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
    """The same in one line."""
    return _on_one_line(_macro(name, facts)).strip().replace(BAR, "|")


def _items(text: str) -> Iterator[tuple[str, str]]:
    """What lines are, by the mark they begin with, and their texts."""
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
