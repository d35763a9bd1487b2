"""The circuit of the family that the records support, reached rung by rung from the simplest."""

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Int

from ..cell import Dependence
from ..cell.elements import is_resistance
from ..cell.parameters import OHMIC
from ..errors import InputError, attempt
from ..execution import in_float64
from ..fit.cross_validation import HeldOut, SocErrors, held_out
from ..fit.dependence import laws_for, propose
from ..fit.folds import numbered_blocks
from ..fit.intervals import intervals_of
from ..fit.node_interval import parts_of
from ..fit.objective import Solution, TableObjective
from ..fit.registration import register
from ..fit.settings import TableSettings
from ..fit.table_problem import coarsened, find_best, held_at, reduced_objective, search_ranges
from ..model.prepared import PreparedRecord
from .family import HYSTERESES, RUNGS, Ladder, Point, Subfamily
from .policy import Gain, Policy


class Fitted(NamedTuple):
    """A point of the family, its best parameters, and its held-out errors by block; None if nothing
    can be held out."""

    point: Point
    objective: TableObjective
    best: Solution
    loss: HeldOut | None


# Outcome of a rung: it is kept; it gains too little, or less than the one that was kept; its
# addition is not determined, or acts like the OCV; or the circuit was requested without it.
Outcome = Literal["kept", "no gain", "less gain", "not determined", "like the OCV", "not asked for"]


@dataclass(frozen=True)
class Tried:
    """One rung that was tried.

    Attributes:
        ladder: The ladder of the rung.
        circuit: Name of the circuit.
        nodes: Number of nodes of its resistances.
        follows: Quantities besides SOC on which resistances depend.
        rmse_v: sqrt(J) of its best fit.
        held_out: Errors on held-out blocks.
        gain: Reduction of the loss relative to the circuit before; None for the first one, and for
            that at registered starts.
        outcome: Outcome of the rung.
    """

    ladder: Ladder | None
    circuit: str
    nodes: int
    follows: tuple[str, ...]
    rmse_v: float
    held_out: SocErrors | None
    gain: Gain | None
    outcome: Outcome = "kept"

    @property
    def kept(self) -> bool:
        """True if it replaced the circuit before."""
        return self.outcome == "kept"


@dataclass(frozen=True, eq=False)
class Choice:
    """The chosen circuit, and every one that was tried on the way."""

    chosen: Fitted
    tried: tuple[Tried, ...]


@in_float64
def choose(
    prepare: Callable[[str], Sequence[PreparedRecord]], settings: TableSettings, limits: Subfamily
) -> Choice:
    """The circuit that the records support: from the simplest one on, the rung that lowers the loss
    most is taken, as long as the policy keeps one.

    Args:
        prepare: Returns the records, in their windows, prepared for a circuit.
        settings: Settings of the tables and of the held-out blocks.
        limits: The circuits to try.
    """
    return Bench(prepare, settings, limits).chosen()


