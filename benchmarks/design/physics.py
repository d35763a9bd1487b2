"""PyBaMM's models as truths that are no circuits: one test in place of an OCV test and an HPPC."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

import barnax
from barnax.cell import CellModel, characterize
from barnax.experiment import Step
from barnax.experiment.protocol import hppc_steps, sampled
from barnax.over_soc.fit import pooled_errors
from barnax.records import Record
from barnax.reporting.design_forms import EMPTYING

from .virtual import (
    CHARGE_C,
    DISCHARGE_C,
    LONGEST_H,
    SEED,
    as_record,
    drive_of,
    prepared_for,
    with_ocv,
    without_ocv,
)

PHYSICS = (
    ("Prada2013", "SPMe", "lfp"),
    ("Chen2020", "SPMe", "nmc"),
    ("Chen2020", "DFN", "nmc"),
)
# What ends a test.
LAST = (EMPTYING, "last rest")
# A current changes within so many seconds.
RAMP_S = 0.02
NOISE_V = 1e-3


@dataclass(frozen=True)
class Model:
    """A PyBaMM model as a cell to test."""

    name: str
    kind: str

    @cached_property
    def values(self) -> Any:
        import pybamm

        pybamm.set_logging_level("ERROR")
        return pybamm.ParameterValues(self.name)

    @cached_property
    def window_v(self) -> tuple[float, float]:
        low, high = (float(self.values[f"{way} voltage cut-off [V]"]) for way in ("Lower", "Upper"))
        return low, high

    def tested(self, name: str, steps: Sequence[Any], soc: float = 1.0) -> Record:
        """The record of an experiment, a sample a second."""
        import pybamm

        made = pybamm.Simulation(
            getattr(pybamm.lithium_ion, self.kind)(),
            parameter_values=self.values,
            experiment=pybamm.Experiment([tuple(steps)], period="1 second"),
        )
        found = made.solve(initial_soc=soc)
        time_s = found["Time [s]"].entries
        place = np.searchsorted(time_s, np.arange(np.floor(time_s[-1])) + 1e-3, "right") - 1
        current_a, voltage_v = (found[key].entries[place] for key in ("Current [A]", "Voltage [V]"))
        rng = np.random.default_rng([SEED, len(place)])
        return as_record(name, current_a, voltage_v + NOISE_V * rng.normal(size=len(place)))

    def ocv_tested(self) -> CellModel:
        """The cell of an OCV test at C/20 in both directions."""
        low_v, high_v = self.window_v
        slow = f"at {float(self.values['Nominal cell capacity [A.h]']) / 20:.4f} A"
        rest = "Rest for 2 hours"
        down = self.tested("down", [rest, f"Discharge {slow} until {low_v} V", rest])
        up = self.tested("up", [rest, f"Charge {slow} until {high_v} V", rest], 0.0)
        cell = characterize([down, up], ocv_fit="interpolated")
        return replace(cell, capacity_ah=float(down.discharged_ah[-1]))


def held(current_a: np.ndarray) -> Any:
    """A PyBaMM step of currents that hold for a second each."""
    import pybamm

    first = np.flatnonzero(np.append(True, np.diff(current_a) != 0))
    last = np.append(first[1:], len(current_a)) - RAMP_S
    profile = np.column_stack(
        [np.column_stack([first, last]).ravel(), np.repeat(current_a[first], 2)]
    )
    profile[-1, 0] = len(current_a)
    return pybamm.step.current(profile, duration=len(current_a))


def as_steps(steps: Sequence[Step], low_v: float) -> list[Any]:
    """A test as PyBaMM runs it: all but what empties the cell as one profile."""
    loaded = [step for step in steps if not step.block.startswith(LAST)]
    found = [held(sampled(loaded)[:-1])]
    for step in steps[len(loaded) :]:
        if step.block == EMPTYING:
            seconds = 2 * step.duration_s
            found.append(
                f"Discharge at {step.current_a:.5g} A for {seconds:g} seconds or until {low_v} V"
            )
        else:
            found.append(f"Rest for {step.duration_s:g} seconds")
    return found


def physics_line(name: str, kind: str, chemistry: str) -> str:
    """The errors of three ways to identify a PyBaMM model, as a row of the table."""
    model = Model(name, kind)
    cell, (low_v, high_v) = model.ocv_tested(), model.window_v
    current_a = drive_of(cell.capacity_ah)
    drive = model.tested("drive", [held(current_a[: round(0.9 * len(current_a))])])
    design = barnax.design(
        capacity=cell.capacity_ah, chemistry=chemistry, max_hours=LONGEST_H, low_voltage=low_v,
        high_voltage=high_v, max_discharge=DISCHARGE_C, max_charge=CHARGE_C,
    )  # fmt: skip
    test = model.tested("test", as_steps(design.steps, low_v))
    steps = hppc_steps(
        cell.capacity_ah, DISCHARGE_C * cell.capacity_ah, CHARGE_C * cell.capacity_ah
    )
    hppc = model.tested("hppc", [held(sampled(steps)[:-1])])
    prepared = prepared_for(drive, cell)
    (promised,) = design.of_table("drive")
    found = [
        promised.alone,
        without_ocv(test, cell.capacity_ah, drive),
        pooled_errors([prepared], with_ocv(cell, hppc).tables).rmse_v,
        pooled_errors([prepared], with_ocv(cell, test).tables).rmse_v,
        pooled_errors([prepared], with_ocv(cell, drive).tables).rmse_v,
    ]
    loaded = sampled([step for step in design.steps if not step.block.startswith(LAST)])
    lowest_v = test.voltage_v[: len(loaded) - 1].min()
    highest_v = test.voltage_v[test.current_a < 0].max(initial=high_v)
    found.append(max(low_v - lowest_v, highest_v - high_v, 0.0))
    cells = " | ".join(f"{1e3 * error_v:.2f}" for error_v in found)
    print(name, kind, cells, file=sys.stderr, flush=True)
    return f"| {name}, {kind}, {cell.capacity_ah:.2f} Ah | {design.hours:.2f} | {cells} |"


def physics_lines(rows: Sequence[str]) -> list[str]:
    """The section of truths that are no circuits."""
    return [
        "## PyBaMM's models as the truth",
        "",
        f"From capacity and chemistry alone: one test of {LONGEST_H:g} h and no OCV test, against "
        "an OCV test at C/20 in both directions (48 h) with an HPPC (12.7 h). RMSE on a drive "
        f"cycle not used, in mV; {1e3 * NOISE_V:g} mV of white noise. The last but one is what a "
        "fit to the drive cycle itself leaves, the last how far a voltage was beyond its limit.",
        "",
        "| truth | hours | predicted | designed test alone | OCV test and HPPC | OCV test and "
        "designed test | the drive itself | beyond |",
        "|---|---|---|---|---|---|---|---|",
        *rows,
        "",
    ]
