"""The time in which a cell's own resistance would move its charge.

R dQ/dV, resistance times the charge that moves the source voltage by one volt, in s. It does not
depend on the unit of the current, so it tells a wrong unit of time from a wrong unit of current.
On whole records of four cells of 2 to 33 Ah it was 130 to 850 s; near empty, where the voltage is
steep, 2 s; on the small charge of a flat stretch 1900 s.
"""

import numpy as np

from ..records.samples import Samples
from .case import STEP_SHARE, step_resistance_ohm


def bulk_time_s(samples: Samples) -> tuple[float, float]:
    """R dQ/dV over the record, in s, and the travel of its voltage without R I, in V.

    The time is zero where the current's steps do not tell R.
    """
    step_a, step_v = np.diff(samples.current_a), np.diff(samples.voltage_v)
    is_step = (np.abs(step_a) > STEP_SHARE * np.abs(samples.current_a).max()) & (step_v != 0)
    resistance_ohm = step_resistance_ohm(step_a[is_step], step_v[is_step])
    rising = np.sign(np.sum(step_a[is_step] * step_v[is_step]))
    source_v = samples.voltage_v - rising * resistance_ohm * samples.current_a
    low_v, high_v = np.quantile(source_v, [0.02, 0.98])
    travel_v = float(high_v - low_v)
    if not resistance_ohm or travel_v <= 0:
        return 0.0, travel_v
    return resistance_ohm * 3600 * span_ah(samples) / travel_v, travel_v


def span_ah(samples: Samples) -> float:
    """The charge between the fullest and emptiest moments."""
    passed = np.cumsum(samples.current_a[1:] * np.diff(samples.time_s))
    return float(np.ptp(passed)) / 3600
