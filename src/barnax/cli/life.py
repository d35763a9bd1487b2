"""`barnax life`: what a fleet's dataset says of its cells' ageing."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..files import is_address
from .options import argument, group, option
from .output import Output
from .session import as_flags, shown

if TYPE_CHECKING:
    from ..life import Life

AGEING = "Ageing"
FOLDER = Path("barnax-life")
# Odd cells have a page each, of many the oddest.
MOST_PAGES = 20


@group
class LifeOptions:
    """The dataset, and which of its columns say what."""

    dataset: str = argument("DATASET", "Folder that barnax fleet --ageing wrote, or its address.")
    by: str | None = option(
        AGEING,
        "COLUMN",
        "Column that names the cell of a row (default: specimen, cell_name, name or serial).",
    )
    age: str | None = option(
        AGEING,
        "COLUMN",
        "Column of dates, or of ages in days, weeks, months, years, cycles or ampere-hours, by its "
        "name (default: the first called so).",
    )
    throughput: str | None = option(
        AGEING, "COLUMN", "Column of ampere-hours since new, for equivalent full cycles."
    )
    false_alarms: float = option(
        AGEING,
        "RATE",
        "Cells flagged without a fault, of each cell and year, or 365 cycles.",
        0.005,
    )
    cell: list[str] | None = option(
        AGEING, "NAME", "A page of this cell too; repeatable (default: of those that are odd)."
    )
    key: int = option(AGEING, "N", "Random key of the fleets without faults.", 0)


def life(given: LifeOptions, output: Output) -> None:
    """Trends of capacity, resistances and OCV over the life of a fleet's cells, and odd cells.

    Each with 95 % intervals, smooth in age and pooled over the fleet. What
    the records do not determine is said, not guessed.
    """
    session, folder = output.begun(
        FOLDER, [] if is_address(given.dataset) else [Path(given.dataset)]
    )
    with session.watch("Fitting trends"):
        from ..fleet.summary import read_fleet
        from ..life import life_of
        from ..reporting.life import life_frame, life_json, life_lines

        if not 0 < given.false_alarms < 1:
            raise InputError(f"`false_alarms` {given.false_alarms:g}: give a rate such as 0.005")
        asked = given.age, given.by, given.throughput, given.false_alarms, given.key
        found = life_of(read_fleet(given.dataset), *asked)
    unknown = [name for name in given.cell or () if name not in found.cells]
    if unknown:
        raise InputError(f"`cell` {unknown[0]!r}: no cell of {given.dataset} is called so")
    odd = list(dict.fromkeys(fault.cell for fault in found.faults))[:MOST_PAGES]
    pages = dict.fromkeys([*(given.cell or ()), *odd])

    def files() -> dict[str, bytes]:
        import io

        table = io.BytesIO()
        life_frame(found).write_parquet(table)
        return {"trends.parquet": table.getvalue(), **_pages(found, pages)}

    session.show(shown(as_flags(line)) for line in life_lines(found))
    folder, _ = output.deliver(session, folder, "life.json", life_json(found), files)
    if folder is not None:
        names = ["report.html", "trends.parquet", "life.json", f"{len(pages)} pages in cells"]
        session.show_written(folder, names)


def _pages(found: "Life", cells: Iterable[str]) -> dict[str, bytes]:
    from ..plots import plot_cell_life, plot_fleet_life
    from ..plots.pictures import illustrate
    from ..reporting.life import cell_document, life_document
    from ..reporting.render import report_files, to_html

    drawn = [illustrate("life", "all cells", plot_fleet_life, found)]
    files = report_files(life_document(found, drawn).with_option_names(as_flags), drawn)
    for number, cell in enumerate(cells, 1):
        own = [illustrate(f"cell-{number}", cell, plot_cell_life, found, cell)]
        page = cell_document(found, cell, own).with_option_names(as_flags)
        files[f"cells/{number}-{_file_name(cell)}.html"] = to_html(page).encode()
        files[f"figures/cell-{number}.png"] = own[0].png
    return files


def _file_name(cell: str) -> str:
    """A name that is one of a file in its folder."""
    kept = "".join(letter if letter.isalnum() or letter in "-_ " else "-" for letter in cell)
    return kept[:100] or "cell"
