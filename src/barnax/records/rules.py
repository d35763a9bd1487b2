"""All rules on a file that need no cell, in order.

Each fault is mended as far as it can be before the next rule looks, so that one fault does not
hide another.
"""

from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from .cells import examine_cells, examine_columns
from .clock import examine_clock, examine_repeats, merge_repeats
from .columns import NEEDED
from .findings import Finding, named
from .samples import Samples, samples_of
from .table import Table, take_lines
from .units import examine_current_unit, examine_time_unit, examine_voltage

_FEWEST_SAMPLES = 10
_SHORTEST_S = 1e-6

_CONTENT = {
    b"PK\x03\x04": ("an OOXML workbook", (".xlsx", ".xlsm")),
    b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1": ("a workbook of the kind before OOXML", (".xls",)),
    b"PAR1": ("a Parquet table", (".parquet", ".pq")),
}


@dataclass(frozen=True, eq=False)
class Examined:
    """A table's samples, and what the rules found.

    `samples` are as the file gives them, fit for a record where no finding is an error. `mended`
    are what they would be without their faults, None where too little is left to look at.
    """

    samples: Samples | None
    mended: Samples | None
    findings: tuple[Finding, ...]


def examine(table: Table, file: str, capacity_ah: float | None = None) -> Examined:
    """The samples of a table, and what is wrong with them; `capacity_ah` lets charge be judged.

    Raises InputError where no column is like any of a record.
    """
    columns, found = examine_columns(table, file)
    findings = named("columns", found)
    lines, found = examine_cells(take_lines(table, columns))
    findings += named("cells", found)
    if not columns.keys() >= NEEDED:
        return Examined(None, None, tuple(findings))
    samples = mended = samples_of(lines)
    if short := _too_short(mended):
        # Where bad cells took the samples, that is said already.
        findings += [] if any(each.severity == "error" for each in findings) else [short]
        return Examined(None, None, tuple(findings))
    # Absurd values overflow on their way to being found absurd.
    with np.errstate(all="ignore"):
        for check, rule in (
            ("clock", examine_clock),
            ("voltage unit", examine_voltage),
            ("repeats", examine_repeats),
            ("time unit", examine_time_unit),
            ("current unit", lambda given: examine_current_unit(given, capacity_ah)),
        ):
            mended, found = rule(mended)
            findings += named(check, found)
            if short := _too_short(mended):
                return Examined(None, None, (*findings, short))
        is_usable = bool(np.all(np.diff(mended.time_s) > 0) and mended.peak_a > 0)
    if not any(finding.severity == "error" for finding in findings):
        samples = merge_repeats(samples)
    return Examined(samples, mended if is_usable else None, tuple(findings))


def _too_short(samples: Samples) -> Finding | None:
    """An error where too few samples are left, or too little time."""
    count = len(samples)
    what, remedy = "", "give a longer record"
    if count == 0:
        what, remedy = "no samples stand below the header", "give the file with its data"
    elif count < _FEWEST_SAMPLES:
        what = f"a record of {count} samples is too short; at least {_FEWEST_SAMPLES} are needed"
    elif np.ptp(samples.time_s) < _SHORTEST_S:
        what = f"the record lasts {np.ptp(samples.time_s):.3g} s by '{samples.header('time')}'"
        remedy = "give the column that holds the time, with its unit"
    return Finding("error", what, remedy, check="length") if what else None


def examine_suffix(file: str, content: bytes) -> tuple[Finding, ...]:
    """A note where a file's suffix promises another format than its content is."""
    suffix = PurePath(file).suffix.lower()
    known = {own for _, suffixes in _CONTENT.values() for own in suffixes}
    kind, suffixes = next(
        (own for start, own in _CONTENT.items() if content.startswith(start)), ("text", ())
    )
    if suffix in suffixes or (suffix not in known and kind == "text"):
        return ()
    what = f"the content is {kind}, although the name ends in '{suffix}'"
    remedy = "barnax goes by the content; other programs may not"
    return (Finding("note", what, remedy, check="format"),)
