"""A plan in the making: the decisions so far on every file, and their wording; and detection of
files that are copies, or from other cells, by folders and by the charge of tests."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise, permutations
from pathlib import Path

from ..cell import CellModel
from ..checks.check_input import LEAST_SHARE
from ..errors import InputError, attempt, counted, printable
from ..job import SIMULATED, FileRole, Use
from ..model.window import Window
from ..notices import Notice
from ..records.fingerprint import Content
from .document import ROLES, Plan
from .looking import CandidateFile, Files, is_same_degc
from .ocv import OcvChoice, Started, ocv_at, ocv_reason, started

# A record that moves this many times the charge of a cell is from another one.
_BEYOND = 1.2
# Tests of one cell between the same voltages, within this share, differ by less than this factor.
_SAME_CELL, _SAME_RANGE = 1.5, 0.9


@dataclass(eq=False)
class Draft:
    """The decisions so far: a role, a reason and a window for some of the files.

    `given_ah` is the given capacity, `is_over` whether all temperatures are requested.
    """

    files: Files
    given_ah: float | None = None
    is_over: bool = False
    taken: dict[CandidateFile, FileRole] = field(default_factory=dict)
    capacity_ah: float | None = None
    tests: dict[CandidateFile, None] = field(default_factory=dict)
    starts: dict[CandidateFile, Started] = field(default_factory=dict)

    @property
    def free(self) -> list[CandidateFile]:
        """The files whose role is not settled."""
        return [file for file in self.files if file not in self.taken]

    def start(self, file: CandidateFile) -> Started:
        """The start of a record; if it was not searched, that of its own window."""
        return self.starts.get(file) or Started(file.window)

    def take(self, file: CandidateFile, role: Use, reason: str) -> None:
        """Settle a file's role, unless it is settled; a simulated file then has its window."""
        if file in self.taken:
            return
        window, source = self.start(file).window if role in SIMULATED else Window(), file.source
        self.taken[file] = FileRole(
            path=file.path,
            name=file.name,
            role=role,
            reason="; ".join(filter(None, (reason, file.evidence))),
            window=window,
            span_s=source.span_s if source else None,
            temperature_degc=file.temperature_degc,
            plans_soc=window.initial_soc is not None and file.chosen.initial_soc is None,
            more=file.more,
            source=None if role == "not used" else file.given or source,
            sha256=source.sha256 if source else "",
        )

    def leave(self, reasons: Mapping[CandidateFile, str]) -> None:
        """Settle that files are not used, each with the reason."""
        for file, reason in reasons.items():
            self.take(file, "not used", reason)

    def take_record(self, file: CandidateFile, capacity_ah: float | None, why: str = "") -> None:
        """Settle that a record is identified on, or validated on if it is unsuitable."""
        if missing := file.missing_for(capacity_ah):
            self.take(file, "validation", f"too little to identify on: {missing}")
        reason = "; ".join(filter(None, (self.words_of(file), why)))
        self.take(file, "identification", reason)

    def take_tests(self, choice: OcvChoice) -> None:
        """Settle the files of an OCV test."""
        self.tests |= dict.fromkeys(choice.tests)
        for test in choice.tests:
            self.take(test, "OCV test", ocv_reason([test], choice.cell.capacity_ah))

    def start_given(
        self, file: CandidateFile, tests: Files, cell: CellModel | None = None
    ) -> OcvChoice | None:
        """Search the start of a record with a given role, on the cell or the OCV test at its
        temperature, which is returned; anything impossible is rejected when the plan is run."""
        degc = file.temperature_degc
        by_test = None if cell else ocv_at(degc, self.files, tests, self.given_ah)
        choice = OcvChoice((), cell.at(degc)) if cell else by_test
        if not isinstance(choice, OcvChoice):
            return None
        if not file.refusal:
            self.no_start(file, choice)
        return choice

    def no_start(self, file: CandidateFile, choice: OcvChoice) -> str:
        """The reason why a record has no start on the OCV; empty if it has one, which is then
        stored."""
        start = attempt(started, self.files, file, choice)
        if isinstance(start, InputError):
            return str(start).removeprefix(f"{file.name}: ")
        self.starts[file] = start
        return ""

    def words_of(self, file: CandidateFile) -> str:
        """The reason why a record is used, according to the checks, and the source of its start."""
        roles = (name for name in ("identification", "validation") if file.serves(name))
        role = next(roles, None)
        return "" if role is None else file.roles[role].reason + self.start(file).words

    def set_temperatures(self) -> None:
        """Put the temperature from a name into the windows of records without a temperature
        column."""
        for file, part in self.taken.items():
            is_open = part.role != "not used" and part.window.temperature_degc is None
            if is_open and file.is_record and file.record.temperature_degc is None:
                window = replace(part.window, temperature_degc=file.temperature_degc)
                self.taken[file] = replace(part, window=window)

    def parts(self) -> tuple[FileRole, ...]:
        """Every file: those with a role first, by role, the best to identify on first.

        Pulse tests have the OCV of their rests, but with an OCV test they are listed as one too.
        """
        parts = []
        best = [file for file, part in self.taken.items() if part.role == "identification"]
        is_given = any(part.role == "OCV test" for part in self.taken.values())
        for file in dict.fromkeys((*best, *self.files)):
            part = replace(self.taken[file], kind=file.kind(self.capacity_ah))
            parts.append(part)
            if is_given and part.role == "identification" and file in self.tests:
                why = ocv_reason([file], self.capacity_ah)
                parts.append(replace(part, role="OCV test", reason=why, window=Window()))
        return tuple(sorted(parts, key=lambda part: ROLES.index(part.role)))


