"""An identified circuit used as a battery manager would: a record replayed through a filter.

The truth is the record's own ampere-hour counter. The filter does not see it: it starts wrong, or
counts with an offset, or takes a wrong capacity, and has the voltage to notice by.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Literal

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
    Innovations,
    Kind,
    examine_innovations,
    run_filter,
)
from .filters.model import CAPACITY, OFFSET
from .inputs import Given, read_validation
from .model.prepared import prepare_record
from .model.start import Start
from .model.window import OCV_MARGIN, Window
from .over_soc import no_temperature, require_temperature
from .result_filter import FilterSettings, axis_sd_of, model_of, window_of
from .results import Result
from .scenarios import SCENARIOS, Case, Scenario, case_of, first_with_room, in_place
from .schema import Count, Document, Part, Told
from .settings import AutoHold, AutoSign, Reading

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Within this share of the counter, and for so long, an estimate has converged.
CONVERGED, HOLDS_S = 0.03, 600.0
# Two standard deviations of a normal distribution hold 95 %.
BAND = 1.959964
# Where the OCV's error is over this SOC, as a standard deviation, the voltage hardly tells the SOC.
FLAT = 0.05
# Offset and capacity gather the errors of a whole record: on measured cells they are off by up to
# three of the filter's deviations. They are told where thrice the deviation is half of what was
# believed before.
DOUBT, TOLD = 3.0, 0.5


class ScenarioPart(Part):
    """The estimates of a filter in one scenario; SOC and errors are fractions.

    Errors are those after convergence, None without, but for those of the whole record.

    Attributes:
        name: The scenario's.
        start_s: When it starts, after the beginning of the replay.
        start_soc: The SOC that the filter starts from.
        offset_a: The current's offset.
        capacity_ah: The capacity that is believed.
        converged_s: Time after which the error stays within 3 % for ten minutes at least.
        whole_rms: Root mean square of the error over the whole record.
        whole_max: The largest error over it.
        rms: Root mean square of the error.
        rms_above_10_soc: The same above 10 % SOC.
        max: The largest error.
        max_before: The largest error before convergence, or of all without.
        band: Mean half width of the 95 % band, over all samples.
        widest: The largest half width of it after the first ten minutes.
        in_band: Share of all samples where the 95 % band holds the counter.
        counter_rms: Root mean square of plain counting over the same samples.
        counter_max: The largest error of plain counting.
        estimates: Final values of the estimated parameters, with their standard deviations; of
            offset and capacity only those that the record tells.
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


