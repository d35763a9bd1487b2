"""The files of an OCV test, and the start of a record on it: at full, or at the end of another
record."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from ..cell import CellModel
from ..cell.characterize import characterize
from ..cell.soc_axis import CAPACITY_WARNING, CHARGE, DISCHARGE, WORD, Sweep
from ..errors import InputError, attempt
from ..model.prepared import PreparedRecord, prepare_record
from ..model.window import Window, first_sample
from ..records.log import goes_on, pause_s
from .looking import CandidateFile, Files, is_same_degc

# A rested cell this near full is full: the last digits of its voltage reflect the rest before.
_FULL = 0.005
# A quarter of the charge without a point is a hole in an OCV test.
_HOLE = 0.25
# Digits to which a capacity and a state of charge are known.
DIGITS = 4
# One test may take this much more charge out of a cell than another; a larger cell takes more than
# that.
_LITTLE_MORE = 1.15
# A file continues another if its counters agree to this share of the capacity, at most this much
# later.
_SAME_COUNT, _PAUSE_S = 1e-3, 3600.0


@dataclass(frozen=True, eq=False)
class OcvChoice:
    """The files of the OCV test, and the cell characterized from them.

    `capacity_ah` is the capacity that they require; None if they determine it themselves.
    """

    tests: tuple[CandidateFile, ...]
    cell: CellModel
    capacity_ah: float | None = None

    @classmethod
    def of(cls, tests: Files, capacity_ah: float | None) -> Self:
        """The files with their cell. Raises `InputError` if they do not determine one."""
        cell = characterize([test.content for test in tests], capacity_ah=capacity_ah)
        return cls(tuple(tests), cell, capacity_ah)

    @property
    def has_temperatures(self) -> bool:
        return all(test.temperature_degc is not None for test in self.tests)


def ocv_at(
    degc: float | None, free: Files, tests: Files, given_ah: float | None
) -> OcvChoice | InputError | None:
    """The OCV test at a temperature: the given one, or the reason why it is none, else the best
    one, if any. `given_ah` is the given capacity."""
    near = [file for file in free if is_same_degc(file.temperature_degc, degc)]
    records = [file.traits.longest_discharge_ah for file in near if file.is_record]
    longest_ah = max(records, default=0.0) or None
    if tests:
        alike = [file for file in tests if is_same_degc(file.temperature_degc, degc)]
        return _first_cell([alike or tests], given_ah, longest_ah)
    alike = [file for file in near if is_same_degc(file.temperature_degc, degc, is_strict=True)]
    for candidates in (alike, near):
        serving = [file for file in candidates if file.serves("OCV test")]
        max_ah = max((sweep.passed_ah for sweep in sweeps_of(serving)), default=0.0)
        sets = sorted(_sets(serving), key=lambda tests, max_ah=max_ah: _rank(tests, max_ah))
        if isinstance(choice := _first_cell(sets, given_ah, longest_ah), OcvChoice):
            return choice
    return None


def _first_cell(
    sets: Sequence[Files], given_ah: float | None, longest_ah: float | None
) -> OcvChoice | InputError | None:
    """The first set of files that gives a cell, with the given capacity or by itself, or if none
    does with the longest discharge, else the reason why the first fails; None without any."""
    refusal = None
    by_itself = itertools.product(sets, dict.fromkeys((given_ah, None)))
    by_longest = itertools.product(sets, [longest_ah] if longest_ah else [])
    for tests, capacity_ah in itertools.chain(by_itself, by_longest):
        choice = attempt(OcvChoice.of, tests, capacity_ah)
        if isinstance(choice, OcvChoice):
            return choice
        refusal = refusal or choice
    return refusal


def ocv_reason(tests: Files, capacity_ah: float | None = None) -> str:
    """The sweeps of a set of tests, in words, with the capacity of the cell, or the charge they
    passed if it is not used."""
    sweeps = sweeps_of(tests)
    if not sweeps:
        return "a table of OCV over state of charge"
    kinds = {
        sweep.direction: f"{WORD[sweep.direction]} "
        + (f"with {len(sweep.points)} rests" if sweep.kind == "rests" else "by a slow sweep")
        for sweep in sweeps
    }
    shown_ah = capacity_ah or max(sweep.passed_ah for sweep in sweeps)
    return f"{' and '.join(kinds.values())}, {shown_ah:.4g} Ah"


def _sets(candidates: Files) -> Iterator[Files]:
    """Every file by itself, every two of opposite directions, and all parts in one direction."""
    outward, inward = (
        [file for file in candidates if _directions([file]) == {direction}]
        for direction in (DISCHARGE, CHARGE)
    )
    yield from ([file] for file in candidates)
    yield from itertools.product(outward, inward)
    if max(len(outward), len(inward)) > 1:
        yield [*outward, *inward]


def _rank(tests: Files, max_ah: float) -> tuple:
    """Sort key of tests: those without holes before others, both directions before one, tests that
    close before others, separate tests before pulse tests, rests before slow sweeps, and many
    points before few."""
    sweeps = sweeps_of(tests)
    passed_ah = [sweep.passed_ah for sweep in sweeps] or [0.0]
    return (
        _hole_ah(sweeps, max_ah) > _HOLE * max_ah,
        -len(_directions(tests)),
        min(passed_ah) < (1 - CAPACITY_WARNING) * max(passed_ah),
        # A table comes last: it has no charge.
        not sweeps,
        any(test.kind(None) == "pulse test" for test in tests),
        any(sweep.kind == "slow" for sweep in sweeps),
        sum(test.warnings for test in tests),
        -sum(len(sweep.points) for sweep in sweeps),
    )


def _hole_ah(sweeps: Sequence[Sweep], max_ah: float) -> float:
    """The largest charge without a point. For a cell that passes `max_ah`, the range that a single
    direction does not reach counts too; two that close reach both ends."""
    gaps_ah = [0.0]
    for sweep in sweeps:
        at_ah = [sweep.start_ah, *sweep.discharged_ah, sweep.end_ah]
        gaps_ah.append(float(np.abs(np.diff(at_ah)).max()))
    if len({sweep.direction for sweep in sweeps}) == 1:
        gaps_ah.append(max_ah - sum(sweep.passed_ah for sweep in sweeps))
    return max(gaps_ah)


def sweeps_of(tests: Files) -> list[Sweep]:
    return [sweep for test in tests for sweep in test.traits.sweeps]


def _directions(tests: Files) -> set[int]:
    return {sweep.direction for sweep in sweeps_of(tests)}


class Started(NamedTuple):
    """A record's window, the source of its start in words, and whether it starts full."""

    window: Window
    words: str = ""
    is_full: bool = False


