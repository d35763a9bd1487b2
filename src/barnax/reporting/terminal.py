"""Output for a terminal: any document in full."""

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.measure import Measurement
from rich.padding import Padding
from rich.table import Table as Shown
from rich.text import Text

from ..errors import printable
from .document import Block, Bullets, Column, Document, Lines, Paragraph, Table

# The looks of tables with a line below the heads, and of those without.
LINED: dict[str, Any] = {"box": box.SIMPLE_HEAD, "header_style": "cyan"}
BARE: dict[str, Any] = {"box": None}
# What stays on one line, options with their values, and the character that keeps it there.
ONE_OPTION = r"--[a-z][\w-]*(?: (?!--)(?:'[^']*'|[^\s']+))?"
# Intervals too, with their units where each end has its own.
INTERVAL = r"(?<![^ (])[-\d.]+ (?:[A-Za-z]+ )?to [-\d.]+(?: (?:[mu]?Ohm|s|min|h|d)\b)?"
ONE_END = r"at (?:most|least) [-\d.]+(?: (?:[mu]?Ohm|s|min|h|d)\b)?"
UNBROKEN = re.compile(f"{ONE_OPTION}(?: {ONE_OPTION})*|{INTERVAL}|{ONE_END}|not determined")
GLUE = "\ue000"
# Longer words, such as file names, may be broken: behind a dot, dash or underscore where one is.
LONGEST_WORD = 24
SEPARATED = re.compile(r"(?<=\w[._-])(?=\w)")

# Width of text that is shown outside a terminal.
TEXT_WIDTH = 110


def to_terminal(document: Document) -> Iterator[RenderableType]:
    """A document with its tables, without its pictures; what has no title is indented."""
    for section in document.sections:
        yield plain(f"\n{section.title}", style="bold cyan") if section.title else Text()
        for block in section.blocks:
            for shown in _renderables(block):
                yield shown if section.title else indented(shown)


def _renderables(block: Block) -> Iterator[RenderableType]:
    if isinstance(block, Paragraph):
        yield plain(block.text)
    elif isinstance(block, Bullets):
        style = "yellow" if block.are_warnings else ""
        for item in block.items:
            yield headed_line("-", item, width=2, style=style)
    elif isinstance(block, Lines):
        for item in block.items:
            head, _, text = item.partition(": ")
            yield headed_line(head, text)
    elif isinstance(block, Table):
        yield terminal_table(block)


def to_text(document: Document) -> str:
    """The same as plain text."""
    console = Console(width=TEXT_WIDTH, color_system=None)
    drawn = console.render(Group(*to_terminal(document)))
    text = "".join(segment.text for segment in drawn if not segment.control)
    return "\n".join(line.rstrip() for line in text.strip().splitlines())


@dataclass(frozen=True)
class Words:
    """A text without markup, and without what a terminal would obey; its lines stay, and options
    with their values stay in one line, so that they can be copied, and so do intervals."""

    plain: str
    style: str = ""

    @property
    def glued(self) -> Text:
        return Text(UNBROKEN.sub(lambda match: match[0].replace(" ", GLUE), self.plain), self.style)

    @property
    def widest(self) -> int:
        """The width of its longest line."""
        return max(map(cell_len, self.plain.split("\n")))

    @property
    def longest(self) -> int:
        """The width below which it would be cut."""
        words = self.glued.plain.split()
        return max(
            (width if GLUE in word else min(width, LONGEST_WORD))
            for word in (*words, "")
            for width in [cell_len(word)]
        )

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        width = max(options.max_width, self.longest)
        glued = self.glued
        glued.plain = re.sub(
            rf"\S{{{width + 1},}}", lambda word: _broken(word[0], width), glued.plain
        )
        lines = glued.wrap(console, width, justify=options.justify, overflow=options.overflow)
        text = Text("\n").join(lines)
        text.plain = text.plain.replace(GLUE, " ")
        yield from text.render(console, end="\n")

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        return Measurement.get(console, options, self.glued)


def _broken(word: str, width: int) -> str:
    """A word that is longer than a line on several."""
    lines = [""]
    for part in SEPARATED.split(word):
        if lines[-1] and len(lines[-1] + part) > width:
            lines.append("")
        lines[-1] += part
    return "\n".join(lines)


def plain(text: str, style: str = "") -> Words:
    """A text as a terminal shows it."""
    return Words("\n".join(map(printable, text.split("\n"))), style)


