"""Output for a terminal: any document in full, in lines of its width."""

import re
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from rich import box
from rich.cells import cell_len, chop_cells
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.padding import Padding
from rich.table import Table as Shown
from rich.text import Text

from ..errors import printable
from .document import Block, Bullets, Entries, Head, Page, Paragraph, ReportTable

# The styles of tables with a line below the heads, and without.
LINED: dict[str, Any] = {"box": box.SIMPLE_HEAD, "header_style": "cyan"}
BARE: dict[str, Any] = {"box": None}
# Text that stays on one line: options with their values, and the character that keeps it there.
ONE_OPTION = r"--[a-z][\w-]*(?: (?!--)(?:'[^']*'|[^\s']+))?"
# Also intervals, with a unit at each end.
INTERVAL = r"(?<![^ (])[-\d.]+ (?:[A-Za-z]+ )?to [-\d.]+(?: (?:[mu]?Ohm|s|min|h|d)\b)?"
ONE_END = r"at (?:most|least) [-\d.]+(?: (?:[mu]?Ohm|s|min|h|d)\b)?"
UNBROKEN = re.compile(f"{ONE_OPTION}(?: {ONE_OPTION})*|{INTERVAL}|{ONE_END}|not determined")
GLUE = "\ue000"
# Longer words, such as file names, may be broken: after a dot, dash or underscore if there is one.
LONGEST_WORD = 24
# Text to be copied is broken if it is wider than most terminals.
LONGEST_GLUED = 60
SEPARATED = re.compile(r"(?<=\w[._-])(?=\w)")

# Width of text that is shown outside a terminal.
TEXT_WIDTH = 110


@dataclass(frozen=True)
class Screen:
    """Lines and tables for any width, laid out when a console shows them."""

    parts: Callable[[int], Iterator[RenderableType]]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield from self.parts(options.max_width)


def to_terminal(document: Page) -> Screen:
    """A document with its tables, without its pictures; without a title it is indented."""

    def parts(width: int) -> Iterator[RenderableType]:
        for section in document.sections:
            yield whole_line("")
            yield from (whole_line(line, "bold cyan") for line in _wrapped(section.title, width))
            indent = 0 if section.title else 2
            for block in section.blocks:
                for part in _parts(block, width - indent):
                    yield Padding(part, (0, 0, 0, 2), expand=False) if indent else part

    return Screen(parts)


def terminal_table(table: ReportTable) -> Screen:
    """A document's table for a terminal, with its caption as wide as the terminal."""
    return Screen(lambda width: _parts(table, width))


def to_text(document: Page) -> str:
    """The same as plain text."""
    drawn = Console(width=TEXT_WIDTH, color_system=None).render(to_terminal(document))
    text = "".join(segment.text for segment in drawn if not segment.control)
    return "\n".join(line.rstrip() for line in text.strip().splitlines())


def whole_line(text: str, style: str = "") -> Text:
    """A line that is neither broken nor cut, so that it can be copied."""
    return Text(printable(text), style, no_wrap=True, overflow="ignore")


def headed(head: str, text: str, width: int, indent: int = 16, style: str = "") -> Iterator[Text]:
    """The lines of a text after its head."""
    for line in _wrapped(text, width - indent):
        yield whole_line(f"{head:{indent}}", "bold").append(line, style or "not bold")
        head = ""


def next_step(advice: str, command: str) -> Screen:
    """The next step, and its command in one line however long."""

    def parts(width: int) -> Iterator[RenderableType]:
        for line in headed("Next:", f"{advice}:" if command else advice, width - 2):
            yield Padding(line, (0, 0, 0, 2), expand=False)
        if command:
            yield whole_line(f"    {command}")

    return Screen(parts)


def _parts(block: Block, width: int) -> Iterator[RenderableType]:
    if isinstance(block, Paragraph):
        yield from map(whole_line, _wrapped(block.text, width))
    elif isinstance(block, Bullets):
        for item in block.items:
            yield from headed("-", item, width, 3, "not bold yellow" * block.are_warnings)
    elif isinstance(block, Entries):
        for item in block.items:
            head, _, text = item.partition(": ")
            yield from headed(head and f"{head}:", text, width)
    elif isinstance(block, ReportTable):
        yield from _Whole(block).parts(width)
        yield from (whole_line(line, "italic dim") for line in _wrapped(block.caption, width))


def _glued(text: str) -> str:
    """The text without control characters, and with each unit that stays on one line as one
    word."""
    lines = "\n".join(map(printable, text.split("\n")))
    return UNBROKEN.sub(lambda match: match[0].replace(" ", GLUE), lines)