def started(files: Files, file: CandidateFile, choice: OcvChoice) -> Started:
    """The window of a record and the source of its start, in words; a record that does not
    determine its own start gets it from the end of the file that it continues. Raises `InputError`
    if neither works."""
    window = file.window
    prepared = attempt(_prepared, file, window, choice, window.initial_soc == 1.0)
    if isinstance(prepared, InputError):
        # A record may take a little more charge out of the full cell than the test did.
        fuller = attempt(_prepared, file, window, choice, True)
        most_ah = _LITTLE_MORE * choice.cell.capacity_ah
        is_read = isinstance(fuller, PreparedRecord) and fuller.start.soc >= 1 - _FULL
        if is_read and (fuller.window.capacity_ah or math.inf) <= most_ah:
            return Started(fuller.window, is_full=True)
    if isinstance(prepared, InputError) or prepared.start.soc_source == "fitted":
        before = next((other for other in files if _goes_on(other, file, choice)), None)
        soc = before and attempt(_final_soc, files, before, choice)
        if before and isinstance(soc, float) and not window.is_chosen:
            begun = replace(window, initial_soc=soc)
            _prepared(file, begun, choice)
            return Started(begun, f", where {before.name} ends")
    if isinstance(prepared, InputError):
        raise prepared
    # A start within the record is read from it when it is run, as without a plan.
    start = prepared.start
    shown = f", at full: {start.voltage_v:.4f} V" if start.soc_source == "full voltage" else ""
    is_full = window.initial_soc is None and start.soc >= 1 - _FULL
    return Started(window, shown, is_full)


def _prepared(
    file: CandidateFile, window: Window, choice: OcvChoice, is_full: bool = False
) -> PreparedRecord:
    """A record prepared for simulation, as one that starts full or not. Raises `InputError` if that
    is impossible."""
    capacity_ah = record_capacity_ah(file, window, choice, is_full)
    counted = replace(window, capacity_ah=capacity_ah)
    return prepare_record(file.record, choice.cell, "so-rc", counted)


def _goes_on(before: CandidateFile, file: CandidateFile, choice: OcvChoice) -> bool:
    """True if a file's clock, or its counters, continue where those of another end."""
    if not before.is_record or not file.is_record or before is file:
        return False
    first, second = before.record, file.record
    if goes_on(first, second):
        return True
    if first.charge_ah is None or second.charge_ah is None or not second.charge_ah[0]:
        return False
    apart_ah = abs(float(second.charge_ah[0] - first.charge_ah[-1]))
    least_ah = _SAME_COUNT * choice.cell.capacity_ah
    return 0 <= pause_s(first, second) <= _PAUSE_S and apart_ah <= least_ah


def _final_soc(files: Files, file: CandidateFile, choice: OcvChoice) -> float:
    """The state of charge at the end of a file. Raises `InputError` if neither it nor the one
    before it determines that."""
    prepared = _prepared(file, started(files, file, choice).window, choice)
    return float(f"{prepared.soc[-1]:.{DIGITS}g}")


def record_capacity_ah(
    file: CandidateFile, window: Window, choice: OcvChoice, is_full: bool
) -> float | None:
    """The given capacity, else the charge that the record takes out of the full cell, if it starts
    full and that exceeds the OCV test's."""
    if window.capacity_ah is not None or not is_full:
        return window.capacity_ah
    discharged_ah = file.record.discharged_ah[first_sample(file.record, window, 0.0) :]
    taken_ah = float(discharged_ah.max() - discharged_ah[0])
    return float(f"{taken_ah:.{DIGITS}g}") if taken_ah > choice.cell.capacity_ah else None
