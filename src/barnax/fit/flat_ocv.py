"""A cell with a constant OCV, so that a fitted OCV table holds the OCV of the records alone; and
the cell with that OCV."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..cell import CellModel, OcvPoint, OcvTable, characterize, get_circuit
from ..cell.curves import InterpolatedCurve, SegmentedHysteresis
from ..cell.model import FitError
from ..cell.ocv_points import EITHER
from ..cell.parameters import HALF_HYSTERESIS, RATE
from ..cell.soc_axis import CHARGE, DISCHARGE
from ..model.prepared import PreparedRecord
from ..settings import NODES
from .objective import Solution, TableObjective
from .settings import TableSettings

# An OCV bends more than resistances do, so its nodes are closer: closest near full, where the OCV
# of LFP falls within 1 % and a hysteresis would absorb any shape between nodes, and a little
# beyond, because full is the mean of what several records call full; but not near empty, where no
# circuit models the voltage and the fall of one record would be taken for that of all.
OCV_NODES = (
    *(node for node in NODES if node < 0.05),
    *(number / 80 for number in range(4, 16)),
    *(number / 40 for number in range(8, 36)),
    *(number / 80 for number in range(72, 78)),
    *(number / 160 for number in range(156, 158)),
    *(number / 320 for number in range(316, 324)),
)
# The table is relative to a constant, so its ridge is negligible.
FREE_RIDGE = 1e-12
NEARLY_LEVEL_V = 1e-6
# A hysteresis that turns more slowly cannot be distinguished from an OCV; one that turns faster,
# within 1 % SOC, from resistances that fall with the current.
DISTINCT_RATES = (10.0, 300.0)
# Between two nodes the OCV is a straight line; this many points represent it in a curve.
POINTS_A_NODE = 8


def with_fitted_ocv(settings: TableSettings, circuit: str | None = None) -> TableSettings:
    """A copy with a table of the OCV instead of its correction, and with one of a dynamic
    hysteresis if the circuit has one."""
    if circuit is not None and get_circuit(circuit).has_rate:
        bounds = {**settings.bounds, **({} if RATE in settings.ranges else {RATE: DISTINCT_RATES})}
        settings = replace(settings, half_hysteresis=True, bounds=bounds)
    return replace(
        settings,
        ocv_nodes=settings.ocv_nodes or OCV_NODES,
        ocv_correction=True,
        voltage_ridge=min(settings.voltage_ridge, FREE_RIDGE),
    )


def flat_ocv_cell(capacity_ah: float, voltage_v: float) -> CellModel:
    """A cell with a constant OCV: the table has to supply all of it."""
    soc = np.array([-1.0, 2.0])
    line = InterpolatedCurve.fit(soc, voltage_v + NEARLY_LEVEL_V * soc)
    points = tuple(OcvPoint(at, voltage_v, "", 0, 0.0) for at in soc.tolist())
    error = FitError(0.0, 0.0)
    return CellModel(
        capacity_ah, "", line, line, SegmentedHysteresis.zero(), (), points, {"average": error}
    )


def with_flat_ocv(
    prepared_records: Sequence[PreparedRecord], like: PreparedRecord | None = None
) -> list[PreparedRecord]:
    """The records with a constant OCV at the level of the first one, or of another, and with their
    hysteresis."""
    first = like or prepared_records[0]
    level, moved = flat_ocv_cell(first.capacity_ah, float(np.median(first.voltage_v))), []
    for prepared in prepared_records:
        cell_v, level_v = (cell.average_ocv_v(prepared.soc) for cell in (prepared.cell, level))
        source_v = prepared.source_v - cell_v + level_v
        moved.append(replace(prepared, cell=level, source_v=source_v))
    return moved


def cell_with_fitted_ocv(
    objective: TableObjective, best: Solution, capacity_ah: float, origin: str
) -> CellModel:
    """The cell with the OCV of a solution, over the range of the samples."""
    nodes, ocv_v = objective.ocv_at(best)
    soc = np.concatenate([prepared.soc[prepared.scored] for prepared in objective.prepared_records])
    # Straight lines between nodes are the fit; a cubic through the nodes would be a different OCV.
    low, high = max(nodes[0], float(soc.min())), min(nodes[-1], float(soc.max()))
    fine = np.interp(
        np.arange(POINTS_A_NODE * (len(nodes) - 1) + 1) / POINTS_A_NODE,
        np.arange(len(nodes)),
        nodes,
    )
    at = np.unique([low, *fine[(fine > low) & (fine < high)], high])
    name = " + ".join(prepared.record.name for prepared in objective.prepared_records)
    ocv_v, half_v = np.interp(at, nodes, ocv_v), 0.0
    if HALF_HYSTERESIS in objective.names:
        table = objective.names.index(HALF_HYSTERESIS)
        half_v = np.interp(at, objective.nodes_of[table], best.values[table])
    directions = (DISCHARGE, CHARGE) if np.any(half_v) else (EITHER,)
    branches = {
        direction: tuple(
            OcvPoint(*pair, name, row=0, rest_s=0.0)
            for pair in zip(at.tolist(), (ocv_v + direction * half_v).tolist(), strict=True)
        )
        for direction in directions
    }
    table = OcvTable(name, branches, sha256="")
    cell = characterize([table], capacity_ah=capacity_ah, ocv_fit="interpolated")
    # The checks of a measured OCV table do not apply.
    return replace(cell, capacity_origin=origin, warnings=())
