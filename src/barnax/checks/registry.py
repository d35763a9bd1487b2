"""The registry of checks on a record, in the order in which they are told."""

from collections.abc import Mapping

from .channels import (
    find_clipped_current,
    find_current_spikes,
    find_stuck_current,
    find_stuck_voltage,
    find_voltage_spikes,
)
from .charge import find_capacity, find_closure, find_counters, find_rests
from .check_input import Check
from .sampling import (
    find_coarse_intervals,
    find_gaps,
    find_rebuilt_clock,
    find_resolution,
    find_temperature,
)
from .sign import find_sign

CHECKS: Mapping[str, Check] = {
    "sign": find_sign,
    "gaps": find_gaps,
    "coarse intervals": find_coarse_intervals,
    "rebuilt clock": find_rebuilt_clock,
    "rests": find_rests,
    "clipped current": find_clipped_current,
    "stuck voltage": find_stuck_voltage,
    "stuck current": find_stuck_current,
    "voltage spikes": find_voltage_spikes,
    "current spikes": find_current_spikes,
    "temperature": find_temperature,
    "counters": find_counters,
    "capacity": find_capacity,
    "closure": find_closure,
    "resolution": find_resolution,
}
