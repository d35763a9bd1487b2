"""Files as instruments write them, against what is true of them.

`python -m benchmarks.formats FOLDER` reads every file that truth.json in the folder names, and
writes benchmarks/results/formats.md. It ends with status 1 where a file is silently wrong.
"""

import argparse
import importlib.util
import json
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from barnax.errors import InputError
from barnax.records import Record, read_record, read_source
from barnax.records.column_rules import examine_columns
from barnax.records.table import examine_cells, take_lines
from benchmarks.pages import as_markdown, provenance, save_page

PAGE = Path(__file__).parent / "results" / "formats.md"
# What reads these files stands in an extra of barnax.
EXTRAS = {".mpr": "galvani", ".res": "access_parser", ".gz": "access_parser"}
_TIME_S, _SHARE, _VOLTS = 1e-3, 1e-5, 1e-5

Truth = Mapping[str, Any]


@dataclass(frozen=True)
class Outcome:
    """What came of one file: refused with a sentence, or read, and wrong in what is named."""

    file: str
    is_record: bool
    rows: int = 0
    refusal: str = ""
    wrong: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def word(self) -> str:
        if self.refusal:
            return "refused"
        if not self.is_record:
            return "read, and said" if self.warnings else "WRONG: not refused"
        return f"WRONG: {', '.join(self.wrong)}" if self.wrong else "agrees"


def truths(folder: Path) -> list[Truth]:
    """What truth.json says of each file; nothing where it is not there."""
    file = folder / "truth.json"
    return json.loads(file.read_text())["files"] if file.exists() else []


def missing_package(truth: Truth) -> str | None:
    """The package that the file needs, where it is not installed."""
    package = EXTRAS.get(Path(truth["file"]).suffix)
    return package if package and importlib.util.find_spec(package) is None else None


def outcome_of(folder: Path, truth: Truth) -> Outcome:
    """What reading a file gives."""
    is_record = "n_rows" in truth
    try:
        source = read_source(folder / truth["file"])
        # Nothing is corrected: what the file says is compared.
        record = read_record(source, voltage_lag=0.0)
    except InputError as refusal:
        return Outcome(truth["file"], is_record, refusal=str(refusal))
    columns, _ = examine_columns(source.table, source.name)
    lines = examine_cells(take_lines(source.table, columns))
    wrong = tuple(_wrong(truth, record, len(lines.row))) if is_record else ()
    said = tuple(str(each) for each in (*record.warnings, *record.notes))
    return Outcome(truth["file"], is_record, len(lines.row), "", wrong, said)


def _wrong(truth: Truth, record: Record, rows: int) -> Iterator[str]:
    """In what a record is not as the truth says."""
    charge_a = -record.current_a
    apart_a = _SHARE * np.abs(charge_a).max() + 1e-12
    if rows != truth["n_rows"]:
        yield f"{rows} rows of {truth['n_rows']}"
    for what, values, names, apart in (
        ("times", record.time_s[[0, -1]], ("t_first_s", "t_last_s"), _TIME_S),
        ("currents", charge_a, ("i_min_A", "i_max_A"), apart_a),
        ("voltages", record.voltage_v, ("v_min_V", "v_max_V"), _VOLTS),
    ):
        if any(
            abs(value - truth[name]) > apart
            for value, name in zip((values.min(), values.max()), names, strict=True)
        ):
            yield f"{what} {values.min():.6g} to {values.max():.6g}"
    for row in truth["rows_to_check"]:
        # A row that repeats the one before stands in the record once.
        at = np.searchsorted(record.time_s, row["t_s"] - _TIME_S)
        near = slice(at, at + 8)
        matches = (
            (np.abs(record.time_s[near] - row["t_s"]) <= _TIME_S)
            & (np.abs(charge_a[near] - row["i_A"]) <= apart_a)
            & (np.abs(record.voltage_v[near] - row["v_V"]) <= _VOLTS)
        )
        if not matches.any():
            yield f"row {row['row']}"


def page_of(outcomes: Sequence[Outcome], facts: str) -> str:
    """The page as Markdown."""
    records = [each for each in outcomes if each.is_record]
    counts = Counter(each.word.partition(":")[0] for each in records)
    others = [each for each in outcomes if not each.is_record]
    refused = sum(bool(each.refusal) for each in others)
    silent = sum(each.word.startswith("WRONG") for each in outcomes)
    lines = [
        "# Formats",
        "",
        "Published files of cyclers, unedited, each read without an option and compared with what "
        "an independent reading of it gives: number of rows, first and last time to 1 ms, the "
        "ranges of current (with its sign) and voltage to 1e-5, and five rows in full.",
        "",
        facts,
        "",
        f"Of {len(records)} records {counts['agrees']} agree and {counts['refused']} are refused "
        f"with what to do, because they are wrong by themselves. Of {len(others)} files that are "
        f"no records {refused} are refused, and the others read with a warning. "
        f"**{silent or 'None'}** is silently wrong.",
        "",
        "| file | outcome | rows | what is said |",
        "|---|---|---|---|",
    ]
    for each in outcomes:
        said = each.refusal or " ".join(each.warnings)
        words = said.replace(f"{Path(each.file).name}: ", "").replace("|", "\\|")
        words = words if each.refusal or not each.is_record else _first(each.warnings, each.file)
        lines.append(f"| `{each.file}` | {each.word} | {each.rows or ''} | {words} |")
    return "\n".join([*lines, ""])


def _first(warnings: Sequence[str], file: str) -> str:
    """The first warning, and how many there are."""
    if not warnings:
        return ""
    said = warnings[0].replace(f"{Path(file).name}: ", "").replace("|", "\\|")
    return said + (f" (and {len(warnings) - 1} more)" if len(warnings) > 1 else "")


def main() -> int:
    """Read every file, write the page, and say whether one is silently wrong."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.formats", description=__doc__)
    parser.add_argument("folder", type=Path, help="the folder with truth.json")
    folder = parser.parse_args().folder
    listed = truths(folder)
    if missing := {package for each in listed if (package := missing_package(each))}:
        parser.error(f"install {', '.join(sorted(missing))} first")
    outcomes = [outcome_of(folder, each) for each in listed]
    facts = provenance("python -m benchmarks.formats FOLDER", 0, "fastnda", "polars", "fastexcel")
    save_page(PAGE, page_of(outcomes, as_markdown(facts)))
    for each in outcomes:
        print(f"{each.word:20} {each.file}")
    return int(any(each.word.startswith("WRONG") for each in outcomes))


if __name__ == "__main__":
    sys.exit(main())
