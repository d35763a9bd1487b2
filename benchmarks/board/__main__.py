"""A board of tools on public records: `python -m benchmarks.board [FOLDER] [--submit NAME=FOLDER]`.

Every tool is given the OCV test and one record of a cell, and is judged on another record, above
and below 10 % SOC. Writes benchmarks/results/board.md. `--where` fetches nothing, and says where
the records are and under which terms. `--submit` adds circuits of a tool of yours: a folder with a
CSV for each set, called as `--where` says, with the columns SOC, R0 [Ohm], R1 [Ohm], tau1 [s] and
so on.
"""

import argparse
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from benchmarks.pages import as_markdown, data_folder, provenance, publish

from .records import splits
from .tools import PEERS, Fitted, along, median, submitted, with_barnax, with_peer

RESULTS = Path(__file__).parents[1] / "results" / "board.md"
# What tools of a run by themselves need too much time for is not in it.
ABSENT = (
    "PyBOP (26.3 installs) and mealpy are not here: they search for the constants that SciPy's row "
    "has, and PyBOP's 1.2 s an evaluation ([speed](speed.md)) makes hours of eight sets. Submit "
    "what they give."
)


def sources(folder: Path | None) -> Iterator[str]:
    """Where every record is, and what its submitted circuit is called."""
    for split in splits(folder or Path("FOLDER")):
        files = ", ".join(path.name for path in (*split.ocv, split.fitted[0], split.left_out[0]))
        yield f"- {split.name} ({split.file_name}): {files}. {split.source}"


def row(name: str, tool: str, one: Fitted) -> str:
    """A line of the table."""
    inside, count = one.intervals
    coverage = f"{inside} of {count}" if count else ""
    high, low = (shown(one.rmse_mv(is_high)) for is_high in (True, False))
    return f"| {name} | {tool} | {high} | {low} | {one.seconds:.1f} | {coverage} |"


def shown(value_mv: float) -> str:
    """An error, or what a free simulation that does not stay bounded leaves."""
    return "–" if math.isnan(value_mv) else f"{value_mv:.2f}" if value_mv < 1000 else "unstable"


def summary(by_tool: Mapping[str, Sequence[Fitted]]) -> Iterator[str]:
    """The medians of every tool."""
    yield "| tool | sets | above 10 % SOC [mV] | below [mV] | seconds | intervals |"
    yield "|---|--:|--:|--:|--:|--:|"
    for tool, all_of in by_tool.items():
        errors = (median([one.rmse_mv(is_high) for one in all_of]) for is_high in (True, False))
        inside, count = (sum(one.intervals[k] for one in all_of) for k in (0, 1))
        seconds = median([one.seconds for one in all_of])
        cells = (tool, str(len(all_of)), *map(shown, errors), f"{seconds:.1f}")
        yield f"| {' | '.join(cells)} | {f'{inside} of {count}' if count else ''} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """The page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.board", description=__doc__)
    parser.add_argument("folder", nargs="?", help="the folder of measured cells")
    parser.add_argument("--where", action="store_true", help="say where the records are")
    parser.add_argument("--submit", action="append", default=[], metavar="NAME=FOLDER")
    options = parser.parse_args(arguments)
    folder = data_folder(options.folder)
    if options.where:
        print(*sources(folder), sep="\n")
        return
    rows, by_tool = list[str](), dict[str, list[Fitted]]()
    for split in splits(folder):
        tools = {
            "barnax": with_barnax,
            **{name: partial(with_peer, of) for name, of in PEERS.items()},
        }
        for name, _, where in (one.partition("=") for one in options.submit):
            if (path := Path(where) / split.file_name).is_file():
                tools[name] = partial(with_peer, lambda _, path=path: along(submitted(path)))
            else:
                print(f"{name} has no {path}: it is not in this set", file=sys.stderr)
        for tool, run in tools.items():
            by_tool.setdefault(tool, []).append(fitted := run(split))
            rows.append(row(split.name, tool, fitted))
            print(rows[-1], flush=True)
    lines = [
        "# Tools on records that they were not fitted to", "", ABSENT, "",
        *summary(by_tool), "",
        "Medians over the sets, below 10 % SOC of those that go there. Every tool has the same OCV "
        "test, start, capacity and counted samples; seconds are wall time with the files read, and "
        "with intervals and proof where a tool gives them. Intervals: at how many nodes the 95 % "
        "interval of R0 holds what the record left out gives by itself. They are of the record "
        "itself: the other one has an error of its own, and another load and temperature, of which "
        "three records to fit to would tell.", "",
        "| set | tool | above 10 % SOC [mV] | below [mV] | seconds | intervals |",
        "|---|---|--:|--:|--:|--:|", *rows, "",
        "## Where the records are", "", *sources(folder), "",
    ]  # fmt: skip
    facts = provenance("python -m benchmarks.board FOLDER", 0)
    publish(RESULTS, "\n".join([*lines, as_markdown(facts), ""]))


if __name__ == "__main__":
    main()
