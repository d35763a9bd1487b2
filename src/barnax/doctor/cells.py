"""Cells that hold no number where one is needed."""

import numpy as np
from jaxtyping import Bool

from ..records.lines import Lines
from ..records.samples import required
from .finding import Finding, Severity, counted

# Even nanoseconds since 1970 are less.
_LARGEST = 1e20


def examine_cells(lines: Lines) -> tuple[Lines, list[Finding]]:
    """The lines whose time, current and voltage are finite, and what stands in the others."""
    findings = []
    is_good = np.ones(len(lines.row), bool)
    units = _units_row(lines)
    if units:
        findings.append(
            _at(
                lines,
                0,
                "error",
                f"the row below the names holds no numbers but {units}, as units",
                "write the units into the names, as in 'Current / mA', and delete the row",
            )
        )
        is_good[0] = False
    for name, column in lines.columns.items():
        bad = _is_bad(lines, name) & is_good
        if not bad.any():
            continue
        first = int(np.argmax(bad))
        cell = lines.cell(name, first)
        stands = "nothing" if cell is None else repr(cell)
        cells = counted(int(bad.sum()), "cell")
        what = f"{stands} stands under '{column.header}', where a number is needed ({cells})"
        if not column.quantity.is_required:
            findings.append(_at(lines, first, "note", f"{what}; the column is left out"))
        elif bad.sum() == is_good.sum():
            remedy = f"export the column as plain numbers in {column.unit.symbol}"
            findings.append(_at(lines, first, "error", what, remedy))
        else:
            remedy = "delete these rows, or fill them from the tester's own file"
            findings.append(_at(lines, first, "error", what, remedy))
    for name in required(lines):
        is_good &= ~_is_bad(lines, name)
    return lines.keep(is_good), findings


def _is_bad(lines: Lines, name: str) -> Bool[np.ndarray, "lines"]:
    """Where no number stands, or one that no tester reads."""
    bad = lines.bad(name)
    return bad | (np.abs(np.where(bad, 0.0, lines.values[name])) > _LARGEST)


def _units_row(lines: Lines) -> str:
    """The units that the first line spells under time, current and voltage, or nothing."""
    spelled = []
    for name in required(lines):
        cell = lines.cell(name, 0) if len(lines.row) else None
        word = cell.strip().strip("[]()").lower() if isinstance(cell, str) else ""
        if word not in lines.columns[name].quantity.units:
            return ""
        spelled.append(repr(cell))
    return ", ".join(spelled)


def _at(lines: Lines, line: int, severity: Severity, what: str, remedy: str = "") -> Finding:
    sheet = lines.sheets[int(lines.sheet[line])] if len(lines.sheets) > 1 else None
    return Finding(severity, what, remedy, int(lines.row[line]), sheet)
