"""A cell at rest: its voltage over the samples that agree, and the SOC that it tells."""

from typing import NamedTuple

import numpy as np

from ..cell import CellModel
from ..errors import InputError
from ..records import Record, is_rested
from ..records.segments import runs

# No tester resolves less.
LEAST_NOISE_V = 1e-4
# From the median step of white noise to its standard deviation.
_TO_SD = 1.4826 / np.sqrt(2)
# A mean that moves by more standard errors, once in ten thousands of white noise, drifts.
_DRIFTING = 4.0
# The OCV's slope is a difference over so much SOC.
_STEP_SOC = 0.01


class Rest(NamedTuple):
    """The voltage and the SOC of a cell at rest, with their standard errors by the noise."""

    voltage_v: float
    soc: float
    voltage_sd_v: float
    soc_sd: float


def cell_at_rest(record: Record, cell: CellModel, at: int, rest_a: float, direction: int) -> Rest:
    """What the rest around the sample `at` tells of a cell that came from a direction. Raises
    `InputError` where that is beyond the OCV."""
    voltage_v, sd_v = mean_at_rest(record, at, rest_a)
    try:
        soc = cell.soc_from_rest_voltage(voltage_v, direction)
    except InputError as problem:
        raise InputError(f"{record.name}: row {record.row[at]}: {problem}") from problem
    branch = cell.charge if direction > 0 else cell.discharge
    around = np.clip([soc - _STEP_SOC / 2, soc + _STEP_SOC / 2], *cell.soc_range)
    slope = float(np.ptp(branch(around)) / np.ptp(around))
    return Rest(voltage_v, soc, sd_v, min(sd_v / max(slope, 1e-9), 1.0))


def mean_at_rest(record: Record, at: int, rest_a: float) -> tuple[float, float]:
    """The mean voltage of a rest and its standard error, over as many of its samples, the nearest
    to the sample `at` first, as differ by no more than their noise."""
    firsts, lasts = runs(is_rested(record, rest_a))
    number = int(np.searchsorted(lasts, at))
    rest = slice(int(firsts[number]), int(lasts[number]) + 1)
    steps_v = np.abs(np.diff(record.voltage_v[rest]))
    noise_v = max(LEAST_NOISE_V, _TO_SD * float(np.median(steps_v)) if len(steps_v) else 0.0)
    nearest = np.argsort(np.abs(np.arange(rest.start, rest.stop) - at), kind="stable")
    voltage_v = record.voltage_v[rest][nearest]
    count = 1
    while count < len(voltage_v):
        drift_v = voltage_v[: 2 * count].mean() - voltage_v[:count].mean()
        if abs(drift_v) > _DRIFTING * noise_v / np.sqrt(count):
            break
        count = min(2 * count, len(voltage_v))
    return float(voltage_v[:count].mean()), noise_v / float(np.sqrt(count))
