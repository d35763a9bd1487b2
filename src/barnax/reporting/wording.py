"""Words from templates: macros as sentences, and templates as whole documents.

A template of `templates/words` makes lines, and how a line begins says what it is:

    = the title of a document     # a section     - a sentence of a list     ! a warning of a list
    @ the name of ready blocks    & a pattern of figures' names, each where it is first asked for

and anything else a paragraph, before any section the summary.

A line that begins with a space goes on with the one above, and blank lines are nothing. A value is
on one line, whatever it holds, so that a file's name is no markup; only `| lines` puts in the lines
of a macro. Words of `words.py` are filters and functions of every template.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
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
from ..cell.soc_axis import ABOVE_SOC
from ..notices import sentences_of
from ..settings import MAX_MOVED_SOC
from . import words
from .document import Block, Bullets, Document, Paragraph, Picture, Section

MARKS = "=#-!@&"
# What sentences say of the numerics, by name.
CONSTANTS = {"ABOVE_SOC": ABOVE_SOC, "MAX_MOVED_SOC": MAX_MOVED_SOC}
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
# Errors within this share of each other are called the same, and circuits nearly as good.
CONSTANTS |= {"SAME": 0.01}


class Lines(str):
    """Lines that a macro made."""

    __slots__ = ()


def document(
    template: str,
    blocks: Mapping[str, Sequence[Block]] | None = None,
    pictures: Iterable[Picture] = (),
    **facts: Any,
) -> Document:
    """The document that a template makes of facts; `blocks` are those that it names after an @,
    `pictures` those that it asks for after an &.

    A section without blocks is left out. Raises `KeyError` for blocks that are not given, and
    jinja2's `UndefinedError` for facts.
    """
    title, summary, left = "", "", list(pictures)
    sections: list[tuple[str, list[Block]]] = []
    for mark, group in groupby(_items(rendered(template, **facts)), itemgetter(0)):
        texts = [text for _, text in group]
        if mark == "=":
            title = texts[0]
        elif mark == "#":
            sections += [(text, []) for text in texts]
        elif not sections:
            summary = " ".join(texts)
        elif mark == "@":
            for name in texts:
                sections[-1][1].extend((blocks or {})[name])
        elif mark == "&":
            placed = [one for one in left if any(fnmatchcase(one.name, each) for each in texts)]
            sections[-1][1].extend(placed)
            left = [one for one in left if one not in placed]
        elif mark == "":
            sections[-1][1].extend(map(Paragraph, texts))
        else:
            sections[-1][1].append(Bullets(tuple(texts), are_warnings=mark == "!"))
    filled = (Section(name, tuple(parts)) for name, parts in sections if parts)
    return Document(title, summary, tuple(filled))


def rendered(template: str, **facts: Any) -> str:
    """The text of a template as it stands."""
    return _template(template).render(**facts)


def sentences(name: str, *facts: Any) -> tuple[str, ...]:
    """The sentences of a macro, such as "starts.adjusted" of `starts.txt`."""
    template, _, macro = name.partition(".")
    made = getattr(_template(template).module, macro)(*facts)
    return tuple(text for _, text in _items(made))


def wording(name: str, *facts: Any) -> str:
    """The same in one line."""
    template, _, macro = name.partition(".")
    return _on_one_line(getattr(_template(template).module, macro)(*facts)).strip()


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
    return ((mark, " ".join(filter(None, texts))) for mark, texts in items)


def _on_one_line(value: Any) -> Any:
    if isinstance(value, Lines) or not isinstance(value, str) or "\n" not in value:
        return value
    return " ".join(filter(None, map(str.strip, value.split("\n"))))


@cache
def _template(name: str) -> Any:
    return _templates().get_template(f"{name}.txt")


@cache
def _templates() -> Environment:
    templates = Environment(
        loader=PackageLoader("barnax.reporting", "templates/words"),
        undefined=StrictUndefined,
        finalize=_on_one_line,
    )
    functions = {name: value for name, value in vars(words).items() if isfunction(value)}
    functions |= {"median": median, "alike": alike}
    templates.filters |= {**functions, "lines": Lines, "sentences_of": sentences_of}
    templates.globals.update({**functions, **CONSTANTS})  # pyrefly: ignore
    return templates
