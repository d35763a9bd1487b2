"""A designed test in words and tables."""

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from ..experiment.belief import UNKNOWN_LOW_SOC
from ..experiment.protocol import LOW_SOC
from ..experiment.stored import DRIVE, is_enough
from .design_forms import EMPTYING, before
from .document import Table, rows_table
from .terminal import bare_table, headed_line, indented, terminal_table
from .words import NOTHING, duration, extent, joined, millivolt, percent, symbol, with_unit

if TYPE_CHECKING:
    from ..experiment import Design
    from ..experiment.information import Believed
    from ..experiment.widths import Width

CURRENTS = ("max_discharge", "max_charge")
# On measured cells, records that are identified together leave wider intervals than was promised:
# so many times, medians of 18 pairs (benchmarks/results/design.md).
TOGETHER = {"R0": 1.3, "R1": 1.1, "R2": 1.2}
# What is printed is said where it is wider than what a design counts by more than this share.
WIDER = 0.25
# A test is said to widen what it leaves so many times as wide as it was.
WIDENED = 1.05
# By so much warmer, the resistances of a cell are others.
WARM_K = 10.0
# Pieces on the screen, of a longer test: its first ones and its end.
FIRST_PIECES, LAST_PIECES = 8, 2


def planned_lines(
    believed: "Believed",
    with_cli_options: Callable[[str], str] = str,
    chosen: Sequence[str] = (),
) -> Iterator[RenderableType]:
    """The assumptions that a test is planned on: the capacity, the SOC that it stays in, the
    largest currents that are not among the options `chosen`, and records that do not count.

    `with_cli_options` turns the options named in texts into those of the reader's interface.
    """
    cell, open_currents = believed.cell, [name for name in CURRENTS if name not in chosen]
    more = "; if that is not its capacity, identify again with `capacity`"
    capacity = f"{cell.capacity_ah:.4g} Ah, {cell.capacity_origin}"
    is_open = cell.has_spanned_capacity and believed.start_v is None
    told = {
        "Planned for": f"{capacity}{more if is_open else ''}.",
        "Cell": _typical_cell(believed),
        "SOC": _planned_soc(believed),
        "Time constants": _at_bounds(believed),
        "Resistances": _without_dependence(believed),
        "Currents": open_currents and _usual_currents(believed, open_currents),
        "Not counted": believed.untold and f"the result's own records: {believed.untold}.",
    }
    yield Text()
    for head, text in told.items():
        if text:
            yield indented(headed_line(head, with_cli_options(text)))


def _at_bounds(believed: "Believed") -> str:
    """The time constants that ended at a bound of their search."""
    told = [
        f"{symbol(name)} at the {bound.side} bound of its search, {with_unit(name, value)}"
        for bound in believed.at_bound
        for name, value in [(bound.name, believed.tables.constants[bound.name])]
    ]
    return f"{joined(told)}. The intervals below take it as known." if told else ""


def _without_dependence(believed: "Believed") -> str:
    """That what resistances follow beside SOC is left out."""
    if not believed.follows:
        return ""
    return (
        f"the result's follow {joined(believed.follows)} too. The design takes them without that, "
        "so intervals of a fit with it will be wider than promised."
    )


def _typical_cell(believed: "Believed") -> str:
    """What is believed of a cell of which nothing was measured."""
    if not believed.typical or believed.typical_reach_v:
        return ""
    taus = joined([f"{tau_s:g}" for tau_s in believed.tables.tau_s])
    return (
        f"a typical {believed.typical.upper()} cell (`chemistry` takes nmc or lfp): its OCV is up "
        f"to {1e3 * believed.ocv_reach_v:g} mV off, its resistances are up to "
        f"{believed.worst.max():g} times as large, its time constants {taus} s."
    )


def _planned_soc(believed: "Believed") -> str:
    """The SOC that a test stays in, and what is believed beyond."""
    low, high = (f"{100 * soc:.0f}" for soc in believed.told_soc)
    known = f"the result knows the OCV from {low} to {high} %"
    if believed.start_v is not None:
        return (
            f"{known}, and the test stays within. {high} % is the fullest point of the record, "
            f"{believed.start_v:.2f} V at rest, whether the cell was full or not. To plan a test "
            "from full, identify again with `initial_soc` and `capacity`."
        )
    if believed.told_soc == (0.0, 1.0):
        if believed.settings.ocv_nodes is None:
            return f"from full to {percent(LOW_SOC)}."
        return f"from full to {percent(UNKNOWN_LOW_SOC)}, then slowly to empty."
    if believed.typical:
        reach = f"{1e3 * (believed.ocv_reach_v + believed.typical_reach_v):.0f} mV"
        return (
            f"{known}, and the test goes from full to empty. Beyond, the OCV of a typical "
            f"{believed.typical.upper()} cell is joined to it, and may be off by {reach}."
        )
    return (
        f"{known}, and the test stays within. `chemistry` nmc or lfp plans one from full to empty, "
        "with a typical OCV beyond."
    )


