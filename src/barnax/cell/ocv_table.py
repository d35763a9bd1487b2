"""OCV over SOC as a table, and whether a file holds one or a record of an OCV test."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..display import Brief
from ..errors import InputError
from ..notices import Notice
from ..records import Record, Source, read_record, read_source
from ..records.quantities import CELL_RANGE_V
from ..records.scale import of_one_cell
from ..records.table import Lines, notice_at, take_lines
from ..settings import AutoHold, AutoSign
from .ocv_points import MINIMUM_POINTS
from .soc_axis import CHARGE, DISCHARGE, OcvPoint

# SOC may pass full and empty a little; what is far beyond is in percent, or no SOC.
_SOC_RANGE, _PERCENT_FROM = (-0.1, 1.1), 1.5
# The direction of a table with a single column of voltage.
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
    columns = dict(source.table.header.ocv_columns)
    if not source.table.header.is_ocv_table:
        raise InputError(
            f"{source.name}: not an OCV table; name its columns, for example, 'SOC [-]' and "
            "'OCV [V]', or 'SOC [-]', 'discharge OCV [V]' and 'charge OCV [V]'."
        )
    if "discharge OCV" in columns or "charge OCV" in columns:
        columns.pop("OCV", None)
    lines = take_lines(source.table, columns)
    voltages = [name for name in columns if name != "SOC"]
    of_one = {name: of_one_cell(lines.values[name], source.series) for name in voltages}
    lines = lines.having(**of_one)
    assumed = [column.header for column in columns.values() if column.is_unit_assumed]
    taken = [{"column": name, "unit": "V"} for name in assumed]
    scale = 1.0
    if np.nanmax(lines.values["SOC"], initial=0.0) > _PERCENT_FROM:
        scale = 0.01
        taken.append({"column": columns["SOC"].header, "unit": "percent"})
    warnings = [Notice("ocv-table.assumed", values, source.name) for values in taken]
    branches = {_DIRECTIONS[name]: _branch(source.name, lines, name, scale) for name in voltages}
    return OcvTable(source.name, branches, source.sha256, tuple(warnings))


def _branch(file: str, lines: Lines, name: str, scale: float) -> tuple[OcvPoint, ...]:
    """The points of one voltage column; lines with an empty cell in it are passed over."""
    soc, voltage_v = scale * lines.values["SOC"], lines.values[name]
    points: list[OcvPoint] = []
    for line in np.argsort(soc, kind="stable").tolist():
        if lines.cell(name, line) is None:
            continue
        point = OcvPoint(float(soc[line]), float(voltage_v[line]), file, int(lines.row[line]), 0.0)
        is_wrong = {
            "soc": not _SOC_RANGE[0] <= point.soc <= _SOC_RANGE[1],
            "voltage": not CELL_RANGE_V[0] <= point.voltage_v <= CELL_RANGE_V[1],
            "twice": bool(points) and point.soc == points[-1].soc,
        }
        for wrong in filter(is_wrong.get, is_wrong):
            soc_cell, cell = (repr(lines.cell(each, line)) for each in ("SOC", name))
            given = {"wrong": wrong, "soc": point.soc, "soc_cell": soc_cell, "cell": cell}
            raise notice_at(lines, line, "ocv-table.point", **given).about(file).error(".")
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
    current_sign: AutoSign = "auto",
    current_hold: AutoHold = "auto",
    voltage_lag: float | None = None,
) -> Record | OcvTable:
    """The OCV test in a file: a table of OCV over SOC, else a record, read as by `read_record`."""
    if not isinstance(source, Source):
        source = read_source(source)
    if source.table.header.is_ocv_table:
        return read_ocv_table(source)
    return read_record(
        source, current_sign=current_sign, current_hold=current_hold, voltage_lag=voltage_lag
    )
