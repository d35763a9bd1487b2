"""Candidate files: each read once, checked, classified, and cut if it holds several tests.

A file that holds a whole schedule is cut into its tests, by full charges and by OCV sweeps.
"""

import os
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ..cell import OcvTable, read_ocv_test
from ..cell.model import REFERENCE_DEGC, SAME_DEGC, group_near
from ..checks import Role, check_file
from ..checks.check_input import NO_TRAITS, Kind, Traits
from ..checks.roles import SuggestedWindow
from ..errors import InputError, attempt
from ..inputs import file_names, name_of, named_source, numbered
from ..job import Job, Use, window_of, windows_by_name
from ..model.window import START, Window, Windows, merged, temperature_of
from ..notices import refusal_of
from ..records import Record, Source
from ..records.log import NEXT_FILE, continuation, joined
from ..records.record import TAPERED
from ..settings import Reading

# Kinds of tests that have a role.
SERVING = ("OCV test", "slow sweep", "pulse test", "drive cycle")
# Quantiles of the current by which two profiles are compared, and the average difference, as a
# share of the larger peak, from which on they differ.
_QUANTILES = np.linspace(0.05, 0.95, 19)
_ANOTHER = 0.05
# A charge, with no rest of this length, that passes this share of the record's span ends a test.
_PAUSE_S, _BULK, _NEAR_FULL_V = 300.0, 0.3, 0.02
# A slow one is itself a test.
_SLOW_S = 9 * 3600.0
# Anything shorter is no test.
_FEWEST, _SHORTEST_S = 50, 600.0


@dataclass(frozen=True, eq=False)
class CandidateFile:
    """A file that was examined, with the findings of the checks.

    `more` are the further files of its log, with the `evidence` for them. `refusal` is the reason
    why it cannot be read. `traits` are those of a record, and `warnings` the number of those about
    it. `starts_full` is True if the file has a charge to full right before this part of it,
    `chosen` holds the user's choices for it, and `how` the way it is read. A record or table passed
    as data is `given`, and not examined.
    """

    path: Path
    name: str
    source: Source | None = None
    more: tuple[Path, ...] = ()
    evidence: str = ""
    refusal: InputError | None = None
    traits: Traits = NO_TRAITS
    roles: Mapping[str, Role] = field(default_factory=dict)
    warnings: int = 0
    starts_full: bool = False
    chosen: Window = field(default_factory=Window)
    how: Mapping[str, Any] = field(default_factory=dict)
    given: Record | OcvTable | None = None

    @property
    def is_record(self) -> bool:
        """True for a readable file other than an OCV table."""
        return self.traits is not NO_TRAITS

    @property
    def temperature_degc(self) -> float | None:
        given = self.chosen.temperature_degc
        return self.traits.temperature_degc if given is None else given

    def serves(self, name: str) -> bool:
        """True if it can have a role, according to the checks."""
        return name in self.roles and self.roles[name].is_usable

    def kind(self, capacity_ah: float | None) -> Kind | str:
        """The kind of file, for a cell of that capacity."""
        if self.is_record:
            return "" if self.given else self.traits.kind(capacity_ah)
        return "unreadable" if self.refusal else "OCV table"

    def missing_for(self, capacity_ah: float | None, is_validated: bool = False) -> str:
        """The reason why it cannot be simulated; empty if it can."""
        return self.traits.missing_for(capacity_ah, is_validated) if self.is_record else ""

    @cached_property
    def content(self) -> Record | OcvTable:
        """Its record or table. Raises `InputError` if it cannot be read."""
        return self.given or read_ocv_test(self.readable, **self.how)

    @property
    def record(self) -> Record:
        assert isinstance(self.content, Record), "a table is asked for no samples"
        return self.content

    @property
    def readable(self) -> Source:
        """Its source. Raises `InputError` if nothing was read."""
        if self.source is None:
            raise self.refusal or InputError(f"{self.name}: was not read")
        return self.source

    @property
    def suggested(self) -> SuggestedWindow | None:
        """The window that the checks suggest."""
        return self.roles["validation"].window if "validation" in self.roles else None

    @property
    def window(self) -> Window:
        """The window that the checks suggest, with the user's choices applied."""
        suggested = self.suggested
        window = suggested.window if suggested else Window()
        if self.chosen.initial_soc is not None:
            # A chosen SOC applies to the first row, or to the start that is chosen with it.
            window = replace(window, **dict.fromkeys(START))
        elif suggested and self.starts_full and window.start_after_step is None:
            window = replace(window, start_time_s=None, initial_soc=1.0)
        return merged(window, self.chosen)

    @cached_property
    def _quantiles_a(self) -> Float[np.ndarray, "quantiles"]:
        record, steps = self.record, self.window.score_steps
        is_scored = np.ones(record.samples, bool)
        if steps is not None and record.step is not None:
            is_scored = np.isin(record.step, steps)
        return np.quantile(record.current_a[is_scored], _QUANTILES)

    def is_like(self, other: "CandidateFile") -> bool:
        """True if both have the same profile, by the distribution of the current."""
        peak_a = max(np.abs(file._quantiles_a).max() for file in (self, other))
        apart_a = np.abs(self._quantiles_a - other._quantiles_a).mean()
        return bool(apart_a <= _ANOTHER * peak_a)


