"""How fast everything is: `python -m benchmarks.speed`, about ten minutes on two cores.

Writes benchmarks/results/speed.md. `--quick` tries everything at tiny sizes and writes nothing.
"""

import argparse
import os
import tempfile
import time
from pathlib import Path

import jax

from benchmarks.pages import as_markdown, provenance, save_page

from . import report
from .cells import row_of, time_cells
from .growth import grow_record, grow_seeds
from .kernel import compile_kernel
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


def measure(sizes: Sizes, page: Page) -> None:
    """Every section in turn."""
    with tempfile.TemporaryDirectory() as folder:
        name, kernel = compile_kernel(Path(folder))
    page.begin("generations and searches")
    rows = time_generations(name, kernel, sizes)
    searches, answers = time_searches(name, kernel, sizes)
    rows += searches
    rows += time_tables(sizes)
    rows += time_reading(sizes)
    page.begin(f"{sizes.cells} cells")
    rows.append(row_of(time_cells(sizes), sizes))
    page.add("## Against baselines", "", *report.work_table(rows))
    page.add("What the runs found:", "", *(f"- {line}" for line in answers))
    page.begin("growth")
    page.add("## Growth with the record", "", *report.length_table(list(grow_record(sizes))))
    page.add("## Growth with seeds", "", *report.seed_table(list(grow_seeds(sizes))))
    page.begin("start-up")
    page.add("## Start-up", "", *report.start_table(list(time_starts(sizes))))
    page.begin("peers")
    reduction = next(row for row in rows if row.work.startswith("the reduction"))
    search = next(row for row in rows if "compressed, after" in row.work)
    peers = report.peer_table(
        *run_peers(sizes), reduction.ours_s + search.ours_s, rows[0].ours_s, sizes
    )
    page.add("## The same job by PyBaMM and PyBOP", "", *peers)


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
        measure(sizes, page)
    page.add(f"The whole took {(time.perf_counter() - begin) / 60:.1f} minutes.")
    if not options.quick:
        save_page(RESULTS / "speed.md", "\n".join(page.lines))


if __name__ == "__main__":
    main()
