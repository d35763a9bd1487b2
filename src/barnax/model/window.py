"""The simulated part of a record, its temperature, the samples where errors count, and the SOC from
voltages: of a cell at rest, and at the start of a record under load.

Under load v = U(s0 - q / C) - sum R_k x_k, with q the charge since the start and x_k the current
and its low-pass by RC pairs with fixed time constants. For every s0 the resistances are
non-negative least squares, which leaves one unknown.
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import minimize_scalar, nnls

from ..cell import CellModel, OcvTable
from ..cell.model import group_near
from ..cell.soc_axis import BEYOND_SOC
from ..errors import InputError
from ..metrics import TO_SD
from ..notices import Notice
from ..records import Record
from ..records.lag import lagged
from ..records.record import SETTLED_V, Segments, degc_in_name
from ..settings import Window

# Scored samples may leave the range of the OCV points by this much SOC; a branch is constant there.
OCV_MARGIN = 0.05
# An excess below the first is rounding; below the difference between full charges of one cell, only
# a note.
NO_MARGIN, SAME_FULL = 1e-4, 0.01
# No cell with a voltage this far inside the OCV, without R I, is full or empty.
_INSIDE_V = 0.1
# Samples, plus one, whose median is the voltage at an end of a rest.
_FEW = 10


# Options that set where a simulation starts: any one from the user replaces all planned ones.
START = ("start_time_s", "start_after_step", "initial_soc")


def merged(planned: Window, chosen: Window) -> Window:
    """A planned window with the user's choices applied."""
    given = {
        field.name: value
        for field in fields(Window)
        if (value := getattr(chosen, field.name)) is not None
    }
    if given.keys() & {"start_time_s", "start_after_step"}:
        given = {**dict.fromkeys((*START, "initial_direction")), **given}
    if given.keys() & {"initial_soc", "capacity_ah"}:
        # A registration is valid only with the start and the capacity from which it was computed.
        planned = planned.unregistered
    if "initial_soc" in given:
        given = {"soc_source": None, **given}
    return replace(planned, **given)


def temperature_of(
    record: Record, window: Window, samples: slice | Int[np.ndarray, "_"] = slice(None)
) -> float | None:
    """The temperature given for a record in degC, else the median of the measured ones, else that
    in its name, if any."""
    given_degc = window.temperature_degc
    return record.usual_degc(samples) if given_degc is None else given_degc


# One for all records, or by the names of records, with "" for the others.
Windows = Window | Mapping[str, Window] | None


def group_tests(
    tests: Sequence[Record | OcvTable], window: Windows
) -> dict[float, list[Record | OcvTable]]:
    """OCV tests by temperature in degC; empty if they have one temperature, or none is known.
    Raises `InputError` if one has an unknown temperature while the others have several."""
    windows = window if isinstance(window, Mapping) else {}

    def degc_of(test: Record | OcvTable) -> float | None:
        window = windows.get(test.name)
        if isinstance(test, Record):
            return temperature_of(test, window or Window())
        return window.temperature_degc if window else degc_in_name(test.name)

    pairs = [(degc_of(test), test) for test in tests]
    groups = group_near((test_degc, test) for test_degc, test in pairs if test_degc is not None)
    if len(groups) < 2:
        return {}
    for test_degc, test in pairs:
        if test_degc is None:
            raise InputError(
                f"{test.name}: has no column of temperatures, and the other OCV tests are of "
                "several; say it with `temperature`"
            )
    return groups


def start_of(record: Record, window: Window, capacity_ah: float) -> tuple[int, float]:
    """The first simulated sample of a record, and the current below which its cell rests."""
    rest_a = window.rest_current_a or record.rest_current_a(capacity_ah)
    return first_sample(record, window, rest_a), rest_a


def first_sample(record: Record, window: Window, rest_a: float) -> int:
    """Index of the sample where the simulation starts; currents below `rest_a` count as zero.
    Raises `InputError` if there is none."""
    if window.start_time_s is not None:
        after = np.flatnonzero(record.time_s >= window.start_time_s)
        if not len(after) or window.start_time_s < record.time_s[0]:
            raise InputError(
                f"{record.name}: `start_time` {window.start_time_s} s lies outside the record, "
                f"whose clock runs from {record.time_s[0]:g} to {record.time_s[-1]:g} s"
            )
        return int(after[0])
    if window.start_after_step is not None:
        inside = np.flatnonzero(_steps(record, "start_after_step", [window.start_after_step]))
        return int(inside[-1])
    return relaxing_rest(record, rest_a)[0]


