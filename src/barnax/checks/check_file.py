"""From a file to its diagnosis, in one straight line that no fault interrupts."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..records.columns import NEEDED
from ..records.conventions import decide_hold, decide_sign
from ..records.plausibility import FEWEST_SAMPLES, check_samples
from ..records.read import make_record, read_content
from ..records.readers import read_table
from ..records.samples import Samples, Table, samples_of, take_lines, take_samples
from .check_input import CheckInput
from .clock import examine_clock, examine_repeats
from .finding import Finding
from .registry import CHECKS
from .roles import Role, find_roles
from .sign import examine_turn
from .table import Columns, examine_cells, examine_columns, examine_suffix, examine_units
from .units import examine_current_unit, examine_time_unit, examine_voltage


@dataclass(frozen=True)
class Facts:
    """What the record is, once mended so far as it could be."""

    samples: int
    first_s: float
    last_s: float
    interval_s: float
    voltage_v: tuple[float, float]
    charged_ah: float
    discharged_ah: float
    current_sign: str
    current_hold: str

    def to_dict(self) -> dict[str, Any]:
        """The facts as plain values, with units in the keys."""
        return {
            "samples": self.samples,
            "time [s]": [self.first_s, self.last_s],
            "median interval [s]": self.interval_s,
            "voltage [V]": list(self.voltage_v),
            "charged [A.h]": self.charged_ah,
            "discharged [A.h]": self.discharged_ah,
            "current sign": self.current_sign,
            "current hold": self.current_hold,
        }


@dataclass(frozen=True)
class FileCheck:
    """What was found in one file. `facts` is None, and `roles` empty, where too little is left.

    `findings` are ordered by severity, then by row. The roles are those of the file once its
    errors are mended.
    """

    file: str
    findings: tuple[Finding, ...]
    facts: Facts | None
    roles: tuple[Role, ...]

    @property
    def is_clean(self) -> bool:
        """Whether nothing but notes was found."""
        return not any(finding.counts for finding in self.findings)

    def to_dict(self) -> dict[str, Any]:
        """The diagnosis as plain values."""
        return {
            "file": self.file,
            "clean": self.is_clean,
            "findings": [finding.to_dict() for finding in self.findings],
            "facts": self.facts.to_dict() if self.facts else None,
            "roles": {role.name: role.to_dict() for role in self.roles},
        }


def facts_of(given: CheckInput) -> Facts:
    """The facts of a case."""
    record = given.record
    return Facts(
        samples=record.samples,
        first_s=float(record.time_s[0]),
        last_s=float(record.time_s[-1]),
        interval_s=float(np.median(record.interval_s)),
        voltage_v=(float(record.voltage_v.min()), float(record.voltage_v.max())),
        charged_ah=given.charged_ah,
        discharged_ah=given.discharged_ah,
        current_sign=record.sign.value,
        current_hold=record.hold.value,
    )


_ORDER = {"error": 0, "warning": 1, "note": 2}


def check_file(path: str | Path, *, capacity_ah: float | None = None) -> FileCheck:
    """Everything that is wrong with a cycler's file, and what it can serve as.

    Each fault is mended as far as it can be before the next is looked for, so that one does not
    hide another. `capacity_ah` lets the charge be judged. Raises InputError where there is no
    table to look at, or the capacity is not positive.

    >>> from barnax.bundled import bundled_file
    >>> diagnosis = check_file(bundled_file("identification"))
    >>> diagnosis.is_clean, [role.name for role in diagnosis.roles if role.is_usable]
    (True, ['identification', 'validation'])
    """
    if capacity_ah is not None and not capacity_ah > 0:
        raise InputError(f"--capacity {capacity_ah} Ah must be positive")
    # Absurd values overflow on their way to being found absurd.
    with np.errstate(all="ignore"):
        return _diagnosis(Path(path), capacity_ah)


def _diagnosis(path: Path, capacity_ah: float | None) -> FileCheck:
    content = read_content(path)
    table = read_table(content, path.name)
    findings = _named("format", examine_suffix(path.name, content))
    samples, columns, more = _examine_table(table, path.name)
    findings += more
    given = None
    if samples is not None:
        samples, more = _mend(samples, columns, capacity_ah)
        findings += more
        given = _case(samples, content, capacity_ah)
    if given is not None:
        for name, check in CHECKS.items():
            findings += _named(name, check(given))
    findings += _unexplained(table, path.name, findings)
    findings.sort(key=lambda finding: (_ORDER[finding.severity], finding.row or 0))
    return FileCheck(
        file=path.name,
        findings=tuple(findings),
        facts=facts_of(given) if given else None,
        roles=find_roles(given) if given else (),
    )


def _examine_table(table: Table, file: str) -> tuple[Samples | None, Columns, list[Finding]]:
    """The samples that the table holds whole, if it has the columns, and its faults."""
    columns, found = examine_columns(table, file)
    findings = _named("columns", found) + _named("units", examine_units(columns))
    lines, found = examine_cells(take_lines(table, columns, file))
    findings += _named("cells", found)
    if not columns.keys() >= NEEDED:
        return None, columns, findings
    return samples_of(lines), columns, findings


def _mend(
    samples: Samples, columns: Columns, capacity_ah: float | None
) -> tuple[Samples, list[Finding]]:
    """The samples as they would be without the faults that can be mended, and these faults."""
    findings: list[Finding] = []
    if len(samples.time_s) < FEWEST_SAMPLES:
        return samples, findings
    samples, found = examine_clock(samples)
    findings += _named("clock", found)
    samples, found = examine_voltage(samples)
    findings += _named("voltage unit", found)
    samples, found = examine_repeats(samples)
    findings += _named("repeats", found)
    if len(samples.time_s) < FEWEST_SAMPLES:
        return samples, findings
    samples, found = examine_time_unit(samples, columns)
    findings += _named("time unit", found)
    samples, found = examine_current_unit(samples, columns, capacity_ah)
    findings += _named("current unit", found)
    samples, found = examine_turn(samples)
    findings += _named("sign", found)
    return samples, findings


def _case(samples: Samples, content: bytes, capacity_ah: float | None) -> CheckInput | None:
    """What the checks look at; None where too few samples are left, or no current flows."""
    try:
        samples = check_samples(samples)
    except InputError:
        return None
    sign, _ = decide_sign(samples, "auto")
    record = make_record(samples, sign, decide_hold(samples, "auto"), content)
    return CheckInput(samples, record, capacity_ah)


def _unexplained(table: Table, file: str, findings: list[Finding]) -> list[Finding]:
    """What stops barnax from reading the file, if no check has found an error in it."""
    if any(finding.severity == "error" for finding in findings):
        return []
    try:
        check_samples(take_samples(table, file))
    except InputError as problem:
        return [Finding("error", str(problem).removeprefix(f"{file}: "), check="reading")]
    return []


def _named(check: str, findings: Iterable[Finding]) -> list[Finding]:
    return [replace(finding, check=check) for finding in findings]
