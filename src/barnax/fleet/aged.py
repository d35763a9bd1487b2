"""What the records of a fleet's row tell of its cell's ageing."""

import hashlib
import itertools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from ..errors import InputError
from ..model.prepared import PreparedRecord
from ..notices import Notice
from ..over_soc.ageing import (
    AGED,
    CAPACITY,
    OCV_NODES,
    SHAPES_V,
    Aged,
    measure_ageing,
    shows_both_ends,
)
from ..over_soc.settings import TableSettings

# A capacity that is so far off shows in the slower resistances.
OTHER_CAPACITY = 0.01


def ageing_row(
    records: Sequence[PreparedRecord], *, is_own: bool = False
) -> tuple[dict[str, Any], list[Notice]]:
    """Values of a cell's ageing from its records at one age, under "aged" names, and what is
    doubtful of them; `is_own` where no other records, and no OCV test, told its OCV."""
    passed_as = sum(
        float(np.abs(prepared.record.interval_current_a) @ np.diff(prepared.record.time_s))
        for prepared in records
    )
    ocv_v = records[0].cell.average_ocv_v(OCV_NODES)
    row: dict[str, Any] = {
        "record throughput [A.h]": passed_as / 3600,
        "aged beside OCV": hashlib.sha256(ocv_v.tobytes()).hexdigest()[:16],
    }
    told: Mapping[str, Aged] = {}
    with suppress(InputError):
        told = measure_ageing(
            records, TableSettings(), is_own=is_own and records[0].cell.is_of_records
        )
    row |= dict.fromkeys(("aged capacity to empty", "aged log evidence by shape"))
    if CAPACITY in told:
        row["aged capacity to empty"] = shows_both_ends(records, told[CAPACITY].value)
    for name in AGED:
        value = told.get(name)
        is_told = value is not None and value.is_determined
        for end in ("value", "low", "high"):
            column = f"aged {name}" + f" {end}" * (end != "value")
            row[column] = getattr(value, end) if is_told else None
        row[f"aged {name} by OCV"] = value and [*value.by_ocv]
        row[f"aged {name} by shape"] = None
        if value is not None and len(value.by_shape) == len(SHAPES_V):
            row["aged log evidence by shape"] = [*value.log_evidence]
            row[f"aged {name} by shape"] = [*itertools.chain(*value.by_shape)]
    return row, [*_doubts(told, records[0])]


def _doubts(told: Mapping[str, Aged], used: PreparedRecord) -> Iterator[Notice]:
    """That values have not settled, and that a record shows another capacity than that of its
    circuit, by more than is of account."""
    if not all(value.is_settled for value in told.values()):
        yield Notice("ageing.not-settled", subject=used.record.name)
    found = told.get(CAPACITY)
    if found is None or not found.is_determined:
        return
    nearest_ah = min(max(used.capacity_ah, found.low), found.high)
    if abs(nearest_ah / used.capacity_ah - 1) > OTHER_CAPACITY:
        ends = {"low_ah": found.low, "high_ah": found.high, "used_ah": used.capacity_ah}
        yield Notice("ageing.other-capacity", ends, used.record.name)
