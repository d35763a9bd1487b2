"""Candidate files: each read once, checked, classified, and cut where it holds several tests.

A file that holds a whole schedule is cut into its tests, by full charges and by OCV sweeps.
"""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ..cell import OcvTable, read_ocv_table
from ..cell.model import SAME_DEGC
from ..cell.soc_axis import Sweep
from ..checks import FileCheck, Role, check_file
from ..checks.traits import Traits
from ..errors import InputError, printable
from ..inputs import Watch, file_names, source_of, window_of
from ..model.window import START, Window
from ..records import Record, Source, read_record
from ..records.columns import is_ocv_table
from ..settings import Reading
from .document import merged

ROOM_DEGC = 25.0
# Kinds of tests that have a role.
SERVING = ("OCV test", "slow sweep", "pulse test", "drive cycle")
# What lies in a folder beside measured files, and is no candidate for one.
_BESIDE = (".toml", ".json")
_TEMPORARY = (".", "~$")
# Quantiles of the current by which two profiles are told apart, and by how much of the larger peak
# they differ on average.
_QUANTILES = np.linspace(0.05, 0.95, 19)
_ANOTHER = 0.05
# A charge without a rest of so long that passes this share of what the record spans ends a test.
_PAUSE_S, _BULK = 300.0, 0.3
# A slow one is a test itself.
_SLOW_S = 9 * 3600.0
# What is shorter is no test.
_FEWEST, _SHORTEST_S = 50, 600.0


@dataclass(frozen=True, eq=False)
class CandidateFile:
    """One file that was looked at; `refusal` says why it cannot be read, empty where it can.

    `check` is None for a table of OCV and for what cannot be read. `starts_full` says that the file
    shows a charge to full right before this part of it, `chosen` what its user says of it.
    """

    path: Path
    name: str
    source: Source | None = None
    check: FileCheck | None = None
    refusal: str = ""
    starts_full: bool = False
    chosen: Window = field(default_factory=Window)

    @property
    def traits(self) -> Traits | None:
        return None if self.check is None or self.refusal else self.check.traits

    @property
    def sweeps(self) -> tuple[Sweep, ...]:
        """The sweeps of an OCV test in it."""
        return self.traits.sweeps if self.traits else ()

    @property
    def reach_ah(self) -> float:
        return self.traits.reach_ah if self.traits else 0.0

    @property
    def span_ah(self) -> float:
        return self.traits.span_ah if self.traits else 0.0

    @property
    def temperature_degc(self) -> float | None:
        measured = None if self.traits is None else self.traits.temperature_degc
        return measured if self.chosen.temperature_degc is None else self.chosen.temperature_degc

    def role(self, name: str) -> Role | None:
        """A role that the checks found, usable or not."""
        roles = self.check.roles if self.check else ()
        return next((role for role in roles if role.name == name), None)

    def serves(self, name: str) -> bool:
        """True if it can serve in a role, as the checks say."""
        role = self.role(name)
        # A table has one role.
        return role.is_usable if role else name == "OCV test"

    def kind(self, capacity_ah: float | None) -> str:
        """The kind of file, for a cell of that capacity."""
        if self.refusal:
            return "unreadable"
        return "OCV table" if self.traits is None else self.traits.kind(capacity_ah)

    def missing_for(self, capacity_ah: float | None, is_validated: bool = False) -> str:
        """The reason why it cannot be simulated; empty where it can."""
        return "" if self.traits is None else self.traits.missing_for(capacity_ah, is_validated)

    @property
    def warnings(self) -> int:
        """The number of warnings about it."""
        findings = self.check.findings if self.check else ()
        return sum(finding.counts for finding in findings)

    @cached_property
    def record(self) -> Record:
        return read_record(self.known_source)

    @cached_property
    def table(self) -> OcvTable | None:
        """The table of OCV in it, if that is what it is."""
        is_table = is_ocv_table(self.known_source.table.header, self.known_source.columns)
        return read_ocv_table(self.known_source) if is_table else None

    @property
    def known_source(self) -> Source:
        assert self.source is not None, "what cannot be read is asked for nothing"
        return self.source

    def called(self, name: str) -> "CandidateFile":
        """The same under another name."""
        return replace(self, name=name, source=replace(self.known_source, name=name))

    @property
    def window(self) -> Window:
        """The window that the checks suggest, with what was chosen in its place."""
        role = self.role("validation")
        suggested = role.window if role else None
        window = Window(**suggested.options) if suggested else Window()
        if self.chosen.initial_soc is not None:
            # It is that of the first row, or of the start that is chosen with it.
            window = replace(window, **dict.fromkeys(START))
        elif suggested and self.starts_full and window.start_after_step is None:
            window = replace(window, start_time_s=None, initial_soc=1.0)
        return merged(window, self.chosen)

    @property
    def is_settled(self) -> bool:
        """True if its profile begins with the cell at rest."""
        role = self.role("validation")
        return bool(role and role.window and role.window.is_settled)

    @cached_property
    def _quantiles_a(self) -> Float[np.ndarray, "quantiles"]:
        record, steps = self.record, self.window.score_steps
        is_scored = np.ones(record.samples, bool)
        if steps is not None and record.step is not None:
            is_scored = np.isin(record.step, steps)
        return np.quantile(record.current_a[is_scored], _QUANTILES)

    def is_like(self, other: "CandidateFile") -> bool:
        """True if both play the same profile, by how the current is distributed."""
        peak_a = max(np.abs(traits._quantiles_a).max() for traits in (self, other))
        apart_a = np.abs(self._quantiles_a - other._quantiles_a).mean()
        return bool(apart_a <= _ANOTHER * peak_a)


