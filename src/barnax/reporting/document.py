"""A report before it is HTML or Markdown, and tables common to several reports."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import chain, takewhile
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Role = Literal["text", "number"]
# Sharp on a phone and in print, and small enough to send.
PICTURE_DPI = 180


@dataclass(frozen=True)
class Paragraph:
    """Sentences in one block."""

    text: str


@dataclass(frozen=True)
class Bullets:
    """Sentences one below the other; warnings are marked."""

    items: tuple[str, ...]
    are_warnings: bool = False


@dataclass(frozen=True)
class Entries:
    """Sentences that begin with a head and a colon, each next to its head."""

    items: tuple[str, ...]


@dataclass(frozen=True)
class Head:
    """A column's head, its unit if it has one, and whether it contains numbers."""

    name: str
    unit: str = ""
    role: Role = "number"

    @property
    def head(self) -> str:
        return f"{self.name} [{self.unit}]" if self.unit else self.name


def column(head: str, role: Role) -> Head:
    """The column of a head such as "R0 [mOhm]"."""
    name, _, unit = head.partition(" [")
    return Head(name, unit.removesuffix("]"), role)


@dataclass(frozen=True)
class ReportTable:
    """Rows under columns.

    `best` are the cells (row, column) to be emphasized, `joined` the columns that stay next to the
    previous one; with `is_bare` a terminal shows no line below the heads.

    Raises `ValueError` if a row does not have a cell for every column.
    """

    caption: str
    columns: tuple[Head, ...]
    rows: tuple[tuple[str, ...], ...]
    best: frozenset[tuple[int, int]] = frozenset()
    joined: frozenset[int] = frozenset()
    is_bare: bool = False

    def __post_init__(self):
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"a row of {len(row)} cells under {len(self.columns)} columns")


def parameter_heads(circuits: Mapping[str, Mapping[str, float]]) -> list[str]:
    """The heads of all parameters of circuits: R0, R1, C1, tau1, R2, ...: pair by pair, then those
    without a pair."""

    def order(head: str) -> tuple[str, int]:
        symbol = head.split()[0]
        kinds = ("R", "C", "tau")
        kind = "".join(takewhile(str.isalpha, symbol))
        number = symbol[len(kind) :]
        return (number or "9", kinds.index(kind) if kind in kinds else len(kinds))

    return sorted(dict.fromkeys(chain.from_iterable(circuits.values())), key=order)


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure, drawn on first use, with what a page and a file need of it.

    Each form is drawn once.

    Attributes:
        name: Its file's name without a suffix.
        draw: What draws it.
        caption: Its caption.
        alt: Words for who cannot see it.
        is_dense: It holds so many points that PNG is the smaller form.
        is_main: It is written beside a result even where no report is.
        live: Gives the numbers of an interactive form, which a page with scripts shows in its
            place, and its caption.
    """

    name: str
    draw: "Callable[[], Figure]"
    caption: str
    alt: str
    is_dense: bool = True
    is_main: bool = False
    live: Callable[[], tuple[dict[str, Any], str]] | None = None

    @cached_property
    def figure(self) -> "Figure":
        return self.draw()

    @cached_property
    def png(self) -> bytes:
        return _encoded(self.figure, "png")

    @cached_property
    def svg(self) -> bytes:
        return _encoded(self.figure, "svg")

    @property
    def suffix(self) -> str:
        """The suffix of the smaller form's file."""
        return ".png" if self.is_dense else ".svg"

    @cached_property
    def content(self) -> bytes:
        """The smaller form; PNG with 256 colors has a third of the bytes."""
        if not self.is_dense:
            return self.svg
        from ..plots import with_few_colors

        return with_few_colors(self.png)


def _encoded(figure: "Figure", kind: Literal["png", "svg"]) -> bytes:
    # Loads matplotlib, which a check of files does not need.
    from ..plots import encode

    return encode(figure, kind, PICTURE_DPI)


Block = Paragraph | Bullets | Entries | ReportTable | Picture


@dataclass(frozen=True)
class Section:
    """Blocks under a title."""

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Page:
    """A whole report; `summary` precedes its sections if none of them is a verdict."""

    title: str
    summary: str
    sections: tuple[Section, ...]

    def with_option_names(self, named: Callable[[str], str]) -> "Page":
        """The document with all its texts as `named` renders them, which spells the options."""
        return _renamed(self, named)

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All figures, in order."""
        blocks = (block for section in self.sections for block in section.blocks)
        return tuple(block for block in blocks if isinstance(block, Picture))


def screen(*groups: Iterable[Block]) -> Page:
    """Groups of blocks without titles, which a terminal indents, each after a blank line."""
    return Page("", "", tuple(Section("", tuple(blocks)) for blocks in groups))


def _renamed(value: Any, named: Callable[[str], str]) -> Any:
    if isinstance(value, str):
        return named(value)
    if isinstance(value, tuple):
        return tuple(_renamed(item, named) for item in value)
    if isinstance(value, Page | Section | Paragraph | Bullets | Entries | ReportTable):
        changed = {
            field.name: _renamed(getattr(value, field.name), named)
            for field in fields(value)
            if field.name not in ("columns", "best", "are_warnings")
        }
        return replace(value, **changed)
    return value
