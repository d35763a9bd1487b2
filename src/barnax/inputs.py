"""From files to checked records and the cell: each file is read once."""

import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from .bundled import BUNDLED
from .cell import CellModel, OcvTable, read_ocv_test
from .cell.characterize import characterize, characterize_over_temperature
from .checks import FileCheck, check_file
from .checks.against_cell import compare_temperatures, compare_with_cell
from .checks.roles import Kind, require_load
from .checks.sampling import OF_R0
from .errors import InputError, attempt, naming, printable
from .job import Job, window_of, windows_by_name
from .model.window import Windows, first_sample, group_tests, scored_samples, temperature_of
from .notices import Notice, raise_first_error
from .records import Given, Record, Source, read_record, read_source, source_from_frame
from .records.fingerprint import Content
from .records.hold import sampled
from .records.logger import Logger, loggers_of
from .records.source import STDIN, STDIN_NAME
from .settings import OVER_TEMPERATURE, Reading, Window

# Records and their temperatures.
RecordTemperatures = Sequence[tuple[str, float | None]]
# The name of a data frame; further ones are numbered.
FRAME = "data frame"
_FRAMES = {"OCV test": "OCV data frame", "validation": "validation data frame"}


@dataclass(frozen=True, eq=False)
class Inputs:
    """Contents of the files: records to identify and to validate on, OCV tests, and the cell; with
    the tables fitted with its OCV if there is no test."""

    records: list[Record]
    ocv: list[Record | OcvTable]
    validation: list[Record]
    cell: CellModel
    warnings: tuple[Notice, ...]
    fitted_ocv: Any = None


@dataclass(frozen=True, eq=False)
class InputFile:
    """A record or table in its role, with the source that it was read from, if it was."""

    role: str
    content: Any
    source: Source | None = None

    @classmethod
    def of(cls, source: Any, role: str, reading: Reading) -> Self:
        """The content of a source, read; a record or table unchanged."""
        if not isinstance(source, Source):
            return cls(role, source)
        read = read_ocv_test if role == "OCV test" else read_record
        return cls(role, read(source, **reading.of_record(source.name, role)), source)

    def logged_by(self, loggers: Mapping[tuple[str, ...], Logger]) -> Self:
        """A copy with its logger."""
        source = self.source and self.source.logged_by(loggers)
        return replace(self, content=sampled(self.content, loggers), source=source)


def read_inputs(job: Job, fit_ocv: Callable[[Job, list[Record]], Any] | None = None) -> Inputs:
    """Every record once, with the findings of the checks, and the cell that is given or
    characterized from the OCV tests; over temperature, from the tests at each temperature
    separately. `fit_ocv` makes the cell of records that have no OCV test; if it is None they are
    rejected."""
    given = {"OCV test": job.ocv, "identification": job.records, "validation": job.validate}
    given = {role: listed(several) for role, several in given.items()}
    if is_bundled := not given["identification"]:
        if given["OCV test"] or given["validation"]:
            raise InputError("give a record to identify on; `ocv` and `validate` need one")
        bundled = [*BUNDLED.ocv], [BUNDLED.record], [BUNDLED.validation]
        given = dict(zip(given, bundled, strict=True))
    is_fitted = not given["OCV test"] and job.cell is None
    with job.watch("Reading records", 0):
        files = read_files(given, job)
        loggers = loggers_of(file.content for file in files)
        sources = [file.source for file in files if file.source]
        loggers |= {one.logger.header: one.logger for one in sources if one.logger}
        files = [file.logged_by(loggers) for file in files]
        tests, records, validation = (
            [file.content for file in files if file.role == role] for role in given
        )
        require_voltages([*records, *validation])
        _require_different([*records, *validation])
        # A table has no samples.
        _require_different([test for test in tests if isinstance(test, Record)])
    require_records(job.lags_s, {source.name for source in sources})
    with job.watch("Characterizing the cell", 0):
        if is_fitted and fit_ocv is None:
            raise Notice("ocv-test.missing", subject=records[0].name).error()
        fitted_ocv = fit_ocv(job, records) if fit_ocv and is_fitted else None
        cell = fitted_ocv.cell if fitted_ocv else job.cell or _characterized(tests, job)
    warnings = [] if is_bundled else warnings_about(files, cell, job.given_ah, job.window, job)
    return Inputs(records, tests, validation, cell, tuple(warnings), fitted_ocv)