Files = Sequence[CandidateFile]


def look(given: Mapping[Use, Sequence[Any]], job: Job) -> dict[Use, list[CandidateFile]]:
    """Every file once, in the order given, by the role for which it is read, with the windows that
    a job gives for it; those of one log that was cut under load as one. One that cannot be read has
    a refusal."""
    items = [item for several in given.values() for item in several]
    names, called = file_names(items), dict[str, int]()
    candidates: dict[Use, list[CandidateFile]] = {role: [] for role in given}
    for role, several in given.items():
        for item in several:
            is_path = isinstance(item, str | Path)
            name = names[Path(item)] if is_path else name_of(item)
            file = CandidateFile(Path(item if is_path else name), name)
            if isinstance(item, Source) and role != "OCV test":
                item = numbered(item, called)
            read = partial(named_source, item, role, names, called, job)
            with job.watch(f"Looking at {name}", 0):
                candidates[role].append(_looked_at(file, read, role, job, job.window))
    # Options given for a file by its name apply to that file alone.
    named = {*windows_by_name(job.window), *job.lags_s} - {""}
    common = window_of(job.window, "")
    for role in candidates.keys() - {"OCV test"}:
        look_at = partial(_looked_at, role=role, reading=job, window=common)
        candidates[role] = list(_whole_logs(candidates[role], named, look_at))
    return candidates


def _looked_at(
    file: CandidateFile,
    read: Callable[[], Any],
    role: str,
    reading: Reading,
    window: Windows,
) -> CandidateFile:
    """A file that is read, with the findings of the checks, or with the reason if it is
    rejected."""
    if isinstance(source := attempt(read), InputError):
        return replace(file, refusal=source)
    chosen = window_of(window, source.name)
    how = reading.of_record(source.name, role)
    file = replace(file, name=source.name, chosen=chosen, how=how)
    if isinstance(source, Source):
        file = replace(file, source=source)
        checked = attempt(_checked, file)
        return replace(file, refusal=checked) if isinstance(checked, InputError) else checked
    is_record = isinstance(source, Record)
    traits = Traits(temperature_degc=temperature_of(source, chosen)) if is_record else NO_TRAITS
    return replace(file, given=source, traits=traits)


def _whole_logs(
    files: Sequence[CandidateFile],
    named: Collection[str],
    look_at: Callable[[CandidateFile, Callable[[], Any]], CandidateFile],
) -> Iterator[CandidateFile]:
    """The files, those that continue each other under load as one; each by itself if several may
    continue it, if its name is among those `named`, or if they make no record together."""
    pieces = [
        file
        for file in files
        if file.is_record
        and os.path.isfile(file.path)
        and file.name not in named
        and NEXT_FILE not in file.name
        and file.kind(None) not in ("slow sweep", "OCV test")
    ]
    pairs = [
        (one, other, evidence)
        for one, other in permutations(pieces, 2)
        if one.path.parent == other.path.parent
        and is_same_degc(one.temperature_degc, other.temperature_degc)
        and (evidence := continuation(one.record, other.record))
    ]
    before = Counter(other for _, other, _ in pairs)
    after = Counter(one for one, _, _ in pairs)
    following = {one: (other, why) for one, other, why in pairs if before[other] == after[one] == 1}
    later = {other for other, _ in following.values()}
    for first in files:
        if first in later:
            continue
        log, evidence = [first], list[str]()
        while log[-1] in following:
            other, why = following[log[-1]]
            log.append(other)
            evidence.append(why)
        more = tuple(file.path for file in log[1:])
        whole = replace(first, more=more, evidence="; ".join(evidence))
        together = look_at(whole, partial(joined, [one.readable for one in log])) if more else first
        yield from log if together.refusal else [together]


def _checked(file: CandidateFile) -> CandidateFile:
    """A file that was read, with the findings of the checks. Raises `InputError` if they cannot
    process it."""
    check = check_file(file.readable, rest_current_a=file.chosen.rest_current_a, **file.how)
    roles = {role.name: role for role in check.roles}
    if check.traits is None and roles:
        return replace(file, roles=roles)
    refusal = refusal_of(check.findings, file.name)
    if check.traits is None or refusal is not None:
        return replace(file, refusal=refusal)
    warnings = sum(finding.counts for finding in check.findings)
    return replace(file, traits=check.traits, roles=roles, warnings=warnings)


