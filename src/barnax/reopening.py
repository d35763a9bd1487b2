"""A stored result on records: those it was identified on, read again, and others.

Records are found by name and identified by content. The circuits are the stored ones: nothing is
searched again, and their errors on each record must be the stored ones.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from .bundled import BUNDLED
from .errors import InputError
from .fit.registration import rest_warnings
from .fit.temperature_fits import no_temperature
from .inputs import source_of, with_warnings_in_errors
from .metrics import Metrics
from .model.prepared import prepare_record
from .model.window import Window
from .notices import Notice
from .plan.document import folders_in
from .records import Given, Record, find_file, folders_around, read_record
from .records.fingerprint import Content, read_fingerprint
from .records.log import NEXT_FILE, joined
from .result_parts import InputPart
from .results import Result
from .search.evaluate import Evaluation, Evaluations, evaluate_from_either, with_registered
from .settings import Reading

# Relative agreement of a stored circuit's error across machines and versions.
SAME_ERROR = 1e-6
# A plan of thousands of files is smaller than this.
LARGEST_PLAN = 1_000_000
# A fingerprint stores times to twelve digits.
ROUNDED = 1e-11
# The name of a part of a file is that of the file with a number.
PART = re.compile(r"#\d+$")

Data = str | Path | Sequence[str | Path] | Mapping[str, Given]


@dataclass(frozen=True)
class StoredInputs:
    """The inputs of a stored result: given by their names, or searched in folders and at the
    locations in the plan beside it.

    A plan from somebody else may name any folder: only files with a stored digest are taken from
    there.
    """

    folders: tuple[Path, ...]
    plan: Path
    given: Mapping[str, Given]
    reading: Reading

    @classmethod
    def of(cls, path: Path, data: Data = (), reading: Reading | None = None) -> "StoredInputs":
        """The inputs of the result at `path`, searched in `data`, its own folder, the one above and
        the working folder."""
        folder = path if path.is_dir() else path.parent
        given = data if isinstance(data, Mapping) else {}
        more = [data] if isinstance(data, str | Path) else () if given else data
        folders = (*map(Path, more), *folders_around(folder), BUNDLED.record.parent)
        unique = tuple(dict.fromkeys(folders))
        return cls(unique, folder / "plan.toml", given, reading or Reading())

    def find(self, name: str, sha256: str) -> Path | Notice:
        """The file with that name and content, or the reason why there is none."""
        return find_file(name, sha256, (*self.folders, *(self._planned if sha256 else ())))

    @cached_property
    def _planned(self) -> tuple[Path, ...]:
        """The folders of the files in the plan; empty if it cannot be read."""
        # Reading would wait for a pipe, and never end for a device.
        if not self.plan.is_file() or self.plan.stat().st_size > LARGEST_PLAN:
            return ()
        return folders_in(self.plan)

    def read(self, part: InputPart) -> Record:
        """A record as it was identified on. Raises `InputError` if it no longer exists."""
        given = self.given.get(part.name)
        if given is None:
            # It may be a log of several files.
            digests = part.sha256.split() or [""]
            names = PART.sub("", part.name).rsplit(NEXT_FILE, len(digests) - 1)
            sources = []
            for name, sha256 in zip(names, digests, strict=True):
                if isinstance(file := self.find(name, sha256), Notice):
                    raise file.error()
                sources.append(source_of(file, {}, self.reading))
            given = joined(sources)
        if not isinstance(given, Record):
            source = replace(source_of(given, {}, self.reading), name=part.name)
            if PART.search(part.name) and part.fingerprint:
                first_s, last_s = read_fingerprint(part.fingerprint)[0]
                slack_s = ROUNDED * max(abs(first_s), abs(last_s))
                source = replace(source, span_s=(first_s - slack_s, last_s + slack_s))
            decided: dict[str, Any] = {
                "current_sign": part.sign.value if part.sign else "auto",
                "current_hold": part.hold.value if part.hold else "auto",
            }
            given = read_record(source, voltage_lag=part.voltage_lag_s, **decided)
        if part.fingerprint and Content(given).fingerprint != part.fingerprint:
            raise InputError(
                f"{part.name}: these are not the samples that the result is of; give what it was "
                "identified on with `data`, and `columns` and `series` as they were then"
            )
        return replace(
            given, name=part.name, sign=part.sign or given.sign, hold=part.hold or given.hold
        )


def loaded(kind: type[Result], path: str | Path, data: Data, reading: Reading) -> Result:
    """`Result.load`: a stored result with the locations of its records."""
    path = Path(path)
    result = kind.from_json(path / "result.json" if path.is_dir() else path)
    result._inputs = StoredInputs.of(path, data, reading)
    return result


def reopened(result: Result, inputs: StoredInputs) -> tuple[Evaluations, ...]:
    """A stored result's constant circuit and its tables, if any, simulated again on its records.

    Raises `InputError` if a record is not found, is another, or no longer gives the stored errors.
    """
    parts = *result.of_role("identification"), *result.of_role("validation")
    pairs = [(part, inputs.read(part)) for part in parts]
    answers = [result.without_tables(), *([result] if result.over else [])]
    return tuple(_evaluations(answer, pairs) for answer in answers)


def _evaluations(result: Result, pairs: Sequence[tuple[InputPart, Record]]) -> Evaluations:
    """A stored answer on every record, those identified on and those validated on."""
    metrics = result.metrics
    identified = metrics.jointly or (metrics.identification,)
    evaluations = tuple(
        _again(result, part, record, stored)
        for (part, record), stored in zip(pairs, [*identified, *metrics.validation], strict=True)
    )
    return Evaluations(evaluations[: len(identified)], evaluations[len(identified) :])


def _again(result: Result, part: InputPart, record: Record, stored: Metrics) -> Evaluation:
    """A stored answer on a record from the settled direction, or the other one: constants and
    tables each have their own."""
    window, start = part.window or Window(), part.start
    rmse_v = stored.rmse_v
    for way in (start.direction, -start.direction) if start else (None,):
        directed = window if way is None else replace(window, initial_direction=way)
        evaluation = result.fits.evaluate(
            prepare_record(record, result.cell, result.model, directed)
        )
        rmse_v = evaluation.metrics.rmse_v
        if abs(rmse_v - stored.rmse_v) <= SAME_ERROR * stored.rmse_v:
            prepared = replace(evaluation.prepared, window=window)
            if start and way == start.direction:
                prepared = replace(prepared, start=start)
            soc, least_v = stored.start_moved_soc, stored.registered_v
            moved = None if soc is None or least_v is None else (soc, least_v)
            return replace(evaluation, prepared=prepared, registered=moved)
    raise InputError(
        f"{part.name}: the stored {result.model} leaves {1e3 * rmse_v:.4g} mV on it now, where the "
        f"result says {1e3 * stored.rmse_v:.4g} mV; identify again with this version"
    )


def validated(stored: Result, record: Given, window: Window | None, reading: Reading) -> Evaluation:
    """`Result.validate`: a stored circuit on another record."""
    from .result_filter import read_for

    measured, window, warnings = read_for(stored, record, window, reading)
    content = Content(measured)
    for part in stored.of_role("identification"):
        if part.sha256 == measured.sha256 or (part.fingerprint and content.holds(part.fingerprint)):
            warnings.append(Notice("role.same-record", {"other": part.name}, measured.name))
    with with_warnings_in_errors(warnings):
        prepared = prepare_record(measured, stored.cell, stored.model, window)
    by_circuit = stored.fits.evaluate
    evaluation = with_registered(evaluate_from_either(prepared, by_circuit), by_circuit)
    warnings += no_temperature(prepared, stored.fits)
    every = (*warnings, *measured.notes, *measured.warnings, *prepared.warnings)
    every += tuple(rest_warnings(prepared))
    return replace(evaluation, warnings=tuple(dict.fromkeys(every)))
