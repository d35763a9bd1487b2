"""The files of a folder that are copies, or of other cells: by folders, and by what tests hold."""

import math
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

from ..checks.roles import LEAST_SHARE
from ..notices import Notice, notice
from ..records.fingerprint import Content
from .looking import CandidateFile, is_same_degc

# Between the same voltages, one cell passes the same charge up to this factor. A test over less of
# the voltage may be a part of another.
_SAME_CELL, _SAME_RANGE = 1.5, 0.9


def copies_of(
    files: Sequence[CandidateFile], given: Sequence[CandidateFile]
) -> dict[CandidateFile, Notice]:
    """The files whose bytes or samples another one has, and what says so.

    What was given is kept, and of a record and a part of it the longer one.
    """
    copies: dict[CandidateFile, Notice] = {}
    first_of: dict[tuple[object, ...], CandidateFile] = {}
    for file in sorted(files, key=lambda one: one not in given):
        # A record that came from no file is only like itself.
        source = (file.source.sha256, file.source.span_s) if file.source else (id(file),)
        if (same := first_of.setdefault(source, file)) is not file:
            copies[file] = notice("role.given-twice", file.name, same="bytes", other=same.name)
    unlike: list[Content] = []
    records = [file for file in files if file not in copies and file.traits]
    for file in sorted(records, key=lambda one: (one not in given, -one.record.samples)):
        content = Content(file.record)
        alike = next((other for other in unlike if content.is_like(other)), None)
        if alike is None:
            unlike.append(content)
        else:
            other = alike.record.name
            copies[file] = notice("role.given-twice", file.name, same="samples", other=other)
    return copies


def of_other_cells(
    files: Sequence[CandidateFile], given_ah: float | None
) -> dict[CandidateFile, str]:
    """The files of other cells than that of the most records, each with the reason.

    `given_ah` is the capacity in Ah of the cell that is meant, if it was given.
    """
    elsewhere = _in_other_folders(files)
    return elsewhere | _of_other_capacity(
        [file for file in files if file not in elsewhere], given_ah
    )


def _in_other_folders(files: Sequence[CandidateFile]) -> dict[CandidateFile, str]:
    """Folders that each hold a record, and an OCV test as another one's, are of different cells."""
    tests = [file for file in files if file.traits and file.serves("OCV test")]
    folders: dict[Path, list[CandidateFile]] = {}
    for pair in combinations(tests, 2):
        if _repeats(*pair):
            for test, other in (pair, pair[::-1]):
                apart = [one for one in test.path.parents if one not in other.path.parents]
                folders |= {one: [] for one in apart[-1:]}
    # Of folders in each other the inner ones.
    folders = {
        folder: [file for file in files if folder in file.path.parents]
        for folder in folders
        if not any(folder in inner.parents for inner in folders)
    }
    cells = {folder: inside for folder, inside in folders.items() if _records(inside)}
    if len(cells) < 2:
        return {}
    kept = max(cells, key=lambda folder: _records(cells[folder]))
    why = f"of another cell than {kept.name}, by the OCV test of its folder {{}}; identify that "
    why += "folder by itself, or all with barnax fleet"
    return {
        file: why.format(folder.name)
        for folder, inside in cells.items()
        for file in inside
        if folder != kept
    }


def _repeats(one: CandidateFile, other: CandidateFile) -> bool:
    """True if two OCV tests are the same test, of different cells or done twice."""
    same = is_same_degc(one.temperature_degc, other.temperature_degc, is_strict=True)
    directions = [{sweep.direction for sweep in _sweeps(test)} for test in (one, other)]
    return same and one.kind(None) == other.kind(None) and directions[0] == directions[1]


def _records(files: Sequence[CandidateFile]) -> int:
    return sum(file.serves("identification") for file in files)


def _sweeps(test: CandidateFile) -> tuple:
    return test.traits.sweeps if test.traits else ()


def _capacity_ah(test: CandidateFile) -> float:
    return max(sweep.passed_ah for sweep in _sweeps(test))


def _of_other_capacity(
    files: Sequence[CandidateFile], given_ah: float | None
) -> dict[CandidateFile, str]:
    """Tests of cells that hold another charge, each with the records that fit it best."""
    tests = [file for file in files if _sweeps(file) and file.serves("OCV test")]
    cells: list[list[CandidateFile]] = []
    for test in sorted(tests, key=_capacity_ah):
        if not cells or not _is_one_cell(cells[-1][-1], test):
            cells.append([])
        cells[-1].append(test)
    if len(cells) < 2:
        return {}
    largest = [cell[-1] for cell in cells]
    for file in files:
        if file.traits and file not in tests:
            span_ah = file.traits.span_ah / _SAME_CELL
            fits = (k for k, test in enumerate(largest) if span_ah <= _capacity_ah(test))
            cells[next(fits, -1)].append(file)

    def rank(k: int) -> tuple[float, int, int]:
        apart = abs(math.log(_capacity_ah(largest[k]) / given_ah)) if given_ah else 0.0
        return -apart, _records(cells[k]), len(cells[k])

    kept = max(range(len(cells)), key=rank)
    holds = [f"{test.name} holds {_capacity_ah(test):.3g} Ah" for test in largest]
    return {
        file: f"of another cell: {holds[k]}, and {holds[kept]}; identify it by itself"
        for k, cell in enumerate(cells)
        for file in cell
        if k != kept
    }


def _is_one_cell(smaller: CandidateFile, larger: CandidateFile) -> bool:
    """True if two OCV tests may be of one cell."""
    ratio = _capacity_ah(larger) / _capacity_ah(smaller)
    if ratio <= _SAME_CELL or ratio >= 1 / LEAST_SHARE:
        return ratio <= _SAME_CELL
    volts = [
        [p.voltage_v for sweep in _sweeps(test) for p in sweep.points] for test in (smaller, larger)
    ]
    lows_v, highs_v = [min(one) for one in volts], [max(one) for one in volts]
    is_same_range = min(highs_v) - max(lows_v) >= _SAME_RANGE * (max(highs_v) - min(lows_v))
    same_degc = is_same_degc(smaller.temperature_degc, larger.temperature_degc)
    return not (is_same_range and same_degc)
