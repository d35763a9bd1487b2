"""The scenarios of a filter and its accuracy: wrong assumptions of a battery manager at the start,
the resulting errors of its estimates, and tests of its innovations."""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field
from scipy.special import chdtrc, chdtri

from .cell.soc_axis import is_above
from .filters import Drive, Filtered, FilterModel
from .filters.model import CAPACITY, OFFSET
from .metrics import CONFIDENCE
from .model.prepared import PreparedRecord
from .schema import Part

# An estimate that stays within this share of the counter for this long has converged.
CONVERGED, HOLDS_S = 0.03, 600.0
# 95 % of a normal distribution are within this many standard deviations.
BAND = 1.959964
# Estimates of offset and capacity absorb the errors of a whole record: on measured cells they are
# off by up to three of the filter's deviations. They are reported if three times the deviation is
# less than half of the prior.
DOUBT, DETERMINED = 3.0, 0.5
# Lags of the tests of innovations.
LAGS = 20
Samples = Float[np.ndarray, "samples"]
Rows = Float[np.ndarray, "samples *_"]


@dataclass(frozen=True)
class Scenario:
    """Errors in a battery manager's assumptions.

    Args:
        name: Name in reports.
        soc_error: Error of the SOC at the start, a fraction, positive if it is too high. The filter
            starts at the first sample that leaves room for it between empty and full.
        offset_c: Offset of the current, as a C-rate.
        capacity_factor: The assumed capacity over the right one.
    """

    name: str
    soc_error: float = 0.0
    offset_c: float = 0.0
    capacity_factor: float = 1.0


SCENARIOS = (
    Scenario("right start"),
    Scenario("start 20 % too low", soc_error=-0.2),
    Scenario("start 20 % too high", soc_error=0.2),
    Scenario("current offset", offset_c=0.01),
    Scenario("capacity 5 % high", capacity_factor=1.05),
)


@dataclass(frozen=True, eq=False)
class Case:
    """A scenario from its first sample on: the model, the start and the drive as the battery
    manager has them."""

    scenario: Scenario
    first: int
    given: tuple[FilterModel, Any, Drive]

    @property
    def counted(self) -> Float[np.ndarray, "samples"]:
        """SOC by counting alone, with the manager's errors."""
        believed, (state, _), drive = self.given
        passed_ah = np.cumsum(np.asarray(drive.held_a * drive.interval_s)) / 3600
        return float(state[0]) - passed_ah / float(believed.capacity_ah)


def first_with_room(soc: Samples, error: float) -> int | None:
    """The first sample that leaves room for a wrong start, None without one."""
    has_room = (soc + error >= min(0.0, soc[0])) & (soc + error <= max(1.0, soc[0]))
    return int(np.argmax(has_room)) if np.any(has_room) else None


def case_of(
    model: FilterModel, prepared: PreparedRecord, scenario: Scenario, first: int, soc_sd: float
) -> Case:
    drive = Drive.of(prepared)
    direction_sd = 1.0 if prepared.start.direction_source == "assumed" else 0.0
    direction = float(prepared.start.direction)
    soc = prepared.soc[first] + scenario.soc_error
    state, variance = model.start(soc, soc_sd, direction, direction_sd)
    if first:
        # The current was known until then: pairs and hysteresis are in the state where it left
        # them.
        right, _ = model.start(prepared.soc[0], soc_sd, direction, direction_sd)
        before = jax.tree.map(lambda array: array[: first + 1], drive)
        reached = _open_loop(model, right, before)
        state = reached.at[0].set(soc)
    # The samples before are moved behind the last, where nothing is counted.
    drive = jax.tree.map(
        lambda array: jnp.concatenate([array[first:], jnp.repeat(array[-1:], first)]), drive
    )
    capacity_ah = model.capacity_ah * scenario.capacity_factor
    offset_a = scenario.offset_c * prepared.capacity_ah
    drive = drive._replace(
        interval_s=drive.interval_s.at[0].set(0.0),
        held_a=drive.held_a.at[1:].add(offset_a),
        current_a=drive.current_a + offset_a,
        pairs_a=None if drive.pairs_a is None else drive.pairs_a.at[1:].add(offset_a),
    )
    believed = eqx.tree_at(lambda model: model.capacity_ah, model, capacity_ah)
    return Case(scenario, first, (believed, (state, variance), drive))


