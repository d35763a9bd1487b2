"""Ageing of cells that are no circuits: `python -m benchmarks.life_physics [CELLS [FOLDER]]`.

PyBaMM's SPMe with a growing SEI and loss of active material, both made faster, so that years pass
in some tens of cycles. Writes benchmarks/results/life_physics.md. What was simulated is kept in the
folder, if one is given, and taken from there.
"""

import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

import barnax
from barnax.fleet.aged import ageing_row
from barnax.life.shapes import with_pooled_shapes
from barnax.model.prepared import prepare_record
from benchmarks.pages import as_markdown, provenance, publish

RESULTS = Path(__file__).parent / "results" / "life_physics.md"
CAPACITY, R0 = "capacity [A.h]", "R0 [Ohm]"
# Within so much of the truth, as `benchmarks.life` counts it.
WITHIN = {CAPACITY: 0.01, R0: 0.02}
CELLS, FRESH_SEEDS = 12, (90_001, 90_002)

VALUES, NOMINAL_AH, FULL_V, EMPTY_V = "OKane2022", 5.0, 4.2, 2.5
STEP_S, SAMPLES, NOISE_V = 5.0, 2000, 1e-3
# Steps of the current take so long.
EDGE_S = 0.02
# Current steps in this range of SOC tell the true R0, those that are larger than this.
NEAR_HALF, LEAST_STEP_A = (0.4, 0.6), 0.05
PULSES_A = (5.0, 2.5, 1.0)
BLOCKS, CYCLES = 5, 18
# What a drive takes of the charge: of a new cell, in part, and before the rest is taken at C/5.
FRESH_DEPTH, PART, TO_EMPTY_DEPTH = 0.97, (0.6, 0.75), 0.85
PARTLY, TO_EMPTY = "from full, over 60 to 75 %", "from full to empty, with a rest"
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
class Drive:
    """A record, and R0 at half charge: of its own current steps, by least squares."""

    time_s: list[float]
    current_a: list[float]
    voltage_v: list[float]
    r0_ohm: float


@dataclass(frozen=True)
class Aged:
    """A cell at one age: its capacity at C/20, what pulses of several currents see at once at half
    charge, and its drives by what they show."""

    capacity_ah: float
    pulses_ohm: dict[str, float]
    drives: dict[str, Drive]


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

    def driven(self, seed: int, charge_ah: float, capacity_ah: float, *tail: str) -> Drive:
        """A drive, each level of which holds until the next sample, and steps after it."""
        import pybamm

        current_a = drive_a(seed, charge_ah)
        time_s = STEP_S * np.arange(SAMPLES)
        edges_s = np.stack([time_s, time_s + STEP_S - EDGE_S], axis=1).ravel()
        profile = np.column_stack([edges_s, np.repeat(current_a, 2)])
        step = pybamm.step.current(profile, duration=time_s[-1] + 1.0, period=STEP_S)
        found, *others = self.run(step, *tail, period=f"{STEP_S} seconds")
        start_s = found["Time [s]"].entries[0]
        shown_s, shown_v = found["Time [s]"].entries - start_s, found["Voltage [V]"].entries
        after, before = (
            np.searchsorted(shown_s, at - 1e-3) for at in (time_s, time_s[1:] - EDGE_S)
        )
        assert np.allclose(shown_s[after], time_s, atol=1e-3)
        assert np.allclose(found["Current [A]"].entries[after], current_a, atol=1e-3)
        passed_ah = np.cumsum(current_a[:-1]) * STEP_S / 3600
        soc, step_a = 1 - passed_ah / capacity_ah, np.diff(current_a)
        near = (soc > NEAR_HALF[0]) & (soc < NEAR_HALF[1]) & (np.abs(step_a) > LEAST_STEP_A)
        columns = np.outer(step_a[near], [1, 0]) + np.outer(
            step_a[near] * (soc[near] - 0.5), [0, 1]
        )
        r0 = np.linalg.lstsq(columns, (shown_v[before] - shown_v[after[1:]])[near])[0][0]
        parts = [(time_s, current_a, shown_v[after])]
        parts += [
            (
                own["Time [s]"].entries - start_s,
                own["Current [A]"].entries,
                own["Voltage [V]"].entries,
            )
            for own in others
        ]
        joined_s, joined_a, joined_v = (
            np.concatenate(values) for values in zip(*parts, strict=True)
        )
        # Of two samples at one time, the later step's.
        kept = np.diff(joined_s, append=np.inf) > 0.5
        noise_v = NOISE_V * np.random.default_rng([seed, 1]).standard_normal(kept.sum())
        return Drive(
            joined_s[kept].tolist(),
            joined_a[kept].tolist(),
            (joined_v[kept] + noise_v).tolist(),
            float(r0),
        )

    def checked(self, seed: int, depth: float | None = None) -> Aged:
        """What is true of it now, and its drives."""
        import pybamm

        slow = self.run(f"Discharge at C/20 until {EMPTY_V} V", "Rest for 1 hour", *self.filling)[0]
        capacity_ah = float(np.ptp(slow["Discharge capacity [A.h]"].entries))
        half = f"Discharge at {NOMINAL_AH / 3} A for {0.5 * capacity_ah / (NOMINAL_AH / 3)} hours"
        steps: list[Any] = [half, "Rest for 2 hours"]
        for pulse_a in PULSES_A:
            pulse = f"Discharge at {pulse_a} A for 20 seconds"
            steps += [pybamm.step.string(pulse, period="1 second"), "Rest for 30 minutes"]
        shown = [step["Voltage [V]"].entries for step in self.run(*steps, *self.filling)]
        pulses_ohm = {
            f"{pulse_a:g} A": float((shown[1 + 2 * place][-1] - shown[2 + 2 * place][0]) / pulse_a)
            for place, pulse_a in enumerate(PULSES_A)
        }
        share = depth or float(np.random.default_rng([seed, 2]).uniform(*PART))
        drives = {PARTLY: self.driven(seed, share * capacity_ah, capacity_ah)}
        self.run(*self.filling)
        tail = f"Discharge at C/5 until {EMPTY_V} V", "Rest for 1 hour"
        to_empty_ah = TO_EMPTY_DEPTH * capacity_ah
        drives[TO_EMPTY] = self.driven(seed + 50, to_empty_ah, capacity_ah, *tail)
        self.run(*self.filling)
        return Aged(capacity_ah, pulses_ohm, drives)

    def cycled(self, cycles: int) -> None:
        """The same, so many full cycles later."""
        for _ in range(cycles):
            self.run(f"Discharge at 1C until {EMPTY_V} V", *self.filling)


