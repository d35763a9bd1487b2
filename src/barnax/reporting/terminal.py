"""Output for a terminal: any document in full, a plan, and a record replayed by a filter."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.measure import Measurement
from rich.padding import Padding
from rich.table import Table as Shown
from rich.text import Text

from ..errors import printable
from .document import Bullets, Document, Paragraph, Table
from .records import facts_of, replay_table, soc_lines

if TYPE_CHECKING:
    from ..plan import Plan
    from ..replay import SocReplay

# Tables with a line below the heads and one space between columns.
LINED: dict[str, Any] = {
    "box": box.SIMPLE_HEAD,
    "padding": (0, 1, 0, 0),
    "pad_edge": False,
    "title_style": "bold cyan",
    "header_style": "cyan",
}
BARE: dict[str, Any] = {"box": None, "padding": (0, 2, 0, 0), "pad_edge": False}
# What stays on one line, options with their values, and the character that keeps it there.
ONE_OPTION = r"--[a-z][\w-]*(?: (?!--)(?:'[^']*'|[^\s']+))?"
# Intervals too, with their units where each end has its own.
INTERVAL = r"(?<![^ (])[-\d.]+ (?:[A-Za-z]+ )?to [-\d.]+(?: (?:[mu]?Ohm|s|min|h|d)\b)?"
ONE_END = r"at (?:most|least) [-\d.]+(?: (?:[mu]?Ohm|s|min|h|d)\b)?"
UNBROKEN = re.compile(f"{ONE_OPTION}(?: {ONE_OPTION})*|{INTERVAL}|{ONE_END}|not determined")
GLUE = "\ue000"
# Longer words, such as file names, may be broken.
LONGEST_WORD = 24

# Width of text that is shown outside a terminal.
TEXT_WIDTH = 110


def to_terminal(document: Document) -> Iterator[RenderableType]:
    """A document with its tables, without its pictures."""
    for section in document.sections:
        yield plain(f"\n{section.title}", style="bold cyan")
        for block in section.blocks:
            if isinstance(block, Paragraph):
                yield plain(block.text)
            elif isinstance(block, Bullets):
                style = "yellow" if block.are_warnings else ""
                for item in block.items:
                    yield headed_line("-", item, width=2, style=style)
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
        return Text(UNBROKEN.sub(lambda found: found[0].replace(" ", GLUE), self.plain), self.style)

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
        lines = self.glued.wrap(console, width, justify=options.justify, overflow=options.overflow)
        text = Text("\n").join(lines)
        text.plain = text.plain.replace(GLUE, " ")
        yield from text.render(console, end="\n")

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        return Measurement.get(console, options, self.glued)


def plain(text: str, style: str = "") -> Words:
    """A text as a terminal shows it."""
    return Words("\n".join(map(printable, text.split("\n"))), style)


@dataclass(frozen=True)
class Whole:
    """Columns of which no character is ever cut, however narrow the terminal.

    Texts go on in the next line. Where numbers are wider than the terminal all the same, the
    further columns stand below, beside the first one again.

    Attributes:
        heads: What stands above the columns; empty for none.
        joined: The columns that stay beside the one before them.
    """

    heads: tuple[Words, ...]
    rows: tuple[tuple[Words, ...], ...]
    are_numbers: tuple[bool, ...]
    layout: Mapping[str, Any]
    joined: frozenset[int] = frozenset()

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        # A line between columns is as wide as a space.
        pad, lines = self.layout["padding"][1], int(self.layout["box"] is not None)
        parts = self._parts(options.max_width, pad, lines)
        if lines and len(closer := self._parts(options.max_width, 0, lines)) < len(parts):
            pad, parts = 0, closer
        for places in parts:
            yield self._part(places, options.max_width, pad, lines)

    def _column(self, place: int) -> list[Words]:
        return [*self.heads[place : place + 1], *(row[place] for row in self.rows)]

    def _least(self, place: int) -> int:
        """The width below which a column would cut."""
        if self.are_numbers[place]:
            return self._most(place)
        return max((text.longest for text in self._column(place)), default=0)

    def _most(self, place: int) -> int:
        lines = [line for text in self._column(place) for line in text.plain.split("\n")]
        return max(map(cell_len, lines), default=0)

    def _parts(self, width: int, pad: int, lines: int) -> list[list[int]]:
        """The columns that stand beside each other, each time after the first."""
        count = len(self.are_numbers)
        firsts = [place for place in range(1, count) if place not in self.joined]
        parts: list[list[int]] = [[0]]
        for first, following in pairwise([*firsts, count]):
            group = [*range(first, following)]
            wanted = [*parts[-1], *group]
            taken = sum(map(self._least, wanted)) + _between(wanted, pad, lines)
            if len(parts[-1]) > 1 and taken > width:
                parts.append([0, *group])
            else:
                parts[-1] = wanted
        return parts

    def _part(self, places: list[int], width: int, pad: int, lines: int) -> Shown:
        widths = {place: self._most(place) for place in places}
        least = {place: self._least(place) for place in places}
        while sum(widths.values()) + _between(places, pad, lines) > width:
            loose = [place for place in places if widths[place] > least[place]]
            if not loose:
                break
            widths[max(loose, key=widths.__getitem__)] -= 1
        layout: dict[str, Any] = {**self.layout, "padding": (0, pad, 0, 0)}
        table = Shown(show_header=bool(self.heads), **layout)
        for place in places:
            is_number = self.are_numbers[place]
            table.add_column(
                self.heads[place] if self.heads else "",
                justify="right" if is_number else "left",
                overflow="fold",
                width=widths[place],
            )
        for row in self.rows:
            cells = [row[place] for place in places]
            # Of a part below there is nothing to say of some rows.
            if places[:2] == [0, 1] or any(cell.plain for cell in cells[1:]):
                table.add_row(*cells)
        return table


def _between(places: Sequence[int], pad: int, lines: int) -> int:
    """The width of everything between and beside columns."""
    return (pad + lines) * len(places) - pad + lines


def terminal_table(table: Table) -> RenderableType:
    """A document's table as a terminal shows it, its caption as wide as the terminal."""
    heads = []
    for column in table.columns:
        is_number = column.role == "number"
        # Narrow heads, so that names fit beside seven numbers in 80 columns; "95 %" is one word.
        narrow = re.sub(r"(?<!\d) ", "\n", column.name.replace("-", "-\n"))
        name = narrow if is_number else column.name
        heads.append(plain(f"{name}\n[{column.unit}]" if column.unit else name))
    rows = tuple(
        tuple(
            plain(cell, style="bold" if (place, index) in table.best else "")
            for index, cell in enumerate(row)
        )
        for place, row in enumerate(table.rows)
    )
    are_numbers = tuple(column.role == "number" for column in table.columns)
    # "R0, 95 %" stays beside "R0".
    pairs = enumerate(pairwise(table.columns), 1)
    joined = {place for place, (one, other) in pairs if other.name.startswith(f"{one.name},")}
    shown = Whole(tuple(heads), rows, are_numbers, LINED, frozenset(joined))
    return Group(shown, plain(table.caption, style="italic dim")) if table.caption else shown


