"""An identified circuit used as a battery manager would: a record replayed through a filter.

The truth is the record's own ampere-hour counter. The filter does not see it: it starts wrong, or
counts with an offset, or takes a wrong capacity, and has the voltage to notice by.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field, PrivateAttr

from .cell.soc_axis import is_above
from .display import Brief, hook
from .errors import InputError
from .execution import compile_for, in_float64
from .filters import (
    Drive,
    Estimate,
    FilterModel,
    Form,
    Innovations,
    Kind,
    examine_innovations,
    run_filter,
)
from .filters.model import CAPACITY, OFFSET
from .inputs import Given, read_validation
from .model.prepared import PreparedRecord, prepare_record
from .model.window import Window
from .over_soc import require_temperature
from .result_filter import model_of
from .results import Result
from .schema import Count, Document, Part, Told
from .settings import AutoHold, AutoSign, Reading

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Within this share of the counter, and for so long, an estimate has converged.
CONVERGED, HOLDS_S = 0.03, 600.0
# Two standard deviations of a normal distribution hold 95 %.
BAND = 1.959964


@dataclass(frozen=True)
class FilterSettings:
    """The Kalman filter that replays a record.

    Args:
        kind: The extended ("ekf") or the unscented ("ukf") Kalman filter.
        form: Estimated parameters as states of the same filter ("joint"), or in a second one
            ("dual").
        estimate: Parameters to estimate: "offset" (of the current), "capacity", and resistances and
            time constants such as "R0" or "tau1".
        soc_sd: Standard deviation of the SOC at the start, a fraction.
        tables: Use the tables over SOC if the result has them.

    Raises `InputError` for an unknown kind or form, and for `soc_sd` outside 0 to 1.
    """

    kind: Kind = "ekf"
    form: Form = "joint"
    estimate: tuple[str, ...] = (OFFSET, CAPACITY)
    soc_sd: float = 0.1
    tables: bool = True

    def __post_init__(self):
        if self.kind not in ("ekf", "ukf"):
            raise InputError(f"`filter` {self.kind!r} is not known; there are ekf, ukf")
        if self.form not in ("joint", "dual"):
            raise InputError(f"`form` {self.form!r} is not known; there are joint, dual")
        if not 0 < self.soc_sd <= 1:
            raise InputError(f"soc_sd {self.soc_sd:g} must be above 0 and at most 1")


@dataclass(frozen=True)
class Scenario:
    """Errors of a battery manager's knowledge.

    Args:
        name: What it is called in reports.
        soc_error: Error of the SOC at the start, a fraction.
        offset_c: Offset of the current, as a C-rate.
        capacity_factor: The capacity that is believed, relative to the right one.
    """

    name: str
    soc_error: float = 0.0
    offset_c: float = 0.0
    capacity_factor: float = 1.0


SCENARIOS = (
    Scenario("right start"),
    Scenario("start 20 % off", soc_error=0.2),
    Scenario("current offset", offset_c=0.01),
    Scenario("capacity 5 % high", capacity_factor=1.05),
)


class ScenarioPart(Part):
    """The estimates of a filter in one scenario; SOC and errors are fractions.

    Errors are those after convergence, None without.

    Attributes:
        name: The scenario's.
        start_soc: The SOC that the filter starts from.
        offset_a: The current's offset.
        capacity_ah: The capacity that is believed.
        converged_s: Time after which the error stays within 3 % for ten minutes at least.
        rms: Root mean square of the error.
        rms_above_10_soc: The same above 10 % SOC.
        max: The largest error.
        in_band: Share of all samples where the 95 % band holds the counter.
        counter_rms: Root mean square of plain counting over the same samples.
        counter_max: The largest error of plain counting.
        estimates: Final values of the estimated parameters, with their standard deviations.
        diverged_s: Time at which the filter's numbers ceased to be finite.
    """

    name: str
    start_soc: float
    offset_a: float
    capacity_ah: float
    converged_s: float | None = None
    rms: float | None = None
    rms_above_10_soc: float | None = None
    max: float | None = None
    in_band: float | None = None
    counter_rms: float | None = None
    counter_max: float | None = None
    estimates: dict[str, tuple[float, float]] = Field(default_factory=dict)
    diverged_s: float | None = None

    @property
    def is_lost(self) -> bool:
        """Whether the estimate does not stay near the reference."""
        return self.diverged_s is None and (self.rms is None or self.rms > CONVERGED)


class SocReplay(Document):
    """The contents of `soc.json`: how well a filter tracked the SOC of a record.

    A notebook shows a replay as its figure, while it has its `traces`: one read from a file has
    none.

    Attributes:
        schema_version: Version 1 of the file.
        record: Name of the record.
        sha256: Digest of its file.
        model: The circuit.
        with_tables: True if tables over SOC were used.
        settings: The filter.
        states: Number of the filter's states.
        samples: Number of samples.
        duration_s: Length of the replay.
        soc_range: Lowest and highest SOC of the counter.
        scenarios: The filter's errors in every scenario.
        innovations: Tests of the innovations from the right start, None if it diverged.
        warnings: What is doubtful, with what to do.
    """

    schema_version: Annotated[int, Field(ge=1, le=1)] = 1
    record: str
    sha256: str
    model: str
    with_tables: bool
    settings: FilterSettings
    states: Count
    samples: Count
    duration_s: float
    soc_range: tuple[float, float]
    scenarios: tuple[ScenarioPart, ...]
    innovations: Innovations | None
    warnings: tuple[Told, ...] = ()

    _traces: "Traces | None" = PrivateAttr(None)
    what: ClassVar[str] = "barnax replay"
    remedy: ClassVar[str] = "give the soc.json that barnax soc wrote"

    @property
    def traces(self) -> "Traces":
        """Raises `InputError` for a replay that was read from a file."""
        if self._traces is None:
            raise InputError(
                "this replay was read from a file, which has no estimates over time; replay "
                "the record again"
            )
        return self._traces

    def figure(self) -> "Figure":
        """SOC by the counter and by the filter in every scenario, and the filter's errors.

        Raises `InputError` for a replay that was read from a file.
        """
        return hook("SocReplay.figure")(self)

    def _repr_png_(self) -> bytes | None:
        return None if self._traces is None else hook("SocReplay._repr_png_")(self.figure())


@dataclass(frozen=True, eq=False, repr=False)
class Traces(Brief):
    """What stands over time in a replay: the counter as the truth, and every scenario's estimate.

    `counted` is the SOC that plain counting gives in each scenario.
    """

    time_s: Float[np.ndarray, "samples"]
    truth: Float[np.ndarray, "samples"]
    estimate: Estimate
    counted: Float[np.ndarray, "scenarios samples"]


@in_float64
def replay_soc(
    result: Result,
    record: Given,
    window: Window | None = None,
    settings: FilterSettings | None = None,
    *,
    scenarios: Sequence[Scenario] = SCENARIOS,
    current_sign: AutoSign = "auto",
    current_hold: AutoHold = "auto",
    voltage_lag: float | None = None,
    columns: Mapping[str, str] | str = "",
    series: int = 1,
) -> SocReplay:
    """A record replayed through a Kalman filter with a result's circuit, for each scenario.

    The reference is the record's ampere-hour count, which the filter does not see.

    Args:
        result: The identified circuit; its assessment gives the filter its noise.
        record: A file, `Record` or data frame.
        window: The part of the record that is replayed; by default the window on which the records
            identified on agree.
        settings: The filter.
        scenarios: Errors of a battery manager's knowledge; by default four cases.
        current_sign: The sign of the file's current; "auto" decides from the data.
        current_hold: When a sample's current flows; "auto" decides from the data.
        voltage_lag: How much older its voltage is than its current, as for `read_record`.
        columns: Names of columns, as for `read_record`.
        series: How many cells are in series, as for `read_record`.

    Raises `InputError` if the record, its window or `settings.estimate` cannot be used, and for a
    result without an assessment.
    """
    settings, window = settings or FilterSettings(), window or result.common_window
    reading = Reading(
        validate_current_sign=current_sign,
        current_hold=current_hold,
        voltage_lag=voltage_lag,
        columns=columns,
        series=series,
    )
    measured, warnings = read_validation(
        record, reading, window, result.cell_model, result.measured_at
    )
    used = result if settings.tables else result.without_tables()
    prepared = prepare_record(measured, used.cell_model, used.model, window)
    degc = prepared.temperature_degc
    if used.tables is not None and used.tables.over_temperature is not None:
        degc = require_temperature(prepared)
    if degc is not None:
        used = used.at_temperature(degc)
    model = eqx.tree_at(
        lambda each: each.capacity_ah,
        model_of(used, settings.estimate),
        jnp.asarray(prepared.capacity_ah),
    )
    cases = [_case(model, prepared, each, settings.soc_sd) for each in scenarios]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *cases)
    program = compile_for(_run_all, *stacked, settings.kind, settings.form)
    found = program(*stacked, settings.kind, settings.form)
    estimate = jax.tree.map(np.asarray, found)
    traces = Traces(
        time_s=prepared.time_s - prepared.time_s[0],
        truth=prepared.soc,
        estimate=estimate,
        counted=np.stack([_counted(case) for case in cases]),
    )
    parts = tuple(
        _score(model, case, each, traces, place)
        for place, (each, case) in enumerate(zip(scenarios, cases, strict=True))
    )
    normalised = np.asarray(estimate.innovation_v[0] / estimate.innovation_sd_v[0])
    replay = SocReplay(
        record=measured.name,
        sha256=measured.sha256,
        model=used.model,
        with_tables=used.tables is not None,
        settings=settings,
        states=model.states + len(settings.estimate),
        samples=len(prepared.soc),
        duration_s=float(traces.time_s[-1]),
        soc_range=(float(prepared.soc.min()), float(prepared.soc.max())),
        scenarios=parts,
        innovations=None if parts[0].diverged_s is not None else examine_innovations(normalised),
        warnings=tuple(dict.fromkeys([*warnings, *measured.warnings, *prepared.warnings])),
    )
    replay._traces = traces
    return replay


def _run_all(models: FilterModel, starts: Any, drives: Drive, kind: Kind, form: Form) -> Estimate:
    """Every scenario, cell or tuning along the first axis."""
    return jax.vmap(lambda model, start, drive: run_filter(model, start, drive, kind, form))(
        models, starts, drives
    )


def _case(model: FilterModel, prepared: PreparedRecord, scenario: Scenario, soc_sd: float):
    """The model, the start and the drive as the battery manager has them."""
    soc, drive = prepared.start.soc, Drive.of(prepared)
    # Where there is no room below, the start is too high.
    soc += scenario.soc_error if soc < scenario.soc_error else -scenario.soc_error
    capacity_ah = model.capacity_ah * scenario.capacity_factor
    offset_a = scenario.offset_c * prepared.capacity_ah
    drive = drive._replace(
        held_a=drive.held_a.at[1:].add(offset_a), current_a=drive.current_a + offset_a
    )
    direction_sd = 1.0 if prepared.start.direction_source == "assumed" else 0.0
    believed = eqx.tree_at(lambda each: each.capacity_ah, model, capacity_ah)
    return believed, model.start(soc, soc_sd, float(prepared.start.direction), direction_sd), drive


def _counted(case: Any) -> Float[np.ndarray, "samples"]:
    """SOC by counting alone, with what the manager has wrong."""
    believed, (state, _), drive = case
    passed_ah = np.cumsum(np.asarray(drive.held_a * drive.interval_s)) / 3600
    return float(state[0]) - passed_ah / float(believed.capacity_ah)


def _score(
    model: FilterModel, case: Any, scenario: Scenario, traces: Traces, place: int
) -> ScenarioPart:
    """What a filter's estimates are worth against the counter."""
    believed, (state, _), _ = case
    soc = np.asarray(traces.estimate.soc[place])
    soc_sd = np.asarray(traces.estimate.soc_sd[place])
    part = ScenarioPart(
        name=scenario.name,
        start_soc=float(state[0]),
        offset_a=scenario.offset_c * float(model.capacity_ah),
        capacity_ah=float(believed.capacity_ah),
    )
    is_number = np.isfinite(soc) & np.isfinite(soc_sd)
    if not np.all(is_number):
        return part.model_copy(update={"diverged_s": float(traces.time_s[np.argmin(is_number)])})
    error, counter_error = soc - traces.truth, traces.counted[place] - traces.truth
    slow, slow_sd = traces.estimate.slow[place, -1], traces.estimate.slow_sd[place, -1]
    # All but the offset are logarithms of a factor.
    estimates = {
        name: (float(value if name == OFFSET else np.exp(value)), float(sd))
        for name, value, sd in zip(model.slow, slow, slow_sd, strict=True)
    }
    found = {"in_band": float(np.mean(np.abs(error) <= BAND * soc_sd)), "estimates": estimates}
    first = _converged(traces.time_s, np.abs(error) <= CONVERGED)
    if first is not None:
        after, above = error[first:], error[first:][is_above(traces.truth[first:])]
        found |= {
            "converged_s": float(traces.time_s[first]),
            "rms": _rms(after),
            "rms_above_10_soc": _rms(above) if len(above) else None,
            "max": float(np.abs(after).max()),
            "counter_rms": _rms(counter_error[first:]),
            "counter_max": float(np.abs(counter_error[first:]).max()),
        }
    return part.model_copy(update=found)


def _converged(
    time_s: Float[np.ndarray, "samples"], is_near: Bool[np.ndarray, "samples"]
) -> int | None:
    """The first sample from which on it stays near for `HOLDS_S`, or to the end."""
    leaves = np.append(np.flatnonzero(~is_near), len(time_s))
    following = leaves[np.searchsorted(leaves, np.arange(len(time_s)))]
    ends_s = np.append(time_s, np.inf)[following]
    held = np.flatnonzero(is_near & (ends_s - time_s >= HOLDS_S))
    return int(held[0]) if len(held) else None


def _rms(values: Float[np.ndarray, "some"]) -> float:
    return float(np.sqrt(np.mean(values**2)))
