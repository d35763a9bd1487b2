"""A designed test in words and tables, and its promises beside what an identification reached."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..experiment.belief import UNKNOWN_LOW_SOC
from ..experiment.information import DRIVE
from ..experiment.protocol import LOW_SOC
from ..experiment.stored import followed, halves_of, is_enough
from .design_forms import EMPTYING
from .document import Document, Lines, Table, rows_table, screen
from .wording import sentences, wording
from .words import (
    NOTHING,
    counted,
    duration,
    extent,
    figures,
    joined,
    millivolt,
    percent,
    symbol,
    with_unit,
)

if TYPE_CHECKING:
    from ..experiment import Design
    from ..experiment.information import Believed, Width
    from ..over_soc.fit import TableFit
    from ..results import Result

# On measured cells, records that are identified together leave wider intervals than was promised:
# so many times, medians of 18 pairs (benchmarks/results/design.md).
TOGETHER = {"R0": 1.3, "R1": 1.1, "R2": 1.2}
# What is printed is said where it is wider than what a design counts by more than this share.
WIDER = 0.25
# A test is said to widen what it leaves so many times as wide as it was.
WIDENED = 1.05
# Pieces on the screen, of a longer test: its first ones and its end.
FIRST_PIECES, LAST_PIECES = 8, 2
# Promised and reached intervals within this share of each other agree.
AGREES = 0.25


def planned_screen(believed: "Believed", chosen: Sequence[str] = ()) -> Document:
    """The assumptions that a test is planned on: the capacity, the SOC that it stays in, the
    largest currents that are not among the options `chosen`, and records that do not count."""
    is_usual = believed.rates_c == type(believed).rates_c
    least_soc = {"known": LOW_SOC, "unknown": UNKNOWN_LOW_SOC}
    return screen([Lines(sentences("design.plan", believed, chosen, is_usual, least_soc))])


def design_screen(design: "Design") -> Document:
    """The test's hours and predicted intervals, its pieces, and the steps to take before it; or
    that none is needed, as the earlier records tell what is wanted."""
    lines = Lines(sentences("design.screen", design, _facts(design)))
    if not design.is_needed:
        return screen([lines])
    return screen([_widths_table(design)], [pieces_table(design)], [lines])


def _facts(design: "Design") -> dict[str, Any]:
    """What the sentences about a test are made of."""
    wanted = design.wanted
    names = dict.fromkeys([*wanted, *design.already, *design.printed])
    before = {name: _halves_before(design.of_table(name)) for name in names}
    after = {name: [width.after for width in design.of_table(name)] for name in wanted}
    facts: dict[str, Any] = {"before": before, "after": after, "together": TOGETHER}
    facts |= {"shown": _shown, "half": _half, "middle": middle, "emptying": EMPTYING}
    facts["already"] = [name for name in design.already if before[name]]
    facts["widened"] = [
        name
        for name in wanted
        if before[name] and np.median(after[name]) > WIDENED * np.median(before[name])
    ]
    facts["wider"] = {
        name: half
        for name, half in design.printed.items()
        if before[name] and half > (1 + WIDER) * np.median(before[name])
    }
    if design.is_needed and not design.is_reached:
        facts |= _shortfall(design, after)
    return facts


def _shortfall(design: "Design", after: dict[str, list[float]]) -> dict[str, Any]:
    """The intervals that stay wider than wanted, and those that a drive cycle leaves narrower, by
    what falls short: the median, or the widest."""

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
        "undetermined": [n for n in wide if n.startswith("R") and np.median(after[n]) > 1],
    }


def _halves_before(widths: "Sequence[Width]") -> list[float]:
    return [width.before for width in widths if width.before is not None]


def _widths_table(design: "Design") -> Table:
    """Half the 95 % interval of every table, before and after, beside usual tests."""
    tests = design.references
    heads = ["95 % interval (+/-)", "wanted", "before", "this test", *(test.name for test in tests)]
    rows = [["hours", "", "", f"{design.hours:.2f}", *(f"{test.hours:.1f}" for test in tests)]]
    for name, wanted in design.wanted.items():
        widths = design.of_table(name)
        before = _halves_before(widths)
        before_words = middle(name, before) if len(before) > len(widths) / 2 else NOTHING
        of_tests = [widths, *(design.of_table(name, test.widths) for test in tests)]
        after = [[width.after for width in widths] for widths in of_tests]
        middles = [middle(name, halves) for halves in after]
        rows.append([_shown(name), _half(name, wanted), before_words, *middles])
        if len(widths) > 1:
            wide = _half(name, max(before)) if len(before) == len(widths) else ""
            rows.append(["  widest", "", wide, *(_half(name, max(halves)) for halves in after)])
    return rows_table("", heads, rows, heads[:1], is_bare=True)


def _shown(name: str) -> str:
    return "error on a drive cycle" if name == DRIVE else name


def middle(name: str, halves: Sequence[float]) -> str:
    return _half(name, float(np.median(halves)))


def _half(name: str, half: float) -> str:
    return millivolt(half) if name in ("OCV", DRIVE) else percent(half)


def pieces_table(design: "Design") -> Table:
    """The test piece by piece; of a long one, its beginning and its end."""
    first, taken_ah, rows = 1, 0.0, []
    for name, steps in design.pieces:
        last = first + len(steps) - 1
        begins = design.initial_soc - taken_ah / design.capacity_ah
        taken_ah += sum(step.duration_s * step.current_a for step in steps) / 3600
        ends = design.initial_soc - taken_ah / design.capacity_ah
        rows.append(
            [
                f"{first}" if first == last else f"{first}-{last}",
                name,
                duration(sum(step.duration_s for step in steps)),
                extent([step.current_a for step in steps], form=".3g"),
                f"{round(100 * max(begins, 0.0))} to {round(100 * max(ends, 0.0))}",
            ]
        )
        first = last + 1
    more = len(rows) - FIRST_PIECES - LAST_PIECES
    if more > 1:
        rows[FIRST_PIECES:-LAST_PIECES] = [["...", f"{more} more", "", "", ""]]
    return rows_table(
        "Discharge current is positive. Every piece is in procedure.txt, every step in steps.csv.",
        ["steps", "piece", "duration", "current [A]", "SOC [%]"],
        rows,
        ["steps", "piece", "duration"],
    )


def promised_screen(design: "Design", result: "Result") -> Document:
    """The promises of a design beside what an identification reached."""
    if result.tables is None:
        return screen([Lines(sentences("design.kept", True, []))])
    is_alone = len(result.of_role("identification")) == 1
    lines = sentences("design.kept", False, [*_differences(design, result)])
    return screen([promised_table(design, result.fit, is_alone), Lines(lines)])


def _differences(design: "Design", result: "Result") -> Iterator[str]:
    """What the fit has otherwise than the promise took it: time constants, resistances, what
    these follow, and the error."""
    fit, rmse_v, taken_v = result.fit, result.metrics.identification.rmse_v, design.error.rmse_v
    bounds = {bound.name: f", at the {bound.side} bound of its search" for bound in fit.at_bound}
    for width in design.widths:
        fitted = fit.tables.constants.get(width.name)
        if width.soc is None and fitted is not None and _is_other(fitted, width.value):
            value, promise = (with_unit(width.name, tau_s) for tau_s in (fitted, width.value))
            bound = bounds.get(width.name, "")
            yield f"{symbol(width.name)} {value}{bound} (promise: {promise})"
    for name in [name for name in design.wanted if name.startswith("R")]:
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


def promised_table(design: "Design", fit: "TableFit", is_alone: bool = True) -> Table:
    """The intervals that a design promised, beside those that the identification reached."""
    rows = []
    for name in [wanted for wanted in design.wanted if wanted != DRIVE]:
        pairs = [
            (width.alone if is_alone else width.after, reached)
            for width in design.of_table(name)
            if (reached := reached_half(fit, width)) is not None
        ]
        if not pairs:
            rows.append((name, "", "", "not determined", ""))
            continue
        promised, reached = np.transpose(pairs)
        near = int(np.sum(np.abs(np.log(reached / promised)) <= math.log1p(AGREES)))
        ratio = f"{np.median(reached) / np.median(promised):.2f}"
        nodes = f"{near} of {counted(len(design.of_table(name)), 'node')}"
        if better := int(np.sum(reached * (1 + AGREES) < promised)):
            nodes += f", {better} narrower"
        rows.append((name, middle(name, promised), middle(name, reached), ratio, nodes))
    caption = wording("design.promised", () if is_alone else design.earlier, TOGETHER)
    return rows_table(caption, ("", "promised", "reached", "ratio", "within 25 %"), rows, [""])


def reached_half(fit: "TableFit", width: "Width") -> float | None:
    """Half the interval that a fit has where a width was promised, in its measure, were its noise
    known as well as the promise takes it; one value stands for every SOC."""
    nodes = () if fit.is_over_soc or not width.name.startswith("R") else fit.tables.nodes
    for node in fit.intervals:
        if node.name == width.name and node.soc in (width.soc, *nodes):
            halves = halves_of(node)
            if halves is not None:
                return halves[0]
    return None