def bare_table(
    heads: Sequence[str],
    rows: Iterable[Sequence[str]],
    are_numbers: Sequence[bool] | None = None,
    joined: Iterable[int] = (),
) -> Whole:
    """Columns without lines, and without heads where these are none; all but the first are
    numbers, unless told otherwise. Those `joined` stay beside the one before them."""
    cells = tuple(tuple(map(plain, row)) for row in rows)
    if are_numbers is None:
        are_numbers = [place > 0 for place in range(len(heads))]
    return Whole(tuple(map(plain, heads)), cells, tuple(are_numbers), BARE, frozenset(joined))


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


def headed_lines(
    lines: Iterable[str], with_cli_options: Callable[[str], str] = str
) -> Iterator[RenderableType]:
    """Lines such as "Head: text", each head beside its text."""
    for line in lines:
        head, _, text = line.partition(": ")
        yield indented(headed_line(head, with_cli_options(text)))


def next_lines(advice: str, command: str) -> Iterator[RenderableType]:
    """The next step, and its command in one line however long, so that it can be copied."""
    yield indented(headed_line("Next", f"{advice}:" if command else advice))
    if command:
        yield Text(f"    {printable(command)}", no_wrap=True)


def plan_lines(
    planned: "Plan", with_cli_options: Callable[[str], str] = str
) -> Iterator[RenderableType]:
    """Every file, what it serves for and why, and the options that the files decide.

    `with_cli_options` turns the options named in texts into those of the reader's interface.
    """
    table = Shown(**BARE, show_header=False)
    table.add_column(no_wrap=True)
    table.add_column()
    for part in planned.parts:
        what = f" ({part.kind})" if part.kind else ""
        reason = f": {part.reason}" if part.reason else ""
        table.add_row(part.role, Text(printable(with_cli_options(f"{part.name}{what}{reason}"))))
    for name, value in planned.options.items():
        why = f", {planned.reasons[name]}" if name in planned.reasons else ""
        table.add_row(name.replace("_", " "), Text(printable(with_cli_options(f"{value}{why}"))))
    yield Text()
    yield indented(table)
    if planned.command == "hppc":
        yield indented(Text("A pulse test alone: identified with tables over SOC, as by hppc."))


def soc_screen(replay: "SocReplay") -> Iterator[RenderableType]:
    """The replay, its scenarios, the estimated parameters, and the innovations."""
    yield Text()
    for fact in facts_of(replay):
        yield indented(Text(fact))
    yield Text()
    table = replay_table(replay)
    yield indented(bare_table([column.name for column in table.columns], table.rows))
    yield Text()
    yield from headed_lines(soc_lines(replay))
