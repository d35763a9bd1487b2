"""A designed test in words and tables, and its promises compared with what an identification
reached."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..cell.elements import is_resistance
from ..experiment.information import DRIVE
from ..experiment.prior import UNKNOWN_LOW_SOC
from ..experiment.protocol import LOW_SOC
from ..experiment.stored import followed, halves_of, is_enough
from .design_forms import EMPTYING
from .document import Entries, Page, screen
from .wording import blocks, sentences
from .words import figures, joined, millivolt, symbol, with_unit

if TYPE_CHECKING:
    from ..experiment import Design
    from ..experiment.information import Prior, Width
    from ..fit.table_fit import TableFit
    from ..results import Result

# On measured cells, records that are identified together have intervals wider than promised by
# these factors, medians of 18 pairs (benchmarks/results/design.md).
TOGETHER = {"R0": 1.3, "R1": 1.1, "R2": 1.2}
# An interval is mentioned if it is wider than in the design by more than this share.
WIDER = 0.25
# A test is said to widen intervals that it leaves this many times as wide as before.
WIDENED = 1.05
# Pieces of a longer test on the screen: its first ones and its end.
FIRST_PIECES, LAST_PIECES = 8, 2
# Promised and reached intervals agree within this share.
AGREES = 0.25


def planned_screen(prior: "Prior", chosen: Sequence[str] = ()) -> Page:
    """The assumptions of a planned test: the capacity, its range of SOC, the largest currents that
    are not among the options `chosen`, and records that do not count."""
    is_usual = prior.rates_c == type(prior).rates_c
    least_soc = {"known": LOW_SOC, "unknown": UNKNOWN_LOW_SOC}
    return screen([Entries(sentences("design.plan", prior, chosen, is_usual, least_soc))])


def design_screen(design: "Design") -> Page:
    """The test's hours and predicted intervals, its pieces, and the steps to take before it; or
    that none is needed, because the earlier records already identify what is wanted."""
    facts = _facts(design)
    lines = Entries(sentences("design.screen", design, facts))
    if not design.is_needed:
        return screen([lines])
    pieces = blocks("design.pieces", [*_pieces(design)], FIRST_PIECES, LAST_PIECES)
    return screen(blocks("design.widths", design, facts["before"]), pieces, [lines])


def _facts(design: "Design") -> dict[str, Any]:
    """The facts behind the sentences about a test."""
    names = dict.fromkeys([*design.wanted, *design.already, *design.printed])
    halves = {name: [width.before for width in design.of_table(name)] for name in names}
    before = {name: [half for half in of if half is not None] for name, of in halves.items()}
    after = {name: [width.after for width in design.of_table(name)] for name in design.wanted}
    facts: dict[str, Any] = {"before": before, "after": after, "together": TOGETHER}
    facts |= {"emptying": EMPTYING, "widened": WIDENED, "wider": WIDER}
    if design.is_needed and not design.is_reached:
        facts |= _shortfall(design, after)
    return facts


def _shortfall(design: "Design", after: dict[str, list[float]]) -> dict[str, Any]:
    """The intervals that stay wider than wanted, and those that a drive cycle leaves narrower, by
    the statistic that falls short: the median, or the largest."""

    def is_wide(name: str, half: Any) -> bool:
        return not is_enough(name, float(half), design.wanted[name])

    drive = next(test for test in design.references if test.name == "drive cycle")
    theirs = {
        name: [width.after for width in design.of_table(name, drive.widths)] for name in after
    }
    wide = [name for name in after if is_wide(name, np.median(after[name]))]
    some = [name for name in after if name not in wide and is_wide(name, max(after[name]))]
    better = [name for name in wide if np.median(theirs[name]) < np.median(after[name])]
    widest = [f"the widest {name}" for name in some if max(theirs[name]) < max(after[name])]
    return {
        "drive": drive,
        "wide": wide,
        "some": some,
        "narrower": [*(name for name in better if name != DRIVE), *widest],
        "is_smaller": DRIVE in better,
        "undetermined": [n for n in wide if is_resistance(n) and np.median(after[n]) > 1],
    }


def _pieces(design: "Design") -> Iterator[dict[str, Any]]:
    """The numbers of each piece's steps, its duration, and its ends in current and SOC."""
    last, soc = 0, design.initial_soc
    for name, steps in design.pieces:
        first, last, begins = last + 1, last + len(steps), soc
        soc -= sum(step.duration_s * step.current_a for step in steps) / 3600 / design.capacity_ah
        yield {
            "name": name,
            "steps": (first, last),
            "duration_s": sum(step.duration_s for step in steps),
            "currents_a": [step.current_a for step in steps],
            "soc_percent": [100 * max(begins, 0.0), 100 * max(soc, 0.0)],
        }