def relaxing_rest(record: Record, rest_a: float) -> tuple[int, float]:
    """The last sample of an opening rest in which the voltage relaxes, and its rise in V; zeros
    without one.

    The circuit starts relaxed, and the last sample of such a rest is closest to that state. A
    current that moves more than a thousandth of the capacity is no rest.
    """
    loaded = record.segments(rest_a).loaded
    last = int(loaded[0]) - 1 if len(loaded) else 0
    few = min(last // 2, _FEW)
    if last < 1 or abs(record.discharged_ah[last] - record.discharged_ah[0]) > rest_a / 10:
        return 0, 0.0
    voltage_v = record.voltage_v[: last + 1]
    end_v = float(np.median(voltage_v[last - few :]))
    rise_v = end_v - float(np.median(voltage_v[: few + 1]))
    # With white noise the two medians are further apart once in millions.
    noise_v = float(np.median(np.abs(np.diff(voltage_v)))) / np.sqrt(few + 1)
    if abs(rise_v) <= max(SETTLED_V, 10 * noise_v):
        return 0, 0.0
    # The last row may already contain the voltage under load.
    return last - int(abs(voltage_v[last] - end_v) > SETTLED_V), rise_v


def scored_samples(
    record: Record, window: Window, first: int, soc: Float[np.ndarray, "samples"]
) -> Bool[np.ndarray, "samples"]:
    """True where errors count, over the whole record. Raises `InputError` if nowhere."""
    scored = np.arange(record.samples) >= first
    if window.score_steps is not None:
        scored &= _steps(record, "score_steps", window.score_steps)
    if window.score_from_s is not None:
        scored &= record.time_s >= window.score_from_s
    if window.score_to_s is not None:
        scored &= record.time_s <= window.score_to_s
    if window.score_soc is not None:
        low, high = window.score_soc
        scored &= (soc >= low) & (soc <= high)
    if not np.any(scored):
        raise InputError(
            f"{record.name}: no sample is left to score after the start at "
            f"{record.time_s[first]:g} s; widen `score_steps`, `score_from`, `score_to` or "
            "`score_soc`"
        )
    return scored


def within_ocv(
    record: Record,
    cell: CellModel,
    capacity_ah: float,
    soc: Float[np.ndarray, "samples"],
    scored: Bool[np.ndarray, "samples"],
) -> tuple[Bool[np.ndarray, "samples"], list[Notice]]:
    """The scored samples within the OCV, all of them unless some lie far beyond the OCV points, and
    a notice of those beyond.

    The notice is an error if the cell cannot be there: the voltage contradicts it, or the charge
    goes beyond full or empty.
    """
    low, high = cell.soc_range
    beyond = np.maximum(low - soc, soc - high)
    outside = scored & (beyond > NO_MARGIN)
    counts = {"samples": scored.sum(), "low_soc": low, "high_soc": high}
    far = np.flatnonzero(scored & (beyond > OCV_MARGIN))
    if not len(far):
        if not outside.any():
            return scored, []
        counts |= {"outside": outside.sum(), "farthest_soc": beyond[outside].max()}
        counts |= {"within": "full-charges" if counts["farthest_soc"] < SAME_FULL else None}
        return scored, [Notice("soc.outside-ocv", counts, record.name)]
    at = far[0]
    given = {"far_row": record.row[at], "capacity_ah": capacity_ah}
    given |= {"ocv": "records" if cell.ocv_is_fitted else "test"}
    end, end_soc, way = ("empty", low, 1) if soc[at] < low else ("full", high, -1)
    end_v = float(cell.average_ocv_v(np.array([end_soc]))[0])
    if (record.source_v[at] - end_v) * way > _INSIDE_V:
        given |= {"end": end, "voltage_v": record.voltage_v[at], "end_v": end_v}
        return scored, [Notice("soc.against-voltage", given, record.name)]
    impossible = far[np.abs(soc[far] - 0.5) > 0.5 + OCV_MARGIN]
    if len(impossible) or not np.any(scored & ~outside):
        at = [*impossible, at][0]
        given |= {"far_row": record.row[at], "soc": soc[at], "low_soc": low, "high_soc": high}
        return scored, [Notice("soc.beyond-ocv", given, record.name)]
    if any(point.source == record.name for point in cell.points):
        # The correction of the OCV extends a little beyond the last rest of a pulse test.
        outside = scored & (beyond > OCV_MARGIN)
        counts |= {"far": "own", "instead": "own"}
    elif cell.ocv_is_fitted:
        counts |= {"instead": "records"}
    notice = Notice("soc.without-ocv", {"left_out": outside.sum(), **counts}, record.name)
    return scored & ~outside, [notice]


def _steps(record: Record, option: str, numbers: Sequence[int]) -> Bool[np.ndarray, "samples"]:
    """The samples of the given steps. Raises `InputError` if the record lacks any of them."""
    if record.step is None:
        raise InputError(
            f"{record.name}: `{option}` needs a step column, and the file has none; use "
            "`start_time`, `score_from` and `score_to` instead"
        )
    present = np.unique(record.step)
    for step in numbers:
        if step not in present:
            steps = ", ".join(map(str, present))
            raise InputError(f"{record.name}: there is no step {step}; the file has steps {steps}")
    return np.isin(record.step, numbers)


# No tester resolves less.
LEAST_NOISE_V = 1e-4
# The OCV's slope is a difference over this step of SOC.
_STEP_SOC = 0.01
# A mean that moves by more standard errors, once in ten thousand for white noise, drifts.
_DRIFTING = 4.0


def soc_from_rest(
    segments: Segments, cell: CellModel, at: int, direction: int
) -> tuple[float, float] | None:
    """The SOC from the rest around the sample `at`, for a cell that came from a direction, and its
    standard error due to noise; None if it is beyond the OCV."""
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


# Time constants representative of any circuit, and enough samples for the fit.
_TAUS_S, _SAMPLES = (5.0, 50.0, 500.0), 2000
_TRIED_SOC = 101
# Distance of the OCV of a slow sweep from that of a drive, and the largest RMSE of a fit: a larger
# one means another cell.
_OCV_SD_V, _LARGEST_V = 0.015, 0.05
# A start with a larger standard error is not identified.
_LARGEST_SD = 0.2


def fitted_soc(
    record: Record, cell: CellModel, capacity_ah: float, first: int
) -> tuple[float, float] | None:
    """The SOC at the sample `first` and its standard error; None if the record from there on does
    not determine it."""
    discharged_ah = record.discharged_ah[first:]
    branch = cell.discharge if discharged_ah[-1] > discharged_ah[0] else cell.charge
    every = slice(None, None, 1 + len(discharged_ah) // _SAMPLES)
    moved = (discharged_ah - discharged_ah[0])[every] / capacity_ah
    voltage_v = record.voltage_v[first:][every]
    # The current, and the currents through the resistors of initially relaxed RC pairs.
    held_a = np.append(record.interval_current_a[first:], 0.0)
    drives_a = (lagged(held_a, tau_s, record.interval_s[first:]) for tau_s in _TAUS_S)
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
    # The part of the slope that resistances cannot compensate.
    drop_v = slope_v - columns @ np.linalg.lstsq(columns, slope_v)[0]
    size_v2 = float(error_v @ error_v)
    alike = max(0.0, float(error_v[1:] @ error_v[:-1])) / max(size_v2, 1e-300)
    # Neighboring samples with equal errors count as one.
    samples = len(moved) * max(1 - alike, 1 / len(moved)) / (1 + alike)
    variance_v2 = size_v2 / len(moved) / samples
    with np.errstate(divide="ignore"):
        sd = np.sqrt((variance_v2 + _OCV_SD_V**2) / np.mean(drop_v**2))
    return (soc, float(sd)) if sd <= _LARGEST_SD and np.sqrt(loss_v2(soc)) <= _LARGEST_V else None
