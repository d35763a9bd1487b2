"""A designed test in words, tables, and the forms that cyclers and PyBaMM take."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from ..experiment.information import HALF_95
from ..experiment.next_test import REACHED
from ..experiment.protocol import sampled
from ..experiment.stored import DRIVE
from ..files import csv_text
from .document import Table, rows_table
from .terminal import bare_table, headed_line, indented, terminal_table
from .words import NOTHING, counted, duration, extent, joined, millivolt, percent

if TYPE_CHECKING:
    from ..experiment import Design, Step
    from ..experiment.information import Believed, Width
    from ..over_soc import TableFit
    from ..results import Result

EMPTYING, CURRENTS = "to empty", ("max_discharge", "max_charge")
# A step below this current is a rest.
REST_A = 1e-9
# On measured cells, records that are identified together leave wider intervals than was promised:
# so many times, medians of 18 pairs (benchmarks/results/design.md).
TOGETHER = {"R0": 1.3, "R1": 1.1, "R2": 1.2}
# Promised and reached intervals within this share of each other agree.
AGREES = 0.25
# Pieces with more different steps are run from a profile.
LONGEST_LINE = 8
# Pieces on the screen, of a longer test: its first ones and its end.
FIRST_PIECES, LAST_PIECES = 8, 2


def planned_lines(
    believed: "Believed",
    with_cli_options: Callable[[str], str] = str,
    chosen: Sequence[str] = (),
) -> Iterator[RenderableType]:
    """The assumptions that a test is planned on: the capacity, the largest currents that are not
    among the options `chosen`, and records that do not count.

    `with_cli_options` turns the options named in texts into those of the reader's interface.
    """
    cell, open_currents = believed.cell, [name for name in CURRENTS if name not in chosen]
    more = "; if that is not its capacity, identify again with `capacity`"
    capacity = f"{cell.capacity_ah:.4g} Ah, {cell.capacity_origin}"
    told = {
        "Planned for": f"{capacity}{more if cell.has_spanned_capacity else ''}.",
        "Currents": open_currents and _usual_currents(believed, open_currents),
        "Not counted": believed.untold and f"the result's own records: {believed.untold}.",
    }
    yield Text()
    for head, text in told.items():
        if text:
            yield indented(headed_line(head, with_cli_options(text)))


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
    return f"{', '.join(told)}; set your own with {options}."


def design_screen(
    design: "Design", with_cli_options: Callable[[str], str] = str
) -> Iterator[RenderableType]:
    """The test's hours and predicted intervals, its pieces, and the steps to take before it."""
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
        known = _middle(name, before) if len(before) > len(own) / 2 else NOTHING
        tests = [own, *(design.of_table(name, reference.widths) for reference in design.references)]
        middle = [_middle(name, [width.after for width in test]) for test in tests]
        widest = [_said(name, max(width.after for width in test)) for test in tests]
        rows.append([_shown(name), _said(name, wanted), known, *middle])
        if len(own) > 1:
            rows.append(["  widest", "", "", *widest])
    return bare_table(heads, rows)


def _shown(name: str) -> str:
    return "error on a drive cycle" if name == DRIVE else name


def _middle(name: str, halves: Sequence[float]) -> str:
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
                f"{round(100 * begins)} to {round(100 * ends)}",
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


def _sentences(design: "Design") -> Iterator[tuple[str, str]]:
    predicted, limits = design.predicted, design.limits
    if not design.is_reached:
        yield "Not reached", _not_reached(design)
    expected = f"{predicted.voltage_v.min():.2f} to {predicted.voltage_v.max():.2f} V"
    kept = f"{limits.low_v:g} to {limits.high_v:g} V"
    is_emptied = any(name == EMPTYING for name, _ in design.pieces)
    ends = f"; {limits.low_v:g} V in '{EMPTYING}' ends that step only" if is_emptied else ""
    yield "Voltage", f"{expected} expected. Set the cycler to stop the test outside {kept}{ends}."
    yield "Warming", f"about {predicted.warming_k:.2g} K, for a typical cell in moving air."
    yield "Before", _before(design)
    if design.earlier:
        yield "Combined with", f"{joined(design.earlier)}. {_together()}"
    left_out = f"{design.error.left_out:.2g}"
    effects = "unmodeled effects as large as in a typical cell"
    if left_out != "1":
        effects = "no unmodeled effects" if left_out == "0" else f"{effects}, times {left_out}"
    yield (
        "Assumed",
        f"errors of {millivolt(design.error.rmse_v)} RMS after the fit, correlated over up to "
        f"{_correlated(design)}; {effects}.",
    )