def why_useless(file: CandidateFile, capacity_ah: float | None) -> str:
    reason = file.missing_for(capacity_ah) or another_cell(file, capacity_ah)
    return reason or "no role is left for it"


def another_cell(file: CandidateFile, capacity_ah: float | None) -> str:
    """The reason that a file moves more charge than the cell holds; empty if it does not."""
    span_ah = file.traits.span_ah
    if not capacity_ah or span_ah <= _BEYOND * capacity_ah:
        return ""
    return f"it spans {span_ah:.3g} Ah, and the cell of the OCV test holds {capacity_ah:.3g} Ah"


def copies_of(files: Files, given: Files) -> dict[CandidateFile, Notice]:
    """The files with the same bytes or samples as another one, with a notice for each.

    A given file is kept, and of a record and a part of it the longer one.
    """
    copies: dict[CandidateFile, Notice] = {}
    first_of: dict[tuple[object, ...], CandidateFile] = {}
    for file in sorted(files, key=lambda one: one not in given):
        # A record without a file has no copy.
        source = (file.source.sha256, file.source.span_s) if file.source else (id(file),)
        if (same := first_of.setdefault(source, file)) is not file:
            values = {"same": "bytes", "other": same.name}
            copies[file] = Notice("role.given-twice", values, file.name)
    unlike: list[Content] = []
    records = [file for file in files if file not in copies and file.is_record]
    for file in sorted(records, key=lambda one: (one not in given, -one.record.samples)):
        content = Content(file.record)
        alike = next((other for other in unlike if content.is_like(other)), None)
        if alike is None:
            unlike.append(content)
            continue
        values = {"same": "samples", "other": alike.record.name}
        copies[file] = Notice("role.given-twice", values, file.name)
    return copies


def plan_of_cells(draft: Draft) -> Plan | None:
    """A plan that lists the cells of a folder and asks for one; None if they are one cell.

    Folders that each hold a record, and the same OCV test, belong to different cells.
    """
    files, folders = draft.free, set[Path]()
    for one, other in permutations([file for file in files if passed_ah(file)], 2):
        if _is_repeated(one, other):
            apart = [folder for folder in one.path.parents if folder not in other.path.parents]
            folders |= set(apart[-1:])
    # Only the inner ones of nested folders.
    inner = folders - {outer for folder in folders for outer in folder.parents}
    cells = {path: [one for one in files if path in one.path.parents] for path in sorted(inner)}
    cells = {folder: inside for folder, inside in cells.items() if _records(inside)}
    if len(cells) < 2:
        return None
    listing = []
    for folder, inside in cells.items():
        capacity_ah, count = max(map(passed_ah, inside)), counted(len(inside), "file")
        listing.append(f"{printable(str(folder))} ({capacity_ah:.4g} Ah, {count})")
        draft.leave(dict.fromkeys(inside, f"of the cell in {printable(folder.name)}"))
    draft.leave(dict.fromkeys(draft.free, "beside the folders of several cells"))
    asked = "give the folder of one to barnax identify, or all to barnax fleet"
    missing = f"these are files of {len(cells)} cells, {', '.join(listing)}; {asked}"
    return Plan("identify", draft.parts(), missing=missing)


def _is_repeated(one: CandidateFile, other: CandidateFile) -> bool:
    """True if two OCV tests have the same kind, temperature and direction."""
    same = is_same_degc(one.temperature_degc, other.temperature_degc, is_strict=True)
    directions = [{sweep.direction for sweep in test.traits.sweeps} for test in (one, other)]
    return same and one.kind(None) == other.kind(None) and directions[0] == directions[1]


def _records(files: Files) -> int:
    return sum(file.serves("identification") for file in files)


def passed_ah(file: CandidateFile) -> float:
    """The charge that passes in an OCV test; zero for another file."""
    sweeps = file.traits.sweeps if file.serves("OCV test") else ()
    return max((sweep.passed_ah for sweep in sweeps), default=0.0)


def of_other_cells(files: Files, given_ah: float | None) -> dict[CandidateFile, str]:
    """OCV tests of cells with a different capacity, each with the records that fit it, and the
    reason why they are left out: the intended cell is that of most records.

    `given_ah` is the capacity in Ah of the intended cell, if given.
    """
    tests = {file: passed_ah(file) for file in files if passed_ah(file)}
    ranked = sorted(tests, key=passed_ah)
    largest_ah = [tests[one] for one, next_one in pairwise(ranked) if _is_other(one, next_one)]
    largest_ah += [tests[test] for test in ranked[-1:]]
    cells: dict[float, list[CandidateFile]] = {ah: [] for ah in largest_ah}
    for file in files if len(cells) > 1 else ():
        if file.is_record:
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
    """True if two OCV tests are from different cells; one with a narrower voltage range may be a
    part."""
    spans_v = []
    for test in (smaller, larger):
        volts = [point.voltage_v for sweep in test.traits.sweeps for point in sweep.points]
        spans_v.append(max(volts) - min(volts))
    is_alike = is_same_degc(smaller.temperature_degc, larger.temperature_degc)
    is_alike &= min(spans_v) >= _SAME_RANGE * max(spans_v)
    times = _SAME_CELL if is_alike else 1 / LEAST_SHARE
    return passed_ah(larger) > times * passed_ah(smaller)
