"""Ageing of cells that are no circuits: `python -m benchmarks.life_physics [CELLS]`.

PyBaMM's SPMe with a growing SEI and loss of active material, both made faster, so that years pass
in some tens of cycles. Writes benchmarks/results/life_physics.md.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import barnax
from barnax.fleet.rows import ageing_row
from barnax.model.prepared import prepare_record
from benchmarks.pages import as_markdown, provenance, publish

RESULTS = Path(__file__).parent / "results" / "life_physics.md"
# Within so much of the truth, as `benchmarks.life` counts it.
WITHIN = {"capacity [A.h]": 0.01, "R0 [Ohm]": 0.02}
CELLS, FRESH_SEEDS = 12, (90_001, 90_002, 90_003)

VALUES, NOMINAL_AH, FULL_V, EMPTY_V = "OKane2022", 5.0, 4.2, 2.5
STEP_S, SAMPLES, NOISE_V = 5.0, 2000, 1e-3
# Steps of the current take so long.
EDGE_S = 0.02
BLOCKS, CYCLES = 5, 18
# By how much the solvent diffuses faster, and active material of both electrodes goes.
MODES = {
    "SEI": (2500.0, 1.0, 1.0),
    "SEI, negative electrode": (700.0, 200.0, 1.0),
    "SEI, positive electrode": (700.0, 1.0, 300.0),
    "SEI, both electrodes": (1500.0, 120.0, 150.0),
}
FASTER = {
    "SEI solvent diffusivity [m2.s-1]": 0,
    "Negative electrode LAM constant proportional term [s-1]": 1,
    "Positive electrode LAM constant proportional term [s-1]": 2,
}


@dataclass(frozen=True)
class Aged:
    """A cell at one age: its capacity at C/20, R0 at 50 % SOC, and a drive from full."""

    capacity_ah: float
    r0_ohm: float
    drive: dict[str, np.ndarray]


def drive_a(seed: int, charge_ah: float) -> np.ndarray:
    """Levels of 5 to 200 s, mostly discharging, that go so far down at the lowest."""
    draw = np.random.default_rng(seed)
    heights = np.minimum(draw.gamma(0.8, 1.0, SAMPLES), 1.0) * draw.choice(
        [1, 1, 1, -0.6, 0], SAMPLES
    )
    current_a = np.repeat(heights, draw.integers(1, 40, SAMPLES))[:SAMPLES]
    current_a[: SAMPLES // 6] = np.abs(current_a[: SAMPLES // 6])
    current_a[:12] = 0.0
    return current_a * charge_ah / (np.cumsum(current_a).max() * STEP_S / 3600)


class PhysicalCell:
    """A cell in PyBaMM that goes from step to step."""

    def __init__(self, faster: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> None:
        import pybamm

        pybamm.set_logging_level("ERROR")
        self.model = pybamm.lithium_ion.SPMe(
            {
                "SEI": "solvent-diffusion limited",
                "particle mechanics": "swelling only",
                "loss of active material": "stress-driven",
            }
        )
        self.values = pybamm.ParameterValues(VALUES)
        self.values.update({name: self.values[name] * faster[at] for name, at in FASTER.items()})
        self.last: Any = None
        self.run(*self.filling)

    @property
    def filling(self) -> tuple[str, ...]:
        return (
            f"Charge at C/3 until {FULL_V} V",
            f"Hold at {FULL_V} V until C/50",
            "Rest for 1 hour",
        )

    def run(self, *steps: Any, period: str = "60 seconds") -> list[Any]:
        """The solutions of some steps."""
        import pybamm

        experiment = pybamm.Experiment([tuple(steps)], period=period)
        made = pybamm.Simulation(self.model, parameter_values=self.values, experiment=experiment)
        self.last = made.solve(starting_solution=self.last and self.last.last_state)
        return self.last.cycles[-1].steps

    def driven(self, seed: int, charge_ah: float) -> dict[str, np.ndarray]:
        """A drive, each level of which holds until the next sample."""
        import pybamm

        current_a = drive_a(seed, charge_ah)
        time_s = STEP_S * np.arange(SAMPLES)
        edges_s = np.stack([time_s, time_s + STEP_S - EDGE_S], axis=1).ravel()
        profile = np.column_stack([edges_s, np.repeat(current_a, 2)])
        step = pybamm.step.current(profile, duration=time_s[-1] + 1.0, period=STEP_S)
        (found,) = self.run(step)
        shown_s = found["Time [s]"].entries - found["Time [s]"].entries[0]
        places = np.searchsorted(shown_s, time_s - 1e-3)
        assert np.allclose(shown_s[places], time_s, atol=1e-3)
        assert np.allclose(found["Current [A]"].entries[places], current_a, atol=1e-3)
        noise_v = NOISE_V * np.random.default_rng([seed, 1]).standard_normal(SAMPLES)
        return {
            "Time [s]": time_s,
            "Current [A]": -current_a,
            "Voltage [V]": found["Voltage [V]"].entries[places] + noise_v,
        }

    def checked(self, seed: int, depth: float | None = None) -> Aged:
        """What is true of it now, and a drive."""
        slow = self.run(f"Discharge at C/20 until {EMPTY_V} V", "Rest for 1 hour", *self.filling)[0]
        capacity_ah = float(np.ptp(slow["Discharge capacity [A.h]"].entries))
        half = f"Discharge at {NOMINAL_AH / 3} A for {0.5 * capacity_ah / (NOMINAL_AH / 3)} hours"
        *_, rest, pulse = self.run(
            half, "Rest for 2 hours", f"Discharge at {NOMINAL_AH} A for 10 seconds"
        )
        dropped_v = rest["Voltage [V]"].entries[-1] - pulse["Voltage [V]"].entries[0]
        self.run(*self.filling)
        share = depth or float(np.random.default_rng([seed, 2]).uniform(0.6, 0.75))
        drive = self.driven(seed, share * capacity_ah)
        self.run(*self.filling)
        return Aged(capacity_ah, float(dropped_v / NOMINAL_AH), drive)

    def cycled(self, cycles: int) -> None:
        """The same, so many full cycles later."""
        for _ in range(cycles):
            self.run(f"Discharge at 1C until {EMPTY_V} V", *self.filling)


def ageing(number: int) -> Iterator[Aged]:
    """A cell at every age. Those of one mode age at rates of their own."""
    faster = list(MODES.values())[number % len(MODES)]
    rate = 0.8 + 0.4 * (number // len(MODES))
    cell = PhysicalCell(tuple(rate * each if each > 1 else each for each in faster))
    for block in range(BLOCKS):
        if block:
            cell.cycled(CYCLES)
        yield cell.checked(100 * number + block)


def record_of(drive: dict[str, np.ndarray], name: str) -> barnax.Record:
    """A drive as a file's record."""
    options = {"current_sign": "charge-positive", "current_hold": "forward"}
    return barnax.record_from_frame(drive, name=name, **options)


