"""A result as named facts, computed once: what screens, reports and tables read."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import median
from typing import TYPE_CHECKING, NamedTuple

from ..cell.model import NEAR_DEGC
from ..cell.parameters import HALF_HYSTERESIS, OHMIC
from ..cell.soc_axis import ABOVE_SOC
from ..over_soc.settings import circuit_name
from .wording import sentences
from .words import degrees, extent, gathered

if TYPE_CHECKING:
    from ..model.window import Window
    from ..notices import Notice
    from ..over_soc.cross_validation import SocErrors
    from ..over_soc.fits import OverTemperature
    from ..over_soc.nuisances import OffsetEffect
    from ..records import Decision
    from ..result_parts import Candidate, InputPart, MetricsPart
    from ..results import Result

# Sources of a start's SOC that another line has, or that need no line.
SAID_ELSEWHERE = ("given", "rested voltage", "own full charge", "own span", "registered")
# Those that settle the SOC axis of records without an OCV test.
OF_AXIS = ("own full charge", "own span", "given")
# Starts and capacities of records that are adjusted by less, as shares, change no answer.
HARDLY_MOVED = 1e-3


class GuessedHold(NamedTuple):
    """How the current of some samples was taken to flow, and the change of R0 if it does not.

    `names` are those of the records, none where it is all of them.
    """

    value: str
    other: str
    names: list[str]
    ohm: float
    change_ohm: float | None


class LowSoc(NamedTuple):
    """The shares of the squared error and of the samples that are below 10 % SOC."""

    share: float
    samples: float


class AdjustedByTest(NamedTuple):
    """What the OCV test moved, in words, and whether its capacity is that of all records."""

    moved: list[str]
    is_for_all: bool


@dataclass(frozen=True, eq=False)
class View:
    """Facts of a result; of a comparison, which has no `fits`, those of its files and cell.

    Voltages are in V, currents in A, resistances in Ohm, shares are fractions.
    """

    result: "Result"

    # The files, the cell, and what was decided about them.

    @property
    def unfit(self) -> "list[Notice]":
        """The records that are not suitable to be identified on."""
        unfit = [notice for notice in self.result.warnings if notice.code == "role.unfit"]
        return [notice for notice in unfit if notice.values["role"] == "identification"]

    @cached_property
    def identified(self) -> "tuple[InputPart, ...]":
        return self._of_role("identification")

    @cached_property
    def validation(self) -> "tuple[InputPart, ...]":
        return self._of_role("validation")

    def _of_role(self, role: str) -> "tuple[InputPart, ...]":
        return tuple(part for part in self.result.inputs if part.role == role)

    @cached_property
    def simulated(self) -> "list[InputPart]":
        """The files with a start."""
        return [part for part in self.result.inputs if part.start is not None]

    @cached_property
    def planned(self) -> set[str]:
        """The files whose SOC at the start is the plan's own."""
        return {file.name for file in getattr(self.result, "plan", ()) if file.plans_soc}

    @property
    def is_pulse_test(self) -> bool:
        """True where what was identified on is the OCV test too."""
        tests = {part.sha256 for part in self._of_role("ocv")}
        return not tests.isdisjoint(part.sha256 for part in self.identified)

    @property
    def signs(self) -> "Mapping[Decision, list[str]]":
        return gathered((part.sign, part.name) for part in self.result.inputs if part.sign)

    @property
    def holds(self) -> "Mapping[Decision, list[str]]":
        return gathered((part.hold, part.name) for part in self.result.inputs if part.hold)

    @property
    def windows(self) -> "Mapping[Window, list[str]]":
        """The records of each window as it was given."""
        windows = [
            (moved.origin.told if (moved := part.window.registration) else part.window, part.name)
            for part in self.simulated
            if part.window
        ]
        if self.result.cell.has_spanned_capacity:
            # It was not given, though the windows have it.
            windows = [(replace(window, capacity_ah=None), name) for window, name in windows]
        return gathered(windows)

    @property
    def has_direction(self) -> bool:
        """True where the direction before a start matters."""
        return not self.result.cell.is_of_records or bool(self.result.cell.hysteresis.points)

    @property
    def sweep_drop_v(self) -> float | None:
        """What slow sweeps lost under load."""
        cell = self.result.cell
        if cell.sweep_ohm is None:
            return None
        points = cell.charge_points + cell.discharge_points
        return cell.sweep_ohm * median(filter(None, (abs(p.current_a) for p in points)))

    @property
    def axis_record(self) -> "InputPart":
        """The record that settles the SOC axis; the others start by their rest on its OCV."""
        return next(part for part in self.identified if part.start and part.start_source in OF_AXIS)

    @property
    def soc_extents(self) -> dict[str, tuple[float, float]]:
        """The lowest and highest SOC of each record."""
        parts = (*self.identified, *self.validation)
        return {part.name: part.soc_range for part in parts if part.soc_range}

    @property
    def soc_whole(self) -> str:
        """What 0 and 100 % SOC are the ends of."""
        is_whole = not self.result.cell.is_of_records and self.result.cell.soc_range == (0.0, 1.0)
        return "the OCV test" if is_whole else "the charge it is counted over"

    @property
    def carried(self) -> "list[tuple[InputPart, Notice | None]]":
        """Records whose start comes from another place, with the warning of a long way there."""
        moved = {one.subject: one for one in self.result.warnings if one.code == "start.moves-more"}
        return [
            (part, moved.get(part.name))
            for part in self.result.inputs
            if part.start is not None and part.start.soc_source not in SAID_ELSEWHERE
        ]

    @property
    def guessed_hold(self) -> GuessedHold | None:
        guessed = [p for p in self.simulated if p.hold and p.hold.strength == "assumed"]
        if not guessed or guessed[0].hold is None:
            return None
        names = [part.name for part in guessed] if guessed != self.simulated else []
        value = guessed[0].hold.value
        other = "backward" if value == "forward" else "forward"
        ohm = self.result.fit.tables.tables[OHMIC]
        change_ohm = (self.result.tables or self.result.constant).hold_shift_ohm
        return GuessedHold(value, other, names, median(ohm), change_ohm)

    # The answer.

    @property
    def answer(self) -> str:
        """The circuit in a sentence."""
        return circuit_name(self.result.model, self.result.over)

    @property
    def measured_degc(self) -> list[str]:
        """The temperatures of the records."""
        degc = (part.temperature_degc for part in self.identified)
        return sorted({degrees(value) for value in degc if value is not None})

    @property
    def guesses(self) -> tuple[str, ...]:
        """What was assumed and the answer depends on, in sentences."""
        return sentences("decisions.guessed", self)

    @property
    def low_soc(self) -> LowSoc | None:
        """None without errors by SOC."""
        tables, assessment = self.result.tables, self.result.constant.assessment
        bands = assessment.diagnostics.by_soc if assessment else ()
        bands = bands if tables is None else tables.by_soc
        low = [band for band in bands if band.high is not None and band.high <= ABOVE_SOC + 1e-9]
        if not low:
            return None
        samples = sum(band.samples for band in low) / sum(band.samples for band in bands)
        return LowSoc(sum(band.share for band in low), samples)

    @property
    def notable_bands(self) -> tuple[str, ...]:
        """The bands with most of the constant circuit's squared error, in sentences."""
        assessment = self.result.constant.assessment
        return sentences("circuit.notable", assessment.diagnostics) if assessment else ()

    @property
    def over_temperature(self) -> "OverTemperature | None":
        return self.result.fits.over_temperature

    @property
    def errors(self) -> "MetricsPart":
        return self.result.metrics.identification

    @property
    def validation_errors(self) -> "tuple[MetricsPart, ...]":
        return self.result.metrics.validation

    @property
    def laws(self) -> tuple[str, ...]:
        """What resistances follow beside SOC, in sentences."""
        return sentences("tables.law", self.result.fits)

    @property
    def has_fitted_hysteresis(self) -> bool:
        return HALF_HYSTERESIS in self.result.fit.tables.tables

    @property
    def slowest_s(self) -> float:
        """The largest time constant that was searched."""
        return max(high for _, high in self.result.fit.tau_ranges_s)

    @property
    def ocv_degc(self) -> list[float]:
        """The temperatures of OCV tests, from cold to warm."""
        cell = self.result.cell
        return sorted(test.temperature_degc or 0.0 for test in (cell, *cell.elsewhere))

    @property
    def degc_without_ocv(self) -> list[float]:
        """The temperatures of tables that have no OCV test of their own."""
        return [
            degc
            for degc in (self.over_temperature.temperatures_degc if self.over_temperature else ())
            if min(abs(tested - degc) for tested in self.ocv_degc) > NEAR_DEGC
        ]

    @property
    def left_out_records(self) -> "list[tuple[str, SocErrors]]":
        """Each record with its errors as predicted by the others."""
        held = self.result.fit.cross_validation
        names = [part.name for part in self.identified]
        return [*zip(names, held.by_record if held else (), strict=False)]

    @property
    def candidates(self) -> "list[Candidate]":
        """The answer first."""
        return sorted(self.result.candidates, key=lambda candidate: not candidate.is_answer)

    @property
    def shown_offset(self) -> "Notice | None":
        """The warning of a current offset that the record's rests show."""
        names = {part.name for part in self.identified}
        offsets = (one for one in self.result.warnings if one.code == "rests.offset")
        return next((one for one in offsets if one.subject in names), None)

    @property
    def offset(self) -> "OffsetEffect | None":
        """The effect of the offset that rests show, else of a common one."""
        effect, seen = self.result.fit.of_offset, self.shown_offset
        if not effect or seen is None:
            return effect
        offset_a = float(seen.values["offset_a"])
        # So small a change is in proportion to what makes it.
        times = abs(offset_a) / effect.offset_a
        return replace(effect, offset_a=offset_a, r0=times * effect.r0, total=times * effect.total)

    # Starts and capacities that were adjusted.

    @cached_property
    def _registered(self):
        return [
            (part, part.start.soc, part.window.capacity_ah, registration)
            for part in self.identified
            if part.start and part.window and (registration := part.window.registration)
            and part.window.capacity_ah
        ]  # fmt: skip

    @property
    def adjusted_by_test(self) -> AdjustedByTest | None:
        """Starts and capacities that were moved to the OCV test."""
        entries = [entry for entry in self._registered if entry[-1].origin.by == "OCV test"]
        if not entries:
            return None
        parts, soc, capacity_ah, registrations = zip(*entries, strict=True)
        origins = [registration.origin for registration in registrations]
        of = parts[0].name if len(parts) == 1 else f"{len(parts)} records"
        before_soc = extent([origin.told_soc for origin in origins], 100)
        before_ah = extent([origin.told_capacity_ah for origin in origins])
        moved = [
            f"{what} of {of} now {now} {unit} (was {before} {unit})"
            for what, now, before, unit in (
                ("initial SOC", extent(soc, 100), before_soc, "%"),
                ("capacity", extent(capacity_ah), before_ah, "Ah"),
            )
            if now != before
        ]
        are_free = not any(origin.told.capacity_ah for origin in origins)
        return AdjustedByTest(moved, are_free and len(parts) == len(self.identified))

    @property
    def adjusted_by_records(self) -> list[str]:
        """The largest changes that made records agree with each other."""
        changes = [
            (soc - moved.told_soc, capacity_ah / moved.told_capacity_ah - 1)
            for _, soc, capacity_ah, moved in self._registered
            if moved.by == "records"
        ]
        largest = [max(map(abs, column)) for column in zip(*changes, strict=True)]
        return [
            f"{what} by up to {100 * most:.2g} %"
            for what, most in zip(("initial SOC", "capacities"), largest, strict=False)
            if most > HARDLY_MOVED
        ]
