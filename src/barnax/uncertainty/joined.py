"""The scored samples of several records one after the other: their clock, and what starts make of
their errors."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from ..model.prepared import PreparedRecord


def open_starts(
    prepared_records: Sequence[PreparedRecord],
) -> tuple[Float[np.ndarray, "scored starts"], Float[np.ndarray, "starts"]]:
    """What a standard error of every start that voltages tell makes of the errors, and how far the
    start is from what they tell, in standard errors."""
    # Half the digits are enough of an error of an error.
    by_start_v = [
        -own.start.soc_sd * own.cell.ocv_slope(own.soc[own.scored])[:, None].astype(np.float32)
        for own in prepared_records
    ]
    columns = np.asarray(block_diag(*by_start_v))
    is_open = np.any(columns != 0, axis=0)
    shifts_sd = np.array([own.start_shift_sd for own in prepared_records])
    return columns[:, is_open], shifts_sd[is_open]


def one_clock(prepared_records: Sequence[PreparedRecord]) -> Float[np.ndarray, "scored"]:
    """Times of all scored samples, no lag within a record being one between records."""
    gap_s = max(
        prepared.scored_duration_s + 2 * prepared.median_interval_s for prepared in prepared_records
    )
    times, start_s = [], 0.0
    for prepared in prepared_records:
        time_s = prepared.time_s[prepared.scored]
        first_s = time_s[0]
        # In place: a long record has no room for copies.
        time_s += start_s
        time_s -= first_s
        times.append(time_s)
        start_s = times[-1][-1] + gap_s
    return np.concatenate(times)
