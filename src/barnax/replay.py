"""An identified circuit used as in a battery manager: a record replayed through a filter.

The reference is the record's own ampere-hour counter. The filter does not see it: it starts wrong,
counts with an offset, or assumes a wrong capacity, and has only the voltage to detect this.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from pydantic import PrivateAttr

from .display import Brief, hook
from .errors import InputError
from .execution import compile_for, in_float64
from .filters import Drive, Filtered, FilterModel, Kind, run_filter
from .fit.temperature_fits import no_temperature, require_temperature
from .metrics import Count
from .model.prepared import PreparedRecord, prepare_record
from .model.start import Start
from .model.window import OCV_MARGIN, Window
from .records import Given, Record
from .result_filter import FilterSettings, model_of, read_for
from .results import Result
from .scenarios import (
    SCENARIOS,
    Case,
    Innovations,
    Scenario,
    ScenarioPart,
    case_of,
    examine_innovations,
    first_with_room,
    from_start,
    score,
)
from .schema import Document, NoticeField
from .settings import AutoHold, AutoSign, Reading

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Where the standard deviation of the SOC due to the OCV's error exceeds this, the voltage hardly
# determines the SOC.
FLAT = 0.05


class SocReplay(Document):
    """The contents of `soc.json`: the accuracy of a filter's SOC on a record.

    A notebook displays a replay as its figure, if it has `traces`: one read from a file has none.

    Attributes:
        schema_version: Version of the schema.
        record: Name of the record.
        sha256: Digest of its file.
        model: The circuit.
        circuit: The circuit as displayed, with its tables.
        with_tables: True if tables over SOC were used.
        settings: The filter.
        states: Number of the filter's states.
        samples: Number of samples.
        duration_s: Length of the replay.
        start: Start of the counter, with the reason.
        before_s: Duration of the record before that, which is not replayed.
        soc_range: Lowest and highest SOC of the counter.
        flat_soc: Lowest and highest SOC of the counter where one standard deviation of the
            circuit's OCV is worth over 5 % SOC: the voltage hardly determines the SOC there.
        flat_share: Share of the samples in that state.
        scenarios: The filter's errors in every scenario.
        untried: Scenarios whose start is outside the record.
        innovations: Tests of the innovations from the right start; None if it diverged.
        warnings: Doubtful results, each with a remedy.
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
    warnings: tuple[NoticeField, ...] = ()

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
    """A replay over time: the counter as the reference, and every scenario's estimate.

    `counted` is plain counting in each scenario; values before its start are not numbers.
    """

    time_s: Float[np.ndarray, "samples"]
    truth: Float[np.ndarray, "samples"]
    estimate: Filtered
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
        window: The replayed part of the record; by default its own if it belongs to the result,
            else the one in a plan.
        settings: The filter.
        scenarios: Wrong starts, currents and capacities; by default four cases. The right start is
            tried first in any case.
        current_sign: The sign of the file's current; "auto" decides from the data.
        current_hold: When a sample's current flows; "auto" decides from the data.
        voltage_lag: Lag of its voltage behind its current, as for `read_record`.
        columns: Names of columns, as for `read_record`.
        series: Number of cells in series, as for `read_record`.

    Raises `InputError` if record, window or `settings.estimate` cannot be used, or without
    assessment.
    """
    settings = settings or FilterSettings()
    reading = Reading(
        validate_current_sign=current_sign, current_hold=current_hold,
        voltage_lag=voltage_lag, columns=columns, series=series,
    )  # fmt: skip
    measured, window, warnings = read_for(result, record, window, reading)
    used, prepared = _prepared(
        result if settings.tables else result.without_tables(), measured, window
    )
    warnings += no_temperature(prepared, used.fits)
    capacity_ah = prepared.capacity_ah
    model = model_of(used, settings.estimate, capacity_ah)
    # Innovations and estimates are those from the right start, which comes first.
    right = [one for one in scenarios if one == Scenario(one.name)] or [SCENARIOS[0]]
    ordered = dict.fromkeys([*right, *scenarios])
    tried = {scenario: first_with_room(prepared.soc, scenario.soc_error) for scenario in ordered}
    cases = [
        case_of(model, prepared, scenario, first, settings.soc_sd)
        for scenario, first in tried.items()
        if first is not None
    ]
    if not cases:
        raise InputError(f"{measured.name}: its SOC leaves no room for a start so far off")
    of_cases = _filtered(cases, settings.kind)
    pairs = [*zip(cases, of_cases, strict=True)]
    late = [jax.tree.map(partial(from_start, first=case.first), each) for case, each in pairs]
    traces = Traces(
        prepared.time_s - prepared.time_s[0],
        prepared.soc,
        jax.tree.map(lambda *leaves: np.stack(leaves), *late),
        np.stack([from_start(case.counted, case.first) for case in cases]),
    )
    parts = tuple(score(case, capacity_ah, prepared, estimate) for case, estimate in pairs)
    from_right, first = of_cases[0], cases[0].first
    normalised = np.asarray(from_right.innovation_v / from_right.innovation_sd_v)
    normalised = normalised[: len(prepared.soc) - first]
    flat_soc = prepared.soc[model.doubt_at(prepared.soc) > FLAT]
    replay = SocReplay(
        record=measured.name,
        sha256=measured.sha256,
        model=used.model,
        circuit=used.answer,
        with_tables=used.over is not None,
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
        innovations=None if parts[0].diverged_s is not None else examine_innovations(normalised),
        warnings=tuple(dict.fromkeys([*warnings, *measured.warnings, *prepared.warnings])),
    )
    replay._traces = traces
    return replay


def _prepared(
    result: Result, record: Record, window: Window | None
) -> tuple[Result, PreparedRecord]:
    """The circuit at the record's temperature, and the record prepared for it. Raises `InputError`
    if its SOC leaves the OCV."""
    prepared = prepare_record(record, result.cell, result.model, window)
    low, high = result.cell.soc_range
    lowest, highest = float(prepared.soc.min()), float(prepared.soc.max())
    if lowest < low - OCV_MARGIN or highest > high + OCV_MARGIN:
        raise InputError(
            f"{record.name}: its SOC goes from {100 * lowest:.0f} to {100 * highest:.0f} %, "
            f"and the OCV is known from {100 * low:.0f} to {100 * high:.0f} %: beyond that a "
            "filter has no voltage to compare with; identify with an OCV that reaches as far, or "
            "start later, with `start_time`"
        )
    degc = prepared.temperature_degc
    if result.fits.over_temperature is not None:
        degc = require_temperature(prepared)
    if degc is not None:
        result = result.at_temperature(degc)
    return result, prepared.with_dependence(result.circuit_parameters.dependence)


def _filtered(cases: Sequence[Case], kind: Kind) -> list[Filtered]:
    """The estimates of every case, run together."""
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(case.given for case in cases))
    program = compile_for(_run_all, *stacked, kind)
    estimate = jax.tree.map(np.asarray, program(*stacked, kind))
    return [jax.tree.map(itemgetter(index), estimate) for index in range(len(cases))]


def _run_all(models: FilterModel, starts: Any, drives: Drive, kind: Kind) -> Filtered:
    """Run every scenario, cell or tuning along the first axis."""
    return jax.vmap(lambda model, start, drive: run_filter(model, start, drive, kind))(
        models, starts, drives
    )