def split(file: CandidateFile) -> list[CandidateFile]:
    """The tests in a file, each as a part of it; the file itself if it holds at most one."""
    parts = _joined(file, _tests(file)) if file.is_record else []
    if sum(_serves(part, file) for part in parts) < 2:
        return [file]
    names = [f"{file.name}#{number}" for number in range(1, len(parts) + 1)]
    return [
        replace(part, name=name, source=replace(part.readable, name=name))
        for part, name in zip(parts, names, strict=True)
    ]


def _serves(part: CandidateFile, file: CandidateFile) -> bool:
    """True if a part holds a test by itself, by the charge that the whole file spans."""
    return part.kind(file.traits.span_ah) in SERVING


def _joined(file: CandidateFile, parts: Iterable[CandidateFile]) -> list[CandidateFile]:
    """The parts, with drive cycles joined if no charge to full lies between them: together, each
    has a known start."""
    joined: list[CandidateFile] = []
    for part in parts:
        are_drives = joined and joined[-1].kind(None) == part.kind(None) == "drive cycle"
        if not are_drives or part.starts_full:
            joined.append(part)
            continue
        spans = [piece.readable.span_s or (0.0, 0.0) for piece in (joined[-1], part)]
        first, last = np.searchsorted(file.record.time_s, [spans[0][0], spans[1][1]]).tolist()
        joined[-1] = _part(file, first, last, joined[-1].starts_full)
    return joined


def _tests(file: CandidateFile) -> Iterator[CandidateFile]:
    """The tests in a file, some of which may begin with the cell charged to full."""
    record = file.record
    for first, last, is_full in _between_charges(record):
        if not _is_long(record, first, last):
            continue
        part = _part(file, first, last, is_full)
        by_rests = [sweep for sweep in part.traits.sweeps if sweep.kind == "rests"]
        rows = [point.row for sweep in by_rests for point in sweep.points]
        at = np.flatnonzero(np.isin(record.row, rows)).tolist() or [first, last]
        # A sweep begins where its first rest ends, and may end at a cut-off without a rest.
        for cut, beside in ((at[-1], (at[-1], last)), (at[0], (first, at[0]))):
            if _is_long(record, *beside) and _serves(_part(file, *beside), file):
                yield _part(file, first, cut, is_full)
                yield _part(file, cut, last)
                break
        else:
            yield part


def _part(file: CandidateFile, first: int, last: int, is_full: bool = False) -> CandidateFile:
    if (first, last) == (0, file.record.samples - 1):
        return replace(file, starts_full=is_full)
    time_s = file.record.time_s
    source = replace(file.readable, span_s=(float(time_s[first]), float(time_s[last])))
    part = CandidateFile(file.path, file.name, source, file.more, file.evidence)
    return _checked(replace(part, starts_full=is_full, chosen=file.chosen, how=file.how))


def _between_charges(record: Record) -> Iterator[tuple[int, int, bool]]:
    """Spans between the ends of the record's long charges, and whether each follows a full one."""
    discharged_ah = record.discharged_ah
    span_ah = record.span_ah
    rest_a = record.rest_current_a(span_ah)
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
        current_a = record.current_a[run]
        is_near = record.voltage_v[last] > record.voltage_v.max() - _NEAR_FULL_V
        is_full = bool(is_near and current_a[-1] > TAPERED * current_a.min())
        begin = min(last + 1, record.samples - 1)
    yield begin, record.samples - 1, is_full


def _is_long(record: Record, first: int, last: int) -> bool:
    is_loaded = np.any(record.current_a[first : last + 1])
    length_s = record.time_s[last] - record.time_s[first]
    return bool(is_loaded and last - first >= _FEWEST and length_s >= _SHORTEST_S)


def by_temperature(files: Files) -> Iterator[tuple[float | None, Files]]:
    """The files at each temperature: the largest group first, equal ones by distance from room
    temperature."""
    unknown = [file for file in files if file.temperature_degc is None]
    by_name = sorted(files, key=lambda file: file.name)
    measured = [(degc, file) for file in by_name if (degc := file.temperature_degc) is not None]

    def rank(group: Files) -> tuple[int, float]:
        degc = group[0].temperature_degc
        return -len(group), np.inf if degc is None else abs(degc - REFERENCE_DEGC)

    # A file of unknown temperature may belong to any group.
    groups = [*group_near(measured).values()]
    groups += [[file for file in by_name if file in unknown]] if unknown else []
    for group in sorted(groups, key=rank):
        degc = group[0].temperature_degc
        yield degc, [*group, *(unknown if degc is not None else ())]


def is_same_degc(one: float | None, other: float | None, is_strict: bool = False) -> bool:
    """True if two temperatures are equal; an unknown one may be any, unless `is_strict`."""
    if one is None or other is None:
        return one is other or not is_strict
    return abs(one - other) <= SAME_DEGC