def read_files(given: Mapping[str, Sequence[Given]], reading: Reading) -> list[InputFile]:
    """Every file, frame or record in its role, read once, each under a unique name."""
    named, called = file_names(itertools.chain(*given.values())), dict[str, int]()
    return [
        InputFile.of(named_source(item, role, named, called, reading), role, reading)
        for role, several in given.items()
        for item in several
    ]


def _characterized(tests: Sequence[Record | OcvTable], job: Job) -> CellModel:
    """The cell from OCV tests: at each temperature from the tests there, for tables over
    temperature, and if together they do not form one test."""
    rest_a = window_of(job.window, "").rest_current_a
    options: dict[str, Any] = {"capacity_ah": job.given_ah, "rest_current_a": rest_a}
    options |= job.of_curves

    def over_temperature() -> CellModel | None:
        by_degc = group_tests(tests, job.window)
        return characterize_over_temperature(by_degc, **options) if by_degc else None

    if job.over == OVER_TEMPERATURE:
        return over_temperature() or characterize(tests, **options)
    cell = attempt(characterize, tests, **options)
    if isinstance(cell, CellModel):
        return cell
    several = attempt(over_temperature)
    if isinstance(several, CellModel):
        return several
    raise cell


def warnings_about(
    files: Sequence[InputFile],
    cell: CellModel,
    capacity_ah: float | None,
    window: Windows,
    reading: Reading,
    identified: RecordTemperatures = (),
) -> list[Notice]:
    """Warnings of the checks about the files, individually and against each other.

    Advice already followed is not repeated, and parts that are not simulated are ignored.
    """
    warnings, kinds, charges = list[Notice](), dict[str, Kind](), set[str]()
    degc: dict[bool, list[tuple[str, float | None]]] = {True: [], False: []}
    for file in files:
        role, source, content = file.role, file.source, file.content
        if source is None or isinstance(content, OcvTable):
            continue
        is_test = role == "OCV test"
        # A record's ampere-hours are checked against the capacity with which it is simulated.
        limits = window_of(window, source.name)
        record_cell = cell if is_test else cell.at(temperature_of(content, limits))
        record_ah = limits.capacity_ah or capacity_ah
        record_ah = record_ah or (None if is_test else record_cell.capacity_ah)
        check = check_file(
            source if is_test else _simulated(source, content, limits),
            capacity_ah=record_ah,
            rest_current_a=limits.rest_current_a,
            **reading.of_record(source.name, role),
        )
        if not is_test:
            # An OCV test of another cell may be the reason why the file seems at fault.
            against = compare_with_cell(content, record_cell, record_ah)
            if not limits.is_chosen:
                raise_first_error(against, check.file)
            warnings += [warning.about(check.file) for warning in against]
        warnings += input_warnings(check, role)
        if role == "identification" and check.traits:
            kinds[check.file] = check.traits.kind(record_ah, has_test=not cell.ocv_is_fitted)
            if check.traits.kind(record_ah) == "charge":
                charges.add(check.file)
        # A record without a single temperature gets a warning.
        if check.traits and not any(finding.check == "temperature" for finding in check.findings):
            degc[is_test].append((check.file, check.traits.temperature_degc))
    require_load(kinds)
    # A charge with a record under load is there for the other direction.
    warnings = [
        warning
        for warning in warnings
        if warning.code != "role.unfit"
        or warning.subject not in charges
        or kinds.keys() == charges
        or warning.values["role"] != "identification"
    ]
    return warnings + compare_temperatures(degc[False], degc[True], identified)


def _simulated(source: Source, record: Record, window: Window) -> Source:
    """The part of a file from the start of the simulation to the last scored sample."""
    if not window.is_chosen or source.span_s is not None:
        return source
    scored = scored_samples(record, replace(window, score_soc=None), 0, record.time_s)
    first, last = first_sample(record, window, 0.0), int(np.flatnonzero(scored)[-1])
    return replace(source, span_s=(float(record.time_s[first]), float(record.time_s[last])))


def with_warnings_in_errors(warnings: Sequence[Notice]) -> AbstractContextManager[None]:
    """Append the findings of the checks to an `InputError`, as they may be its cause."""
    lines = [f"warning: {each}" for each in warnings]
    return naming("", lambda text: "\n".join((text, *lines)))


def source_of(
    given: Given, names: Mapping[Path, str], reading: Reading, frame: str = FRAME
) -> Source:
    """A file or a data frame, read once, under its name in results."""
    if isinstance(given, Source):
        return given
    if not isinstance(given, str | Path):
        return source_from_frame(given, frame, **reading.of_tables)
    source = read_source(given, **reading.of_tables)
    return replace(source, name=names.get(Path(given), source.name))