def promised_screen(design: "Design", result: "Result") -> Page:
    """The promises of a design compared with what an identification reached."""
    if result.over is None:
        return screen([Entries(sentences("design.kept", True, []))])
    is_alone = len(result.of_role("identification")) == 1
    lines = sentences("design.kept", False, [*_differences(design, result)])
    promises, earlier = _promises(design, result.fit, is_alone), () if is_alone else design.earlier
    return screen([*blocks("design.promises", promises, earlier, TOGETHER), Entries(lines)])


def _differences(design: "Design", result: "Result") -> Iterator[str]:
    """Differences between the fit and the assumptions of the promise: time constants, resistances,
    their dependence, and the error."""
    fit, rmse_v, taken_v = result.fit, result.metrics.identification.rmse_v, design.error.rmse_v
    bounds = {bound.name: f", at the {bound.side} bound of its search" for bound in fit.at_bound}
    for width in design.widths:
        fitted = fit.tables.constants.get(width.name)
        if width.soc is None and fitted is not None and _is_other(fitted, width.value):
            value, promise = (with_unit(width.name, tau_s) for tau_s in (fitted, width.value))
            bound = bounds.get(width.name, "")
            yield f"{symbol(width.name)} {value}{bound} (promise: {promise})"
    for name in [name for name in design.wanted if is_resistance(name)]:
        ratios = [
            float(fit.tables.at(width.name, np.array([width.soc]))[0]) / width.value
            for width in design.of_table(name)
            if width.name in fit.tables.tables
        ]
        if ratios and _is_other(float(np.median(ratios)), 1.0):
            yield f"{name} {figures(float(np.median(ratios)), 2)} times the promise's"
    if words := followed(fit.tables.dependence):
        yield f"resistances that follow {joined(words)}, which the promise leaves out"
    if _is_other(rmse_v, taken_v):
        yield f"errors of {millivolt(rmse_v)} (promise: {millivolt(taken_v)})"


def _is_other(fitted: float, taken: float) -> bool:
    return abs(math.log(max(fitted, 1e-12) / max(taken, 1e-12))) > math.log1p(AGREES)


def _promises(design: "Design", fit: "TableFit", is_alone: bool) -> dict[str, dict[str, Any]]:
    """The promised and reached half-widths of every table, at its nodes that have both."""
    promises = {}
    for name in [wanted for wanted in design.wanted if wanted != DRIVE]:
        widths = design.of_table(name)
        pairs = [
            (width.alone if is_alone else width.after, reached_half(fit, width)) for width in widths
        ]
        both = [(promised, reached) for promised, reached in pairs if reached is not None]
        promises[name] = {
            "promised": [promised for promised, _ in both],
            "reached": [reached for _, reached in both],
            "nodes": len(widths),
            "near": sum(not _is_other(reached, promised) for promised, reached in both),
            "better": sum(reached * (1 + AGREES) < promised for promised, reached in both),
        }
    return promises


def reached_half(fit: "TableFit", width: "Width") -> float | None:
    """The half-width of a fit's interval, in the measure of the promise and with its noise; one
    value for every SOC."""
    nodes = () if fit.is_over_soc or not is_resistance(width.name) else fit.tables.nodes
    for node in fit.intervals:
        if node.name == width.name and node.soc in (width.soc, *nodes):
            halves = halves_of(node)
            if halves is not None:
                return halves[0]
    return None
