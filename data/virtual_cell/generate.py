"""Simulate the two virtual cells and write their records as Parquet files.

    pip install barnax[data]
    python data/virtual_cell/generate.py --out FOLDER

Each new file is compared with the one that ships beside this script. Takes about ten minutes.
"""

import argparse
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pybamm
from cell_model import NICKEL_CELL, PHOSPHATE_CELL, VirtualCell
from profiles import as_breakpoints, identification_current, validation_current

SHIPPED = Path(__file__).resolve().parent
PULSE_S = 360
MOST_PULSES = 30
NOISE_SEEDS = {
    "ocv_charge": 20240621,
    "ocv_discharge": 20240631,
    "identification": 20240641,
    "validation": 20240651,
    "hppc_10degC": 20240661,
    "hppc_25degC": 20240671,
    "hppc_40degC": 20240681,
    "lfp_ocv_charge": 20240691,
    "lfp_ocv_discharge": 20240701,
    "lfp_identification": 20240711,
    "lfp_validation": 20240721,
}
HPPC_DEGC = (10.0, 25.0, 40.0)
HPPC_LEVELS = 10
# Seconds and current in units of 1C of each pulse, discharge positive, and the rest after it.
HPPC_PULSES = ((30, 1.0, 40), (10, -0.75, 40), (10, 2.0, 40), (10, -1.5, 600))
VOLTAGE_NOISE_V = 1e-3
CURRENT_NOISE_A = 2e-3
TEMPERATURE_NOISE_K = 0.05
DECIMALS = 4
TEMPERATURE_DECIMALS = 1
LONG_REST = [pybamm.step.rest(300, period="1 s"), pybamm.step.rest(6900, period="30 s")]