def files_of(sources: Sequence[Any]) -> list[Any]:
    """The files of what was given, folders replaced by the files in them and in their folders.

    Raises `InputError` for a folder without files.
    """
    files: list[Any] = []
    for source in sources:
        is_folder = isinstance(source, str | Path) and os.path.isdir(source)
        inside = list(_inside(Path(source))) if is_folder else [source]
        if not inside:
            name = printable(str(source))
            raise InputError(f"{name}: has no files; give the folder with the records of a cell")
        files += inside
    return files


def _inside(folder: Path) -> Iterator[Path]:
    """The files in a folder and in its folders, but for results."""
    for path in sorted(folder.iterdir()):
        if path.name.startswith(_TEMPORARY):
            continue
        if not path.is_dir():
            yield from [path] if path.suffix.lower() not in _BESIDE else []
        elif os.access(path, os.R_OK) and not (path / "result.json").exists():
            # A link may lead back.
            yield from [] if folder.resolve().is_relative_to(path.resolve()) else _inside(path)


def found_in(given: Sequence[Any], sources: Sequence[Any]) -> list[Any]:
    """The given sources, names that are no files here replaced by those in a given folder."""
    folders = [Path(source) for source in sources if isinstance(source, str | Path)]

    def found(source: Any) -> Any:
        if not isinstance(source, str | Path) or os.path.exists(source):
            return source
        inside = (folder / source for folder in folders if folder.is_dir())
        return next((path for path in inside if path.exists()), source)

    return [found(source) for source in given]


def look(
    sources: Sequence[Any], reading: Reading, watch: Watch, windows: Mapping[str, Window]
) -> Iterator[CandidateFile]:
    """Every file once, in the order given, with what `windows` say of it. One that cannot be read
    is told as such."""
    names = file_names([source for source in sources if isinstance(source, str | Path)])
    for source in sources:
        name = source.name if isinstance(source, Source) else names[Path(source)]
        path = Path(name if isinstance(source, Source) else source)
        with watch(f"Looking at {name}", 0):
            try:
                yield _looked_at(path, source_of(source, names, reading), window_of(windows, name))
            except InputError as problem:
                yield CandidateFile(path, name, refusal=str(problem))


def _looked_at(path: Path, source: Source, chosen: Window) -> CandidateFile:
    """A file that was read, checked."""
    file = CandidateFile(path, source.name, source, chosen=chosen)
    try:
        if file.table:
            return file
        check = check_file(source, rest_current_a=chosen.rest_current_a)
    except InputError as problem:
        return replace(file, refusal=str(problem))
    file = replace(file, check=check)
    error = next((one for one in check.findings if one.severity == "error"), None)
    if error is None and check.traits is None:
        error = next(iter(check.findings), None)
    if error is not None:
        return replace(file, refusal=str(error.about(source.name)))
    too_little = "" if check.traits else f"{source.name}: holds too few samples that can be read"
    return replace(file, refusal=too_little)


def split(file: CandidateFile) -> list[CandidateFile]:
    """The tests of a file, each as a part of it; the file itself where it holds one at most."""
    parts = list(_joined(file, _tests(file))) if file.traits else []
    if sum(_serves(part, file) for part in parts) < 2:
        return [file]
    return [part.called(f"{file.name}#{number}") for number, part in enumerate(parts, 1)]


def _serves(part: CandidateFile, file: CandidateFile) -> bool:
    """True if a part holds a test by itself, by the charge that the whole file spans."""
    return part.kind(file.traits.span_ah if file.traits else None) in SERVING