def _least_width(text: str) -> int:
    """The width below which a text would be cut."""
    words = [(word, cell_len(word)) for word in _glued(text).split()]
    widths = (min(width, LONGEST_GLUED if GLUE in word else LONGEST_WORD) for word, width in words)
    return max(widths, default=0)


def _wrapped(text: str, width: int) -> list[str]:
    """The lines of a text, none if it is empty: options with their values stay on one line, so that
    they can be copied, and so do intervals."""
    width, lines = max(width, _least_width(text)), list[str]()
    for line in _glued(text).split("\n") if text else ():
        lines.append("")
        for word in re.findall(r"\s*\S+", line):
            parts = SEPARATED.split(word) if cell_len(word.lstrip()) > width else [word]
            for part in parts:
                if lines[-1] and cell_len(lines[-1] + part) > width:
                    lines.append("")
                    part = part.lstrip()
                lines[-1] += part
                if cell_len(lines[-1]) > width:
                    lines[-1:] = chop_cells(lines[-1], width)
    return [line.replace(GLUE, " ") for line in lines]


class _Whole:
    """A table of which no character is ever cut, however narrow the terminal.

    Texts continue on the next line. If numbers are still wider than the terminal, the further
    columns come below, again next to the texts before the first number.
    """

    def __init__(self, table: ReportTable):
        self.table = table
        # A line between columns is as wide as a space.
        self.pad, self.lines = (2, 0) if table.is_bare else (1, 1)
        self.are_numbers = [column.role == "number" for column in table.columns]
        # Columns that name a row: those before the first number.
        self.named = max(1, self.are_numbers.index(True)) if any(self.are_numbers) else 1
        self.heads = [_head(column, table.is_bare) for column in table.columns]
        columns = [*zip(self.heads, *table.rows, strict=True)]
        # Column widths without wrapping, and those below which they would be cut.
        self.most = [
            max(cell_len(line) for cell in column for line in cell.split("\n"))
            for column in columns
        ]
        self.least = [
            most if is_number else max(map(_least_width, column))
            for column, most, is_number in zip(columns, self.most, self.are_numbers, strict=True)
        ]

    def parts(self, width: int) -> Iterator[Shown]:
        pad, parts = self.pad, self._columns(width, self.pad)
        if self.lines and len(closer := self._columns(width, 0)) < len(parts):
            pad, parts = 0, closer
        for part in parts:
            yield self._drawn(part, width, pad, is_first=part is parts[0])

    def _width(self, widths: Collection[int], pad: int) -> int:
        """The width of columns with everything between and around them."""
        return sum(widths) + (pad + self.lines) * len(widths) - pad + self.lines

    def _columns(self, width: int, pad: int) -> list[list[int]]:
        """The groups of columns that fit side by side, each after those that name a row."""
        count = len(self.heads)
        firsts = [index for index in range(self.named, count) if index not in self.table.joined]
        parts: list[list[int]] = [[*range(self.named)]]
        for ends in pairwise([*firsts, count]):
            wanted = [*parts[-1], *range(*ends)]
            taken = self._width([self.least[index] for index in wanted], pad)
            if len(parts[-1]) > self.named and taken > width:
                parts.append([*range(self.named), *range(*ends)])
            else:
                parts[-1] = wanted
        return parts

    def _drawn(self, part: list[int], width: int, pad: int, is_first: bool) -> Shown:
        widths = {index: self.most[index] for index in part}
        while self._width(widths.values(), pad) > width:
            loose = [index for index in part if widths[index] > self.least[index]]
            if not loose:
                break
            widths[max(loose, key=widths.__getitem__)] -= 1
        layout = BARE if self.table.is_bare else LINED
        shown = Shown(show_header=any(self.heads), padding=(0, pad, 0, 0), pad_edge=False, **layout)
        for index in part:
            justify, head = "right" if self.are_numbers[index] else "left", self.heads[index]
            lines = Text("\n".join(_wrapped(head, widths[index])))
            shown.add_column(lines, justify=justify, no_wrap=True, width=widths[index])
        for number, row in enumerate(self.table.rows):
            # Some rows have nothing in a part below.
            if is_first or any(row[index] for index in part[self.named :]):
                cells = ("\n".join(_wrapped(row[index], widths[index])) for index in part)
                styles = ("bold" * ((number, index) in self.table.best) for index in part)
                shown.add_row(*map(Text, cells, styles))
        return shown


def _head(column: Head, is_bare: bool) -> str:
    if is_bare:
        return column.head
    name = column.name
    if column.role == "number":
        # Narrow, so that names fit next to seven numbers in 80 columns; "95 %" is one word.
        name = re.sub(r"(?<!\d) ", "\n", name.replace("-", "-\n"))
    return f"{name}\n[{column.unit}]" if column.unit else name
