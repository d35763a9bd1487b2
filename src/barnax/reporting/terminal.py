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
from .words import NOTHING, duration, joined

if TYPE_CHECKING:
    from ..plan import Plan
    from ..replay import ScenarioPart, SocReplay

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

# The columns of a replay's screen.
HEADS = (
    *("errors in % SOC", "within 3 %", "RMS", "above 10 %", "max", "in band"),
    *("counting", "max"),
)
FILTERS = {"ekf": "extended Kalman filter", "ukf": "unscented Kalman filter"}
# A band of 95 % that holds less often than this is said to be wrong.
TRUSTED_BAND = 0.9


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
    return indented(plain("   ".join(parts)))


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
    low, high = replay.soc_range
    tables = " with tables over SOC" if replay.with_tables else ""
    yield Text()
    facts = (
        f"{replay.record}   {duration(replay.duration_s)}   {replay.samples:,} samples   "
        f"SOC {100 * high:.0f} to {100 * low + 0.0:.0f} %"
    )
    yield indented(Text(facts))
    yield indented(
        Text(f"{replay.model}{tables}, {FILTERS[replay.settings.kind]}, {replay.states} states")
    )
    yield Text()
    yield indented(bare_table(HEADS, map(_scenario_row, replay.scenarios)))
    yield Text()
    for head, text in soc_lines(replay):
        yield indented(headed_line(head, text))


def soc_lines(replay: "SocReplay") -> Iterator[tuple[str, str]]:
    """Heads and sentences: what went wrong, what was estimated, whether innovations are white."""
    diverged = [each for each in replay.scenarios if each.diverged_s is not None]
    for each in diverged:
        yield (
            "Diverged",
            f"{each.name}: after {duration(each.diverged_s or 0.0)} the filter returns no numbers",
        )
    right = replay.scenarios[0]
    if right.is_lost:
        size = "" if right.max is None else f" by up to {_in_percent(right.max)} %"
        advice = "" if replay.with_tables else "; tables over SOC may"
        yield (
            "Lost",
            f"even from the right start, the estimate of SOC goes wrong{size}: the circuit's "
            f"voltage does not tell it{advice}",
        )
    held = [each.in_band for each in replay.scenarios if each.in_band is not None]
    if held and min(held) < TRUSTED_BAND:
        low, high = (f"{100 * share:.0f}" for share in (min(held), max(held)))
        shares = f"{low} %" if low == high else f"{low} to {high} %"
        yield (
            "Overconfident",
            f"the filter's 95 % band contains the reference SOC {shares} of the time: its errors "
            "of SOC are larger than it assumes",
        )
    found = [_estimate(name, *right.estimates[name]) for name in right.estimates]
    if found:
        yield "Estimated", f"from the right start, {joined(found)}"
    tested = replay.innovations
    if tested is not None:
        white = "white" if tested.are_white else "not white"
        low, high = tested.mean_square_bounds
        size = tested.mean_square
        how = "as expected" if low <= size <= high else "smaller" if size < low else "larger"
        than = "" if how == "as expected" else " than the filter expects of a single sample"
        yield (
            "Innovations",
            f"measured minus predicted voltage is {white} (autocorrelation at lag one "
            f"{tested.first_lag:.2f}, below {tested.bound:.2f} for white noise), "
            f"{how}{than} (mean square {size:.2g}, ideally 1)",
        )


def _scenario_row(each: "ScenarioPart") -> list[str]:
    errors = each.rms, each.rms_above_10_soc, each.max
    counting = each.counter_rms, each.counter_max
    return [
        each.name,
        _converged(each),
        *(_in_percent(share) for share in errors),
        _in_percent(each.in_band, 0),
        *(_in_percent(share) for share in counting),
    ]


def _converged(part: "ScenarioPart") -> str:
    if part.diverged_s is not None:
        return "diverged"
    if part.converged_s is None:
        return "never"
    if part.is_lost:
        return "lost"
    return duration(part.converged_s) if part.converged_s else "at once"


def _in_percent(share: float | None, decimals: int = 1) -> str:
    return NOTHING if share is None else f"{100 * share:.{decimals}f}"


def _estimate(name: str, value: float, sd: float) -> str:
    if name == "offset":
        return f"current offset {1e3 * value:.1f} +/- {1e3 * sd:.1f} mA"
    return f"{name} times {value:.3f} +/- {value * sd:.3f}"
