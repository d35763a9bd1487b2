"""The plan for several files: the temperature, the OCV test, and the records for identification and
validation."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..inputs import listed
from ..job import Job, Use, takes_options
from ..notices import Notice
from ..records import Given
from ..records.source import files_of
from ..settings import OVER_TEMPERATURE
from .document import Plan, named_degc
from .draft import Draft, another_cell, copies_of, of_other_cells, plan_of_cells, why_useless
from .looking import CandidateFile, Files, by_temperature, is_same_degc, look, split
from .ocv import DIGITS, OcvChoice, Started, ocv_at, ocv_reason, record_capacity_ah, sweeps_of

# Kinds of records to identify on, the most dynamic load first.
_LOADS = ("drive cycle", "pulse test", "OCV test")
# Ranges of charge within this share of the widest count as equal, and other criteria decide.
_AS_WIDE = 0.9
# A record that moves this many times the capacity is from another cell, or in another unit.
_ANOTHER = 1.5
# A charge of this share of the capacity covers the other direction.
_MUCH = 0.5
NO_RECORD = "no record can be identified on, for the reason beside each file; "
OTHER_CELL = "for the reason beside each file; leave it out of the folder if it is of another cell"
MAKE_RECORD = (
    "measure a drive cycle, or pulses after rests (HPPC), sampled about every second under load, "
    "over most of the state of charge"
)
# The files of each temperature with their OCV test.
Chosen = Sequence[tuple[Files, OcvChoice | None]]


@takes_options(Job)
def plan(job: Job) -> Plan:
    """The plan for a folder or several files of one cell, with reasons; nothing is run.

    Records are combined only with an OCV test at the same temperature. If a test is missing, the
    plan names it.

    Args:
        records: A folder, or files.
        ocv: Files that are OCV tests; bare names refer to files in the folder.
        validate: Files to validate on, likewise.
        over: With "soc,temperature", and for a folder of pulse tests alone, one record at each
            temperature is identified, with its own OCV test if there is one.

    Raises `InputError` if there is no such file or none can be read.

    >>> from barnax.bundled import BUNDLED
    >>> found = plan([BUNDLED.validation, *BUNDLED.ocv, BUNDLED.record])
    >>> [part.name for part in found.of_role("identification")]
    ['identification.parquet', 'validation.parquet']
    """
    folders = [Path(source) for source in listed(job.records) if isinstance(source, str | Path)]
    given, tests, others = (
        files_of(listed(several), folders) for several in (job.records, job.ocv, job.validate)
    )
    free = [file for file in given if not _resolved([file]) & _resolved([*tests, *others])]
    if not free and (twice := [file for file in given if _resolved([file]) & _resolved(others)]):
        raise Notice("role.given-twice", {"same": "name"}, Path(twice[0]).name).error()
    roles: dict[Use, Any] = {"identification": free, "OCV test": tests, "validation": others}
    free, tests, others = look(roles, job).values()
    if all(file.refusal for file in (*free, *tests, *others)):
        raise InputError("\n".join(str(file.refusal) for file in (*free, *tests, *others)))
    # A folder may contain unrelated files; those with a given role are intended.
    for file in (*tests, *others):
        if file.refusal:
            raise file.refusal
    with job.watch("Planning", 0):
        files = [*(part for file in free for part in split(file)), *tests, *others]
        draft = Draft(files, given_ah=job.given_ah, is_over=job.over == OVER_TEMPERATURE)
        return _decide(draft, tests, others)


def _resolved(files: Sequence[Given]) -> set[Path]:
    return {Path(file).resolve() for file in files if isinstance(file, str | Path)}


def _decide(draft: Draft, tests: Files, others: Files) -> Plan:
    """The plan for files of which some have a given role."""
    _take_given(draft, tests, others)
    if not tests:
        if (several := plan_of_cells(draft)) is not None:
            return several
        draft.leave(of_other_cells(draft.free, draft.given_ah))
    free = draft.free
    records = [file for file in free if file.serves("identification")]
    # An OCV test with enough pulses is a record too if there is no other.
    dynamic = [file for file in records if file.kind(None) != "OCV test"] or records
    groups = list(by_temperature(dynamic or free))
    # An OCV test at the same temperature comes before many records, and a drive before pulses.
    chosen = list[tuple[Files, OcvChoice | None]]()
    for degc, group in sorted(groups, key=lambda pair: not _holds_drive(pair[1])):
        if isinstance(test := ocv_at(degc, free, tests, draft.given_ah), InputError):
            raise test
        chosen.append((group, test))
    with_test = [(group, test) for group, test in chosen if test]
    if not with_test:
        groups = [group for group, _ in chosen if dynamic]
        return _on_records(draft, groups) or _without_record(draft, free)
    choice, is_pulsed, runs = with_test[0][1], False, list[CandidateFile]()
    for group, choice in with_test if dynamic else []:
        is_pulsed = not _holds_drive(group)
        runs = _runnable(draft, group, choice, is_pulsed)
        if not runs:
            pulses = [test for test in choice.tests if test.kind(None) == "pulse test"]
            is_pulsed, runs = True, _runnable(draft, pulses, choice, True)
        if runs:
            break
    draft.capacity_ah = choice.cell.capacity_ah
    if not runs:
        draft.take_tests(choice)
        _leave_others(draft, choice, [])
        names = " and ".join(test.name for test in choice.tests)
        unfit = f"no record can be identified on with the OCV test {names}, {OTHER_CELL}"
        missing = unfit if dynamic else NO_RECORD + MAKE_RECORD
        return Plan("identify", draft.parts(), missing=missing)
    record = runs[0]
    is_pulse_test = is_pulsed and choice.tests == (record,)
    why = f"{ocv_reason([record], choice.cell.capacity_ah)}; " if is_pulse_test else ""
    draft.take(record, "identification", why + draft.words_of(record))
    draft.take_tests(choice)
    if draft.is_over or is_pulsed:
        runs = [record, *(file for file in runs if file not in draft.taken)]
        if not others and runs[1:]:
            _choose_validation(draft, record, runs[1:])
        _take_other_temperatures(draft, record, chosen, choice, is_pulsed)
    else:
        _take_others(draft, runs[1:], choice.cell.capacity_ah)
        if choice.cell.has_flat_ocv:
            _take_charges(draft, record, choice)
    _leave_others(draft, choice, chosen)
    options, reasons = ({}, {}) if is_pulse_test else options_of(draft, runs, choice)
    return Plan("hppc" if is_pulsed else "identify", draft.parts(), options, reasons)


def _take_given(draft: Draft, tests: Files, others: Files) -> None:
    """Settle the files with a given role, and leave out unreadable files and copies."""
    for file in draft.files:
        lines = [line.removeprefix(f"{file.name}: ") for line in str(file.refusal).splitlines()]
        draft.leave({file: "; ".join(lines)} if file.refusal else {})
    copies = copies_of(draft.free, (*tests, *others))
    draft.leave({file: same.what for file, same in copies.items()})
    has_free = any(file not in (*tests, *others) for file in draft.free)
    # Copies in a folder are left out; a file given for validation is intended.
    doubled = [file for file in others if file in copies] or ([] if has_free else [*copies])
    if others and doubled:
        raise copies[doubled[-1]].error()
    for file in others:
        draft.start_given(file, tests)
        draft.take(file, "validation", "given")
    for file in tests:
        draft.take(file, "OCV test", "given")


def _on_records(draft: Draft, groups: Sequence[Files]) -> Plan | None:
    """A plan without an OCV test, if the records at one temperature suffice, or those at several
    for tables over temperature: the OCV is then fitted to the records."""
    dated = [group for group in groups if draft.is_over and group[0].temperature_degc is not None]
    # If the temperatures are too few, that is rejected as for files with given roles.
    for together in (dated, *([group] for group in groups)):
        runs = [run for group in together for run in _without_test(draft, group)]
        if not runs:
            continue
        record = runs[0]
        for file in runs:
            alone = file is record and len(together) == 1
            its = "its OCV" if alone else "the OCV of its temperature" if draft.is_over else ""
            why = f"{its} is identified with it, because there is no OCV test" if its else ""
            draft.take_record(file, draft.given_ah, why)
        if draft.is_over:
            draft.set_temperatures()
        at = named_degc(record.temperature_degc)
        for file in draft.free:
            elsewhere = f"measured{named_degc(file.temperature_degc)}, and {record.name}{at}"
            is_there = is_same_degc(file.temperature_degc, record.temperature_degc)
            draft.take(file, "not used", why_useless(file, None) if is_there else elsewhere)
        given = {} if draft.given_ah is None else {"capacity": draft.given_ah}
        return Plan("identify", draft.parts(), given, dict.fromkeys(given, "given"))
    return None


def _without_test(draft: Draft, group: Files) -> Files:
    """Records to identify on without an OCV test, then those to validate on, the widest first; none
    if the first is unsuitable for identification."""
    given_ah, free = draft.given_ah, [file for file in group if file in draft.free]
    runs = [file for file in free if not file.missing_for(given_ah, is_validated=True)]
    runs.sort(key=lambda file: (bool(file.missing_for(given_ah)), -file.traits.reach_ah))
    return [] if not runs or runs[0].missing_for(given_ah) else runs


def _without_record(draft: Draft, free: Files) -> Plan:
    """A plan without a record to identify on, or an OCV test."""
    given_ah = draft.given_ah
    draft.leave({file: why_useless(file, given_ah) for file in free})
    is_too_large = any(one.missing_for(given_ah) and not one.missing_for(None) for one in free)
    remedy = "check `capacity`" if is_too_large else MAKE_RECORD
    return Plan("identify", draft.parts(), missing=NO_RECORD + remedy)


def _runnable(draft: Draft, group: Files, choice: OcvChoice, is_pulsed: bool) -> Files:
    """Records that can be simulated with the cell, the best to identify on first.

    The others are left out with the reason.
    """
    runs: list[CandidateFile] = []
    for file in group:
        if file in draft.taken or (not is_pulsed and file in choice.tests):
            continue
        if is_pulsed:
            # The window starts before the first pulse.
            draft.starts[file] = Started(file.chosen)
        missing = file.missing_for(choice.cell.capacity_ah, is_validated=True)
        if not missing and not is_pulsed and (missing := draft.no_start(file, choice)):
            missing = another_cell(file, choice.cell.capacity_ah) or missing
        if missing:
            draft.take(file, "not used", missing)
        else:
            runs.append(file)
    # An OCV test that is cut short may span less than a record, but not by this much.
    max_ah = math.inf if choice.capacity_ah else _ANOTHER * choice.cell.capacity_ah
    if within := [file for file in runs if file.traits.span_ah <= max_ah]:
        beyond = [file for file in runs if file not in within]
        draft.leave({file: why_useless(file, choice.cell.capacity_ah) for file in beyond})
        runs = within
    widest_ah = max((file.traits.reach_ah for file in runs), default=0.0)

    def rank(file: CandidateFile) -> tuple:
        is_wide = file.traits.reach_ah >= _AS_WIDE * widest_ah
        return (
            _LOADS.index(file.kind(None)),
            bool(file.missing_for(choice.cell.capacity_ah)),
            not is_wide,
            file.warnings if is_wide else 0,
            not (file.suggested and file.suggested.is_settled),
            -file.traits.reach_ah,
        )

    return sorted(runs, key=rank)


def _holds_drive(files: Files) -> bool:
    return any(file.kind(None) == "drive cycle" for file in files)


def _choose_validation(draft: Draft, record: CandidateFile, others: Files) -> None:
    """Choose another profile at the same temperature rather than a repetition, and the widest of
    them."""
    file = min(others, key=lambda file: (file.is_like(record), -file.traits.reach_ah))
    which = "the same profile again" if file.is_like(record) else "another profile"
    draft.take(file, "validation", f"{which}: {draft.words_of(file)}")
    reason = "equally suitable; add it with `validate` to validate on it too"
    draft.leave(dict.fromkeys(others, reason))


def _take_others(draft: Draft, others: Files, capacity_ah: float) -> None:
    """All further records at the same temperature are identified on too, each left out once; those
    that are unsuitable are left for validation."""
    for file in others:
        if file.kind(None) == "pulse test" and not file.missing_for(capacity_ah):
            reason = f"pulses, to predict from the drive: {draft.words_of(file)}"
            draft.take(file, "validation", reason)
        draft.take_record(file, capacity_ah)


def _take_charges(draft: Draft, record: CandidateFile, choice: OcvChoice) -> None:
    """Charges at the same temperature are identified on too, if they span enough: on a flat OCV
    they determine the resistances and the hysteresis in the other direction."""
    cell = choice.cell
    for file in draft.free:
        span_ah, degc = file.traits.span_ah, file.temperature_degc
        is_charge = file.kind(cell.capacity_ah) == "charge" and span_ah >= _MUCH * cell.capacity_ah
        is_there = is_same_degc(degc, record.temperature_degc)
        if is_charge and is_there and not draft.no_start(file, choice):
            of = f"a charge of {span_ah:.3g} Ah, for the other direction"
            draft.take(file, "identification", of + draft.starts[file].words)


def _take_other_temperatures(
    draft: Draft, record: CandidateFile, chosen: Chosen, choice: OcvChoice, is_pulsed: bool
) -> None:
    """The best record at each further temperature, for tables over temperature, with its own OCV
    test."""
    for group, test in chosen:
        degc = group[0].temperature_degc
        if degc is None or is_same_degc(degc, record.temperature_degc):
            continue
        dated = [file for file in group if file.temperature_degc is not None]
        if test is None or not (test.has_temperatures and choice.has_temperatures):
            test = choice
        for file in _runnable(draft, dated, test, is_pulsed)[:1]:
            why = f"for tables over temperature too: {draft.words_of(file)}"
            draft.take(file, "identification", why)
            draft.take_tests(test)
    draft.set_temperatures()


def _leave_others(draft: Draft, choice: OcvChoice, chosen: Chosen) -> None:
    """Leave the remaining files without a role, with the reason."""
    degcs = (test.temperature_degc for test in choice.tests if test.temperature_degc is not None)
    degc = next(degcs, None)
    usable = {file for group, test in chosen if test for file in (*group, *test.tests)}
    names = " and ".join(test.name for test in choice.tests)
    for file in draft.free:
        at, reason = named_degc(file.temperature_degc), why_useless(file, draft.capacity_ah)
        if not is_same_degc(file.temperature_degc, degc):
            reason = f"measured{at}, the OCV test{named_degc(degc)}"
            if file in usable:
                reason = f"measured{at}: for tables over temperature (`over=soc,temperature`)"
        elif file.serves("OCV test"):
            better = f"{names} {'is' if len(choice.tests) == 1 else 'are'} better"
            reason = f"also an OCV test ({ocv_reason([file])}), but {better}"
        draft.take(file, "not used", reason)


def options_of(
    draft: Draft, runs: Files, choice: OcvChoice
) -> tuple[dict[str, Any], dict[str, str]]:
    """Arguments of `identify` that the files decide, and the reasons."""
    if draft.given_ah is not None:
        return {"capacity": draft.given_ah}, {"capacity": "given"}
    record, record_ah = runs[0], None
    for file in runs:
        start = draft.start(file)
        is_full = start.window.initial_soc == 1.0 or start.is_full
        taken_ah = record_capacity_ah(file, start.window, choice, is_full)
        is_used = draft.taken[file].role == "identification"
        if taken_ah is not None and is_used and taken_ah > (record_ah or 0.0):
            record, record_ah = file, taken_ah
    if record_ah is not None and draft.start(record).window.capacity_ah is None:
        test = f"the OCV test has {choice.cell.capacity_ah:.4g} Ah"
        capacity_ah = record_ah
        reason = f"the Ah that {record.name} takes out of the full cell; {test}"
    elif choice.capacity_ah is not None:
        capacity_ah = float(f"{choice.capacity_ah:.{DIGITS}g}")
        passed_ah = [f"{sweep.passed_ah:.4g}" for sweep in sweeps_of(choice.tests)]
        why = f"passed {' and '.join(passed_ah)} Ah" if passed_ah else "has none"
        reason = f"the Ah of the longest discharge, because the OCV test {why}"
    else:
        return {}, {}
    return {"capacity": capacity_ah}, {"capacity": reason}
