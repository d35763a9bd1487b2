"""Running a plan: `identify` for a folder, a plan, or files without an OCV test; and pulse tests.

Pulse tests are prepared for identification: their own OCV, and the start of each.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from ..bundled import BUNDLED
from ..cell import CellModel, characterize_over_temperature
from ..cell.model import REFERENCE_DEGC, group_near
from ..errors import InputError
from ..inputs import listed, read_files, require_voltages
from ..job import PLANNED, SIMULATED, FileRole, Job, Use, window_of, windows_by_name
from ..model.window import Window, temperature_of
from ..pulses import first_pulse
from ..records import Record, Source, read_source
from ..records.log import joined
from ..records.logger import Decision, Logger, SlowRows
from ..records.source import STDIN
from ..result_parts import InputPart
from ..settings import OVER_TEMPERATURE, Reading
from .choosing import options_of, plan
from .document import Plan, plan_from_toml
from .draft import Draft
from .looking import CandidateFile, by_temperature, look
from .ocv import OcvChoice, Started

Asked = TypeVar("Asked", bound=Job)


def plan_of(job: Job) -> Plan | None:
    """The plan for a call of `identify`; None for the bundled cell.

    Roles are chosen in a folder, and for files of an unknown cell without an OCV test; otherwise
    they are given.
    """
    given = listed(job.records)
    if not given:
        return None
    if len(given) == 1 and isinstance(given[0], Plan):
        return given[0]
    paths = [Path(source) for source in given if isinstance(source, str | Path)]
    if len(given) == len(paths) == 1 and paths[0].suffix.lower() == ".toml":
        return plan_from_toml(paths[0])
    have_roles = not any(map(os.path.isdir, paths)) and listed(job.ocv)
    if have_roles or job.cell is not None or len(paths) < len(given):
        return plan_given(job)
    return plan(job)


def plan_given(job: Job, command: Literal["identify", "hppc"] = "identify") -> Plan:
    """The plan for files with given roles, with the windows and the capacity that they would have
    in a folder, and the reasons; without any files the bundled cell's.

    Raises `InputError` for a file that cannot be read.
    """
    files: dict[Use, Any] = {"identification": job.records, "OCV test": job.ocv}
    files["validation"] = job.validate
    if not listed(job.records):
        is_hppc = command == "hppc"
        files["identification"] = BUNDLED.hppc[1] if is_hppc else BUNDLED.record
        files["OCV test"] = job.ocv if is_hppc else [*BUNDLED.ocv]
        files["validation"] = listed(job.validate) or BUNDLED.validation
    given = {role: listed(several) for role, several in files.items()}
    looked = look(given, job)
    of_role = {file: role for role, several in looked.items() for file in several}
    for file in of_role:
        if file.refusal:
            # A file rejected only by the checks can be read.
            _ = file.content
    tests = [file for file in looked["OCV test"] if not file.refusal]
    draft, choices = Draft([*of_role], given_ah=job.given_ah), dict[CandidateFile, OcvChoice]()
    for file, role in of_role.items():
        if command == "hppc" and role == "identification":
            draft.starts[file] = Started(file.chosen)
        elif role in SIMULATED and not file.refusal:
            choice = draft.start_given(file, tests, job.cell)
            choices |= {file: choice} if choice else {}
        suggested, words = file.suggested, draft.start(file).words
        is_planned = role in SIMULATED and draft.start(file).window != file.chosen
        draft.take(file, role, suggested.reason + words if is_planned and suggested else "")
    if job.over == OVER_TEMPERATURE:
        draft.set_temperatures()
    # One capacity applies to all, so records at several temperatures have none in common.
    records = [file for file in looked["identification"] if file in choices]
    are_of_one = len({degc for degc, _ in by_temperature(records)} - {None}) < 2
    is_open = records and are_of_one and job.ocv_capacity is None
    options, reasons = options_of(draft, records, choices[records[0]]) if is_open else ({}, {})
    return Plan(command, draft.parts(), options, reasons)


def planned_window(
    record: Source | Record, cell: CellModel, reading: Reading, common: Window
) -> Window:
    """The window of a record to validate on a known cell, with the known values for it."""
    (file,) = look({"validation": [record]}, Job(reading=reading, window=common))["validation"]
    draft = Draft([file])
    draft.start_given(file, (), cell)
    return draft.start(file).window


def with_choices(made: Plan, job: Job) -> Plan:
    """A plan with all of the user's choices applied."""
    chosen = {name: value for name, value in job.chosen.items() if name in PLANNED}
    return made.changed(job.window, **chosen)


def with_whole_paths(made: Plan, inputs: Sequence[InputPart]) -> Plan:
    """A plan that was run on these inputs, with its files by their whole paths and digests."""
    digests = {part.name: part.sha256 for part in inputs}
    parts = []
    for part in made.parts:
        path = part.path if part.path == STDIN else part.path.absolute()
        more = tuple(path.absolute() for path in part.more)
        sha256 = digests.get(part.name, part.sha256)
        parts.append(replace(part, path=path, more=more, sha256=sha256))
    options = dict(made.options)
    if isinstance(bounds := options.get("bounds"), str | Path):
        options["bounds"] = Path(bounds).absolute()
    return replace(made, parts=tuple(parts), options=options)


