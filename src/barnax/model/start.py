"""The state in which a simulation starts: its SOC, the direction before it, and their sources."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from ..cell import CellModel
from ..cell.soc_axis import BEYOND_SOC
from ..errors import InputError
from ..notices import Notice
from ..records import Record
from ..records.log import goes_on
from ..records.record import MINIMUM_REST_S, Segments, is_long
from ..settings import SocSource
from .window import Window, fitted_soc, mean_at_rest, relaxing_rest, soc_from_rest

# A discharge reaches empty after this time, at up to C/1.8, because many tests run at C/2. The
# voltage without R I is within 2 % of an end.
_EMPTY_HOURS, _AT_AN_END = 1.8, 0.02
# A current this small leaves the voltage nearly at rest.
_SMALL_HOURS = 20.0
# The largest distance of the voltage at the start, without R I, from the OCV at the SOC derived
# from an end, or at a SOC this near to it; and at the SOC from a counter, whose zero no sample
# confirms.
_APART_V, _APART_SOC, _COUNTED_APART_V = 0.15, 0.02, 0.05
# The SOC called full differs by less than this from one charge to the next.
_BEYOND_AN_END = 0.005
# This near full or empty, the last current was the one that leads there.
NEAR_AN_END = 0.02
# A given SOC is doubtful if the rested voltage is this far from its OCV, and implies another SOC.
DOUBTFUL_V, DOUBTFUL_SOC = 0.01, 0.02
# Relative standard deviation of counted charge.
_COUNTED_SD = 0.02
# A rested voltage this far above or below the OCV is from another cell, or another temperature.
BEYOND_OCV_V = 0.005

# Source of the direction before the start: given; the load before it; a start at full or empty; a
# worse fit with the other one; or none, whether or not it matters.
DirectionSource = Literal[
    "given", "load before", "full or empty", "better fit", "without effect", "assumed"
]


@dataclass(frozen=True)
class Start:
    """The state in which a simulation starts, and its sources.

    `voltage_v` and `row` are those of the sample that the SOC comes from, at rest or at full or
    empty; for a rest the voltage is its mean. `direction` is the last current before the start, +1
    charging, -1 discharging; if both were tried, `other_rmse_v` is the RMSE with the other.
    `soc_sd` is the standard error of a SOC derived from voltages, due to their noise.
    """

    soc: float
    soc_source: Literal["given", "rested voltage"] | SocSource
    direction: Literal[-1, 1]
    direction_source: DirectionSource
    row: int
    voltage_v: float
    other_rmse_v: float | None = None
    soc_sd: float = 0.0


def find_start(
    record: Record, cell: CellModel, window: Window, capacity_ah: float, first: int, rest_a: float
) -> tuple[Start, float, list[Notice]]:
    """The state at the start, the capacity over which the record is counted, and the evidence
    against them.

    Raises `InputError` if the SOC is neither given nor shown by a sample nor identifiable from the
    whole record. A given SOC applies to the first row, or to the start if that is given too.
    Between an end and the start the record may move more charge than the capacity. The end stays
    where the data show it: the record is counted over that charge or, if its capacity was given,
    starts beyond the other end. A rested cell is on the OCV branch of the direction it comes from.
    If it has not rested, the SOC is carried to the start from where the record shows it.
    """
    begun = _Beginning(record, cell, window, capacity_ah, first, record.segments(rest_a))
    relaxed_at, rise_v = relaxing_rest(record, rest_a)
    is_relaxing = 0 < relaxed_at == first
    direction, source = begun.direction_before(first)
    if source == "assumed" and is_relaxing:
        direction, source = -1 if rise_v > 0 else 1, "load before"
    unrested, voltage_v, sd_v = begun.unrested, float(record.voltage_v[first]), 0.0
    if not unrested:
        voltage_v, sd_v = mean_at_rest(begun.segments, first)
    is_short = record.time_s[first] - record.time_s[0] < MINIMUM_REST_S
    at, soc_sd = first, 0.0
    elsewhere: DeterminedSoc | None = None
    notices: list[Notice] = []
    if window.initial_soc is None and (unrested or is_short):
        # The length of a record's opening rest before the first row is unknown; counters are more
        # reliable, and if the rest still relaxes, so is any other source.
        only = not (unrested or is_relaxing)
        elsewhere = begun.determined_soc(only_counters=only)
        if only and elsewhere is not None and begun.denies(voltage_v, sd_v, elsewhere.soc):
            elsewhere = None
    if window.initial_soc is not None:
        soc, soc_source = window.initial_soc, window.soc_source or "given"
        soc_sd = 0.0 if window.registration is None else window.registration.given_sd
        if soc_source == "given":
            soc -= begun.counted_soc
    elif elsewhere is not None:
        soc, soc_source, at, soc_sd = elsewhere
        voltage_v = float(record.voltage_v[at])
        if (room := abs(soc - 0.5) + 0.5) > 1 + _BEYOND_AN_END:
            moved = {"soc": soc, "known_row": record.row[at], "capacity_ah": capacity_ah}
            other_end = {"full end": soc < 0, "empty end": soc > 1}
            code = "start.beyond-an-end"
            if window.capacity_ah is None and other_end.get(soc_source):
                soc, capacity_ah = float(soc > 1), room * capacity_ah
                code, moved = "start.moves-more", moved | {"moved_ah": capacity_ah}
            notices = [Notice(code, moved, record.name)]
    elif not unrested:
        (soc, soc_sd), soc_source = begun.rested(first, direction), "rested voltage"
    elif fitted := None if cell.ocv_is_fitted else fitted_soc(record, cell, capacity_ah, first):
        (soc, soc_sd), soc_source = fitted, "fitted"
        values = {"start_row": record.row[at], "soc": soc, "soc_sd": soc_sd}
        notices = [Notice("start.fitted", values, record.name)]
    else:
        raise unrested.error()
    if source == "assumed" and min(soc, 1 - soc) < NEAR_AN_END:
        direction, source = (1 if soc > 0.5 else -1), "full or empty"
        if soc_source == "rested voltage":
            soc = begun.rested(first, direction)[0]
    row = int(record.row[at])
    start = Start(soc, soc_source, direction, source, row, voltage_v, soc_sd=soc_sd)
    begun = replace(begun, capacity_ah=capacity_ah)
    if unrested is None:
        notices += begun.beyond_ocv(start, sd_v)
    rests = (rest.sample for rest in begun.rest_socs()) if unrested else [first]
    for at in sorted(rests, key=lambda at: abs(at - first))[:1]:
        notices += begun.denied_by_rest(at)
    if is_relaxing:
        notices.append(begun.relaxing(soc_source == "rested voltage"))
    return start, capacity_ah, notices


class DeterminedSoc(NamedTuple):
    """The state of charge at one sample, its source, and the index `sample`, whose voltage gives it
    the standard error `soc_sd`."""

    soc: float
    source: SocSource
    sample: int
    soc_sd: float = 0.0


@dataclass(frozen=True, eq=False)
class _Beginning:
    """A record, the cell, and the sample `first` at which a simulation starts."""

    record: Record
    cell: CellModel
    window: Window
    capacity_ah: float
    first: int
    segments: Segments

    @cached_property
    def discharged_ah(self) -> Float[np.ndarray, "samples"]:
        return self.record.discharged_ah

    def determined_soc(self, *, only_counters: bool) -> DeterminedSoc | None:
        """The state of charge at the start, carried by ampere-hours from where it is known.

        The nearest full or empty end is preferred to the voltage of a full cell at the start, that
        to the tester's counters, which may have begun at an end, and those to the nearest long
        rest. None if there is no source, or the voltage contradicts it.
        """
        # A flat OCV neither confirms the counters nor gives the SOC at a rest.
        is_flat = self.cell.has_flat_ocv
        witnesses = [] if only_counters else [self._ends(), self._full_voltage()]
        witnesses += [] if is_flat else [self._counted()]
        witnesses += [] if is_flat or only_counters else [self.rest_socs()]
        for witness in witnesses:
            likely = [soc for soc in map(self._carried, witness) if self._is_likely(soc)]
            if likely:
                return min(likely, key=lambda soc: abs(soc.sample - self.first))
        return None

    def _carried(self, determined: DeterminedSoc) -> DeterminedSoc:
        passed_ah = self.discharged_ah[determined.sample] - self.discharged_ah[self.first]
        return determined._replace(soc=float(determined.soc + passed_ah / self.capacity_ah))

    def _is_likely(self, determined: DeterminedSoc) -> bool:
        apart_v = _COUNTED_APART_V if determined.source == "counters" else _APART_V
        # Near empty, 1 % SOC lost between two testers is hundreds of mV.
        low_v, high_v = self.cell.average_ocv_v(
            determined.soc + np.array([-_APART_SOC, _APART_SOC])
        )
        is_within = -BEYOND_SOC <= determined.soc <= 1 + BEYOND_SOC
        start_v = self.record.source_v[self.first]
        return is_within and bool(low_v - apart_v <= start_v <= high_v + apart_v)

    def _ends(self) -> Iterator[DeterminedSoc]:
        """The last samples of charges to full and of discharges to empty."""
        low, high = self.cell.soc_range
        if high >= 1 - _AT_AN_END:
            full_v = self.cell.charge(np.array([1 - _AT_AN_END]))[0]
            for last in self.segments.held_charges(self.capacity_ah):
                if self.record.source_v[last] >= full_v:
                    yield DeterminedSoc(1.0, "full end", last)
        if low <= _AT_AN_END:
            empty_v = self.cell.discharge(np.array([_AT_AN_END]))[0]
            for _, last in self.segments.long_loads(-1):
                is_slow = self.record.current_a[last] <= self.capacity_ah / _EMPTY_HOURS
                if is_slow and self.record.source_v[last] <= empty_v:
                    yield DeterminedSoc(0.0, "empty end", last)

    def _full_voltage(self) -> Iterator[DeterminedSoc]:
        """The start, if it is at the voltage of a full cell."""
        full_v = self.cell.average_ocv_v(np.array([1 - _AT_AN_END]))[0]
        is_small = abs(self.record.current_a[self.first]) <= self.capacity_ah / _SMALL_HOURS
        is_measured = self.cell.soc_range[1] >= 1 - _AT_AN_END
        if is_measured and is_small and self.record.source_v[self.first] >= full_v:
            yield DeterminedSoc(1.0, "full voltage", self.first)

    def _counted(self) -> Iterator[DeterminedSoc]:
        """The first sample, assuming that the tester's counters were at zero when the cell was full
        or empty."""
        counted_ah = self.record.charge_ah
        begun_ah = 0.0 if counted_ah is None else float(counted_ah[0])
        soc = (1.0 if begun_ah > 0 else 0.0) - begun_ah / self.capacity_ah
        if begun_ah and -BEYOND_SOC <= soc <= 1 + BEYOND_SOC:
            yield DeterminedSoc(soc, "counters", 0)

    def rest_socs(self) -> Iterator[DeterminedSoc]:
        """The last samples of rests that are long enough and come after a load."""
        for first, last, rest_s in self.segments.rests:
            if first and is_long(rest_s):
                direction = -1 if self.record.current_a[first - 1] > 0 else 1
                rest = soc_from_rest(self.segments, self.cell, last, direction)
                if rest is not None:
                    yield DeterminedSoc(rest[0], "rest elsewhere", last, rest[1])

    def rested(self, at: int, direction: int) -> tuple[float, float]:
        """The SOC given by the rest around a sample, and its standard error. Raises `InputError` if
        it is beyond the OCV."""
        rest = soc_from_rest(self.segments, self.cell, at, direction)
        if rest is None:
            beyond = self.cell.beyond_ocv(mean_at_rest(self.segments, at)[0], direction)
            raise InputError(f"{self.record.name}: row {self.record.row[at]}: {beyond}")
        return rest

    def direction_before(self, at: int) -> tuple[Literal[-1, 1], DirectionSource]:
        """The last current before a sample; if there is none, the given direction or an
        assumption."""
        # The current of a sample flows before it only under a backward hold.
        before = at if self.record.hold.value == "backward" else at - 1
        if at > 0 and (last := self.segments.directions(0)[before]):
            return -1 if last < 0 else 1, "load before"
        if self.window.initial_direction is not None:
            return self.window.initial_direction, "given"
        # For a record that starts under load, only the load is known.
        return -1 if self.record.current_a[at] >= self.segments.rest_a else 1, "assumed"

    @cached_property
    def unrested(self) -> Notice | None:
        """The reason why the voltage at the start gives no state of charge; None if it does."""
        record, first, is_rested = self.record, self.first, self.segments.is_rested
        about = {"start_row": int(record.row[first])}
        if not is_rested[first]:
            about |= {"current_a": record.current_a[first]}
            return Notice("start.unrested", about, record.name)
        before = self.segments.loaded[self.segments.loaded < first]
        rest_s = record.time_s[first] - record.time_s[before[-1]] if len(before) else 0.0
        # A single sample without current at the beginning of a record is no rest.
        if (len(before) or (first == 0 and not is_rested[1])) and not is_long(rest_s):
            rests_s = {"rest_s": rest_s, "needed_s": MINIMUM_REST_S}
            return Notice("start.unrested", {**about, **rests_s}, record.name)
        return None

    def relaxing(self, sets_soc: bool) -> Notice:
        """The notice of an opening rest that relaxes; a doubt if it is short and sets the SOC."""
        record, first = self.record, self.first
        rest_s = float(record.time_s[first] - record.time_s[0])
        is_doubtful = sets_soc and rest_s < MINIMUM_REST_S
        values = {"first_v": record.voltage_v[0], "last_v": record.voltage_v[first]}
        values |= {"start_row": record.row[first], "rest_s": rest_s}
        values |= {"rest": "short" if is_doubtful else None}
        return Notice("start.relaxing", values, record.name)

    @property
    def counted_soc(self) -> float:
        """The charge, as SOC, from the point to which a given SOC applies (the first row unless the
        start is given too) to the start of the simulation."""
        is_moved = self.window.start_time_s is None and self.window.start_after_step is None
        return float(self.discharged_ah[self.first]) / self.capacity_ah if is_moved else 0.0

    def denies(self, voltage_v: float, sd_v: float, soc: float, soc_sd: float = 0.0) -> bool:
        """True if a rested voltage is off both branches at a SOC, in voltage and in SOC."""
        doubtful_v, doubtful_soc = DOUBTFUL_V + 3 * sd_v, DOUBTFUL_SOC + 3 * soc_sd
        ends = [self.cell.soc_at_rest(voltage_v, way) for way in (-1, 1)]
        branch_socs = [soc for soc in ends if soc is not None]
        # If a branch gives no SOC, the voltage is far from its end.
        if len(branch_socs) < 2 or _is_within(soc, branch_socs, doubtful_soc):
            return False
        branches = self.cell.discharge, self.cell.charge
        expected_v = [float(branch(np.array([soc]))[0]) for branch in branches]
        return not _is_within(voltage_v, expected_v, doubtful_v)

    def beyond_ocv(self, start: Start, sd_v: float) -> Iterator[Notice]:
        """A warning if the rested voltage at the start lies beyond the OCV."""
        branch = self.cell.charge if start.direction > 0 else self.cell.discharge
        low_v, high_v = branch(np.array(self.cell.soc_range)).tolist()
        beyond_v = max(start.voltage_v - high_v, low_v - start.voltage_v)
        if beyond_v > BEYOND_OCV_V + 3 * sd_v and not self.cell.ocv_is_fitted:
            where = {"voltage_v": start.voltage_v, "start_row": start.row}
            ends = {"beyond_v": beyond_v, "low_v": low_v, "high_v": high_v}
            yield Notice("start.beyond-ocv", {**where, **ends}, self.record.name)

    def denied_by_rest(self, at: int) -> Iterator[Notice]:
        """A warning if the rest around a sample contradicts the given SOC."""
        record, first = self.record, self.first
        # Registration on other records of the cell casts no doubt on the given SOC.
        window = self.window.unregistered
        if self.cell.ocv_is_fitted or window.initial_soc is None:
            return
        counted = float(self.discharged_ah[at] - self.discharged_ah[first]) / self.capacity_ah
        given_soc = window.initial_soc - counted - self.counted_soc
        voltage_v, sd_v = mean_at_rest(self.segments, at)
        if self.denies(voltage_v, sd_v, given_soc, _COUNTED_SD * abs(counted)):
            rested_soc, rested_sd = self.rested(at, self.direction_before(at)[0])
            where = {"voltage_v": voltage_v, "start_row": record.row[at]}
            socs = {"rested_soc": rested_soc, "rested_sd": rested_sd}
            before = self.discharged_ah[first] / self.capacity_ah
            before = before if window.soc_source == "given earlier" else 0.0
            given = {"given_soc": window.initial_soc + before, "counted_soc": given_soc}
            yield Notice("start.other-soc", {**where, **socs, **given}, record.name)


def _is_within(value: float, ends: Sequence[float], margin: float) -> bool:
    return min(ends) - margin <= value <= max(ends) + margin


def require_whole_log(record: Record, records: Sequence[Record], unknown: InputError) -> None:
    """Raise `InputError` if a record with an unknown start is one log with others."""
    log = [record]
    while before := next((other for other in records if goes_on(other, log[0])), None):
        log.insert(0, before)
    while after := next((other for other in records if goes_on(log[-1], other)), None):
        log.append(after)
    if len(log) > 1:
        others = ", ".join(other.name for other in log if other is not record)
        files = ", ".join(other.name for other in log)
        values = {"others": others, "files": files}
        raise Notice("start.goes-on", values, record.name).error() from unknown