@jax.jit
def _open_loop(model: FilterModel, state: Any, drive: Drive) -> Any:
    """The state at the end of a drive."""
    slow = jnp.zeros_like(model.slow_sd)
    return jax.lax.scan(
        lambda state, current_a: (model.advance(state, slow, current_a), None), state, drive
    )[0]


def from_start(values: Rows, first: int) -> Rows:
    """Values computed from a sample on, at their original positions."""
    padded = np.full(values.shape, np.nan)
    padded[first:] = values[: len(values) - first]
    return padded


class ScenarioPart(Part):
    """The estimates of a filter in one scenario; SOC and errors are fractions.

    Errors are those after convergence, None without it, except those of the whole record.

    Attributes:
        name: Name of the scenario.
        start_s: Time of its start, after the beginning of the replay.
        start_soc: The SOC that the filter starts from.
        offset_a: The current's offset.
        capacity_ah: Assumed capacity.
        converged_s: Time after which the error stays within 3 % for ten minutes at least.
        whole_rms: Root mean square of the error over the whole record.
        whole_max: Largest error over the whole record.
        rms: Root mean square of the error.
        rms_above_10_soc: Root mean square of the error above 10 % SOC.
        max: The largest error.
        max_before: The largest error before convergence, or of all samples without it.
        band: Mean half width of the 95 % band, over all samples.
        widest: The largest half width of it after the first ten minutes.
        in_band: Share of all samples with the counter inside the 95 % band.
        counter_rms: Root mean square of plain counting over the same samples.
        counter_max: The largest error of plain counting.
        estimates: Final values of the estimated parameters, with their standard deviations; offset
            and capacity only if the record determines them.
        diverged_s: Time at which the filter's numbers ceased to be finite.
    """

    name: str
    start_s: float = 0.0
    start_soc: float
    offset_a: float
    capacity_ah: float
    converged_s: float | None = None
    whole_rms: float | None = None
    whole_max: float | None = None
    rms: float | None = None
    rms_above_10_soc: float | None = None
    max: float | None = None
    max_before: float | None = None
    band: float | None = None
    widest: float | None = None
    in_band: float | None = None
    counter_rms: float | None = None
    counter_max: float | None = None
    estimates: dict[str, tuple[float, float]] = Field(default_factory=dict)
    diverged_s: float | None = None

    @property
    def is_lost(self) -> bool:
        """True if the estimate does not stay near the reference."""
        return self.diverged_s is None and (self.rms is None or self.rms > CONVERGED)


def score(
    case: Case, capacity_ah: float, prepared: PreparedRecord, estimate: Filtered
) -> ScenarioPart:
    """The errors of a filter's estimates from the start of a case on, relative to the counter.

    Args:
        case: The scenario, and the filter's model and start in it.
        capacity_ah: Capacity for converting the offset.
        prepared: The record.
        estimate: Samples from the start on, followed by padding.
    """
    (believed, (state, _), _), count = case.given, len(prepared.soc) - case.first
    clock_s, truth = prepared.time_s - prepared.time_s[0], prepared.soc[case.first :]
    time_s = clock_s[case.first :] - clock_s[case.first]
    soc, band = np.asarray(estimate.soc)[:count], BAND * np.asarray(estimate.soc_sd)[:count]
    part = ScenarioPart(
        name=case.scenario.name,
        start_s=float(clock_s[case.first]),
        start_soc=float(state[0]),
        offset_a=case.scenario.offset_c * capacity_ah,
        capacity_ah=float(believed.capacity_ah),
    )
    is_number = np.isfinite(soc) & np.isfinite(band)
    if not np.all(is_number):
        return part.model_copy(update={"diverged_s": float(time_s[np.argmin(is_number)])})
    error, off = soc - truth, np.abs(soc - truth)
    determined = _determined(believed, estimate.slow[count - 1], estimate.slow_sd[count - 1])
    figures: dict[str, Any] = {
        "whole_rms": _rms(error),
        "whole_max": float(off.max()),
        "in_band": float(np.mean(off <= band)),
        "band": float(np.mean(band)),
        "widest": float(band[time_s >= min(HOLDS_S, time_s[-1])].max()),
        "estimates": determined,
    }
    first = converged(time_s, off <= CONVERGED)
    if first != 0:
        figures["max_before"] = float(off[:first].max())
    if first is not None:
        above = error[first:][is_above(truth[first:])]
        counted = (case.counted[:count] - truth)[first:]
        figures |= {
            "converged_s": float(time_s[first]),
            "rms": _rms(error[first:]),
            "rms_above_10_soc": _rms(above) if len(above) else None,
            "max": float(off[first:].max()),
            "counter_rms": _rms(counted),
            "counter_max": float(np.abs(counted).max()),
        }
    return part.model_copy(update=figures)


