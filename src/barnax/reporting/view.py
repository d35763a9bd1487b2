"""A result as named facts, computed once: the source of screens, reports and tables."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from ..cell.elements import names_beside
from ..cell.model import NEAR_DEGC
from ..cell.parameters import HALF_HYSTERESIS
from ..cell.soc_axis import ABOVE_SOC
from ..fit.node_interval import parts_of
from ..fit.settings import circuit_name
from ..fit.temperature_fits import MIDDLE_SOC
from .wording import sentences
from .words import SAME, degrees, gathered, interval_beside, numbered, soc_extent

if TYPE_CHECKING:
    from ..fit.cross_validation import SocErrors
    from ..fit.current_offset import OffsetEffect
    from ..fit.node_interval import Fact
    from ..fit.temperature_fits import OverTemperature
    from ..metrics import Metrics
    from ..model.window import Window
    from ..notices import Notice
    from ..records import Decision
    from ..result_parts import Candidate, InputPart, MetricsBlock
    from ..results import Result
    from ..select.policy import Policy


@dataclass(frozen=True, eq=False)
class View:
    """Facts of a result; for a comparison, which has no `fits`, those of its files and cell.

    Voltages are in V, currents in A, resistances in Ohm, shares are fractions.
    """

    result: "Result"

    @property
    def policy(self) -> "Policy":
        """The rule by which circuits are chosen."""
        # Loads JAX, which the report of a fleet does not need.
        from ..select.policy import Policy

        return Policy()

    # The files, the cell, and what was decided about them.

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
        """The files whose SOC at the start is that of the plan."""
        return {file.name for file in getattr(self.result, "plan", ()) if file.plans_soc}

    @property
    def is_pulse_test(self) -> bool:
        """True if the identification record is the OCV test too."""
        tests = {part.sha256 for part in self._of_role("ocv")}
        return not tests.isdisjoint(part.sha256 for part in self.identified)

    def decided(self, what: str) -> "Mapping[Decision, list[str]]":
        """The files by the decision about their `sign` or `hold`."""
        decisions = ((getattr(part, what), part.name) for part in self.result.inputs)
        return gathered((decision, name) for decision, name in decisions if decision)

    @property
    def windows(self) -> "Mapping[Window, list[str]]":
        """The records of each window as it was given."""
        windows = [(part.window.unregistered, part.name) for part in self.simulated if part.window]
        if self.result.cell.has_spanned_capacity:
            # The given start, although the windows have an adjusted one.
            windows = [(replace(window, capacity_ah=None), name) for window, name in windows]
        return gathered(windows)

    @property
    def sweep_drop_v(self) -> float | None:
        """The voltage that slow sweeps lost under load."""
        cell = self.result.cell
        if cell.sweep_ohm is None:
            return None
        points = cell.charge_points + cell.discharge_points
        return cell.sweep_ohm * median(filter(None, (abs(p.current_a) for p in points)))

    @property
    def soc_extents(self) -> dict[str, tuple[float, float]]:
        """The lowest and highest SOC of each record."""
        parts = (*self.identified, *self.validation)
        return {part.name: part.soc_range for part in parts if part.soc_range}

    @staticmethod
    def travel(part: "InputPart") -> tuple[float, float]:
        """The ends of a record's SOC, the one nearer to its start first."""
        low, high = part.soc_range or (0.0, 1.0)
        first = part.start.soc if part.start else high
        return (high, low) if abs(first - high) <= abs(first - low) else (low, high)

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
        """The assumptions on which the answer depends, in sentences."""
        return sentences("decisions.guessed", self)

    @property
    def low_soc(self) -> tuple[float, float] | None:
        """The shares of the squared error and of the samples that are below 10 % SOC; None without
        errors by SOC."""
        bands = self.result.fits.by_soc
        low = [band for band in bands if band.high is not None and band.high <= ABOVE_SOC + 1e-9]
        if not low:
            return None
        samples = sum(band.samples for band in low) / sum(band.samples for band in bands)
        return sum(band.share for band in low), samples

    @property
    def notable_bands(self) -> tuple[str, ...]:
        """The bands with most of the constant circuit's squared error, in sentences."""
        assessment = self.result.constant.assessment
        return sentences("circuit.notable", assessment.diagnostics) if assessment else ()

    @property
    def over_temperature(self) -> "OverTemperature | None":
        return self.result.fits.over_temperature

    @property
    def errors(self) -> "Metrics":
        return self.result.metrics.identification

    @property
    def by_record(self) -> "list[tuple[str, Metrics, Metrics]]":
        """The role of each record with the errors of the answer and of the constant circuit, and of
        all identification records together."""

        def rows(metrics: "MetricsBlock") -> "tuple[Metrics, ...]":
            return *metrics.jointly, metrics.identification, *metrics.validation

        metrics = self.result.metrics
        roles = [
            *numbered("identification", len(metrics.jointly)),
            "together" if metrics.jointly else "identification",
            *numbered("validation", len(metrics.validation)),
        ]
        both = map(rows, (metrics, self.result.constant.metrics))
        return [*zip(roles, *both, strict=True)]

    def left_out(self, record: str) -> "SocErrors | None":
        """The largest error of held-out temperatures that were predicted like a validation record;
        None if it has its own tables."""
        over = self.over_temperature
        degc = next(
            (part.temperature_degc for part in self.validation if part.name == record), None
        )
        if over is None or degc is None or over.measured_near(degc) is not None:
            return None
        return max((left.errors for left in over.like(degc)), key=lambda errors: errors.rmse_v)

    @property
    def validation_errors(self) -> "tuple[Metrics, ...]":
        return self.result.metrics.validation

    @property
    def laws(self) -> tuple[str, ...]:
        """The dependence of resistances beyond SOC, in sentences."""
        return sentences("tables.law", self.result.fits)

    @property
    def has_fitted_hysteresis(self) -> bool:
        return HALF_HYSTERESIS in self.result.fit.tables.tables

    @property
    def ocv_degc(self) -> list[float]:
        """The temperatures of OCV tests, from cold to warm."""
        cell = self.result.cell
        return sorted(test.temperature_degc or 0.0 for test in (cell, *cell.elsewhere))

    @property
    def degc_without_ocv(self) -> list[float]:
        """The temperatures of tables without an OCV test."""
        return [
            degc
            for degc in self.result.fits.temperatures_degc
            if min(abs(tested - degc) for tested in self.ocv_degc) > NEAR_DEGC
        ]

    @property
    def extent(self) -> str:
        """The SOC range of means; empty for a constant circuit."""
        soc = self.result.fit.mean_soc
        return f"{soc_extent(soc)} SOC" if soc else ""

    @property
    def means(self) -> "list[Fact]":
        """The means of resistances, with each sum in place of its parts; of two sums that share a
        part, the first."""
        means = {fact.name: fact for fact in self.result.fit.facts if fact.is_mean}
        for total in [name for name in means if len(parts_of(name)) > 1]:
            first, *others = parts_of(total)
            shown = means.pop(total)
            if means.keys() >= {first, *others}:
                means[first] = shown
                for part in others:
                    del means[part]
        return [*means.values()]

    @property
    def middle_soc(self) -> float:
        """The visited node nearest to 50 % SOC."""
        return min(self.result.fit.visited_nodes, key=lambda soc: abs(soc - MIDDLE_SOC))

    def at_middle(self, mean: "Fact") -> float:
        """The value of a resistance, or of a sum of some, at that node."""
        at, soc = self.result.fit.tables.at, np.array(self.middle_soc)
        return sum(float(at(part, soc)) for part in parts_of(mean.name))

    def taus(self, mean: "Fact") -> "list[Fact]":
        """The time constants of a resistance, or of a sum of some."""
        names = [names_beside(part).tau for part in parts_of(mean.name)]
        facts = self.result.fit.constant_facts
        return [fact for name in names for fact in facts if fact.name == name]

    @property
    def longest_s(self) -> float:
        return max(part.duration_s or 0.0 for part in self.identified)

    def outlasts_records(self, tau: "Fact") -> bool:
        """True for a time constant whose range ends at the length of the longest record."""
        at_upper = {bound.name for bound in self.result.fit.at_bound if bound.side == "upper"}
        return tau.name in at_upper and tau.value >= self.longest_s * (1 - 1e-3)

    def interval(self, fact: "Fact", value: str) -> str:
        """The interval of a number, to be shown next to its value; empty without one."""
        if fact.name in self.result.fits.held:
            return "held"
        if fact.low is None and fact.high is None:
            for bound in self.result.fit.at_bound:
                if bound.name == fact.name:
                    return f"at its {bound.side} bound"
        return interval_beside(value, fact) if self.result.fit.intervals else ""

    @property
    def candidates(self) -> "list[Candidate]":
        """The candidates, with the answer first."""
        return sorted(self.result.candidates, key=lambda candidate: not candidate.is_answer)

    def validated(self, candidate: "Candidate") -> "tuple[SocErrors | Metrics, ...]":
        """The errors of a candidate on each validation record; a comparison only has those over
        whole records."""
        from ..fit.cross_validation import SocErrors
        from ..results import Result

        if not isinstance(self.result, Result):
            return tuple(SocErrors(rmse_v, None) for rmse_v in candidate.validation_v)
        block = self.result if candidate.is_answer else self.result.constant
        return block.metrics.validation

    @property
    def surpassed(self) -> "list[tuple[Metrics, Metrics]]":
        """The errors of the constant circuit and of the tables on each record that the constant
        circuit simulates better; errors within `SAME` are equal."""
        pairs = zip(self.result.constant.metrics.validation, self.validation_errors, strict=True)
        return [pair for pair in pairs if pair[0].rmse_v < (1 - SAME) * pair[1].rmse_v]

    @property
    def offset(self) -> "tuple[OffsetEffect | None, Notice | None]":
        """The effect of the current offset seen at rests, else of a common one; and the warning for
        the former."""
        names = {part.name for part in self.identified}
        offsets = (one for one in self.result.warnings if one.code == "rests.offset")
        seen = next((one for one in offsets if one.subject in names), None)
        effect = self.result.fit.of_offset
        if effect and seen:
            offset_a = float(seen.values["offset_a"])
            # So small a change is proportional to its cause.
            times = abs(offset_a) / effect.offset_a
            more = {"offset_a": offset_a, "r0": times * effect.r0, "total": times * effect.total}
            effect = replace(effect, **more)
        return effect, seen

    @property
    def registered(self) -> "list[InputPart]":
        """The records with adjusted starts and capacities."""
        windows = [(part, part.window) for part in self.identified if part.start and part.window]
        return [part for part, window in windows if window.registration and window.capacity_ah]