@dataclass(eq=False)
class Bench:
    """The records, settings and limits with which circuits of the family are fitted and
    compared."""

    prepare: Callable[[str], Sequence[PreparedRecord]]
    settings: TableSettings
    limits: Subfamily
    policy: Policy = field(default_factory=Policy)
    tried: list[Tried] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._fits: dict[Point, Fitted] = {}
        self._prepared: dict[str, Sequence[PreparedRecord]] = {}
        self._finest: dict[tuple[Any, ...], TableObjective] = {}

    def chosen(self) -> Choice:
        chosen = self.fit(Point(self.limits.start, self.limits.nodes[0]))
        for what in self.limits.laws or ():
            proposed = propose(chosen.objective, chosen.best, what, is_asked=True)
            if proposed is not None:
                chosen = self.fit(replace(chosen.point, law=proposed[0]))
        self.tried.append(_tried(None, chosen, None))
        if chosen.loss is None:
            # Nothing can be held out, so there is no evidence for more.
            return Choice(self.registered(chosen)[1], tuple(self.tried))
        chosen = self._climbed(chosen)
        again, answer = self.registered(chosen)
        if again is not self:
            # A wrong start looks like a feature of a richer circuit, so the choice is repeated
            # without it. Factors at the given starts are large, and seldom needed after that.
            self._fits.clear()
            self._finest.clear()
            self.tried.append(_tried("starts", answer, None))
            chosen = again._climbed(answer)
            answer = answer if chosen.point == answer.point else self.registered(chosen)[1]
        return Choice(self._with_determined_pairs(answer), tuple(self.tried))

    def _climbed(self, chosen: Fitted) -> Fitted:
        """The circuit from which no rung leads further, without rungs that gain nothing."""
        laws = self._laws_to_try(chosen.point)
        while True:
            # A hysteresis that gained nothing over a simpler circuit is tried last.
            worthless = {one.ladder for one in self.tried if one.outcome == "no gain"}
            waiting = {ladder for ladder in HYSTERESES if ladder in worthless}
            step = (
                self._best_of(chosen, self._richer(chosen.point, {*RUNGS} - waiting))
                or self._best_of(chosen, self._finest_nodes(chosen))
                or self._best_of(chosen, self._laws(chosen, laws))
                or self._best_of(chosen, self._richer(chosen.point, waiting))
            )
            if step is None:
                return self._without_needless(chosen)
            # A law was tried at the time constants of the circuit before.
            chosen = self.fit(step.point) if step.point.law != chosen.point.law else step
            if self._is_like_ocv(chosen):
                # The rate of a kept hysteresis has fallen: the circuit without it does the same.
                slow, chosen = chosen, self.fit(self.limits.without_rate(chosen.point))
                self.tried.append(_tried("without", chosen, self._gain(chosen, slow)))

    def _laws_to_try(self, point: Point) -> tuple[str, ...]:
        """The laws that the records can determine. With an OCV fitted to the records, only
        dependence on the direction if laws are excluded, because that OCV would absorb it."""
        if self.limits.laws is None:
            return laws_for(self._all_prepared(point))
        return ("direction",) if self.limits.has_ocv and not self.limits.laws else ()

    def _without_needless(self, chosen: Fitted) -> Fitted:
        """The circuit without rungs that gain nothing in addition to those kept later."""
        for point in self.limits.simpler(chosen.point):
            simpler = self.fit(point)
            gain = self._gain(simpler, chosen)
            if not self._is_worth(simpler, chosen, gain):
                self.tried.append(_tried("without", simpler, gain))
                return self._without_needless(simpler)
        return chosen

    def _with_determined_pairs(self, answer: Fitted) -> Fitted:
        """The circuit without pairs of nearly one time constant, of which only the sum is
        determined, and without one whose resistance is zero wherever there are samples."""
        for point in self.limits.simpler(answer.point):
            if point.kind != answer.point.kind or point.pairs == answer.point.pairs:
                continue
            intervals = intervals_of(answer.objective, answer.best)
            means = [one for one in intervals if one.soc is None and is_resistance(one.name)]
            are_alike = any(len(parts_of(one.name)) > 1 for one in means)
            if are_alike or any(one.low is None for one in means if one.name != OHMIC):
                simpler = self.fit(point)
                self.tried.append(_tried("without", simpler, None))
                return self._with_determined_pairs(self.registered(simpler)[1])
        return answer

    @in_float64
    def registered(self, chosen: Fitted) -> "tuple[Bench, Fitted]":
        """A circuit with starts and capacities of several records registered on each other, and the
        records with these; unchanged if nothing is to be registered."""
        given, settings = self.records_of(chosen.point), self.settings
        is_fixed = settings.keep_starts or not settings.ocv_correction or self.limits.has_ocv
        if is_fixed or len(given) < 2:
            return self, chosen
        records = register(given, replace(chosen.objective.settings, ocv_correction=True))
        registration = records[0].window.registration
        if registration is None or records[0].window == given[0].window:
            return self, chosen
        law = Dependence(**{**registration.follows}) if registration.follows else None  # pyrefly: ignore
        windows = {one.record.name: one.window for one in records}

        def prepare(circuit: str) -> list[PreparedRecord]:
            return [one.in_window(windows[one.record.name]) for one in self.prepare(circuit)]

        again = replace(self, prepare=prepare)
        return again, again.fit(replace(chosen.point, law=law))

    def _richer(self, point: Point, ladders: Collection[Ladder]) -> Iterator[tuple[Ladder, Fitted]]:
        """The circuits one rung of these ladders away."""
        for ladder, other in self.limits.rungs(point):
            if ladder in ladders and (ladder != "nodes" or self._spans_enough):
                yield ladder, self.fit(other)

    def _finest_nodes(self, chosen: Fitted) -> Iterator[tuple[Ladder, Fitted]]:
        """The circuit with the second finer set of nodes, if the first one gains something but too
        little."""
        finer = self.limits.nodes[self.limits.nodes.index(chosen.point.nodes) + 1 :]
        if len(finer) < 2 or not self._spans_enough:
            return
        if self._gain(chosen, self.fit(replace(chosen.point, nodes=finer[0]))).value > 0:
            yield "nodes", self.fit(replace(chosen.point, nodes=finer[1]))

    @cached_property
    def _spans_enough(self) -> bool:
        records = self._all_prepared(Point(self.limits.start))
        soc = np.concatenate([prepared.soc[prepared.scored] for prepared in records])
        return bool(np.ptp(soc) >= self.policy.least_span_soc)

    def _best_of(self, chosen: Fitted, richer: Iterable[tuple[Ladder, Fitted]]) -> Fitted | None:
        """The richer circuit that lowers the loss most; None if none is better."""
        best, best_gain, index = None, 0.0, 0
        for ladder, more in richer:
            gain = self._gain(chosen, more)
            outcome = self._outcome(chosen, more, gain, best_gain)
            self.tried.append(_tried(ladder, more, gain, outcome))
            richer_still = [point for _, point in self.limits.rungs(best.point)] if best else []
            if best is not None and more.point in richer_still:
                # Its addition to the other one has to be worth it.
                outcome = self._outcome(best, more, self._gain(best, more), 0.0)
            if outcome == "less gain" and gain.value > best_gain:
                best, best_gain, index = more, gain.value, len(self.tried) - 1
        if best is not None:
            self.tried[index] = replace(self.tried[index], outcome="kept")
        return best

    def _gain(self, simpler: Fitted, richer: Fitted) -> Gain:
        assert simpler.loss is not None, "blocks are held out"
        assert richer.loss is not None, "blocks are held out"
        return self.policy.gain(simpler.loss, richer.loss)

    def _outcome(self, chosen: Fitted, more: Fitted, gain: Gain, best_gain: float) -> Outcome:
        """The outcome of a richer circuit, unless another gains more; if one does, its law need not
        be determined."""
        if not self._is_worth(chosen, more, gain):
            return "no gain"
        if not chosen.point.has_rate and self._is_like_ocv(more):
            return "like the OCV"
        is_needed = gain.value > best_gain or more.point.law == chosen.point.law
        if is_needed and not self._is_determined(chosen.point, more):
            return "not determined"
        is_other = self.limits.is_asked and more.point.circuit != chosen.point.circuit
        is_law = self.limits.laws is not None and more.point.law != chosen.point.law
        return "not asked for" if is_other or is_law else "less gain"

    def _is_worth(self, simpler: Fitted, richer: Fitted, gain: Gain) -> bool:
        """True if a richer circuit is better, with an OCV test by enough for a hysteresis."""
        is_new = richer.point.kind != simpler.point.kind and not self.limits.has_ocv
        least = self.policy.least_gain_of_hysteresis if is_new else 0.0
        return self.policy.is_better(gain) and gain.value > least

    def _is_like_ocv(self, more: Fitted) -> bool:
        """True for a hysteresis that turns so slowly that a fitted OCV does the same: its gap is
        then arbitrary, and so is the OCV."""
        has_to_earn_it = more.point.has_rate and not Point(self.limits.start).has_rate
        if not (self.limits.has_ocv and has_to_earn_it):
            return False
        return math.exp(more.best.log_scales[-1]) < self.policy.slowest_rate

    def _is_determined(self, before: Point, more: Fitted) -> bool:
        """False for a new hysteresis that turns at once, and for a new law with a wide interval."""
        if more.point.has_rate and not before.has_rate:
            return math.exp(more.best.log_scales[-1]) <= self.policy.fastest_rate
        if more.point.law == before.law:
            return True
        # The time constants were held.
        more = self.fit(more.point)
        numbers = more.objective.numbers
        intervals = [one for one in intervals_of(more.objective, more.best) if one.name in numbers]
        widest = 10.0**self.policy.widest
        return all(one.low and one.high and one.high < widest * one.low for one in intervals)

    def _laws(self, chosen: Fitted, laws: Sequence[str]) -> list[tuple[Ladder, Fitted]]:
        """The circuit with one more law, each at the time constants that fit best with it; the
        largest gain first, because the laws after it need not be determined."""
        law, richer = chosen.point.law, list[tuple[Ladder, Fitted]]()
        for what in laws:
            proposed = propose(chosen.objective, chosen.best, what)
            if proposed is None or (law and proposed[0].numbers.keys() == law.numbers.keys()):
                continue
            point = replace(chosen.point, law=proposed[0])
            settings = self.limits.settings_of(point, self.settings)
            held = held_at(chosen.objective.ranges, proposed[1])
            objective = reduced_objective(self.records_of(point), settings, held)
            best = objective.solve(proposed[1], exact=True)
            richer.append(("law", Fitted(point, objective, best, self._loss(objective, best))))
        return sorted(richer, key=lambda each: -self._gain(chosen, each[1]).value)

    def _all_prepared(self, point: Point) -> Sequence[PreparedRecord]:
        """The records prepared for circuits with the same kind of hysteresis."""
        if point.kind not in self._prepared:
            self._prepared[point.kind] = self.prepare(point.circuit)
        return self._prepared[point.kind]

    def records_of(self, point: Point) -> list[PreparedRecord]:
        """The records prepared for a point."""
        prepared = self._all_prepared(point)
        return [replace(one, circuit=point.circuit).with_dependence(point.law) for one in prepared]

    def fit(self, point: Point) -> Fitted:
        """The best parameters of a point, from one reduction with the finest nodes."""
        if point not in self._fits:
            self._fits[point] = self._fit(point)
        return self._fits[point]

    def _fit(self, point: Point) -> Fitted:
        # The finest nodes of all are seldom reached, and cost as much as all others together.
        ladder = self.limits.nodes
        has_finest = (point.kind, ladder[-1], point.law) in self._finest
        is_finest = has_finest or point.nodes == ladder[-1]
        finest = replace(point, nodes=ladder[-1] if is_finest else ladder[-2])
        key = (point.kind, finest.nodes, point.law)
        if key not in self._finest:
            self._reduce(self._alike(finest))
        settings = self.limits.settings_of(point, self.settings)
        objective = coarsened(self._finest[key], self.records_of(point), settings)
        best = find_best(objective)
        return Fitted(point, objective, best, self._loss(objective, best))

    def _alike(self, point: Point) -> list[Point]:
        """The point with every kind of hysteresis, if the records prepared for these differ in
        their voltage source alone; a kind with columns of its own comes first."""
        if self.limits.has_ocv or not self.settings.folds:
            return [point]
        # The first circuit of a kind asks for the fewest samples.
        others = (replace(point, circuit=circuit) for circuit in reversed([*self.limits.richer]))
        kinds = {one.kind: one for one in others} | {point.kind: point}
        points = sorted(kinds.values(), key=lambda one: not one.has_rate)
        prepared = [attempt(self.records_of, one) for one in points]
        if any(isinstance(records, InputError) for records in prepared):
            return [point]
        alike = all(
            np.array_equal(one.soc, other.soc) and np.array_equal(one.scored, other.scored)
            for every in zip(*prepared, strict=True)
            for one, other in pairwise(every)
        )
        return points if alike else [point]

    def _reduce(self, points: Sequence[Point]) -> None:
        """Reduce the records once for points that are alike."""
        records, settings = (
            self.records_of(points[0]),
            self.limits.settings_of(points[0], self.settings),
        )
        # Without a correction of the OCV, pairs may be slower.
        widest = search_ranges(records, replace(settings, ocv_correction=self.limits.has_ocv))
        offsets_v = [
            np.column_stack([every[0].source_v - each.source_v for each in every])
            for every in zip(*map(self.records_of, points), strict=True)
        ]
        objective = reduced_objective(records, settings, widest, offsets_v)
        for number, point in enumerate(points):
            layout = replace(objective.reduced.layout, voltages=(number,))
            if not point.has_rate:
                layout = replace(layout, in_rate=None)
            reduced = objective.reduced.coarser(layout)
            self._finest[point.kind, point.nodes, point.law] = replace(objective, reduced=reduced)

    def _loss(self, objective: TableObjective, best: Solution) -> HeldOut | None:
        return held_out(objective, best, self._blocks) if self.settings.folds else None

    @cached_property
    def _blocks(self) -> tuple[list[Int[np.ndarray, "_"]], int]:
        """The block of every sample; all circuits use those of the simplest."""
        return numbered_blocks(self._all_prepared(Point(self.limits.start)), self.settings)


def _tried(
    ladder: Ladder | None, fitted: Fitted, gain: Gain | None, outcome: Outcome = "kept"
) -> Tried:
    circuit, nodes, law = fitted.point.circuit, len(fitted.point.nodes), fitted.point.law
    held = None if fitted.loss is None else fitted.loss.errors
    follows = tuple(law.numbers) if law else ()
    return Tried(ladder, circuit, nodes, follows, fitted.best.rms_v, held, gain, outcome)
