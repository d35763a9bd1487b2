"""What a terminal shows: any document in full, a plan, and a record replayed by a filter."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table as Shown
from rich.text import Text

from ..errors import printable
from .document import Bullets, Document, Listing, Paragraph, Table
from .replay import facts_of, replay_table, soc_lines

if TYPE_CHECKING:
    from ..plan import Plan
    from ..replay import SocReplay

# Seven figures and a file's name in 80 columns.
LAYOUT: dict[str, Any] = {
    "box": box.SIMPLE_HEAD,
    "padding": (0, 1, 0, 0),
    "pad_edge": False,
    "title_style": "bold cyan",
    "header_style": "cyan",
}
# More columns than these stand closer together.
MOST_SPACED = 8
BARE: dict[str, Any] = {"box": None, "padding": (0, 2, 0, 0), "pad_edge": False}

# Of what is shown outside a terminal.
TEXT_WIDTH = 110


def to_terminal(document: Document) -> Iterator[RenderableType]:
    """A document with its tables, without its pictures."""
    for section in document.sections:
        yield plain(f"\n{section.title}", style="bold cyan")
        for block in section.blocks:
            if isinstance(block, Paragraph | Listing):
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


def plain(text: str, style: str = "") -> Text:
    """A text without markup, and without what a terminal would obey; its lines stay."""
    return Text("\n".join(map(printable, text.split("\n"))), style=style)


def terminal_table(table: Table) -> RenderableType:
    """A document's table as a terminal shows it, its caption as wide as the terminal."""
    shown = Shown(**LAYOUT)
    if len(table.columns) > MOST_SPACED:
        shown.padding = 0
    for column in table.columns:
        is_number = column.role == "number"
        # Narrow, so that names stay whole beside seven figures in 80 columns.
        name = column.name.replace("-", "-\n").replace(" ", "\n") if is_number else column.name
        head = f"{name}\n[{column.unit}]" if column.unit else name
        shown.add_column(
            escape(head),
            justify="right" if is_number else "left",
            overflow="fold",
            # Where the terminal is too narrow, names are folded, and numbers stay whole.
            no_wrap=is_number,
        )
    for place, row in enumerate(table.rows):
        shown.add_row(
            *(
                plain(cell, style="bold" if (place, index) in table.best else "")
                for index, cell in enumerate(row)
            )
        )
    return Group(shown, plain(table.caption, style="italic dim")) if table.caption else shown


def bare_table(
    heads: Sequence[str], rows: Iterable[Sequence[str]], are_numbers: Sequence[bool] | None = None
) -> Shown:
    """Columns without lines; all but the first are numbers, unless told otherwise."""
    table = Shown(**BARE)
    for place, head in enumerate(heads):
        is_number = place > 0 if are_numbers is None else are_numbers[place]
        table.add_column(plain(head), justify="right" if is_number else "left", no_wrap=True)
    for row in rows:
        table.add_row(*map(plain, row))
    return table


def indented(block: RenderableType) -> RenderableType:
    return Padding(block, (0, 0, 0, 2))


def headed_line(head: str, text: str, width: int = 15, style: str = "") -> RenderableType:
    """A head and its text, which goes on below itself."""
    grid = Shown.grid(padding=(0, 1, 0, 0))
    grid.add_column(width=width, no_wrap=True)
    grid.add_column()
    label = head if head in ("-", "") else f"{head}:"
    grid.add_row(Text(label, style="bold"), plain(text, style=style))
    return grid


def parts_line(parts: Sequence[str]) -> RenderableType:
    """Short facts in one line."""
    return indented(plain("  ".join(parts)))


def next_lines(advice: str, command: str) -> Iterator[RenderableType]:
    """What to do next, and its command in one line however long, so that it can be copied."""
    yield indented(headed_line("Next", f"{advice}:" if command else advice))
    if command:
        yield Text(f"    {printable(command)}", no_wrap=True)


def plan_lines(planned: "Plan", spell: Callable[[str], str] = str) -> Iterator[RenderableType]:
    """Every file, what it serves for and why, and the options that the files decide.

    `spell` gives the texts as who reads them names the options.
    """
    table = Shown(**BARE, show_header=False)
    table.add_column(no_wrap=True)
    table.add_column()
    for part in planned.parts:
        what = f" ({part.kind})" if part.kind else ""
        reason = f": {part.reason}" if part.reason else ""
        table.add_row(part.role, Text(printable(spell(f"{part.name}{what}{reason}"))))
    for name, value in planned.options.items():
        why = f", {planned.reasons[name]}" if name in planned.reasons else ""
        table.add_row(name.replace("_", " "), Text(printable(spell(f"{value}{why}"))))
    yield Text()
    yield indented(table)
    if planned.command == "hppc":
        yield indented(Text("A pulse test alone: identified with tables over SOC, as by hppc."))


def soc_screen(replay: "SocReplay") -> Iterator[RenderableType]:
    """What was replayed, the scenarios, what was estimated, and the innovations."""
    yield Text()
    for fact in facts_of(replay):
        yield indented(Text(fact))
    yield Text()
    table = replay_table(replay)
    yield indented(bare_table([each.name for each in table.columns], table.rows))
    yield Text()
    for head, text in soc_lines(replay):
        yield indented(headed_line(head, text))
