"""A stored result on records: those it was identified on, read again, and others.

Records are found by name and known by content. The circuits are those that are stored: nothing is
searched again, and what they leave of each record has to be what they left then.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from .bundled import BUNDLED
from .cell import CellModel
from .errors import InputError
from .inputs import Given, read_validation, source_of, telling
from .model.prepared import PreparedRecord, prepare_record
from .model.window import Window
from .notices import Notice
from .over_soc.fits import no_temperature
from .over_soc.registration import rest_warnings
from .plan import plan_from_toml
from .records import Record, find_file, folders_around, read_record
from .records.fingerprint import Content, read_fingerprint
from .result_filter import window_of
from .result_parts import InputPart, MetricsBlock, MetricsPart
from .results import Result
from .search.evaluate import (
    Evaluation,
    Evaluations,
    evaluate,
    evaluate_from_either,
    with_registered,
)
from .settings import Reading

# Across machines and versions a stored circuit's error agrees this closely, relative.
SAME_ERROR = 1e-6
# A plan of thousands of files has fewer bytes.
LARGEST_PLAN = 1_000_000
# A fingerprint holds times to twelve digits.
ROUNDED = 1e-11
# What was read of a part of a file is named by the file and a number.
PART = re.compile(r"#\d+$")

By = Callable[[PreparedRecord], Evaluation]


def file_of(name: str) -> str:
    """The name of the file that a record, or a part of one, was read from."""
    return PART.sub("", name)


@dataclass(frozen=True)
class Places:
    """The folders in which a stored result's files are looked for, and the plan that may name more.

    Another's plan names folders as it likes: only what has a stored digest is taken from there.
    """

    folders: tuple[Path, ...]
    plan: Path

    @classmethod
    def of(cls, path: Path, data: Iterable[Path] = ()) -> "Places":
        """`data`, the result's own folder, the one above that, and the working folder."""
        place = path if path.is_dir() else path.parent
        folders = (*data, *folders_around(place), BUNDLED.record.parent)
        return cls(tuple(dict.fromkeys(folders)), place / "plan.toml")

    def find(self, name: str, sha256: str) -> Path:
        """The file of that name and content. Raises `InputError` where there is none."""
        return find_file(name, sha256, (*self.folders, *(self._planned if sha256 else ())))

    @cached_property
    def _planned(self) -> tuple[Path, ...]:
        """The folders of the files in the plan; none where it cannot be read."""
        # A pipe would be waited for, and a device read without end.
        if not self.plan.is_file() or self.plan.stat().st_size > LARGEST_PLAN:
            return ()
        with suppress(InputError, ValueError, RecursionError):
            return tuple({part.path.parent: None for part in plan_from_toml(self.plan).parts})
        return ()


@dataclass(frozen=True)
class Inputs:
    """The inputs of a stored result: in folders, or given by their names."""

    places: Places
    given: Mapping[str, Given]
    reading: Reading

    def read(self, part: InputPart) -> Record:
        """A record as it was identified on. Raises `InputError` where it is not there any more."""
        given = self.given.get(part.name)
        if given is None:
            given = self.places.find(file_of(part.name), part.sha256)
        decided: dict[str, Any] = {
            "current_sign": part.sign.value if part.sign else "auto",
            "current_hold": part.hold.value if part.hold else "auto",
            "voltage_lag": part.voltage_lag_s,
        }
        if not isinstance(given, Record):
            source = source_of(given, {}, self.reading)
            if PART.search(part.name) and part.fingerprint:
                first_s, last_s = read_fingerprint(part.fingerprint)[0]
                slack_s = ROUNDED * max(abs(first_s), abs(last_s))
                source = replace(source, span_s=(first_s - slack_s, last_s + slack_s))
            source = replace(source, name=part.name)
            given = read_record(source, **decided)
        if part.fingerprint and Content(given).fingerprint != part.fingerprint:
            raise InputError(
                f"{part.name}: these are not the samples that the result is of; give what it was "
                "identified on with `data`, and `columns` and `series` as they were then"
            )
        return replace(
            given, name=part.name, sign=part.sign or given.sign, hold=part.hold or given.hold
        )


