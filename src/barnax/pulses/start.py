"""What a pulse test tells of its cell by itself: capacity and OCV from its rests, and its start."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..cell import CellModel, OcvPoint, characterize
from ..model.window import Window
from ..records import Record


def own_cell(records: Sequence[Record], capacity_ah: float | None = None) -> CellModel:
    """The cell as the rests of its pulse tests show it, interpolated between them.

    A polynomial would swing between ten points. Raises `InputError` where there are too few.
    """
    return characterize(records, capacity_ah=capacity_ah, ocv_fit="interpolated")


def own_window(record: Record, cell: CellModel, window: Window | None = None) -> Window:
    """Where a pulse test starts: at its first OCV point, at that point's state of charge.

    What is given in `window` stays. Nothing changes where the OCV is of another record.
    """
    window = window or Window()
    points = [
        point
        for point in (*cell.charge_points, *cell.discharge_points)
        if point.source == record.name
    ]
    if not points or window.start_time_s is not None or window.start_after_step is not None:
        return window
    first: OcvPoint = min(points, key=lambda point: point.row)
    start_s = float(record.time_s[np.searchsorted(record.row, first.row)])
    soc = first.soc if window.initial_soc is None else window.initial_soc
    return replace(window, start_time_s=start_s, initial_soc=min(max(soc, 0.0), 1.0))
