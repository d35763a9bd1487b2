"""An OCV table: SOC with the voltage at rest, read from a file."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ..display import Brief
from ..errors import InputError
from ..notices import Notice, notice
from ..records import Hold, Record, Source, read_record, read_source
from ..records.columns import find_columns, is_ocv_table
from ..records.dialects import Sign
from ..records.quantities import CELL_RANGE_V, OCV_QUANTITIES
from ..records.table import Lines, found_at, take_lines
from .ocv_points import MINIMUM_POINTS
from .soc_axis import CHARGE, DISCHARGE, OcvPoint

# SOC may pass full and empty a little; what is far beyond is in percent, or no SOC.
_SOC_RANGE, _PERCENT_FROM = (-0.1, 1.1), 1.5


# Of a voltage that was not measured in one direction only.
EITHER = 0
_DIRECTIONS = {"discharge OCV": DISCHARGE, "charge OCV": CHARGE, "OCV": EITHER}


@dataclass(frozen=True, repr=False)
class OcvTable(Brief):
    """OCV over SOC from a file or data frame.

    Attributes:
        name: Name of the file.
        branches: Points (SOC as a fraction, OCV in V), by increasing SOC, of the discharge (-1), of
            the charge (+1), or of a single curve for both (0).
        sha256: Digest of the file.
        warnings: What is doubtful, with what to do.
    """

    name: str
    branches: Mapping[int, tuple[OcvPoint, ...]]
    sha256: str
    warnings: tuple[Notice, ...] = ()


def read_ocv_table(source: str | Path | Source) -> OcvTable:
    """The OCV table in a file: SOC with one voltage, or with one of charge and one of discharge.

    Args:
        source: The file. Its columns are called "SOC [-]" or "SOC / %", and "OCV [V]" or "discharge
            OCV [V]" and "charge OCV [V]"; the usual other spellings are understood.

    Raises `InputError` that names the file and the row where it holds anything else.

    >>> import pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "ocv.csv")
    ...     _ = file.write_text("SOC / %,OCV / V\\n0,3.0\\n30,3.5\\n60,3.7\\n100,4.2\\n")
    ...     table = read_ocv_table(file)
    >>> [point.soc for point in table.branches[0]]
    [0.0, 0.3, 0.6, 1.0]
    """
    if not isinstance(source, Source):
        source = read_source(source)
    columns = find_columns(source.table.header, OCV_QUANTITIES)
    if not is_ocv_table(source.table.header, source.columns):
        raise InputError(
            f"{source.name}: not an OCV table; name its columns, for example, 'SOC [-]' and "
            "'OCV [V]', or 'SOC [-]', 'discharge OCV [V]' and 'charge OCV [V]'."
        )
    if "discharge OCV" in columns or "charge OCV" in columns:
        columns.pop("OCV", None)
    lines = take_lines(source.table, columns)
    voltages = {name: lines.values[name] for name in columns if name != "SOC"}
    lines = lines.having(**{name: source.of_one_cell(column) for name, column in voltages.items()})
    warnings = [
        notice("ocv-table.volts", source.name, column=column.header)
        for column in columns.values()
        if column.is_unit_assumed
    ]
    scale = 1.0
    if np.nanmax(lines.values["SOC"], initial=0.0) > _PERCENT_FROM:
        scale = 0.01
        warnings.append(notice("ocv-table.percent", source.name, column=columns["SOC"].header))
    branches = {
        _DIRECTIONS[name]: _branch(source.name, lines, name, scale)
        for name in columns
        if name != "SOC"
    }
    return OcvTable(source.name, branches, source.sha256, tuple(warnings))


def _branch(file: str, lines: Lines, name: str, scale: float) -> tuple[OcvPoint, ...]:
    """The points of one voltage column; lines with an empty cell in it are passed over."""
    soc, voltage_v = scale * lines.values["SOC"], lines.values[name]
    points: list[OcvPoint] = []
    for line in np.argsort(soc, kind="stable").tolist():
        if lines.cell(name, line) is None:
            continue
        point = OcvPoint(float(soc[line]), float(voltage_v[line]), file, int(lines.row[line]), 0.0)
        code = ""
        if not _SOC_RANGE[0] <= point.soc <= _SOC_RANGE[1]:
            code = "ocv-table.no-soc"
        elif not CELL_RANGE_V[0] <= point.voltage_v <= CELL_RANGE_V[1]:
            code = "ocv-table.no-voltage"
        elif points and point.soc == points[-1].soc:
            code = "ocv-table.twice"
        if code:
            cells = {
                "soc_cell": repr(lines.cell("SOC", line)),
                "cell": repr(lines.cell(name, line)),
            }
            raise found_at(lines, line, code, soc=point.soc, **cells).about(file).error(".")
        points.append(point)
    if len(points) < MINIMUM_POINTS:
        raise InputError(
            f"{file}: an OCV table needs at least {MINIMUM_POINTS} points, and "
            f"'{lines.columns[name].header}' has {len(points)}."
        )
    return tuple(points)


def read_ocv_test(
    source: str | Path | Source,
    *,
    current_sign: Sign | Literal["auto"] = "auto",
    current_hold: Hold | Literal["auto"] = "auto",
    voltage_lag: float | None = None,
) -> Record | OcvTable:
    """The OCV test in a file: a table of OCV over SOC, else a record."""
    if not isinstance(source, Source):
        source = read_source(source)
    if is_ocv_table(source.table.header, source.columns):
        return read_ocv_table(source)
    return read_record(
        source, current_sign=current_sign, current_hold=current_hold, voltage_lag=voltage_lag
    )
