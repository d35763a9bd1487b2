"""What a record does to a cell's hysteresis: its size, who turns it, and how often."""

from dataclasses import dataclass

import numpy as np

from barnax.cell import CellModel
from barnax.model.prepared import PreparedRecord


@dataclass(frozen=True)
class Condition:
    """Over the scored samples: half the gap (rms), charged over discharged ampere-hours, how often
    the direction Sig switches, and the charge that passes between two switches (median), as a
    share of the capacity.
    """

    half_gap_v: float
    charging_share: float
    switches_per_hour: float
    soc_between_switches: float


def condition_of(prepared: PreparedRecord, cell: CellModel) -> Condition:
    """The condition of one record on one cell."""
    scored = prepared.scored
    held_a, interval_s = prepared.held_a[:-1], np.diff(prepared.time_s)
    within = scored[:-1] & scored[1:]
    passed_ah = held_a[within] * interval_s[within] / 3600
    direction = prepared.direction[scored]
    switches = np.flatnonzero(np.diff(direction) != 0)
    throughput = np.cumsum(np.abs(passed_ah)) / cell.capacity_ah
    between = np.diff(throughput[np.minimum(switches, len(throughput) - 1)])
    return Condition(
        half_gap_v=float(np.sqrt(np.mean((cell.hysteresis_v(prepared.soc[scored]) / 2) ** 2))),
        charging_share=float(-passed_ah[passed_ah < 0].sum() / passed_ah[passed_ah > 0].sum()),
        switches_per_hour=float(3600 * len(switches) / interval_s[within].sum()),
        soc_between_switches=float(np.median(between)) if len(between) else float("nan"),
    )