def fresh_cell() -> tuple[Any, float]:
    """What drives of a new cell tell of it, and its capacity."""
    cell = PhysicalCell()
    drives = [cell.checked(seed, depth=0.97) for seed in FRESH_SEEDS]
    capacity_ah = drives[0].capacity_ah
    found = barnax.identify(
        [record_of(aged.drive, f"fresh{place}") for place, aged in enumerate(drives)],
        seeds=0,
        trust="none",
        window=barnax.Window(initial_soc=1.0, capacity_ah=capacity_ah),
    )
    return found.cell, capacity_ah


def rows_of(number: int, cell: Any, capacity_ah: float) -> Iterator[dict[str, tuple[float, ...]]]:
    """Of every age of a cell: estimate, both ends of its interval and truth, by quantity."""
    window = barnax.Window(initial_soc=1.0, capacity_ah=capacity_ah)
    for place, aged in enumerate(ageing(number)):
        record = record_of(aged.drive, f"{number}-{place}")
        row = ageing_row([prepare_record(record, cell, "so-rc", window)])
        truths = {"capacity [A.h]": aged.capacity_ah, "R0 [Ohm]": aged.r0_ohm}
        yield {
            name: (row[f"aged {name}"], row[f"aged {name} low"], row[f"aged {name} high"], truth)
            for name, truth in truths.items()
            if row[f"aged {name}"] is not None
        }


def main() -> None:
    """Measure, print the page and write it."""
    cells = int(sys.argv[1]) if len(sys.argv) > 1 else CELLS
    began, rows = time.perf_counter(), []
    cell, capacity_ah = fresh_cell()
    for number in range(cells):
        rows += rows_of(number, cell, capacity_ah)
        print(f"{number + 1} of {cells}", file=sys.stderr)
    names = "quantity", "told", "off, median", "in 95 %", "within", "intervals hold"
    table = [f"| {' | '.join(names)} |", "|---" * len(names) + "|"]
    for name, near in WITHIN.items():
        value, low, high, truth = np.array([row[name] for row in rows if name in row]).T
        off, told = value / truth - 1, len(value) / len(rows)
        held = np.mean((low <= truth) & (truth <= high))
        table.append(
            f"| {name} | {100 * told:.0f} % | {100 * np.median(off):+.2f} % "
            f"| {100 * np.quantile(np.abs(off), 0.95):.2f} % "
            f"| {100 * np.mean(np.abs(off) <= near):.0f} % within {100 * near:g} % "
            f"| {100 * held:.0f} % |"
        )
    fades = [row["capacity [A.h]"][3] / capacity_ah for row in rows if "capacity [A.h]" in row]
    lines = [
        "# Ageing of cells that are no circuits",
        "",
        as_markdown(provenance(f"python -m benchmarks.life_physics {cells}", 0)),
        "",
        f"{cells} cells of {VALUES}, each at {BLOCKS} ages and with one drive of "
        f"{SAMPLES * STEP_S / 3600:.1f} h at each, from full. SEI, and with it loss of the "
        "negative electrode, of the positive one, or of both; capacities fall to "
        f"{100 * min(fades):.0f} %. No OCV test: three drives of a new cell told the OCV. The "
        "truth of a capacity is a discharge at C/20, that of R0 the step of the voltage at half "
        "charge. "
        f"It took {time.perf_counter() - began:.0f} s.",
        "",
        *table,
    ]
    publish(RESULTS, "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