def _usual_currents(believed: "Believed", names: Sequence[str]) -> str:
    """The largest of the currents that were not given, by the names of their options."""
    is_usual = believed.rates_c == type(believed).rates_c
    measured = ("the largest of the records", "half the largest of the records")
    origins = ("1C", "C/2") if is_usual else measured
    told = [
        f"{name.removeprefix('max_')} up to {rate * believed.cell.capacity_ah:.3g} A ({origin})"
        for name, rate, origin in zip(CURRENTS, believed.rates_c, origins, strict=True)
        if name in names
    ]
    options = joined([f"`{name}`" for name in names])
    return f"the limits are {' and '.join(told)}; set your own with {options}."


def design_screen(
    design: "Design", with_cli_options: Callable[[str], str] = str
) -> Iterator[RenderableType]:
    """The test's hours and predicted intervals, its pieces, and the steps to take before it; or
    that none is needed."""
    if not design.is_needed:
        yield from known_screen(design, with_cli_options)
        return
    yield Text()
    yield indented(_widths_table(design))
    yield Text()
    yield indented(terminal_table(pieces_table(design)))
    yield Text()
    for head, text in _sentences(design):
        yield indented(headed_line(head, with_cli_options(text)))


def _widths_table(design: "Design"):
    """Half the 95 % interval of every table, before and after, beside usual tests."""
    heads = [
        "95 % interval (+/-)",
        "wanted",
        "before",
        "this test",
        *(r.name for r in design.references),
    ]
    rows = [
        ["hours", "", "", f"{design.hours:.2f}", *(f"{r.hours:.1f}" for r in design.references)]
    ]
    for name, wanted in design.wanted.items():
        own = design.of_table(name)
        before = [width.before for width in own if width.before is not None]
        is_known = len(before) > len(own) / 2
        known = middle(name, before) if is_known else NOTHING
        tests = [own, *(design.of_table(name, reference.widths) for reference in design.references)]
        middles = [middle(name, [width.after for width in test]) for test in tests]
        widest = [_said(name, max(width.after for width in test)) for test in tests]
        rows.append([_shown(name), _said(name, wanted), known, *middles])
        if len(own) > 1:
            wide = _said(name, max(before)) if len(before) == len(own) else ""
            rows.append(["  widest", "", wide, *widest])
    return bare_table(heads, rows)


def _shown(name: str) -> str:
    return "error on a drive cycle" if name == DRIVE else name


def middle(name: str, halves: Sequence[float]) -> str:
    return _said(name, float(np.median(halves)))


def _said(name: str, half: float) -> str:
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


def known_screen(
    design: "Design", with_cli_options: Callable[[str], str] = str
) -> Iterator[RenderableType]:
    """That no test is needed, as the earlier records tell what is wanted."""
    yield Text()
    told = {
        "No test needed": f"{joined(design.earlier)} told what is wanted: {_already(design)}. For "
        "a test anyway, give `max_hours`; for narrower intervals, `want`.",
        "Intervals": _printed(design),
    }
    for head, text in told.items():
        if text:
            yield indented(headed_line(head, with_cli_options(text)))


def _already(design: "Design") -> str:
    """What the earlier records tell as well as is wanted, both beside each other."""
    told = [
        f"{_shown(name)} {middle(name, before)} ({_said(name, design.wanted[name])} wanted)"
        for name in design.already
        for before in [[width.before for width in design.of_table(name) if width.before]]
        if before
    ]
    return joined(told)


def _printed(design: "Design") -> str:
    """The intervals that the result prints, where they are wider than what a design counts, why,
    and how that is settled."""
    wider = {
        name: half
        for name, half in design.printed.items()
        for before in [[width.before for width in design.of_table(name) if width.before]]
        if before and half > (1 + WIDER) * np.median(before)
    }
    reasons = []
    if "fits" in design.beyond:
        reasons.append("cover two fits, of which errors near empty count in one")
    if design.follows:
        reasons.append(f"count that resistances follow {joined(design.follows)}")
    if "hold" in design.beyond:
        reasons.append(
            "reach over both holds of the current, which no test narrows: identify again with the "
            "right `current_hold`"
        )
    if not wider or not reasons:
        return ""
    halves = joined([f"{name} {_said(name, half)}" for name, half in wider.items()])
    return (
        f"the result's intervals of {halves} are wider than what more samples narrow; they also "
        f"{', and '.join(reasons)}."
    )


def _widened(design: "Design") -> str:
    """What a fit with the test leaves wider than the earlier records alone."""
    told = []
    for name in design.wanted:
        own = design.of_table(name)
        before = [width.before for width in own if width.before is not None]
        if before and np.median(_halves(own)) > WIDENED * np.median(before):
            both = f"{middle(name, before)} before, {middle(name, _halves(own))} with it"
            told.append(f"{_shown(name)} {both}")
    why = "the fit weighs all samples alike, however much their errors are correlated"
    return f"{joined(told)}: {why}." if told else ""


