"""Parameters that the data do not determine: too fast or too slow, alike, or at bounds."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..cell.elements import ElementNames, is_resistance, names_beside
from ..cell.parameters import OHMIC
from .covariance import Covariance, Estimate, Uncertainty

if TYPE_CHECKING:
    from ..model.problem import Problem

# A combination is reported if its error is this much smaller than its members'.
SHARPER = 1 / 3
# The data cannot distinguish time constants within this factor of each other.
SAME_TAU = 1.5
# A parameter whose interval ends more than this factor away from its value is hardly determined.
LOOSE_FACTOR = 2.0
# A time constant at its bound, 0.1 % of the box's log width, is this close to it.
NEAR_LIMIT = 0.01
# Parameters that change by less than this in a direction are not part of it.
PART_OF_DIRECTION = 0.1

UndeterminedKind = Literal["too fast", "too slow", "alike", "at bound", "loose", "direction"]


@dataclass(frozen=True)
class Undetermined:
    """One thing the data do not determine, and the estimates involved.

    - "too fast": a pair that ends within a sampling interval. Only the sum of its resistance and R0
      is determined or, if only tau is among the estimates, its resistance is determined and tau is
      not.
    - "too slow": a pair that does not end within the record, of which only the capacitance is
      determined.
    - "alike": two pairs that may have one time constant, of which only the summed R is determined.
    - "at bound": a parameter whose value a bound decides.
    - "loose": a parameter whose interval is wide or open.
    - "direction": parameters that can change at once, by `log_steps` of their logarithms, within
      one standard error.

    `combined` is a combination of them that is still determined, None if there is none.
    `interval_s` is the sampling interval, `duration_s` the record's scored duration.
    """

    kind: UndeterminedKind
    estimates: tuple[Estimate, ...]
    interval_s: float
    duration_s: float
    combined: Estimate | None = None
    log_steps: tuple[float, ...] = ()

    @property
    def parameters(self) -> tuple[str, ...]:
        return tuple(estimate.name for estimate in self.estimates)


@dataclass(frozen=True)
class Identifiability:
    """The parameters and combinations that the data leave undetermined."""

    findings: tuple[Undetermined, ...]


def identifiability(
    problem: "Problem", covariance: Covariance, uncertainty: Uncertainty
) -> Identifiability:
    """The identifiability of an optimum from the records of its problem."""
    search = _Search(
        covariance,
        {estimate.name: estimate for estimate in uncertainty.estimates},
        min(prepared.median_interval_s for prepared in problem.prepared_records),
        max(prepared.scored_duration_s for prepared in problem.prepared_records),
    )
    return Identifiability(search.all(problem.bounds.element_names))


def are_one(log_ratio: float, reach: float, total: float, *members: float) -> bool:
    """True if only the sum of two pairs' resistances is determined: their time constants are nearly
    the same, or may be (`reach` is half the interval of that logarithm) and the sum is known far
    better than its members, by relative errors. False if a bound decides one of these."""
    apart = abs(log_ratio)
    is_better = apart <= reach and total < SHARPER * min(members)
    return min(members) > 0 and (apart <= math.log(SAME_TAU) or is_better)


@dataclass(frozen=True, eq=False)
class _Search:
    """The covariance and estimates that are searched for findings."""

    covariance: Covariance
    estimates: dict[str, Estimate]
    interval_s: float
    duration_s: float

    def all(self, names: Sequence[ElementNames]) -> tuple[Undetermined, ...]:
        """All findings. Each kind leaves out parameters that an earlier one covers."""
        covered: set[str] = set()
        findings: list[Undetermined] = []

        def add(more: Iterable[Undetermined]) -> None:
            more = [*more]
            findings.extend(more)
            covered.update(name for finding in more for name in finding.parameters)

        pairs = [pair for pair in names if pair.capacitance is not None]
        add(finding for pair in pairs for finding in self.too_fast(pair))
        add(finding for pair in pairs for finding in self.too_slow(pair))
        add(finding for two in pairwise(pairs) for finding in self.alike(*two, covered))
        add(self.at_bounds(covered))
        add(self.loose(covered))
        add(self.weak_directions())
        return tuple(findings)

    def finding(
        self,
        kind: UndeterminedKind,
        names: Sequence[str],
        combined: Estimate | None = None,
        log_steps: tuple[float, ...] = (),
    ) -> Undetermined:
        estimates = tuple(self.estimates[name] for name in names)
        return Undetermined(kind, estimates, self.interval_s, self.duration_s, combined, log_steps)

    def too_fast(self, pair: ElementNames) -> Iterator[Undetermined]:
        """A pair that ends within a sampling interval: below half of it, as in the default box.

        If a current is held from its sample on, such a pair still responds one sample after R0, and
        a current that varies enough distinguishes the two; only its time constant is then hidden.
        """
        tau, resistance = self.estimates[pair.tau], self.estimates[pair.resistance]
        if not tau.value <= 0.5 * self.interval_s * (1 + NEAR_LIMIT):
            return
        if not _is_tight(resistance):
            total = self.sum_of((OHMIC, resistance.name))
            if self.is_sharper(total, (OHMIC, resistance.name)):
                yield self.finding("too fast", (tau.name, resistance.name, OHMIC), total)
        elif not _is_tight(tau) and tau.held != "fixed":
            yield self.finding("too fast", (tau.name,), resistance)

    def too_slow(self, pair: ElementNames) -> Iterator[Undetermined]:
        resistance, tau, capacitance = pair
        if self.estimates[tau].value >= self.duration_s * (1 - 1e-3):
            yield self.finding("too slow", (tau, resistance), self.estimates[str(capacitance)])

    def alike(
        self, faster: ElementNames, slower: ElementNames, covered: set[str]
    ) -> Iterator[Undetermined]:
        """Neighboring time constants whose ratio may be 1, if their sum is better known."""
        first, second = faster.tau, slower.tau
        if first in covered or second in covered:
            return
        direction_of = self.covariance.linearization.direction_of
        ratio = self.covariance.estimate(
            "ratio",
            self.estimates[second].value / self.estimates[first].value,
            direction_of(second)[0] - direction_of(first)[0],
        )
        resistances = (faster.resistance, slower.resistance)
        total = self.sum_of(resistances)
        reach = math.inf if ratio.high is None else math.log(ratio.high / ratio.value)
        errors = [self.estimates[name].relative_error or 0.0 for name in resistances]
        error = math.inf if total.relative_error is None else total.relative_error
        if ratio.relative_error != 0 and are_one(math.log(ratio.value), reach, error, *errors):
            yield self.finding("alike", (first, second, *resistances), total)

    def at_bounds(self, covered: set[str]) -> Iterator[Undetermined]:
        for name, why in self.covariance.linearization.held.items():
            if why != "fixed" and name not in covered and name in self.estimates:
                yield self.finding("at bound", (name,))

    def loose(self, covered: set[str]) -> Iterator[Undetermined]:
        for name, estimate in self.estimates.items():
            is_free = name not in covered and estimate.relative_error is not None
            if is_free and not name.startswith("C") and not _is_tight(estimate):
                yield self.finding("loose", (name,))

    def weak_directions(self) -> Iterator[Undetermined]:
        """Changes of several parameters at once that hardly affect the errors."""
        names = self.covariance.linearization.names
        variances, directions = np.linalg.eigh(self.covariance.matrix)
        for variance, direction in zip(variances[::-1], directions.T[::-1], strict=True):
            if not math.log(LOOSE_FACTOR) < math.sqrt(max(variance, 0.0)):
                break
            order = np.argsort(-np.abs(direction))
            moving = [int(k) for k in order if abs(direction[k]) > PART_OF_DIRECTION]
            if len(moving) < 2:
                continue
            steps = direction[moving] * math.sqrt(variance) * np.sign(direction[moving[0]])
            members = [names[k] for k in moving]
            combined = self.sharpest(members)
            yield self.finding("direction", members, combined, tuple(steps.tolist()))

    def sharpest(self, names: Sequence[str]) -> Estimate | None:
        """The best known of the sums of resistances and the capacitances among `names`, if one is
        known far better than its members."""
        resistances = sorted(filter(is_resistance, names))
        sharper = [
            total
            for size in range(2, len(resistances) + 1)
            for members in combinations(resistances, size)
            if self.is_sharper(total := self.sum_of(members), members)
        ]
        for name in resistances:
            pair = names_beside(name)
            tau, capacitance = pair.tau, self.estimates.get(pair.capacitance or "")
            if tau in names and capacitance and self.is_sharper(capacitance, (name, tau)):
                sharper.append(capacitance)
        return min(sharper, key=lambda estimate: estimate.relative_error or 0.0, default=None)

    def sum_of(self, names: Sequence[str]) -> Estimate:
        """The sum of some resistances in ohm, with its interval."""
        values = [self.estimates[name].value for name in names]
        direction_of = self.covariance.linearization.direction_of
        direction = sum(
            value / sum(values) * direction_of(name)[0]
            for name, value in zip(names, values, strict=True)
        )
        label = " + ".join(name.removesuffix(" [Ohm]") for name in names)
        return self.covariance.estimate(f"{label} [Ohm]", sum(values), np.asarray(direction))

    def is_sharper(self, total: Estimate, members: Sequence[str]) -> bool:
        """True if the total is known far better than any of its members."""
        errors = [self.estimates[name].relative_error for name in members]
        given = [error for error in errors if error is not None]
        if total.low is None or total.relative_error is None or len(given) < len(errors):
            return False
        return total.relative_error < SHARPER * min(given)


def _is_tight(estimate: Estimate) -> bool:
    """True if its interval ends within `LOOSE_FACTOR` of the value; False without one."""
    return estimate.low is not None and estimate.value / estimate.low <= LOOSE_FACTOR
