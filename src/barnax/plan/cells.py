"""The files of a folder that are copies, or of other cells: by folders, and by what tests hold."""

import math
from collections.abc import Sequence
from itertools import pairwise, permutations
from pathlib import Path

from ..cell.soc_axis import Sweep
from ..checks.roles import LEAST_SHARE
from ..notices import Notice, notice
from ..records.fingerprint import Content
from .looking import CandidateFile, is_same_degc

# Tests of one cell between the same voltages, to this share, differ by less than this factor.
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
    """Folders that each hold a record, and the same OCV test, are of different cells."""
    folders: set[Path] = set()
    for one, other in permutations([file for file in files if _sweeps(file)], 2):
        if _is_repeated(one, other):
            apart = [folder for folder in one.path.parents if folder not in other.path.parents]
            folders |= set(apart[-1:])
    # Of folders in each other the inner ones.
    folders -= {outer for inner in folders for outer in inner.parents}
    cells = {
        folder: [file for file in files if folder in file.path.parents]
        for folder in sorted(folders)
    }
    cells = {folder: inside for folder, inside in cells.items() if _records(inside)}
    kept = max(cells, key=lambda folder: _records(cells[folder]), default=None)
    return {
        file: f"of another cell than {kept.name}, by the OCV test of its folder {folder.name}; "
        "identify that folder by itself, or all with barnax fleet"
        for folder, inside in cells.items()
        for file in inside
        if kept and folder != kept
    }


def _is_repeated(one: CandidateFile, other: CandidateFile) -> bool:
    """True if two OCV tests are of one kind, temperature and direction."""
    same = is_same_degc(one.temperature_degc, other.temperature_degc, is_strict=True)
    directions = [{sweep.direction for sweep in _sweeps(test)} for test in (one, other)]
    return same and one.kind(None) == other.kind(None) and directions[0] == directions[1]


def _records(files: Sequence[CandidateFile]) -> int:
    return sum(file.serves("identification") for file in files)


def _sweeps(file: CandidateFile) -> tuple[Sweep, ...]:
    """The sweeps of an OCV test, none of another file."""
    return file.traits.sweeps if file.traits and file.serves("OCV test") else ()


def _of_other_capacity(
    files: Sequence[CandidateFile], given_ah: float | None
) -> dict[CandidateFile, str]:
    """OCV tests of cells that hold another charge, each with the records that fit it."""
    tests = {
        file: max(sweep.passed_ah for sweep in _sweeps(file)) for file in files if _sweeps(file)
    }
    ranked = sorted(tests, key=lambda test: tests[test])
    largest_ah = [tests[one] for one, next_one in pairwise(ranked) if _is_other(one, next_one)]
    largest_ah += [tests[test] for test in ranked[-1:]]
    cells: dict[float, list[CandidateFile]] = {ah: [] for ah in largest_ah}
    for file in files if len(cells) > 1 else ():
        if file.traits:
            span_ah = tests.get(file, file.traits.span_ah / _SAME_CELL)
            cells[next((ah for ah in largest_ah if span_ah <= ah), largest_ah[-1])].append(file)

    def rank(ah: float) -> tuple[float, int, int]:
        apart = abs(math.log(ah / given_ah)) if given_ah else 0.0
        return -apart, _records(cells[ah]), len(cells[ah])

    kept_ah = max(cells, key=rank, default=0.0)
    return {
        file: f"of a cell of {ah:.3g} Ah, and the one identified holds {kept_ah:.3g} Ah; "
        "identify its files by themselves"
        for ah, cell in cells.items()
        for file in cell
        if ah != kept_ah
    }


def _is_other(smaller: CandidateFile, larger: CandidateFile) -> bool:
    """True if two OCV tests are of different cells; one over less of the voltage may be a part."""
    passed_ah, spans_v = [], []
    for test in (smaller, larger):
        passed_ah.append(max(sweep.passed_ah for sweep in _sweeps(test)))
        volts = [point.voltage_v for sweep in _sweeps(test) for point in sweep.points]
        spans_v.append(max(volts) - min(volts))
    is_alike = min(spans_v) >= _SAME_RANGE * max(spans_v) and is_same_degc(
        smaller.temperature_degc, larger.temperature_degc
    )
    return passed_ah[1] > (_SAME_CELL if is_alike else 1 / LEAST_SHARE) * passed_ah[0]