def named_source(
    item: Given, role: str, names: Mapping[Path, str], called: dict[str, int], reading: Reading
) -> Any:
    """A file or frame, read once, under a unique name; a `Record` or table unchanged."""
    if isinstance(item, OcvTable):
        return item
    frame = _FRAMES.get(role, FRAME)
    source = item if isinstance(item, Record) else source_of(item, names, reading, frame)
    # Files have names already; one that is given twice is rejected by its name.
    is_named = role == "OCV test" or isinstance(item, str | Path | Source)
    return source if is_named else numbered(source, called)


def numbered(source: Any, called: dict[str, int]) -> Any:
    """A source or record, numbered if its name is already in `called`: windows are assigned by
    name, and two records of one name would share a start."""
    count = called[source.name] = called.get(source.name, 0) + 1
    return source if count == 1 else replace(source, name=f"{source.name} {count}")


def input_warnings(check: FileCheck, role: str) -> list[Notice]:
    """Warnings of the checks of a file for its given role."""
    warnings = [
        finding.about(check.file)
        for finding in check.findings
        if finding.counts and not (role == "OCV test" and finding.code in OF_R0)
    ]
    for use in check.roles:
        if use.name == role and not use.is_usable:
            unfit = {"role": role, "reason": use.reason, "half_width": use.half_width}
            warnings.insert(0, Notice("role.unfit", unfit, check.file))
    return warnings


def require_records(given: Iterable[str], names: Collection[str]) -> None:
    """Raise `InputError` if an option is given for a record that does not exist."""
    unknown = sorted({*given} - {*names, ""})
    if unknown:
        there = f"there are {', '.join(sorted(names))}" if names else "no file is read"
        raise InputError(
            f"no record is called {unknown[0]!r}, for which options are given; {there}"
        )


def windows_of(inputs: Inputs, window: Windows, capacity: float | None) -> dict[str, Window]:
    """The window of every record. Raises `InputError` if one is for a record that does not
    exist."""
    # For an OCV test only the temperature of a window counts.
    tests = {test.name for test in inputs.ocv}
    names = {record.name for record in (*inputs.records, *inputs.validation)}
    require_records(windows_by_name(window).keys() - tests, names)
    windows = {}
    for name in names:
        limits = window_of(window, name)
        windows[name] = replace(limits, capacity_ah=limits.capacity_ah or capacity)
    return windows


def listed(sources: Given | Sequence[Given]) -> list[Given]:
    return list(sources) if isinstance(sources, list | tuple) else [sources]


def name_of(source: Given) -> str:
    if isinstance(source, str | Path):
        return printable(Path(source).name)
    return source.name if isinstance(source, Record | OcvTable | Source) else FRAME


def file_names(paths: Iterable[Any]) -> dict[Path, str]:
    """The display name of each file, with folders if names are shared; none for anything other than
    a path."""
    distinct = {Path(path) for path in paths if isinstance(path, str | Path)}
    names = {path: printable(_shortest_name(path, distinct - {path})) for path in distinct}
    return names | ({STDIN: STDIN_NAME} if STDIN in distinct else {})


def _shortest_name(path: Path, others: set[Path]) -> str:
    parts = path.absolute().parts
    for count in range(1, len(parts)):
        if all(other.absolute().parts[-count:] != parts[-count:] for other in others):
            return "/".join(parts[-count:])
    return path.name


def require_voltages(records: Sequence[Record]) -> None:
    """Raise `InputError` for a record with a constant voltage, for which reading gives a
    warning."""
    for record in records:
        doubts = (one for one in record.warnings if one.code == "voltage-unit.constant")
        raise_first_error((doubt.rated("error") for doubt in doubts), record.name)


def _require_different(records: Sequence[Record]) -> None:
    """Raise `InputError` if two records have the same samples: they would count twice."""
    contents = [Content(record) for record in records]
    for first, other in itertools.combinations(contents, 2):
        one, record = first.record, other.record
        # Parts of one file are different records.
        is_same_file = record.sha256 == one.sha256 != "" and record.time_s[0] == one.time_s[0]
        if is_same_file or other.is_like(first):
            same = "bytes" if is_same_file else "samples"
            given = {"same": "name" if one.name == record.name else same, "other": one.name}
            raise Notice("role.given-twice", given, record.name).error()