def _sentences(design: "Design") -> Iterator[tuple[str, str]]:
    predicted, limits = design.predicted, design.limits
    if design.already:
        is_all = len(design.already) == len(design.wanted)
        best = "; this is the best test of the hours" if is_all else ""
        yield "Known already", f"{_already(design)}; no further test is needed for it{best}."
    if not design.is_reached:
        yield "Not reached", _not_reached(design)
    for head, text in (("Wider", _widened(design)), ("Intervals", _printed(design))):
        if text:
            yield head, text
    # What reaches the lowest voltage ends there.
    lowest_v = max(predicted.voltage_v.min(), limits.low_v)
    expected = f"{lowest_v:.2f} to {predicted.voltage_v.max():.2f} V"
    kept = f"{limits.low_v:g} to {limits.high_v:g} V"
    is_emptied = any(name == EMPTYING for name, _ in design.pieces)
    ends = f"; {limits.low_v:g} V in '{EMPTYING}' ends that step only" if is_emptied else ""
    yield "Voltage", f"{expected} expected. Set the cycler to stop the test outside {kept}{ends}."
    warmer = predicted.warming_k > WARM_K
    lower = ", enough to lower its resistances; limit it with `max_warming`" if warmer else ""
    yield "Warming", f"about {predicted.warming_k:.2g} K, for a typical cell in moving air{lower}."
    yield "Before", before(design)
    if design.earlier:
        yield "Combined with", f"{joined(design.earlier)}. {together()}"
    left_out = f"{design.error.left_out:.2g}"
    times = "" if left_out == "1" else f"{left_out} times "
    effects = f"unmodeled effects {times}as large as in a typical cell"
    if left_out == "0":
        effects = "no unmodeled effects"
    yield (
        "Assumed",
        f"errors of {millivolt(design.error.rmse_v)} RMS after the fit, correlated over up to "
        f"{_correlated(design)}; {effects}.",
    )


def _not_reached(design: "Design") -> str:
    """The intervals that stay wider than wanted, why, and whether a drive cycle does better."""
    after = {name: _halves(design.of_table(name)) for name in design.wanted}
    wanted = design.wanted

    def is_wide(name: str, halves: np.ndarray | float) -> bool:
        return not is_enough(name, float(halves), wanted[name])

    wide = [name for name in after if is_wide(name, np.median(after[name]))]
    some = [name for name in after if name not in wide and is_wide(name, max(after[name]))]
    of_wide = [f"{_shown(name)} ({middle(name, after[name])})" for name in wide]
    of_some = [f"{_shown(name)} ({_said(name, max(after[name]))})" for name in some]
    told = [joined(of_wide)] if wide else []
    told += [f"{joined(of_some)} at some SOC"] if some else []
    drive = next(test for test in design.references if test.name == "drive cycle")
    # By what falls short: the median, or the widest.
    theirs = {name: _halves(design.of_table(name, drive.widths)) for name in (*wide, *some)}
    better = [_shown(name) for name in wide if np.median(theirs[name]) < np.median(after[name])]
    better += [f"the widest {name}" for name in some if max(theirs[name]) < max(after[name])]
    narrower = [name for name in better if name != _shown(DRIVE)]
    does = [f"leaves {joined(narrower)} narrower"] if narrower else []
    does += [f"the {_shown(DRIVE)} smaller"] if len(narrower) < len(better) else []
    if not does:
        does = ["does no better"]
    elif not narrower:
        does = [f"leaves {does[0]}"]
    untold = [name for name in wide if name.startswith("R") and np.median(after[name]) > 1]
    open_ = f" {joined(untold)} would stay undetermined." if untold else ""
    return (
        f"{'; '.join(told)}.{open_} This is the best test found of {design.hours:.3g} h. "
        f"Errors are correlated over up to {_correlated(design)}, so intervals narrow no faster "
        f"than with the square root of test time; a drive cycle of {drive.hours:.1f} h "
        f"{' and '.join(does)}. {_needed(design)}"
    )


def _halves(widths: "Sequence[Width]") -> list[float]:
    return [width.after for width in widths]


def _needed(design: "Design") -> str:
    """The time that would reach what is wanted, or what to change where none does."""
    if design.hours_needed is not None:
        return f"A test of {design.hours_needed:.4g} h would reach all: allow it with `max_hours`."
    if design.hours_searched is None:
        return "No longer test is planned: allow more current, or `want` less."
    return (
        f"No test of {design.hours_searched:.4g} h was found that reaches all: allow more current "
        "or still more `max_hours`, or `want` less."
    )


def _correlated(design: "Design") -> str:
    """For how long errors are alike."""
    return duration(max(time_s for time_s, _ in design.error.noise))


def together() -> str:
    """The measured widths of what records tell together, over the promised ones."""
    times = joined([f"{times:g} ({name})" for name, times in TOGETHER.items()])
    return (
        "Two measured records of a cell disagree somewhat: their joint intervals were "
        f"{times} times as wide as promised, the median of 18 pairs."
    )