def _not_reached(design: "Design") -> str:
    """The intervals that stay wider than wanted, why, and whether a drive cycle does better."""
    after = {name: [width.after for width in design.of_table(name)] for name in design.wanted}
    enough = {name: REACHED * half for name, half in design.wanted.items()}
    wide = [name for name in after if np.median(after[name]) > enough[name]]
    some = [name for name in after if np.median(after[name]) <= enough[name] < max(after[name])]
    told = [joined([*map(_shown, wide)])] if wide else []
    told += [f"{joined([*map(_shown, some)])} at some SOC"] if some else []
    drive = next(test for test in design.references if test.name == "drive cycle")
    better = [
        _shown(name)
        for name in (*wide, *some)
        for theirs in [[width.after for width in design.of_table(name, drive.widths)]]
        if np.median(theirs) < np.median(after[name])
    ]
    does = f"determines {joined(better)} better" if better else "does no better"
    untold = [name for name in wide if name.startswith("R") and np.median(after[name]) > 1]
    open_ = f" {joined(untold)} would stay undetermined." if untold else ""
    return (
        f"{'; '.join(told)}.{open_} This is the best test found of {design.hours:.3g} h. Errors "
        f"last up to {_correlated(design)}, so intervals narrow only with the square root of test "
        f"time; a drive cycle of {drive.hours:.1f} h {does}. Allow more `max_hours` or current."
    )


def _correlated(design: "Design") -> str:
    """For how long errors are alike."""
    return duration(max(time_s for time_s, _ in design.error.noise))


def _together() -> str:
    """The measured widths of what records tell together, over the promised ones."""
    times = joined([f"{times:g} ({name})" for name, times in TOGETHER.items()])
    return (
        "Two measured records of a cell disagree somewhat: their joint intervals were "
        f"{times} times as wide as promised, the median of 18 pairs."
    )


def _before(design: "Design") -> str:
    return (
        f"charge at C/2 to {design.limits.high_v:g} V, hold until C/20, and rest 1 h: the test "
        "starts full."
    )


def design_files(design: "Design") -> dict[str, bytes]:
    """The test in all its forms, by the names of their files."""
    texts = {
        "steps.csv": steps_csv(design),
        "profile.csv": profile_csv(design),
        "experiment_pybamm.py": pybamm_script(design),
        "procedure.txt": procedure(design),
    }
    return {name: text.encode() for name, text in texts.items()}


def steps_csv(design: "Design") -> str:
    """Every step in a row, as a cycler's editor has it."""
    limits, soc = design.limits, design.initial_soc
    rows = []
    for number, step in enumerate(design.steps, 1):
        soc -= step.duration_s * step.current_a / 3600 / design.capacity_ah
        rows.append(
            [number, step.block, _mode(step), f"{step.duration_s:g}", _ampere(abs(step.current_a)),
             f"{abs(step.current_a) / design.capacity_ah:.3f}", f"{limits.low_v:g}",
             f"{limits.high_v:g}", 1, f"{soc:.4f}"]
        )  # fmt: skip
    heads = (
        *("Step", "Piece", "Mode", "Duration / s", "Current / A", "Rate / C", "Lowest voltage / V"),
        *("Highest voltage / V", "Log every / s", "SOC at the end"),
    )
    return csv_text(heads, rows)


def profile_csv(design: "Design") -> str:
    """The current of every second, for cyclers that run a profile (discharge positive)."""
    current_a = sampled(design.steps)
    rows = ([second, _ampere(current)] for second, current in enumerate(current_a.tolist()))
    return csv_text(("Time / s", "Current / A"), rows)


def _ampere(current_a: float) -> str:
    """Five digits of a current, however small the cell is."""
    return np.format_float_positional(current_a + 0.0, 5, fractional=False, trim="-")


def _mode(step: "Step") -> str:
    if abs(step.current_a) < REST_A:
        return "rest"
    return "discharge" if step.current_a > 0 else "charge"


def pybamm_steps(design: "Design") -> list[str]:
    """Every step as PyBaMM's `Experiment` takes it."""
    limits = {"discharge": design.limits.low_v, "charge": design.limits.high_v}
    steps = []
    for step in design.steps:
        mode = _mode(step)
        if mode == "rest":
            steps.append(f"Rest for {step.duration_s:g} seconds")
            continue
        # The discharge to empty must end at the voltage, not before.
        seconds = step.duration_s * (2 if step.block == EMPTYING else 1)
        steps.append(
            f"{mode.capitalize()} at {_ampere(abs(step.current_a))} A for {seconds:g} seconds "
            f"or until {limits[mode]:g} V"
        )
    return steps