def _determined(model: FilterModel, values: Any, deviations: Any) -> dict[str, tuple[float, float]]:
    """Final values with their deviations; offset and capacity only if a record distinguishes them
    from the errors of the circuit. All except the offset are logarithms of a factor."""
    determined, rows = {}, zip(model.slow, values, deviations, model.slow_sd.tolist(), strict=True)
    for name, value, sd, prior_sd in rows:
        sd *= DOUBT if name in (OFFSET, CAPACITY) else 1.0
        if name not in (OFFSET, CAPACITY) or sd <= DETERMINED * prior_sd:
            determined[name] = float(value if name == OFFSET else np.exp(value)), float(sd)
    return determined


def converged(time_s: Samples, is_near: Bool[np.ndarray, "samples"]) -> int | None:
    """The first sample from which on it stays near for `HOLDS_S`, or to the end."""
    leaves = np.append(np.flatnonzero(~is_near), len(time_s))
    following = leaves[np.searchsorted(leaves, np.arange(len(time_s)))]
    ends_s = np.append(time_s, np.inf)[following]
    held = np.flatnonzero(is_near & (ends_s - time_s >= HOLDS_S))
    return int(held[0]) if len(held) else None


def _rms(values: Float[np.ndarray, "some"]) -> float:
    return float(np.sqrt(np.mean(values**2)))


@dataclass(frozen=True)
class Innovations:
    """Innovations over their expected deviation, tested against white noise of variance one.

    `first_lag` is their autocorrelation from one sample to the next; that of white noise stays
    within `bound`. `p_value` is that of Ljung and Box's statistic (1978) over `lags` lags: below
    0.05 they are not white. `mean_square` is the mean normalized innovation squared, whose 95 %
    interval is `mean_square_bounds` if the filter's deviations are right.
    """

    samples: int
    first_lag: float
    bound: float
    lags: int
    p_value: float
    mean_square: float
    mean_square_bounds: tuple[float, float]

    @property
    def are_white(self) -> bool:
        return self.p_value >= 1 - CONFIDENCE


def examine_innovations(normalised: Samples) -> Innovations:
    """Both tests on innovations divided by their expected deviations.

    Over `LAGS` lags, or half the number of samples of a shorter record.

    >>> found = examine_innovations(np.random.default_rng(0).normal(size=1000))
    >>> found.are_white, found.mean_square_bounds[0] < found.mean_square
    (True, True)
    """
    count = len(normalised)
    around = normalised - normalised.mean()
    power = float(around @ around)
    lags = np.arange(1, min(LAGS, count // 2) + 1)
    correlation = np.array([around[lag:] @ around[:-lag] for lag in lags]) / (power or 1.0)
    statistic = count * (count + 2) * float(np.sum(correlation**2 / (count - lags)))
    return Innovations(
        samples=count,
        first_lag=float(correlation[0]),
        bound=float(np.sqrt(chdtri(1, 1 - CONFIDENCE) / count)),
        lags=len(lags),
        p_value=float(chdtrc(len(lags), statistic)),
        mean_square=float(np.mean(normalised**2)),
        mean_square_bounds=mean_bounds(count),
    )


def mean_bounds(count: int) -> tuple[float, float]:
    """The 95 % interval of the mean of `count` chi-square values with one degree of freedom.

    Bar-Shalom, Li and Kirubarajan (2001), section 5.4: the test of estimation errors over
    Monte-Carlo runs, and of innovations over time.

    >>> [round(bound, 2) for bound in mean_bounds(100)]
    [0.74, 1.3]
    """
    above = np.array([(1 + CONFIDENCE) / 2, (1 - CONFIDENCE) / 2])
    low, high = chdtri(count, above) / count
    return float(low), float(high)
