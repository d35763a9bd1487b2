"""A cell whose OCV says nothing: what a table then finds is the OCV of the records alone."""

from dataclasses import replace

import numpy as np

from ..cell import CellModel, OcvPoint, get_circuit
from ..cell.curves import InterpolatedCurve, SegmentedHysteresis
from ..cell.model import FitError
from ..cell.parameters import RATE
from ..model.prepared import PreparedRecord
from ..settings import NODES
from .settings import TableSettings

# An OCV bends more than resistances do: closer nodes, and the closest near full, where that of LFP
# falls within 1 % and a hysteresis would take up what it has between nodes; but not near empty,
# where no circuit follows and the fall of one record would be taken for that of all.
OCV_NODES = (
    *(node for node in NODES if node < 0.05),
    *(place / 80 for place in range(4, 16)),
    *(place / 40 for place in range(8, 36)),
    *(place / 80 for place in range(72, 78)),
    *(place / 160 for place in range(156, 158)),
    *(place / 320 for place in range(316, 321)),
)
# It is measured from a line that says nothing.
FREE_RIDGE = 1e-12
NEARLY_LEVEL_V = 1e-6
# A hysteresis that turns more slowly cannot be told from an OCV; one that turns faster, within 1 %
# SOC, from resistances that fall with the current.
OWN_RATES = (10.0, 300.0)


def with_own_ocv(settings: TableSettings, circuit: str | None = None) -> TableSettings:
    """The same with a table of the OCV in place of its correction, and with one of a dynamic
    hysteresis where the circuit has that."""
    if circuit is not None and get_circuit(circuit).has_rate:
        bounds = {**settings.bounds, **({} if RATE in settings.ranges else {RATE: OWN_RATES})}
        settings = replace(settings, half_hysteresis=True, bounds=bounds)
    return replace(
        settings,
        ocv_nodes=settings.ocv_nodes or OCV_NODES,
        ocv_correction=True,
        voltage_ridge=min(settings.voltage_ridge, FREE_RIDGE),
    )


def level_cell(capacity_ah: float, voltage_v: float) -> CellModel:
    """A cell whose OCV says nothing: all of it is left to the table."""
    soc = np.array([-1.0, 2.0])
    line = InterpolatedCurve.fit(soc, voltage_v + NEARLY_LEVEL_V * soc)
    points = tuple(OcvPoint(place, voltage_v, "", 0, 0.0) for place in soc.tolist())
    error = FitError(0.0, 0.0)
    return CellModel(
        capacity_ah, "", line, line, SegmentedHysteresis.zero(), (), points, {"average": error}
    )


def leveled(prepared: PreparedRecord, level: CellModel) -> PreparedRecord:
    """The record with such a cell, and the hysteresis that it has."""
    known_v, level_v = (cell.average_ocv_v(prepared.soc) for cell in (prepared.cell, level))
    return replace(prepared, cell=level, source_v=prepared.source_v - known_v + level_v)
