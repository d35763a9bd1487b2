"""One record prepared for simulation: the simulated part, its SOC, and the cell's voltage at
rest."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Int

from ..cell import CellModel, Dependence, get_circuit
from ..cell.dependence import filled
from ..cell.tables import hats
from ..display import Brief
from ..errors import InputError, attempt
from ..execution import as_input
from ..notices import Notice
from ..records import Record
from ..records.record import STEP_SHARE, is_long
from ..records.samples import STEADY_SHARE
from ..settings import Registration, is_temperature
from .start import Start, find_start
from .window import Window, scored_samples, start_of, temperature_of, within_ocv

if TYPE_CHECKING:
    from .simulate import SimulationInput

FEWEST_SAMPLES = 10
# This share of a record's samples is enough to determine a time constant equal to their interval.
DENSE_QUANTILE = 0.05
# The response to a step contains all of R0 after this time (a second, less a clock's jitter) and at
# least two samples, whichever side of its sample a current flows on.
AFTER_S = 0.99
# Samples processed at a time; records of every length share the programs for such a block.
BLOCK = 4096
# Fields of a prepared record with one value per simulated sample.
COURSES = (
    "soc", "direction", "source_v", "hysteresis_amplitude_v", "scored", "resistance_factor"
)  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class PreparedRecord(Brief):
    """The simulated span of one record, first to last scored sample.

    `cell` is the cell at the record's temperature. `source_v` is the open-circuit voltage with the
    circuit's hysteresis term, a dynamic one held constant; `direction` the last direction of the
    current (+1 charging, -1 discharging). `hysteresis_amplitude_v` is None for circuits without
    dynamic hysteresis.
    """

    record: Record
    cell: CellModel
    circuit: str
    window: Window
    start: Start
    first: int
    soc: Float[np.ndarray, "simulated"]
    direction: Float[np.ndarray, "simulated"]
    source_v: Float[np.ndarray, "simulated"]
    hysteresis_amplitude_v: Float[np.ndarray, "simulated"] | None
    scored: Bool[np.ndarray, "simulated"]
    rest_current_a: float
    capacity_ah: float
    warnings: tuple[Notice, ...]
    dependence: Dependence | None = None
    resistance_factor: Float[np.ndarray, "simulated"] | None = None

    @property
    def span(self) -> slice:
        return slice(self.first, self.first + len(self.soc))

    @property
    def settled_window(self) -> Window:
        """The window, with the better-fitting direction before the start."""
        if self.start.direction_source != "better fit":
            return self.window
        return replace(self.window, initial_direction=self.start.direction)

    @property
    def unregistered(self) -> "PreparedRecord":
        """A copy with start and capacity as before any registration."""
        if self.window.registration is None:
            return self
        return self.in_window(self.window.unregistered).with_dependence(self.dependence)

    def in_window(self, window: Window, record: Record | None = None) -> "PreparedRecord":
        """A copy prepared in another window or of another record, in the better-fitting direction
        and without a law. Raises `InputError` as `prepare_record` does."""
        window = replace(self, window=window).settled_window
        moved = prepare_record(record or self.record, self.cell, self.circuit, window)
        other_v = self.start.other_rmse_v
        return moved if other_v is None else moved.fitting_better(other_v)

    def registered(
        self,
        soc: float,
        capacity_ah: float,
        registration: Registration | None = None,
        record: Record | None = None,
    ) -> "PreparedRecord | None":
        """A copy with another start and capacity; None if these are impossible for the record."""
        window = replace(
            self.window,
            initial_soc=soc,
            soc_source="registered",
            capacity_ah=capacity_ah,
            registration=registration or self.window.registration,
        )
        moved = attempt(self.in_window, window, record)
        return None if isinstance(moved, InputError) else moved

    def with_dependence(self, dependence: Dependence | None) -> "PreparedRecord":
        """A copy whose resistances have this law beyond SOC; None for no law."""
        if dependence == self.dependence:
            return self
        factor = None
        if dependence is not None:
            record = self.record
            given = record.time_s, record.interval_current_a
            factor = dependence.factor(*given, self.sample_degc)[self.span]
        return replace(self, dependence=dependence, resistance_factor=factor)

    def fitting_better(self, other_rmse_v: float) -> "PreparedRecord":
        """A copy that records that its direction fits better than the other one."""
        start = replace(self.start, direction_source="better fit", other_rmse_v=other_rmse_v)
        return replace(self, start=start)

    def part(self, here: slice) -> "PreparedRecord":
        """A slice of the simulated samples, the last one's current unused."""
        courses = {name: values for name in COURSES if (values := getattr(self, name)) is not None}
        courses = {name: values[here] for name, values in courses.items()}
        return replace(self, first=self.first + here.start, **courses)

    def parts(self, samples: int) -> Iterator["PreparedRecord"]:
        """Blocks of `samples` samples, each with the first sample of the next, at which its last
        current interval ends."""
        for first in range(0, len(self.soc), samples):
            yield self.part(slice(first, first + samples + 1))

    def input_blocks(
        self, samples: int, shortest_tau_s: float, highest_gamma: float | None = None
    ) -> Iterator[tuple[slice, "SimulationInput"]]:
        """`simulation_input` block by block, each padded to `samples` samples: the states at the
        end of one are those at the start of the next."""
        for number, part in enumerate(self.parts(samples)):
            first = number * samples
            inputs = part.simulation_input(shortest_tau_s, highest_gamma, samples, in_one_form=True)
            yield slice(first, min(first + samples, len(self.soc))), inputs

    def simulates_as(self, other: "PreparedRecord") -> bool:
        """True if every circuit has the same errors on the other record, sample by sample, because
        the data they are computed from are the same."""
        samples = ("time_s", "current_a", "held_a", "voltage_v", *COURSES)
        is_like = self.start.direction == other.start.direction
        return is_like and all(
            np.array_equal(getattr(self, name), getattr(other, name))
            for name in (*samples, "rest_current_a", "dependence")
        )

    @property
    def time_s(self) -> Float[np.ndarray, "simulated"]:
        return self.record.time_s[self.span]

    @property
    def current_a(self) -> Float[np.ndarray, "simulated"]:
        return self.record.current_a[self.span]

    @property
    def voltage_v(self) -> Float[np.ndarray, "simulated"]:
        return self.record.voltage_v[self.span]

    @property
    def is_informative(self) -> Bool[np.ndarray, "simulated"]:
        """The scored samples from the first load on: a rest before it contains no information about
        a circuit."""
        loaded = np.abs(self.current_a) >= self.rest_current_a
        return self.scored & (np.arange(len(loaded)) >= np.argmax(loaded))

    @property
    def scored_duration_s(self) -> float:
        first, after = np.argmax(self.scored), len(self.scored) - np.argmax(self.scored[::-1])
        return float(self.time_s[after - 1] - self.time_s[first])

    @property
    def sample_degc(self) -> Float[np.ndarray, "samples"] | None:
        """The temperature at every sample of the record: measured, else given or in its name."""
        degc, usual_degc = self.record.temperature_degc, self.temperature_degc
        if degc is not None and (measured := filled(self.record.time_s, degc)) is not None:
            return measured
        has_usual = usual_degc is not None and is_temperature(usual_degc)
        return np.full(self.record.samples, usual_degc) if has_usual else None

    @property
    def measured_degc(self) -> Float[np.ndarray, "simulated"] | None:
        """The temperature at every simulated sample; None if none was measured."""
        degc = self.record.temperature_degc
        return None if degc is None else filled(self.time_s, degc[self.span])

    @property
    def median_interval_s(self) -> float:
        return float(np.median(np.diff(self.time_s), overwrite_input=True))

    @property
    def dense_interval_s(self) -> float:
        """The interval of the densest samples, enough of them to determine a time constant of that
        length."""
        return float(np.quantile(np.diff(self.time_s), DENSE_QUANTILE, overwrite_input=True))

    @property
    def step_ohm(self) -> float:
        """The resistance at the current's steps; zero if they do not determine it."""
        return self.record.resistance_ohm

    @property
    def is_step(self) -> Bool[np.ndarray, "simulated"]:
        """True at the samples that the current steps to, regardless of the samples around them."""
        moved_a = np.abs(np.diff(self.current_a, prepend=self.current_a[:1]))
        return moved_a > STEP_SHARE * np.abs(self.current_a).max()

    @property
    def is_at_ocv(self) -> Bool[np.ndarray, "simulated"]:
        """True at the ends of rests long enough for the voltage to be the OCV."""
        rests = self.record.segments(self.rest_current_a).rests
        ends = [rest.last for rest in rests if is_long(rest.duration_s)]
        return np.isin(np.arange(self.span.start, self.span.stop), ends)

    @property
    def steps(self) -> tuple[Int[np.ndarray, "steps"], Int[np.ndarray, "steps"]]:
        """The scored samples before the steps of the current, and those at which their responses
        are read, with one change of the current in between.

        By then the voltage has moved by R0 and the response of the pairs, so R0 is no larger.
        """
        moved_a, peak_a = np.abs(np.diff(self.current_a)), np.abs(self.current_a).max()
        time_s, moves = self.time_s, np.append(0, np.cumsum(moved_a >= STEADY_SHARE * peak_a))
        before = np.flatnonzero(self.is_step) - 1
        before = before[before > 0]
        after = np.maximum(before + 2, np.searchsorted(time_s, time_s[before + 1] + AFTER_S))
        is_inside = after < len(moves)
        before, after = before[is_inside], after[is_inside]
        is_single = moves[after] - moves[before - 1] == 1
        is_single &= self.scored[before] & self.scored[after]
        return before[is_single], after[is_single]

    def nearest(self, nodes: Float[np.ndarray, "nodes"]) -> Bool[np.ndarray, "nodes"]:
        """True at the nodes that are nearest to some scored sample."""
        soc = self.soc[self.scored]
        shares = (hats(soc[n : n + BLOCK], nodes) for n in range(0, len(soc), BLOCK))
        return np.any([np.any(hat >= 0.5, axis=0) for hat in shares], axis=0)

    @property
    def temperature_degc(self) -> float | None:
        """The given temperature, else the median of scored samples, else that in the name."""
        here = np.arange(self.record.samples)[self.span][self.scored]
        return temperature_of(self.record, self.window, here)

    def simulation_input(
        self,
        shortest_tau_s: float,
        highest_gamma: float | None = None,
        samples: int | None = None,
        in_one_form: bool = False,
    ) -> "SimulationInput":
        """The span as a circuit's input, exact for time constants from `shortest_tau_s` on.

        With dynamic hysteresis, exact for rates up to `highest_gamma`. With `samples`, only the
        first of them; if there are fewer, the last is repeated without weight, which changes no bit
        of an error. `in_one_form` gives the form shared by blocks.
        """
        from .sampling_intervals import Intervals, sized
        from .simulate import HysteresisInput, SimulationInput

        def fit(values: np.ndarray) -> Any:
            return as_input(values if samples is None else sized(values, samples))

        def fit_clock(clock: Intervals) -> Intervals:
            return clock if samples is None else clock.sized(samples, in_one_form)

        hysteresis, amplitude_v = None, self.hysteresis_amplitude_v
        if highest_gamma is not None and amplitude_v is not None:
            turning, passed = self._turning
            clock = fit_clock(Intervals.gather(passed, 1 / highest_gamma, 0.0))
            hysteresis = HysteresisInput(fit(amplitude_v), fit(turning), clock)
        ohmic_a, through_pairs_a = self.weighed_a
        weight = self.scored.astype(float)
        if samples is not None:
            weight = np.append(weight[:samples], np.zeros(max(0, samples - len(weight))))
        return SimulationInput(
            current_a=fit(ohmic_a),
            held_a=fit(through_pairs_a),
            base_error_v=fit(self.voltage_v - self.source_v),
            weight=None if np.all(weight) and samples is None else as_input(weight),
            scored=as_input(float(np.count_nonzero(weight))),
            intervals=fit_clock(Intervals.measure(self.time_s, shortest_tau_s)),
            hysteresis=hysteresis,
        )

    @property
    def weighed_a(self) -> tuple[Float[np.ndarray, "simulated"], Float[np.ndarray, "simulated"]]:
        """The currents through R0 at the samples and through the pairs from each to the next,
        scaled by the resistance law."""
        law, factor = self.dependence, self.resistance_factor
        if law is None or factor is None:
            return self.current_a, self.held_a
        return factor * law.by_direction(self.current_a), factor * law.through_pairs(self.held_a)

    @property
    def held_a(self) -> Float[np.ndarray, "simulated"]:
        """The current that flows from each sample to the next; the last entry is unused."""
        last = slice(self.first, self.first + len(self.soc) - 1)
        return np.append(self.record.interval_current_a[last], 0.0)

    @property
    def _turning(self) -> tuple[Float[np.ndarray, "simulated"], Float[np.ndarray, "simulated"]]:
        """The limit that a dynamic hysteresis approaches after every sample, relative to its start,
        and the SOC passed meanwhile.
        """
        # Below the rest current a cell keeps its direction: noise and offsets reverse nothing.
        is_moving = (np.abs(self.held_a) >= self.rest_current_a) & (self.held_a != 0)
        passed = np.where(is_moving, np.abs(np.diff(self.soc, append=self.soc[-1])), 0.0)
        toward = np.where(is_moving, -np.sign(self.held_a), self.direction)
        return toward - self.start.direction, passed


