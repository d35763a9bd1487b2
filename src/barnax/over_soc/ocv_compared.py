"""How far an OCV of the records' own is from that of a test."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..blas import one_blas_thread
from ..cell.parameters import OCV
from ..execution import in_float64
from ..model.prepared import PreparedRecord
from .fit import OcvCompared, TableFit
from .level import level_cell, leveled, with_own_ocv
from .problem import box_of, reduced_objective
from .settings import TableSettings

COMPARED_SOC = np.linspace(0.1, 0.9, 81)


@in_float64
def compare_with_own(
    prepared_records: Sequence[PreparedRecord], fit: TableFit, settings: TableSettings
) -> OcvCompared | None:
    """How far an OCV of the records' own is from their cell's, at the time constants of tables that
    were fitted to them; None where they visit too little."""
    first = prepared_records[0]
    level = level_cell(first.capacity_ah, float(np.median(first.voltage_v)))
    found = fit.tables.constants
    ranges = {name: (found[name], found[name]) for name in box_of(prepared_records, settings)}

    def without_ocv(prepared: PreparedRecord) -> PreparedRecord:
        return leveled(prepared, level).following(fit.tables.dependence)

    settings = with_own_ocv(replace(settings, folds=0))
    objective = reduced_objective(prepared_records, settings, ranges, without_ocv)
    with one_blas_thread():
        log_scales = tuple(math.log(low) for low, _ in ranges.values())
        best = objective.solve(log_scales, exact=True)
    nodes, own_v = objective.ocv_at(best)
    seen = nodes[objective.visited_of(objective.names.index(OCV))]
    soc = COMPARED_SOC[(seen.min() <= COMPARED_SOC) & (seen.max() >= COMPARED_SOC)]
    if not len(soc):
        return None
    apart_v = np.interp(soc, nodes, own_v) - first.cell.average_ocv_v(soc)
    largest = int(np.argmax(np.abs(apart_v)))
    return OcvCompared(
        median_v=float(np.median(np.abs(apart_v))),
        largest_v=float(apart_v[largest]),
        largest_soc=float(soc[largest]),
    )