def ageing(number: int) -> Iterator[Aged]:
    """A cell at every age. Those of one mode age at rates of their own."""
    faster = list(MODES.values())[number % len(MODES)]
    rate = 0.8 + 0.4 * (number // len(MODES))
    cell = PhysicalCell(tuple(rate * factor if factor > 1 else factor for factor in faster))
    for block in range(BLOCKS):
        if block:
            cell.cycled(CYCLES)
        yield cell.checked(100 * number + block)


def fresh() -> Iterator[Aged]:
    """A new cell."""
    cell = PhysicalCell()
    for seed in FRESH_SEEDS:
        yield cell.checked(seed, depth=FRESH_DEPTH)


def kept(folder: Path | None, name: str, make: Callable[[], Iterator[Aged]]) -> list[Aged]:
    """What is simulated, or was once."""
    path = folder and folder / f"{name}.json"
    if path and path.exists():
        return [
            Aged(**{**row, "drives": {kind: Drive(**own) for kind, own in row["drives"].items()}})
            for row in json.loads(path.read_text())
        ]
    made = list(make())
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps([asdict(aged) for aged in made]))
    return made


def record_of(drive: Drive, name: str) -> barnax.Record:
    """A drive as a file's record."""
    columns = {
        "Time [s]": np.array(drive.time_s),
        "Current [A]": -np.array(drive.current_a),
        "Voltage [V]": np.array(drive.voltage_v),
    }
    options = {"current_sign": "charge-positive", "current_hold": "forward"}
    return barnax.record_from_frame(columns, name=name, **options)


def fresh_cell(ages: list[Aged]) -> Any:
    """What three records of a new cell tell of it, one of which goes to empty."""
    drives = [*(aged.drives[PARTLY] for aged in ages), ages[0].drives[TO_EMPTY]]
    found = barnax.identify(
        [record_of(drive, f"fresh{place}") for place, drive in enumerate(drives)],
        seeds=0,
        trust="none",
        window=barnax.Window(initial_soc=1.0, capacity_ah=ages[0].capacity_ah),
    )
    return found.cell