def planned(made: Plan, job: Asked) -> Asked:
    """The job of a plan; choices in `job` replace the plan's.

    Raises `InputError` if a test is missing.
    """
    if made.missing:
        raise InputError("\n".join([made.missing, *made.lines]))
    made = made.changed(job.window, capacity=job.capacity)
    chosen = {name: value for name, value in job.chosen.items() if name != "capacity"}
    job = type(job)(**{**made.options, **chosen})
    # Windows for names that are not simulated are rejected further on.
    windows = {**windows_by_name(job.window), "": made.window}
    for part in made.parts:
        # For an OCV test its temperature counts.
        if part.is_simulated or part.window.temperature_degc is not None:
            windows[part.name] = part.window
    records, tests = (_sources(made, role, job) for role in ("identification", "OCV test"))
    job = job.changed(records=records, ocv=tests, window=windows)
    if made.command == "hppc":
        job = prepare_pulse_tests(job)
    return job.changed(validate=_sources(made, "validation", job))


def _sources(made: Plan, role: Use, reading: Reading) -> list[Any]:
    return [_source(part, reading) for part in made.of_role(role)]


def _source(part: FileRole, reading: Reading) -> Any:
    if part.span_s is None and part.sampling is None and not part.more:
        return part.source or part.path
    source = part.source or joined([read_source(path, **reading.of_tables) for path in part.paths])
    source = replace(source, name=part.name, span_s=part.span_s)
    if part.sampling is None:
        return source
    shown = Decision(part.sampling, "weak", "the steps of the designed test show it")
    logger = Logger(source.table.header.names, shown, SlowRows(), slow_records=0)
    return replace(source, logger=logger)


def prepare_pulse_tests(job: Asked) -> Asked:
    """The job of `identify` for pulse tests, as `barnax.hppc` describes.

    Raises `InputError` if a record has no pulses.
    """
    chosen, cell = windows_by_name(job.window), None
    with job.watch("Finding pulses", 0):
        files = read_files({"identification": listed(job.records)}, job)
        tests = [(file.source or file.content, _pulse_test(file.content)) for file in files]
        at_degc = (temperature_of(record, window_of(chosen, record.name)) for _, record in tests)
        degcs = (REFERENCE_DEGC if degc is None else degc for degc in at_degc)
        by_degc = group_near(zip(degcs, tests, strict=True))
        if not listed(job.ocv):
            # A polynomial would oscillate between ten points, whatever was requested.
            fit: dict[str, Any] = {"ocv_fit": "interpolated"}
            first = {degc: alike[0] for degc, alike in by_degc.items()}
            records = {degc: [record] for degc, (_, record) in first.items()}
            cell = characterize_over_temperature(records, capacity_ah=job.given_ah, **fit)
            ocv = [source for source, _ in first.values()]
            job = job.changed(ocv=ocv, ocv_current_sign=job.current_sign, **fit)
        # From the rest before the first pulse on, unless another start is chosen.
        windows = {record.name: _pulse_window(record, cell, chosen) for _, record in tests}
    return job.changed(
        records=[source for source, _ in tests],
        over=job.over or ("soc" if len(by_degc) == 1 else OVER_TEMPERATURE),
        window={"": window_of(chosen, ""), **chosen, **windows},
    )


def _pulse_test(record: Record) -> Record:
    """The record. Raises `InputError` if it has no pulses."""
    require_voltages([record])
    if first_pulse(record) is None:
        raise InputError(
            f"{record.name}: has no pulse of up to 2 min, or a quarter of its charge, after a rest "
            "of at least 5 min; barnax check says what it can be used for"
        )
    return record


def _pulse_window(record: Record, cell: CellModel | None, chosen: Mapping[str, Window]) -> Window:
    """The window of a pulse test, from its first OCV point on, at that point's state of charge.

    If the OCV is from another record, or `cell` is None, the window starts at the end of the rest
    before the first pulse. The user's choices are kept.
    """
    window = window_of(chosen, record.name)
    if window.start_time_s is not None or window.start_after_step is not None:
        return window
    cell = None if cell is None else cell.at(temperature_of(record, window))
    points = [point for point in cell.points if point.source == record.name] if cell else []
    if cell is None or not points:
        pulse = first_pulse(record)
        if pulse is None or window.initial_soc is not None:
            return window
        at = int(np.searchsorted(record.row, pulse.row)) - 1
        return replace(window, start_time_s=float(record.time_s[at]))
    first = min(points, key=lambda point: point.row)
    at = int(np.searchsorted(record.row, first.row))
    soc, source = min(max(first.soc, 0.0), 1.0), window.soc_source
    if window.initial_soc is not None:
        # The SOC is that of the first row.
        capacity_ah = window.capacity_ah or cell.capacity_ah
        soc = window.initial_soc - float(record.discharged_ah[at]) / capacity_ah
        source = "given earlier"
    begun = replace(window, start_time_s=float(record.time_s[at]))
    return replace(begun, initial_soc=soc, soc_source=source)