class Whole:
    """A table of which no character is ever cut, however narrow the terminal.

    Texts go on in the next line. Where numbers are wider than the terminal all the same, the
    further columns stand below, beside the first one again.
    """

    def __init__(self, table: Table):
        self.table = table
        # A line between columns is as wide as a space.
        self.pad, self.lines = (2, 0) if table.is_bare else (1, 1)
        self.heads = [_head(column, table.is_bare) for column in table.columns]
        self.rows = [
            [
                plain(cell, style="bold" if (number, index) in table.best else "")
                for index, cell in enumerate(row)
            ]
            for number, row in enumerate(table.rows)
        ]
        columns = [*zip(self.heads, *self.rows, strict=True)]
        # The widths that columns have room in, and those below which they would be cut.
        self.most = [max(text.widest for text in column) for column in columns]
        self.least = [
            most if self._is_number(number) else max(text.longest for text in columns[number])
            for number, most in enumerate(self.most)
        ]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        pad, parts = self.pad, self._parts(options.max_width, self.pad)
        if self.lines and len(closer := self._parts(options.max_width, 0)) < len(parts):
            pad, parts = 0, closer
        for places in parts:
            yield self._part(places, options.max_width, pad)

    def _is_number(self, index: int) -> bool:
        return self.table.columns[index].role == "number"

    def _width(self, widths: Collection[int], pad: int) -> int:
        """The width of columns with everything between and beside them."""
        return sum(widths) + (pad + self.lines) * len(widths) - pad + self.lines

    def _parts(self, width: int, pad: int) -> list[list[int]]:
        """The columns that stand beside each other, each time after the first."""
        count = len(self.heads)
        firsts = [index for index in range(1, count) if index not in self.table.joined]
        parts: list[list[int]] = [[0]]
        for first, following in pairwise([*firsts, count]):
            group = [*range(first, following)]
            wanted = [*parts[-1], *group]
            taken = self._width([self.least[index] for index in wanted], pad)
            if len(parts[-1]) > 1 and taken > width:
                parts.append([0, *group])
            else:
                parts[-1] = wanted
        return parts

    def _part(self, places: list[int], width: int, pad: int) -> Shown:
        widths = {index: self.most[index] for index in places}
        while self._width(widths.values(), pad) > width:
            loose = [index for index in places if widths[index] > self.least[index]]
            if not loose:
                break
            widths[max(loose, key=widths.__getitem__)] -= 1
        has_heads = any(head.plain for head in self.heads)
        layout = BARE if self.table.is_bare else LINED
        part = Shown(show_header=has_heads, padding=(0, pad, 0, 0), pad_edge=False, **layout)
        for index in places:
            justify = "right" if self._is_number(index) else "left"
            width = widths[index]
            part.add_column(self.heads[index], justify=justify, overflow="fold", width=width)
        for row in self.rows:
            cells = [row[index] for index in places]
            # Of a part below there is nothing to say of some rows.
            if places[:2] == [0, 1] or any(cell.plain for cell in cells[1:]):
                part.add_row(*cells)
        return part


def _head(column: Column, is_bare: bool) -> Words:
    if is_bare:
        return plain(column.head)
    name = column.name
    if column.role == "number":
        # Narrow, so that names fit beside seven numbers in 80 columns; "95 %" is one word.
        name = re.sub(r"(?<!\d) ", "\n", column.name.replace("-", "-\n"))
    return plain(f"{name}\n[{column.unit}]" if column.unit else name)


def terminal_table(table: Table) -> RenderableType:
    """A document's table as a terminal shows it, its caption as wide as the terminal."""
    whole = Whole(table)
    return Group(whole, plain(table.caption, style="italic dim")) if table.caption else whole


def indented(block: RenderableType) -> RenderableType:
    return Padding(block, (0, 0, 0, 2))


def headed_line(head: str, text: str, width: int = 15, style: str = "") -> RenderableType:
    """A head and its text, which goes on below itself."""
    grid = Shown.grid(padding=(0, 1, 0, 0))
    grid.add_column(width=width, no_wrap=True)
    grid.add_column(overflow="fold")
    label = head if head in ("-", "") else f"{head}:"
    grid.add_row(Text(label, style="bold"), plain(text, style=style))
    return grid


def next_lines(advice: str, command: str) -> Iterator[RenderableType]:
    """The next step, and its command in one line however long, so that it can be copied."""
    yield indented(headed_line("Next", f"{advice}:" if command else advice))
    if command:
        yield Text(f"    {printable(command)}", no_wrap=True)