@dataclass(frozen=True)
class Tester:
    """A cell on a tester: every test starts from a state of the cell and gives steps."""

    cell: VirtualCell

    @property
    def half_rate_a(self) -> float:
        return self.cell.capacity_ah / 2

    @property
    def slow_rate_a(self) -> float:
        return self.cell.capacity_ah / 20

    @property
    def charge_fully(self) -> list[Any]:
        return [
            pybamm.step.current(
                -self.half_rate_a,
                termination=f"{self.cell.upper_v} V",
                duration=6 * 3600,
                period="10 s",
            ),
            self._hold_full(),
            pybamm.step.rest(7200, period="60 s"),
        ]

    @property
    def discharge_fully(self) -> list[Any]:
        return [
            pybamm.step.current(
                self.slow_rate_a,
                termination=f"{self.cell.lower_v} V",
                duration=40 * 3600,
                period="60 s",
            ),
            pybamm.step.rest(7200, period="60 s"),
        ]

    def condition(self) -> tuple[Any, float]:
        """The full, rested cell after two slow cycles, and its C/20 discharge capacity in Ah.

        Two cycles give the hysteresis states a history; the capacity is the second discharge's.
        """
        cycle = [*self.discharge_fully, *self.charge_fully]
        steps = self.cell.simulation(cycle * 2).solve().cycles[-1].steps
        passed_ah = steps[len(cycle)]["Discharge capacity [A.h]"].entries[-1]
        before_ah = steps[len(cycle) - 1]["Discharge capacity [A.h]"].entries[-1]
        return steps[-1].last_state, float(passed_ah - before_ah)

    def empty(self, full: Any) -> Any:
        """The state after a slow discharge from full and a rest."""
        return self._run(self.discharge_fully, full)[-1].last_state

    def pulse_rest_test(self, start: Any, current_a: float) -> list[Any]:
        """The steps of an OCV test at C/2: pulses of 5 % and rests of 2 h up to the cut-off.

        `current_a` is discharge-positive. The cell is then brought to its end point: full at
        constant voltage, or empty at C/20, and rests again.
        """
        charging = current_a < 0
        pulse = pybamm.step.current(
            current_a, duration=PULSE_S, termination=self._cutoff(current_a), period="1 s"
        )
        to_the_end = (
            self._hold_full()
            if charging
            else pybamm.step.current(
                self.slow_rate_a,
                termination=self._cutoff(current_a),
                duration=4 * 3600,
                period="10 s",
            )
        )
        steps = self._run([pybamm.step.rest(60, period="1 s")], start)
        one_pulse = self.cell.simulation([pulse, *LONG_REST])
        for _ in range(MOST_PULSES):
            latest = one_pulse.solve(starting_solution=steps[-1].last_state).cycles[-1].steps
            steps += latest
            if "event" in str(latest[0].termination):
                break
        return steps + self._run([to_the_end, *LONG_REST], steps[-1].last_state)

    def hppc_test(self, full: Any, ambient_degc: float) -> list[Any]:
        """The steps of an HPPC test from full, after 3 h in air of that temperature.

        At ten levels the pulses of `HPPC_PULSES`, cut short at a cut-off; then C/2 for 10 % of the
        capacity and a rest of 1 h; at last C/2 to the lower cut-off and a rest of 1 h.
        """
        pulses = [step for pulse in HPPC_PULSES for step in self._pulse(*pulse)]
        # The pulses take and give charge too: 10 % in all.
        pulses_ah = sum(duration_s * rate for duration_s, rate, _ in HPPC_PULSES) / 3600
        rest_of_level_s = round(
            3600 * (self.cell.capacity_ah / HPPC_LEVELS / self.half_rate_a - pulses_ah)
        )
        hour = [pybamm.step.rest(60, period="1 s"), pybamm.step.rest(3540, period="30 s")]
        steps = self._run([pybamm.step.rest(3 * 3600, period="60 s")], full, ambient_degc)
        one_level = self.cell.simulation(
            [*pulses, self._discharge(rest_of_level_s), *hour], ambient_degc
        )
        for _ in range(HPPC_LEVELS):
            latest = one_level.solve(starting_solution=steps[-1].last_state).cycles[-1].steps
            steps += latest
            if "event" in str(latest[2 * len(HPPC_PULSES)].termination):
                return steps
        last = [self._discharge(3600), *hour]
        return steps + self._run(last, steps[-1].last_state, ambient_degc)

    def dynamic_test(self, start: Any, current_a: np.ndarray) -> list[Any]:
        """The one step of a profile given each second."""
        rows = as_breakpoints(current_a)
        profile = pybamm.step.current(rows, period="1 s", duration=rows[-1, 0])
        return self._run([profile], start)[:1]

    def _hold_full(self) -> Any:
        return pybamm.step.voltage(
            self.cell.upper_v,
            termination=f"{self.slow_rate_a} A",
            duration=4 * 3600,
            period="10 s",
        )

    def _cutoff(self, current_a: float) -> str:
        return f"{self.cell.upper_v if current_a < 0 else self.cell.lower_v} V"

    def _pulse(self, duration_s: int, rate: float, rest_s: int) -> list[Any]:
        current_a = rate * self.cell.capacity_ah
        return [
            pybamm.step.current(
                current_a,
                termination=self._cutoff(current_a),
                duration=duration_s,
                period="0.1 s",
            ),
            pybamm.step.rest(rest_s, period="1 s" if rest_s < 60 else "10 s"),
        ]

    def _discharge(self, duration_s: int) -> Any:
        return pybamm.step.current(
            self.half_rate_a,
            termination=self._cutoff(self.half_rate_a),
            duration=duration_s,
            period="10 s",
        )

    def _run(self, steps: list[Any], start: Any, ambient_degc: float = 25.0) -> list[Any]:
        simulation = self.cell.simulation(steps, ambient_degc)
        return list(simulation.solve(starting_solution=start).cycles[-1].steps)


VALUES = {"time_s": "Time [s]", "current_a": "Current [A]", "voltage_v": "Voltage [V]"}
TEMPERATURE = {"temperature_degc": "X-averaged cell temperature [C]"}


def exact_values(steps: Iterable[Any], names: Mapping[str, str] = VALUES) -> pl.DataFrame:
    """Time from 0 and the other values without noise, discharge positive, of all the steps.

    Where two steps meet in one instant, the earlier one's sample stays.
    """
    frames = [
        pl.DataFrame({name: step[variable].entries for name, variable in names.items()})
        for step in steps
        # A pulse that would begin beyond its cut-off is left out.
        if not isinstance(step, pybamm.EmptySolution)
    ]
    table = pl.concat(frames).unique("time_s", keep="first", maintain_order=True)
    return table.with_columns(pl.col("time_s") - pl.col("time_s").first())