def pybamm_script(design: "Design") -> str:
    """The same as a module with the experiment."""
    lines = "\n".join(f'    "{step}",' for step in pybamm_steps(design))
    return (
        '"""The designed test, from a full and rested cell."""\n\nimport pybamm\n\n'
        f"steps = [\n{lines}\n]\n"
        'experiment = pybamm.Experiment([tuple(steps)], period="1 second")\n'
    )


def procedure(design: "Design") -> str:
    """The test in lines that are typed into a cycler's editor; what has many steps is run from a
    profile."""
    limits = design.limits
    lines = [
        f"Test of a cell of {design.capacity_ah:g} Ah, {design.hours:.2f} h",
        f"Stop the test below {limits.low_v:g} V or above {limits.high_v:g} V. Log every second.",
        f"Before: {_before(design)}",
        "",
    ]
    second, row = 0, 1
    for number, (name, steps) in enumerate(design.pieces, 1):
        seconds = round(sum(step.duration_s for step in steps))
        unit = next(n for n in range(1, len(steps) + 1) if _repeats(steps, n))
        what = "; ".join(map(_line, steps[:unit]))
        if unit < len(steps):
            what = f"{len(steps) // unit} times ({what})"
        if unit > LONGEST_LINE:
            rows = f"seconds {second} to {second + seconds - 1} of profile.csv"
            what = f"{rows}, or steps {row} to {row + len(steps) - 1} of steps.csv"
        if name == EMPTYING:
            what = f"discharge {steps[0].current_a:.4g} A until {limits.low_v:g} V, then go on"
        own = "" if what.startswith(name) else f"{name}: "
        lines.append(f"{number:3d}  {own}{what}")
        second, row = second + seconds, row + len(steps)
    return "\n".join(lines) + "\n"


def _repeats(steps: "Sequence[Step]", count: int) -> bool:
    """True if the first `count` steps are repeated to the end."""
    return len(steps) % count == 0 and all(
        step == steps[place % count] for place, step in enumerate(steps)
    )


def _line(step: "Step") -> str:
    mode = _mode(step)
    current = "" if mode == "rest" else f" {abs(step.current_a):.4g} A"
    return f"{mode}{current} {step.duration_s:g} s"


def promised_lines(design: "Design", result: "Result") -> Iterator[RenderableType]:
    """The promises of a design beside what an identification reached."""
    if result.tables is None:
        yield headed_line(
            "Promised", "the answer has no tables over SOC to compare; give `over` soc"
        )
        return
    is_alone = len(result.of_role("identification")) == 1
    yield Text()
    yield indented(terminal_table(promised_table(design, result.tables.fit, is_alone)))


def promised_table(design: "Design", fit: "TableFit", is_alone: bool = True) -> Table:
    """The intervals that a design promised, beside those that the identification reached."""
    rows = []
    for name in [wanted for wanted in design.wanted if wanted != DRIVE]:
        pairs = [
            (promised, reached)
            for width in design.of_table(name)
            if (reached := reached_half(fit, width)) is not None
            for promised in [width.alone if is_alone else width.after]
        ]
        if not pairs:
            rows.append((name, "", "", "not determined", ""))
            continue
        promised, reached = np.transpose(pairs)
        ratio = reached / promised
        near = int(np.sum(np.abs(np.log(ratio)) <= math.log1p(AGREES)))
        rows.append(
            (name, _middle(name, promised), _middle(name, reached), f"{np.median(ratio):.2f}",
             f"{near} of {counted(len(design.of_table(name)), 'node')}")
        )  # fmt: skip
    earlier = () if is_alone else design.earlier
    caption = (
        "Half the 95 % interval that was promised of the test "
        f"{f'with {joined(earlier)}' if earlier else 'alone'} and reached by the standard errors, "
        "medians from 10 to 90 % SOC. An interval is wider yet where a short record tells its "
        "noise badly."
    )
    return rows_table(
        f"{caption} {_together()}" if earlier else caption,
        ("", "promised", "reached", "ratio", "within 25 %"),
        rows,
        [""],
    )


def reached_half(fit: "TableFit", width: "Width") -> float | None:
    """Half the interval that a fit has where a width was promised, in its measure, were its noise
    known as well as the promise takes it; one value stands for every SOC."""
    nodes = fit.tables.nodes if len(fit.tables.nodes) == 1 and width.name.startswith("R") else ()
    for node in fit.intervals:
        is_there = node.name == width.name and node.soc in (width.soc, *nodes)
        if is_there and node.low is not None and node.high is not None:
            scale = node.value if node.name.startswith("R") else 1.0
            half = HALF_95 * node.standard_error + abs(node.bias) / 2
            return half / scale if scale > 0 else None
    return None
