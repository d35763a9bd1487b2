"""How fast everything is: `python -m benchmarks.speed`, about ten minutes on two cores.

Writes benchmarks/results/speed.md, speed.csv and speed.png. `--quick` tries everything at tiny
sizes and writes nothing.
"""

import argparse
import os
import tempfile
import time
from dataclasses import asdict
from pathlib import Path

import jax

from benchmarks.pages import as_markdown, provenance, save_figure, save_page, write_csv

from . import report
from .cells import grow_cells, row_of, time_cells
from .figures import growth_figure
from .growth import grow_record, grow_seeds
from .kernel import compile_kernel
from .parts import profile
from .peers import run_peers
from .reading import time_reading
from .sizes import KEY, QUICK, Sizes
from .startup import time_starts
from .tables import time_tables
from .work import time_generations, time_searches

RESULTS = Path(__file__).parents[1] / "results"


class Page:
    """Lines that are printed as they come, and kept."""

    def __init__(self):
        self.lines: list[str] = []
        self._begin = time.perf_counter()

    def add(self, *lines: str) -> None:
        self.lines += [*lines, ""]
        print(*lines, "", sep="\n", flush=True)

    def begin(self, what: str) -> None:
        print(f"[{time.perf_counter() - self._begin:.0f} s] {what} ...", flush=True)


def facts_of(command: str) -> dict[str, str]:
    """Machine, versions and how busy the machine was."""
    facts = provenance(command, KEY)
    facts["load average at the start"] = ", ".join(f"{load:.1f}" for load in os.getloadavg())
    return facts


def measure(sizes: Sizes, page: Page) -> tuple[list[dict], object]:
    """Every section in turn; the rows of the CSV file and the figure."""
    with tempfile.TemporaryDirectory() as folder:
        name, kernel = compile_kernel(Path(folder))
    page.begin("generations and searches")
    rows = time_generations(name, kernel, sizes)
    searches, found = time_searches(name, kernel, sizes)
    rows += searches
    rows += time_tables(sizes)
    rows += time_reading(sizes)
    page.begin(f"{sizes.cells} cells")
    cells = time_cells(sizes)
    rows.append(row_of(cells, sizes))
    page.add("## Against baselines", "", *report.work_table(rows))
    page.add("What the runs found:", "", *(f"- {line}" for line in found))
    page.begin("parts")
    parts, follows = profile(sizes)
    page.add("## Where the time goes", "", *report.parts_table(parts), "", *follows)
    page.begin("growth")
    lengths = list(grow_record(sizes))
    page.add("## Growth with the record", "", *report.length_table(lengths))
    seeds = list(grow_seeds(sizes))
    page.add("## Growth with seeds", "", *report.count_table("seeds", seeds))
    more_cells = list(grow_cells(sizes, cells))
    page.add("## Growth with cells", "", *report.count_table("cells", more_cells))
    page.begin("start-up")
    starts = list(time_starts(sizes))
    page.add("## Start-up", "", "`barnax identify --quiet` on the bundled cell, a fresh process: "
             "thirty seeds, cross-check, figures.", "", *report.start_table(starts))  # fmt: skip
    page.begin("peers")
    measured, why_not = run_peers(sizes)
    reduction_s, search_s = lengths_of(rows)
    peers = report.peer_table(measured, why_not, reduction_s + search_s, rows[0].ours_s, sizes)
    page.add("## The same job by PyBaMM and PyBOP", "", *peers)
    table = [row.as_dict() for row in rows]
    table += [{"section": "part", "work": name, "ours_s": taken} for name, taken in parts]
    table += [{"section": "length", **asdict(each)} for each in lengths]
    table += [{"section": "seeds", "count": count, "ours_s": taken} for count, taken in seeds]
    table += [{"section": "cells", "count": count, "ours_s": taken} for count, taken in more_cells]
    table += [{"section": "start", **asdict(each), "verdict": each.verdict} for each in starts]
    for tool in ("PyBaMM", "PyBOP") if measured else ():
        table.append({"section": "peer", "work": tool, **measured[tool]})
    figure = growth_figure(lengths, seeds, more_cells, sizes.generations, sizes.seeds_a_cell)
    return table, figure


def lengths_of(rows) -> tuple[float, float]:
    """Seconds of one reduction and of one compressed search."""
    reduction = next(row for row in rows if row.work.startswith("the reduction"))
    search = next(row for row in rows if "compressed, after" in row.work)
    return reduction.ours_s, search.ours_s


def main() -> None:
    """Measure, print as it goes, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.speed", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="tiny sizes; nothing is written")
    options = parser.parse_args()
    sizes = QUICK if options.quick else Sizes()
    page = Page()
    page.add("# Speed", "", "Medians of turns: what is compared runs one after the other, again "
             "and again, after a call of each that compiles. Ratios are medians of the turns' own.",
             "", as_markdown(facts_of("python -m benchmarks.speed")))  # fmt: skip
    begin = time.perf_counter()
    with jax.enable_x64(True):
        table, figure = measure(sizes, page)
    page.add(f"The whole took {(time.perf_counter() - begin) / 60:.1f} minutes.")
    if not options.quick:
        columns = dict.fromkeys(key for row in table for key in row)
        write_csv(
            RESULTS / "speed.csv", [{key: row.get(key, "") for key in columns} for row in table]
        )
        save_figure(RESULTS / "speed.png", figure, dpi=130)
        text = "\n".join([*page.lines, "![growth](speed.png)", ""])
        save_page(RESULTS / "speed.md", text)


if __name__ == "__main__":
    main()
