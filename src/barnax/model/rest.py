"""The SOC that voltages tell: of a cell at rest, and at the start of a record under load.

Under load v = U(s0 - q / C) - sum R_k x_k, with q the charge since the start and x_k the current,
and what RC pairs of fixed time constants make of it. For every s0 the resistances are non-negative
least squares, which leaves one unknown.
"""

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize_scalar, nnls

from ..cell import CellModel
from ..cell.soc_axis import BEYOND_SOC
from ..metrics import TO_SD
from ..records import Record
from ..records.lag import lagged
from ..records.record import Segments

# No tester resolves less.
LEAST_NOISE_V = 1e-4
# The OCV's slope is a difference over so much SOC.
_STEP_SOC = 0.01
# A mean that moves by more standard errors, once in ten thousands of white noise, drifts.
_DRIFTING = 4.0


def cell_at_rest(
    segments: Segments, cell: CellModel, at: int, direction: int
) -> tuple[float, float] | None:
    """The SOC that the rest around the sample `at` tells of a cell that came from a direction, and
    its standard error by the noise; None where that is beyond the OCV."""
    voltage_v, sd_v = mean_at_rest(segments, at)
    soc = cell.soc_at_rest(voltage_v, direction)
    if soc is None:
        return None
    branch = cell.charge if direction > 0 else cell.discharge
    around = np.clip([soc - _STEP_SOC / 2, soc + _STEP_SOC / 2], *cell.soc_range)
    slope = float(np.ptp(branch(around)) / np.ptp(around))
    return soc, min(sd_v / max(slope, 1e-9), 1.0)


def mean_at_rest(segments: Segments, at: int) -> tuple[float, float]:
    """The mean voltage of a rest and its standard error, over as many of its samples, the nearest
    to the sample `at` first, as differ by no more than their noise."""
    first, last = next(rest[:2] for rest in segments.rests if rest.last >= at)
    rest = np.arange(first, last + 1)
    voltage_v = segments.record.voltage_v[rest]
    steps_v = np.abs(np.diff(voltage_v))
    step_v = float(np.median(steps_v)) if len(steps_v) else 0.0
    noise_v = max(LEAST_NOISE_V, TO_SD / np.sqrt(2) * step_v)
    voltage_v = voltage_v[np.argsort(np.abs(rest - at), kind="stable")]
    count = 1
    while count < len(voltage_v):
        drift_v = voltage_v[: 2 * count].mean() - voltage_v[:count].mean()
        if abs(drift_v) > _DRIFTING * noise_v / np.sqrt(count):
            break
        count = min(2 * count, len(voltage_v))
    return float(voltage_v[:count].mean()), noise_v / float(np.sqrt(count))


# Time constants that stand for any circuit's, and samples that tell as much as all of them.
_TAUS_S, _SAMPLES = (5.0, 50.0, 500.0), 2000
_TRIED_SOC = 101
# The OCV of a slow sweep is so far from that of a drive, and a fit that leaves more is of another
# cell.
_OCV_SD_V, _LARGEST_V = 0.015, 0.05
# A start that is known no better is not known.
_LARGEST_SD = 0.2


def fitted_soc(
    record: Record, cell: CellModel, capacity_ah: float, first: int
) -> tuple[float, float] | None:
    """The SOC at the sample `first` and its standard error; None where the record from there on
    does not tell it."""
    discharged_ah = record.discharged_ah[first:]
    branch = cell.discharge if discharged_ah[-1] > discharged_ah[0] else cell.charge
    every = slice(None, None, 1 + len(discharged_ah) // _SAMPLES)
    moved = (discharged_ah - discharged_ah[0])[every] / capacity_ah
    voltage_v = record.voltage_v[first:][every]
    # The current, and that through the resistors of relaxed RC pairs.
    held_a, interval_s = (
        np.append(record.interval_current_a[first:], 0.0),
        record.interval_s[first:],
    )
    drives_a = (lagged(held_a, tau_s, interval_s) for tau_s in _TAUS_S)
    columns = np.stack([record.current_a[first:], *drives_a], axis=1)[every]
    low, high = cell.soc_range
    low, high = low + moved.max() - BEYOND_SOC, high + moved.min() + BEYOND_SOC
    if low >= high:
        return None

    def errors_v(soc: float) -> Float[np.ndarray, "samples"]:
        over_v = branch(soc - moved) - voltage_v
        return over_v - columns @ nnls(columns, over_v)[0]

    def loss_v2(soc: float) -> float:
        return float(np.mean(errors_v(soc) ** 2))

    tried = np.linspace(low, high, _TRIED_SOC)
    best, step = tried[np.argmin([loss_v2(soc) for soc in tried])], tried[1] - tried[0]
    ends = max(best - step, low), min(best + step, high)
    soc: float = minimize_scalar(loss_v2, bounds=ends, method="bounded").x  # pyrefly: ignore
    error_v = errors_v(soc)
    slope_v = cell.ocv_slope(soc - moved)
    # What resistances cannot make up for.
    drop_v = slope_v - columns @ np.linalg.lstsq(columns, slope_v)[0]
    size_v2 = float(error_v @ error_v)
    alike = max(0.0, float(error_v[1:] @ error_v[:-1])) / max(size_v2, 1e-300)
    # Neighbors that err alike are one sample.
    samples = len(moved) * max(1 - alike, 1 / len(moved)) / (1 + alike)
    variance_v2 = size_v2 / len(moved) / samples
    with np.errstate(divide="ignore"):
        sd = np.sqrt((variance_v2 + _OCV_SD_V**2) / np.mean(drop_v**2))
    return (soc, float(sd)) if sd <= _LARGEST_SD and np.sqrt(loss_v2(soc)) <= _LARGEST_V else None
