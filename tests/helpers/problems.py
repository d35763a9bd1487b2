"""What a made record says of a cell: its voltage on a drive, by the reference alone."""

import numpy as np

from reference import drop_v, looped_response, make_record

R0_OHM, R_OHM, TAU_S = 0.05, (0.01, 0.02), (5.0, 80.0)


def drive_a(samples, seed=0, interval=10):
    """A current that jumps every few samples between rest, discharge and charge."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.choice([0.0, 2.0, 3.0, -1.0], samples // interval + 1), interval)[:samples]


def simulated_record(cell, time_s, current_a, soc, direction, **changes):
    """A record of `cell` from `soc` on, whose hysteresis follows the current's last direction."""
    time_s, current_a = np.asarray(time_s, float), np.asarray(current_a, float)
    charge_ah = np.append(0.0, np.cumsum(current_a[:-1] * np.diff(time_s))) / 3600
    directions = []
    for flowing_a in current_a:
        direction = -np.sign(flowing_a) if flowing_a else direction
        directions.append(direction)
    soc = soc - charge_ah / cell.capacity_ah
    source_v = cell.average_ocv_v(soc) + np.array(directions) * cell.hysteresis_v(soc) / 2
    drop = drop_v(looped_response, time_s, current_a, (R0_OHM, R_OHM, TAU_S))
    return make_record(time_s, current_a, source_v - drop, **changes)