def loaded(
    kind: type[Result],
    path: str | Path,
    data: str | Path | Sequence[str | Path] | Mapping[str, Given],
    columns: Mapping[str, str] | str,
    series: int,
) -> Result:
    """`Result.load`: a stored result that knows where its records are looked for."""
    path = Path(path)
    result = kind.from_json(path / "result.json" if path.is_dir() else path)
    given = data if isinstance(data, Mapping) else {}
    folders = [data] if isinstance(data, str | Path) else () if given else data
    reading = Reading(columns=columns, series=series)
    result._inputs = Inputs(Places.of(path, map(Path, folders)), given, reading)
    return result


def reopened(result: Result, inputs: Inputs) -> tuple[Evaluations, Evaluations | None]:
    """A stored result's constant circuit and its tables, simulated again on its records.

    Raises `InputError` where a record is not found, is another, or no longer gives the stored
    errors.
    """
    parts = *result.of_role("identification"), *result.of_role("validation")
    pairs = [(part, inputs.read(part)) for part in parts]
    constant = result.constant
    by_constant = partial(evaluate, parameters=constant.parameters)
    evaluated = partial(_evaluations, pairs, result.cell)
    of_constant = evaluated(constant.model, by_constant, constant.metrics)
    if result.tables is None:
        return of_constant, None
    return of_constant, evaluated(result.model, result.tables.evaluate, result.metrics)


def _evaluations(
    pairs: Sequence[tuple[InputPart, Record]],
    cell: CellModel,
    model: str,
    by_circuit: By,
    metrics: MetricsBlock,
) -> Evaluations:
    """A stored circuit on every record, those identified on and those validated on."""
    identified = metrics.jointly or (metrics.identification,)
    evaluations = tuple(
        _again(part, record, cell, model, by_circuit, stored)
        for (part, record), stored in zip(pairs, [*identified, *metrics.validation], strict=True)
    )
    return Evaluations(evaluations[: len(identified)], evaluations[len(identified) :])


def _again(
    part: InputPart,
    record: Record,
    cell: CellModel,
    model: str,
    by_circuit: By,
    stored: MetricsPart,
) -> Evaluation:
    """A stored circuit on a record from the direction that was settled, or the other one: each
    circuit has its own."""
    window, start = part.window or Window(), part.start
    rmse_v = stored.rmse_v
    for way in (start.direction, -start.direction) if start else (None,):
        own = window if way is None else replace(window, initial_direction=way)
        found = by_circuit(prepare_record(record, cell, model, own))
        rmse_v = found.metrics.rmse_v
        if abs(rmse_v - stored.rmse_v) <= SAME_ERROR * stored.rmse_v:
            prepared = replace(found.prepared, window=window)
            if start and way == start.direction:
                prepared = replace(prepared, start=start)
            return replace(found, prepared=prepared)
    raise InputError(
        f"{part.name}: the stored {model} leaves {1e3 * rmse_v:.4g} mV on it now, where the result "
        f"says {1e3 * stored.rmse_v:.4g} mV; identify again with this version"
    )


def validated(
    stored: Result, record: Given, window: Window | None = None, **read: Any
) -> Evaluation:
    """`Result.validate`: a stored circuit on another record."""
    signs = {"validate_current_sign": read.pop("current_sign", "auto")}
    reading = Reading(**signs, **read)
    choose, cell = partial(window_of, stored, chosen=window), stored.cell_model
    measured, warnings = read_validation(record, reading, choose, cell, stored.measured_at)
    window = choose(measured)
    content = Content(measured)
    for own in stored.of_role("identification"):
        if own.sha256 == measured.sha256 or (own.fingerprint and content.holds(own.fingerprint)):
            warnings.append(Notice("role.same-record", {"other": own.name}, measured.name))
    with telling(warnings):
        prepared = prepare_record(measured, cell, stored.model, window)
    by_circuit = stored.fits.evaluate
    found = with_registered(evaluate_from_either(prepared, by_circuit), by_circuit)
    warnings += no_temperature(prepared, stored.fits)
    told = (*warnings, *measured.notes, *measured.warnings, *prepared.warnings)
    told += tuple(rest_warnings(prepared))
    return replace(found, warnings=tuple(dict.fromkeys(told)))
