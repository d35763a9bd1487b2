"""A designed test in the formats of cyclers and PyBaMM."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from ..experiment.protocol import hours_of, sampled
from ..files import csv_text
from .wording import rendered, wording

if TYPE_CHECKING:
    from ..experiment import Design, Step

# The only step that may reach the lowest voltage, which ends it.
EMPTYING = "to empty"
# A step below this current is a rest.
REST_A = 1e-9
# Pieces with more different steps are run from a profile.
LONGEST_LINE = 8


def design_files(design: "Design") -> dict[str, bytes]:
    """The test in all formats, by file name; none if no test is needed."""
    if not design.is_needed:
        return {}
    texts = {
        "steps.csv": steps_csv(design),
        "profile.csv": profile_csv(design),
        "experiment_pybamm.py": pybamm_script(design),
        "procedure.txt": procedure(design),
    }
    return {name: text.encode() for name, text in texts.items()}


def longest(step: "Step") -> "Step":
    """The step with its longest duration: the discharge to empty has to end at the voltage, and the
    capacity may be larger than assumed."""
    return replace(step, duration_s=2 * step.duration_s) if step.block == EMPTYING else step


def steps_csv(design: "Design") -> str:
    """Every step in a row, as in a cycler's editor."""
    limits, soc = design.limits, design.initial_soc
    rows = []
    for number, step in enumerate(design.steps, 1):
        soc -= step.duration_s * step.current_a / 3600 / design.capacity_ah
        at_lowest = "next step" if step.block == EMPTYING else "stop"
        rows.append(
            [number, step.block, _mode(step), f"{longest(step).duration_s:g}",
             _ampere(abs(step.current_a)), f"{abs(step.current_a) / design.capacity_ah:.3f}",
             f"{limits.low_v:g}", at_lowest, f"{limits.high_v:g}", 1, f"{max(soc, 0.0):.4f}"]
        )  # fmt: skip
    heads = (
        *("Step", "Piece", "Mode", "Duration / s", "Current / A", "Rate / C", "Lowest voltage / V"),
        *("At the lowest voltage", "Highest voltage / V", "Log every / s", "SOC at the end"),
    )
    return csv_text(heads, rows)


def profile_csv(design: "Design") -> str:
    """The current at every second, for cyclers that run a profile (discharge positive)."""
    current_a = sampled([*map(longest, design.steps)])
    rows = ([second, _ampere(current)] for second, current in enumerate(current_a.tolist()))
    return csv_text(("Time / s", "Current / A"), rows)


def _ampere(current_a: float) -> str:
    """A current with five digits, however small the cell."""
    return np.format_float_positional(current_a + 0.0, 5, fractional=False, trim="-")


def _mode(step: "Step") -> str:
    if abs(step.current_a) < REST_A:
        return "rest"
    return "discharge" if step.current_a > 0 else "charge"


def pybamm_steps(design: "Design") -> list[str]:
    """Every step for PyBaMM's `Experiment`."""
    limits = {"discharge": design.limits.low_v, "charge": design.limits.high_v}
    steps = []
    for step in design.steps:
        mode = _mode(step)
        if mode == "rest":
            steps.append(f"Rest for {step.duration_s:g} seconds")
            continue
        seconds = longest(step).duration_s
        steps.append(
            f"{mode.capitalize()} at {_ampere(abs(step.current_a))} A for {seconds:g} seconds "
            f"or until {limits[mode]:g} V"
        )
    return steps


def pybamm_script(design: "Design") -> str:
    """The same as a module with the experiment."""
    facts = {"steps": pybamm_steps(design), "before": wording("design.before", design)}
    return rendered("experiment", emptying=EMPTYING, **facts)


def procedure(design: "Design") -> str:
    """The test in lines that are typed into a cycler's editor; pieces with many steps are run from
    a profile."""
    pieces, second, row = [], 0, 1
    for name, piece in design.pieces:
        steps, end_s = [*_merged(piece)], second + round(3600 * hours_of([*map(longest, piece)]))
        # As many steps as are repeated to the end.
        unit = next(n for n in range(1, len(steps) + 1) if steps == steps[:n] * (len(steps) // n))
        facts = {"name": name, "seconds": (second, end_s), "rows": (row, row + len(piece) - 1)}
        pieces.append(facts | {"steps": steps[:unit], "times": len(steps) // unit})
        second, row = end_s, row + len(piece)
    facts = {"design": design, "pieces": pieces, "before": wording("design.before", design)}
    facts |= {"most_h": hours_of([*map(longest, design.steps)]), "mode": _mode}
    return rendered("procedure", emptying=EMPTYING, longest=LONGEST_LINE, **facts)


def _merged(steps: "Sequence[Step]") -> "Iterator[Step]":
    """The steps, with neighboring rests merged."""
    for mode, group in groupby(steps, _mode):
        alike = list(group)
        if mode == "rest":
            alike = [replace(alike[0], duration_s=sum(step.duration_s for step in alike))]
        yield from alike