def rows_of(number: int, ages: list[Aged], kind: str, cell: Any) -> Iterator[dict[str, Any]]:
    """The rows of a cell at every age, with what is true."""
    window = barnax.Window(initial_soc=1.0, capacity_ah=cell.capacity_ah)
    for place, aged in enumerate(ages):
        record = record_of(aged.drives[kind], f"drive{place}")
        row, _ = ageing_row([prepare_record(record, cell, "so-rc", window)])
        truths = {f"true {CAPACITY}": aged.capacity_ah, f"true {R0}": aged.drives[kind].r0_ohm}
        yield {"specimen": str(number), "age": place, **truths, **row}


def line_of(name: str, kind: str, rows: Any) -> str:
    """How good one quantity is."""
    ends = [f"aged {name}", f"aged {name} low", f"aged {name} high", f"true {name}"]
    known = rows.filter(rows[ends[0]].is_not_null()).select(ends).to_numpy().astype(float)
    share = f"| {name}, {kind} | {len(known)} of {len(rows)} "
    if not len(known):
        return share + "| | | | |"
    value, low, high, truth = known.T
    off, near = value / truth - 1, WITHIN[name]
    return (
        f"{share}| {100 * np.median(off):+.2f} % | {100 * np.quantile(np.abs(off), 0.95):.2f} % "
        f"| {np.sum(np.abs(off) <= near)} within {100 * near:g} % "
        f"| {np.sum((low <= truth) & (truth <= high))}, "
        f"{100 * np.median((high - low) / (2 * value)):.1f} % to either side |"
    )


def main() -> None:
    """Measure, print the page and write it."""
    cells = int(sys.argv[1]) if len(sys.argv) > 1 else CELLS
    folder = Path(sys.argv[2]) if len(sys.argv) > 2 else None
    began, fades = time.perf_counter(), []
    rows: dict[str, Any] = {PARTLY: [], TO_EMPTY: []}
    new = kept(folder, "fresh", fresh)
    cell = fresh_cell(new)
    for number in range(cells):
        ages = kept(folder, str(number), lambda number=number: ageing(number))
        fades += [aged.capacity_ah / cell.capacity_ah for aged in ages]
        for kind, own in rows.items():
            own += rows_of(number, ages, kind, cell)
        print(f"{number + 1} of {cells}", file=sys.stderr)
    frames = {kind: pl.DataFrame(own, infer_schema_length=None) for kind, own in rows.items()}
    for kind, own in [*frames.items()]:
        frames[f"{kind}, in a life"] = with_pooled_shapes(own, "specimen", "age", tuple(WITHIN))
    names = "quantity, record", "told", "off, median", "in 95 %", "near", "intervals hold"
    pulses = [f"{1e3 * ohm:.1f} mOhm to {size}" for size, ohm in new[0].pulses_ohm.items()]
    lines = [
        "# Ageing of cells that are no circuits",
        "",
        as_markdown(provenance(f"python -m benchmarks.life_physics {cells}", 0)),
        "",
        f"{cells} cells of {VALUES}, each at {BLOCKS} ages and with two records at each, both from "
        f"full: a drive of {SAMPLES * STEP_S / 3600:.1f} h over 60 to 75 % of the charge, and one "
        f"over {100 * TO_EMPTY_DEPTH:.0f} %, then C/5 to {EMPTY_V} V and a rest of 1 h. SEI, and "
        "with it loss of the negative electrode, of the positive one, or of both; capacities fall "
        f"to {100 * min(fades):.0f} %. No OCV test: three records of a new cell told the OCV, one "
        "of which goes to empty. The truth of a capacity is a discharge at C/20. It took "
        f"{time.perf_counter() - began:.0f} s{', with simulations that were kept' * bool(folder)}.",
        "",
        f"| {' | '.join(names)} |",
        "|---" * len(names) + "|",
        *(line_of(name, kind, own) for name in WITHIN for kind, own in frames.items()),
        "",
        "Electrodes that lose lithium and material change the shape of the OCV, and over 60 to 75 "
        "% of the charge that cannot be told from a change of capacity: hardly any is told. A rest "
        "near empty tells it. In a life, as `barnax life` has it, the records of all cells tell "
        "how much the shape changes, and so how wide intervals are.",
        "",
        "R0 of such a cell depends on the current, by the charge transfer that is in it: the new "
        f"cell's at half charge is {', '.join(pulses)}. So the truth is that of the record's own "
        f"steps of current, between {100 * NEAR_HALF[0]:.0f} and {100 * NEAR_HALF[1]:.0f} % of the "
        "charge, and a circuit with one R0 for all currents is rarely within 2 % of it. Compare "
        "ages under like loads.",
    ]
    publish(RESULTS, "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