def prepare_record(
    record: Record,
    cell: CellModel,
    circuit: str,
    window: Window | None = None,
    *,
    is_measured: bool = True,
) -> PreparedRecord:
    """A record prepared with the cell at its temperature. Raises `InputError` if window, SOC or OCV
    range do not fit it; a current that is not measured is not checked, as it identifies nothing."""
    window = window or Window()
    cell = cell.at(temperature_of(record, window))
    capacity_ah = window.capacity_ah or cell.capacity_ah
    first, rest_a = start_of(record, window, capacity_ah)
    start, capacity_ah, warnings = find_start(record, cell, window, capacity_ah, first, rest_a)
    soc = soc_along(record, capacity_ah, first, start.soc)
    scored = scored_samples(record, window, first, soc)
    if is_measured:
        scored, beyond = within_ocv(record, cell, capacity_ah, soc, scored)
        if any(one.severity == "error" for one in beyond):
            raise beyond[0].error()
        warnings += beyond
    wrong = np.flatnonzero(scored & (record.voltage_v <= 0))
    if len(wrong):
        # Relative errors divide by voltages.
        raise InputError(
            f"{record.name}: row {record.row[wrong[0]]} is scored at "
            f"{record.voltage_v[wrong[0]]:g} V, which is not a cell voltage ({len(wrong)} such "
            "samples); delete the row, or leave it out with `score_from`, `score_to` or "
            "`score_steps`"
        )
    if is_measured and not np.any(record.current_a[scored]):
        raise InputError(
            f"{record.name}: the current of every scored sample is zero, so nothing can be "
            "identified; give a record under load, or widen the window"
        )

    span = slice(first, int(np.flatnonzero(scored)[-1]) + 1)
    is_short = np.count_nonzero(scored) < FEWEST_SAMPLES or span.stop - first < FEWEST_SAMPLES
    if is_measured and is_short:
        raise InputError(
            f"{record.name}: fewer than {FEWEST_SAMPLES} samples are left to score; widen the "
            "window"
        )
    direction = record.segments(rest_a).directions(start.direction)[span]
    model = get_circuit(circuit)
    half_v, hysteresis = model.hysteresis.half_v(cell, soc[span]), model.hysteresis
    state = start.direction if model.has_rate else hysteresis.state(soc[span], direction)
    return PreparedRecord(
        record=record,
        cell=cell,
        circuit=circuit,
        window=window,
        start=start,
        first=first,
        soc=soc[span],
        direction=direction,
        source_v=model.ocv_v(cell, soc[span]) + state * half_v,
        hysteresis_amplitude_v=half_v if model.has_rate else None,
        scored=scored[span],
        rest_current_a=rest_a,
        capacity_ah=capacity_ah,
        warnings=tuple(warnings),
    )


def soc_along(
    record: Record, capacity_ah: float, first: int, soc: float
) -> Float[np.ndarray, "samples"]:
    """SOC by ampere-hours, from `soc` at the sample `first` (Li et al., 2023, Eq. 20)."""
    discharged_ah = record.discharged_ah
    return soc - (discharged_ah - discharged_ah[first]) / capacity_ah
