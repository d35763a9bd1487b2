"""Everything that is wrong with a file, and what it can be used for."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from ..cell import OcvTable, read_ocv_table
from ..display import Brief
from ..errors import require_positive
from ..notices import Notice
from ..records import Hold
from ..records.dialects import Sign
from ..records.read import examine, make_record
from ..records.scale import examine_voltage_range
from ..records.sign import decide_sign
from ..records.source import Source, read_source
from ..schema import Json, notice_to_dict
from . import channels, charge, sampling
from .check_input import Check, CheckInput, Traits, traits_of
from .roles import Role, find_fall, find_roles, roles_of_table

# The registry of checks on a record, in reporting order.
CHECKS: Mapping[str, Check] = {
    "gaps": sampling.find_gaps,
    "skipped": sampling.find_skipped,
    "breaks": sampling.find_breaks,
    "coarse intervals": sampling.find_coarse_intervals,
    "late voltage, smoothed current": sampling.find_late_voltage,
    "fast load": sampling.find_fast_load,
    "rebuilt clock": sampling.find_rebuilt_clock,
    "rests": charge.find_rests,
    "clipped current": channels.find_clipped_current,
    "stuck voltage": channels.find_stuck_voltage,
    "stuck current": channels.find_stuck_current,
    "spikes": channels.find_spikes,
    "temperature": sampling.find_temperature,
    "counters": charge.find_counters,
    "capacity": charge.find_capacity,
    "closure": charge.find_closure,
    "resolution": sampling.find_resolution,
}
_ORDER = {"error": 0, "warning": 1, "note": 2}
# Testers' own files cannot be edited: they are exported first.
_BINARY_SUFFIXES = (".nda", ".ndax", ".mpr", ".res")


@dataclass(frozen=True, repr=False)
class FileCheck(Brief):
    """Findings in one file, and its possible roles. A table of OCV over SOC has no traits.

    Attributes:
        file: Its name.
        findings: Every problem with its row and remedy, by severity, then by row.
        roles: What the file can be used for once its errors are fixed; empty if too little can be
            read.
        traits: What it holds, once mended so far as it could be, and what kind of test it is; None
            if too little can be read.
    """

    file: str
    findings: tuple[Notice, ...]
    roles: tuple[Role, ...]
    traits: Traits | None = None

    @property
    def is_clean(self) -> bool:
        """True if there are only notes."""
        return not any(finding.counts for finding in self.findings)

    def to_dict(self) -> Json:
        """The outcome as plain values."""
        return {
            "file": self.file,
            "clean": self.is_clean,
            "findings": [
                {"check": finding.check, **notice_to_dict(finding)} for finding in self.findings
            ],
            "facts": None if self.traits is None else self.traits.facts,
            "roles": {role.name: role.to_dict() for role in self.roles},
        }


def check_file(
    source: str | Path | Source,
    *,
    capacity_ah: float | None = None,
    columns: Mapping[str, str] | str = "",
    current_sign: Sign | Literal["auto"] = "auto",
    current_hold: Hold | Literal["auto"] = "auto",
    voltage_lag: float | None = None,
    rest_current_a: float | None = None,
) -> FileCheck:
    """Every problem in a cycler file, and what the file can be used for.

    The rules are those of `read_record`, which raises the first error, and others on the record as
    a whole. Each problem is repaired as far as possible before the next rule is applied, so that
    one does not hide another.

    Args:
        source: The file.
        capacity_ah: Capacity of the cell; with it, the charge is checked too.
        columns: Names of columns, as for `read_record`.
        current_sign: The sign of the file's current; "auto" decides from the data.
        current_hold: When a sample's current flows; "auto" decides from the data.
        voltage_lag: Seconds by which the voltage is older than the current of its row, if known.
        rest_current_a: The cell rests below this current; by default found from the data.

    Raises `InputError` if the file is not a table or the capacity is not positive.

    >>> from barnax.bundled import bundled_file
    >>> checked = check_file(bundled_file("identification"))
    >>> checked.is_clean, [role.name for role in checked.roles if role.is_usable]
    (True, ['identification', 'validation'])
    """
    require_positive("capacity", capacity_ah, "Ah")
    if not isinstance(source, Source):
        source = read_source(source, columns=columns)
    if source.table.header.is_ocv_table:
        return _check_table(read_ocv_table(source))
    samples, examined = examine(source, capacity_ah)
    findings = [*examined]
    roles, traits = (), None
    # Absurd values overflow before they are detected.
    with np.errstate(all="ignore"):
        if samples is not None and samples.intervals_s.min() > 0 and samples.peak_a > 0:
            within = examine_voltage_range(samples)
            samples = channels.in_one_sign(within)
            # A current without any sign has been reported already.
            is_reported = any(finding.check == "sign" for finding in findings)
            findings += samples.findings[len(within.findings) :]
            sign, doubts = decide_sign(samples, current_sign, source.name)
            findings += [] if is_reported else doubts
            record = make_record(source, samples, sign, current_hold)
            part = source.cut(samples)
            user = {"capacity_ah": capacity_ah, "given_rest_a": rest_current_a}
            given = CheckInput.of(part, record, voltage_lag, **user)
            for check in CHECKS.values():
                findings += check(given)
            traits = traits_of(given)
            roles = find_roles(given, traits)
    if source.name.lower().endswith(_BINARY_SUFFIXES):
        edit = {"edit": "exported"}
        findings = [replace(finding, values={**finding.values, **edit}) for finding in findings]
    findings.sort(key=lambda finding: (_ORDER[finding.severity], finding.row or 0))
    return FileCheck(source.name, tuple(findings), roles, traits)


def _check_table(table: OcvTable) -> FileCheck:
    """The check of a table of OCV over SOC."""
    findings = [replace(warning, subject="", rating="note") for warning in table.warnings]
    for points in table.branches.values():
        fall = find_fall(points)
        if fall:
            before, after = fall
            values = {"from_v": before.voltage_v, "from_soc": before.soc}
            values |= {"to_v": after.voltage_v, "to_soc": after.soc}
            findings.append(Notice("monotone.falls", values, row=after.row))
    findings.sort(key=lambda finding: _ORDER[finding.severity])
    return FileCheck(table.name, tuple(findings), roles_of_table(table))
