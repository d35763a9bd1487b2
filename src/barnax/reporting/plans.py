"""A plan as the terminal shows it before it is run."""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.table import Table as Shown
from rich.text import Text

from ..errors import printable
from .terminal import BARE, indented

if TYPE_CHECKING:
    from ..plan import Plan


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