class SocReplay(Document):
    """The contents of `soc.json`: how well a filter tracked the SOC of a record.

    A notebook shows a replay as its figure, while it has its `traces`: one read from a file has
    none.

    Attributes:
        schema_version: Version of the schema.
        record: Name of the record.
        sha256: Digest of its file.
        model: The circuit.
        circuit: The circuit as screens call it, with its tables.
        with_tables: True if tables over SOC were used.
        settings: The filter.
        states: Number of the filter's states.
        samples: Number of samples.
        duration_s: Length of the replay.
        start: Where the counter starts, and why there.
        before_s: What the record has before that, which is not replayed.
        soc_range: Lowest and highest SOC of the counter.
        flat_soc: Lowest and highest SOC of the counter where the errors of the circuit's OCV are
            over 5 % SOC, as one standard deviation: the voltage hardly tells the SOC there.
        flat_share: The share of the samples where they are.
        scenarios: The filter's errors in every scenario.
        untried: Scenarios whose start the record has no room for.
        innovations: Tests of the innovations from the right start, None if it diverged.
        warnings: What is doubtful, with what to do.
    """

    schema_version: Literal[2] = 2
    record: str
    sha256: str
    model: str
    circuit: str
    with_tables: bool
    settings: FilterSettings
    states: Count
    samples: Count
    duration_s: float
    start: Start | None = None
    before_s: float = 0.0
    soc_range: tuple[float, float]
    flat_soc: tuple[float, float] | None = None
    flat_share: float = 0.0
    scenarios: tuple[ScenarioPart, ...]
    untried: tuple[str, ...] = ()
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
    """A replay over time: the counter as the truth, and every scenario's estimate.

    `counted` is plain counting in each scenario; before one starts there are no numbers.
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
        window: The part of the record that is replayed; by default its own if the result is of
            it, else all of it.
        settings: The filter.
        scenarios: Errors of a battery manager's knowledge; by default four cases.
        current_sign: The sign of the file's current; "auto" decides from the data.
        current_hold: When a sample's current flows; "auto" decides from the data.
        voltage_lag: How much older its voltage is than its current, as for `read_record`.
        columns: Names of columns, as for `read_record`.
        series: How many cells are in series, as for `read_record`.

    Raises `InputError` if record, window or `settings.estimate` are no use, or without assessment.
    """
    settings = settings or FilterSettings()
    choose = partial(window_of, result, chosen=window)
    reading = Reading(
        validate_current_sign=current_sign, current_hold=current_hold,
        voltage_lag=voltage_lag, columns=columns, series=series,
    )  # fmt: skip
    measured, warnings = read_validation(
        record, reading, choose, result.cell_model, result.measured_at
    )
    window = choose(measured)
    used = result if settings.tables else result.without_tables()
    prepared = prepare_record(measured, used.cell_model, used.model, window)
    low, high = used.cell_model.soc_range
    own_low, own_high = float(prepared.soc.min()), float(prepared.soc.max())
    if own_low < low - OCV_MARGIN or own_high > high + OCV_MARGIN:
        raise InputError(
            f"{measured.name}: its SOC goes from {100 * own_low:.0f} to {100 * own_high:.0f} %, "
            f"and the OCV is known from {100 * low:.0f} to {100 * high:.0f} %: beyond that a "
            "filter has no voltage to compare with; identify with an OCV that reaches as far, or "
            "start later, with `start_time`"
        )
    degc = prepared.temperature_degc
    if used.fits.over_temperature is not None:
        degc = require_temperature(prepared)
    if degc is not None:
        used = used.at_temperature(degc)
    prepared = prepared.following(used.circuit_parameters.dependence)
    warnings += no_temperature(prepared, used.fits)
    capacity_ah = prepared.capacity_ah
    model = eqx.tree_at(
        lambda model: (model.capacity_ah, model.axis_sd),
        model_of(used, settings.estimate),
        (jnp.asarray(capacity_ah), jnp.asarray(axis_sd_of(result, capacity_ah))),
    )
    tried = {scenario: first_with_room(prepared.soc, scenario.soc_error) for scenario in scenarios}
    cases = [
        case_of(model, prepared, scenario, first, settings.soc_sd)
        for scenario, first in tried.items()
        if first is not None
    ]
    if not cases:
        raise InputError(f"{measured.name}: its SOC leaves no room for a start so far off")
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(case.given for case in cases))
    program = compile_for(_run_all, *stacked, settings.kind)
    estimate = jax.tree.map(np.asarray, program(*stacked, settings.kind))
    late = [
        jax.tree.map(
            lambda array, place=place, case=case: in_place(array[place], case.first), estimate
        )
        for place, case in enumerate(cases)
    ]
    traces = Traces(
        prepared.time_s - prepared.time_s[0],
        prepared.soc,
        jax.tree.map(lambda *leaves: np.stack(leaves), *late),
        np.stack([in_place(case.counted, case.first) for case in cases]),
    )
    parts = tuple(_score(model, case, traces, place) for place, case in enumerate(cases))
    normalised = np.asarray(traces.estimate.innovation_v[0] / traces.estimate.innovation_sd_v[0])
    flat_soc = prepared.soc[model.doubt_at(prepared.soc) > FLAT]
    replay = SocReplay(
        record=measured.name,
        sha256=measured.sha256,
        model=used.model,
        circuit=used.answer,
        with_tables=used.tables is not None,
        settings=settings,
        states=model.states + len(settings.estimate),
        samples=len(prepared.soc),
        duration_s=float(traces.time_s[-1]),
        start=prepared.start,
        before_s=float(prepared.time_s[0] - measured.time_s[0]),
        soc_range=(float(prepared.soc.min()), float(prepared.soc.max())),
        flat_soc=(float(flat_soc.min()), float(flat_soc.max())) if len(flat_soc) else None,
        flat_share=len(flat_soc) / len(prepared.soc),
        scenarios=parts,
        untried=tuple(scenario.name for scenario, first in tried.items() if first is None),
        innovations=None
        if parts[0].diverged_s is not None
        else examine_innovations(normalised[cases[0].first :]),
        warnings=tuple(dict.fromkeys([*warnings, *measured.warnings, *prepared.warnings])),
    )
    replay._traces = traces
    return replay


