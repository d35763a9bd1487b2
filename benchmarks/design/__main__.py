"""Is a designed test worth an HPPC? `python -m benchmarks.design [CELLS] [FOLDER] [--rows FILE]`.

Virtual cells with known truth, half of them of NMC, half of LFP with its moving hysteresis: random
tables that bend over SOC, an error correlated over seconds and minutes, and a capacity. Then
PyBaMM's SPMe and DFN as truths that are no circuits, where it is installed, and measured records
of which the design picks a quarter without seeing the voltage, or which are identified together,
where their folder is given. What is finished is kept in FILE, and not done again. Writes
benchmarks/results/design.md.
"""

import argparse
import json
import sys
from importlib.util import find_spec
from pathlib import Path

from benchmarks.pages import as_markdown, provenance, publish
from benchmarks.real_cells.cases import data_folder

from .physics import PHYSICS, physics_line, physics_lines
from .quarter import quarter_lines, together_lines
from .virtual import SEED, virtual_lines, virtual_row

RESULTS = Path(__file__).parents[1] / "results" / "design.md"
CELLS = 60


def main() -> None:
    """Measure, print the page and write it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.design")
    parser.add_argument("cells", type=int, nargs="?", default=CELLS)
    parser.add_argument("folder", nargs="?")
    parser.add_argument("--rows", type=Path)
    given = parser.parse_args()
    done = {}
    if given.rows is not None and given.rows.exists():
        done = dict(map(json.loads, given.rows.read_text().splitlines()))

    def kept(name: str, work, *arguments):
        """What was done before, or is done now."""
        if name not in done:
            done[name] = work(*arguments)
            print(name, done[name], file=sys.stderr, flush=True)
            if given.rows is not None:
                with given.rows.open("a") as rows:
                    rows.write(json.dumps([name, done[name]]) + "\n")
        return done[name]

    lines = [
        "# Is a designed test worth an HPPC?",
        "",
        as_markdown(provenance(f"python -m benchmarks.design {given.cells} [FOLDER]", SEED)),
        "",
    ]
    cells = range(given.cells)
    lines += virtual_lines([kept(f"cell {number}", virtual_row, number) for number in cells])
    if find_spec("pybamm"):
        lines += physics_lines([kept(" ".join(own[:2]), physics_line, *own) for own in PHYSICS])
    folder = data_folder(given.folder)
    if folder is not None:
        lines += kept("quarter", quarter_lines, folder) + kept("together", together_lines, folder)
    publish(RESULTS, "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