def _joined(file: CandidateFile, parts: Iterable[CandidateFile]) -> Iterator[CandidateFile]:
    """The parts, drive cycles joined that no charge to full lies between: as one they know where
    each of them starts."""
    before: CandidateFile | None = None
    for part in parts:
        kinds = {piece.kind(None) for piece in (before, part) if piece is not None}
        if before is None:
            before = part
        elif kinds == {"drive cycle"} and not part.starts_full:
            spans = [piece.known_source.span_s or (0.0, 0.0) for piece in (before, part)]
            first, last = np.searchsorted(file.record.time_s, [spans[0][0], spans[1][1]]).tolist()
            before = _part(file, first, last, before.starts_full)
        else:
            yield before
            before = part
    if before is not None:
        yield before


def _tests(file: CandidateFile) -> Iterator[CandidateFile]:
    """The tests of a file, some of which may begin with the cell charged to full."""
    record = file.record
    for first, last, is_full in _between_charges(record):
        if not _is_long(record, first, last):
            continue
        part = _part(file, first, last, is_full)
        rows = [
            point.row for sweep in part.sweeps if sweep.kind == "rests" for point in sweep.points
        ]
        begin, end = np.flatnonzero(np.isin(record.row, rows))[[0, -1]] if rows else (first, last)
        # A sweep begins where its first rest ends, and may end at a cut-off without a rest.
        for cut, beside in ((int(end), (int(end), last)), (int(begin), (first, int(begin)))):
            if _is_long(record, *beside) and _serves(_part(file, *beside), file):
                yield _part(file, first, cut, is_full)
                yield _part(file, cut, last)
                break
        else:
            yield part


def _part(file: CandidateFile, first: int, last: int, is_full: bool = False) -> CandidateFile:
    time_s = file.record.time_s
    source = replace(file.known_source, span_s=(float(time_s[first]), float(time_s[last])))
    return replace(_looked_at(file.path, source, file.chosen), starts_full=is_full)


def _between_charges(record: Record) -> Iterator[tuple[int, int, bool]]:
    """Spans between the ends of the record's long charges, and whether each follows a full one."""
    discharged_ah = record.discharged_ah
    span_ah = record.span_ah
    rest_a = record.rest_current_a(span_ah)
    full = {*record.segments(rest_a).full_charges(span_ah)}
    charging = np.flatnonzero(record.current_a < -rest_a)
    discharging = np.flatnonzero(record.current_a > rest_a)
    begin, is_full = 0, False
    is_cut = np.diff(record.time_s[charging]) > _PAUSE_S
    is_cut |= np.diff(np.searchsorted(discharging, charging)) != 0
    for run in np.split(charging, np.flatnonzero(is_cut) + 1):
        if not len(run):
            continue
        first, last = int(run[0]), int(run[-1])
        if discharged_ah[first] - discharged_ah[last] < _BULK * span_ah:
            continue
        is_slow = record.time_s[last] - record.time_s[first] > _SLOW_S
        yield begin, (last if is_slow else max(first - 1, begin)), is_full
        is_full = last in full
        begin = min(last + 1, record.samples - 1)
    yield begin, record.samples - 1, is_full


def _is_long(record: Record, first: int, last: int) -> bool:
    is_loaded = np.any(record.current_a[first : last + 1])
    length_s = record.time_s[last] - record.time_s[first]
    return bool(is_loaded and last - first >= _FEWEST and length_s >= _SHORTEST_S)


def by_temperature(
    files: Sequence[CandidateFile],
) -> Iterator[tuple[float | None, list[CandidateFile]]]:
    """The files of each temperature: the most first, and of equally many those nearest to room."""
    groups: list[list[CandidateFile]] = []
    for file in sorted(files, key=lambda one: (one.temperature_degc or 0.0, one.name)):
        for group in groups:
            if is_same_degc(group[0].temperature_degc, file.temperature_degc, is_strict=True):
                group.append(file)
                break
        else:
            groups.append([file])

    def rank(group: list[CandidateFile]) -> tuple[int, float]:
        degc = group[0].temperature_degc
        return -len(group), np.inf if degc is None else abs(degc - ROOM_DEGC)

    for group in sorted(groups, key=rank):
        degc = group[0].temperature_degc
        # A file of unknown temperature may be of this one.
        unknown = [file for file in files if degc is not None and file.temperature_degc is None]
        yield degc, [*group, *unknown]


def is_same_degc(one: float | None, other: float | None, is_strict: bool = False) -> bool:
    """True if two temperatures are one; an unknown one may be any, unless `is_strict`."""
    if one is None or other is None:
        return one is other or not is_strict
    return abs(one - other) <= SAME_DEGC