def on_whole_seconds(table: pl.DataFrame) -> pl.DataFrame:
    """Without the samples that lie on the ramps between two seconds."""
    return table.filter((pl.col("time_s") - pl.col("time_s").round()).abs() < 1e-6)


def measured(table: pl.DataFrame, seed: int) -> pl.DataFrame:
    """What a tester would log, in Battery Data Format: noise, then 0.1 mV and 0.1 mA steps.

    Battery Data Format counts a charging current positive.
    """
    rng = np.random.default_rng(seed)
    voltage_noise_v = VOLTAGE_NOISE_V * rng.standard_normal(table.height)
    current_noise_a = CURRENT_NOISE_A * rng.standard_normal(table.height)
    columns = {
        "Test Time / s": table["time_s"],
        "Current / A": np.round(-table["current_a"].to_numpy() + current_noise_a, DECIMALS),
        "Voltage / V": np.round(table["voltage_v"].to_numpy() + voltage_noise_v, DECIMALS),
    }
    if "temperature_degc" in table.columns:
        read_degc = table["temperature_degc"] + TEMPERATURE_NOISE_K * rng.standard_normal(
            table.height
        )
        columns["Surface Temperature / degC"] = np.round(read_degc, TEMPERATURE_DECIMALS)
    return pl.DataFrame(columns)


def compared(new: pl.DataFrame, shipped: pl.DataFrame) -> str:
    """In words, how far two records differ."""
    if new.shape != shipped.shape or new.columns != shipped.columns:
        return f"shape {new.shape}, shipped {shipped.shape}"
    differences = np.abs(new.to_numpy() - shipped.to_numpy()).max(axis=0)
    if not differences.any():
        return "every value equals the shipped one"
    return "largest difference from the shipped file: " + ", ".join(
        f"{difference:.1e} in {name}"
        for name, difference in zip(new.columns, differences, strict=True)
    )


def tests_of(cell: VirtualCell) -> dict[str, Callable[[], pl.DataFrame]]:
    """An OCV test in each direction and two dynamic records, all from one conditioned cell."""
    tester = Tester(cell)
    full, capacity_ah = tester.condition()
    print(f"capacity at C/20: {capacity_ah:.4f} Ah", flush=True)
    empty = tester.empty(full)

    def dynamic(current_a: np.ndarray) -> pl.DataFrame:
        return on_whole_seconds(exact_values(tester.dynamic_test(full, current_a)))

    tests: dict[str, Callable[[], pl.DataFrame]] = {
        "ocv_charge": lambda: exact_values(tester.pulse_rest_test(empty, -tester.half_rate_a)),
        "ocv_discharge": lambda: exact_values(tester.pulse_rest_test(full, tester.half_rate_a)),
        "identification": lambda: dynamic(identification_current(cell.capacity_ah)),
        "validation": lambda: dynamic(validation_current(cell.capacity_ah)),
    }
    if cell is PHOSPHATE_CELL:
        return {f"lfp_{name}": run_test for name, run_test in tests.items()}
    return tests | {
        f"hppc_{degc:.0f}degC": lambda degc=degc: exact_values(
            tester.hppc_test(full, degc), VALUES | TEMPERATURE
        )
        for degc in HPPC_DEGC
    }


def main() -> None:
    """Run the tests of both cells, or of one, one after another."""
    cells = {"nickel": NICKEL_CELL, "lfp": PHOSPHATE_CELL}
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the files")
    parser.add_argument("--cell", choices=cells, action="append", help="only this cell")
    given = parser.parse_args()
    folder: Path = given.out
    folder.mkdir(parents=True, exist_ok=True)
    pybamm.set_logging_level("ERROR")

    tests = {
        name: run_test
        for cell in given.cell or cells
        for name, run_test in tests_of(cells[cell]).items()
    }
    for name, run_test in tests.items():
        record = measured(run_test(), NOISE_SEEDS[name])
        record.write_parquet(folder / f"{name}.parquet", compression="zstd")
        shipped = SHIPPED / f"{name}.parquet"
        verdict = compared(record, pl.read_parquet(shipped)) if shipped.is_file() else "new"
        print(f"{name}: {record.height} samples; {verdict}", flush=True)


if __name__ == "__main__":
    main()