def _run_all(models: FilterModel, starts: Any, drives: Drive, kind: Kind) -> Estimate:
    """Every scenario, cell or tuning along the first axis."""
    return jax.vmap(lambda model, start, drive: run_filter(model, start, drive, kind))(
        models, starts, drives
    )


def _score(model: FilterModel, case: Case, traces: Traces, place: int) -> ScenarioPart:
    """The errors of a filter's estimates against the counter."""
    believed, (state, _), _ = case.given
    here = slice(case.first, None)
    time_s, truth = traces.time_s[here] - traces.time_s[case.first], traces.truth[here]
    soc = np.asarray(traces.estimate.soc[place])[here]
    band = BAND * np.asarray(traces.estimate.soc_sd[place])[here]
    part = ScenarioPart(
        name=case.scenario.name,
        start_s=float(traces.time_s[case.first]),
        start_soc=float(state[0]),
        offset_a=case.scenario.offset_c * float(model.capacity_ah),
        capacity_ah=float(believed.capacity_ah),
    )
    is_number = np.isfinite(soc) & np.isfinite(band)
    if not np.all(is_number):
        return part.model_copy(update={"diverged_s": float(time_s[np.argmin(is_number)])})
    error, counter_error = soc - truth, traces.counted[place][here] - truth
    found: dict[str, Any] = {
        "whole_rms": _rms(error),
        "whole_max": float(np.abs(error).max()),
        "in_band": float(np.mean(np.abs(error) <= band)),
        "band": float(np.mean(band)),
        "widest": float(band[time_s >= min(HOLDS_S, time_s[-1])].max()),
        "estimates": _told(
            model, traces.estimate.slow[place, -1], traces.estimate.slow_sd[place, -1]
        ),
    }
    first = _converged(time_s, np.abs(error) <= CONVERGED)
    if first != 0:
        found["max_before"] = float(np.abs(error[:first]).max())
    if first is not None:
        after, above = error[first:], error[first:][is_above(truth[first:])]
        found |= {
            "converged_s": float(time_s[first]),
            "rms": _rms(after),
            "rms_above_10_soc": _rms(above) if len(above) else None,
            "max": float(np.abs(after).max()),
            "counter_rms": _rms(counter_error[first:]),
            "counter_max": float(np.abs(counter_error[first:]).max()),
        }
    return part.model_copy(update=found)


def _told(model: FilterModel, values: Any, deviations: Any) -> dict[str, tuple[float, float]]:
    """Final values with their deviations; of offset and capacity only what a record tells from the
    errors of the circuit. All but the offset are logarithms of a factor."""
    told, rows = {}, zip(model.slow, values, deviations, model.slow_sd.tolist(), strict=True)
    for name, value, sd, prior_sd in rows:
        sd *= DOUBT if name in (OFFSET, CAPACITY) else 1.0
        if name not in (OFFSET, CAPACITY) or sd <= TOLD * prior_sd:
            told[name] = float(value if name == OFFSET else np.exp(value)), float(sd)
    return told


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
