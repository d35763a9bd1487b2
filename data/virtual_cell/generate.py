"""Simulate the virtual cell and write its four records as Parquet files.

    pip install barnax[data]
    python data/virtual_cell/generate.py --out FOLDER

Each new file is compared with the one that ships beside this script. Takes about four minutes.
"""

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pybamm
from cell_model import LOWER_CUTOFF_V, NOMINAL_CAPACITY_AH, UPPER_CUTOFF_V, build_simulation
from profiles import as_breakpoints, identification_current, validation_current

SHIPPED = Path(__file__).resolve().parent
HALF_RATE_A = NOMINAL_CAPACITY_AH / 2
SLOW_RATE_A = NOMINAL_CAPACITY_AH / 20
PULSE_S = 360
MOST_PULSES = 30
NOISE_SEEDS = {
    "ocv_charge": 20240621,
    "ocv_discharge": 20240631,
    "identification": 20240641,
    "validation": 20240651,
}
VOLTAGE_NOISE_V = 1e-3
CURRENT_NOISE_A = 2e-3
DECIMALS = 4
CHARGE_VOLTAGE = f"{UPPER_CUTOFF_V} V"
DISCHARGE_VOLTAGE = f"{LOWER_CUTOFF_V} V"

CHARGE_FULLY = [
    pybamm.step.current(-HALF_RATE_A, termination=CHARGE_VOLTAGE, duration=6 * 3600, period="10 s"),
    pybamm.step.voltage(
        UPPER_CUTOFF_V, termination=f"{SLOW_RATE_A} A", duration=4 * 3600, period="10 s"
    ),
    pybamm.step.rest(7200, period="60 s"),
]
DISCHARGE_FULLY = [
    pybamm.step.current(
        SLOW_RATE_A, termination=DISCHARGE_VOLTAGE, duration=40 * 3600, period="60 s"
    ),
    pybamm.step.rest(7200, period="60 s"),
]
LONG_REST = [pybamm.step.rest(300, period="1 s"), pybamm.step.rest(6900, period="30 s")]


def condition() -> tuple[Any, float]:
    """The full, rested cell after two slow cycles, and its C/20 discharge capacity in Ah.

    Two cycles give the hysteresis states a history; the capacity is the second discharge's.
    """
    cycle = [*DISCHARGE_FULLY, *CHARGE_FULLY]
    steps = build_simulation(cycle * 2).solve().cycles[-1].steps
    passed_ah = steps[len(cycle)]["Discharge capacity [A.h]"].entries[-1]
    before_ah = steps[len(cycle) - 1]["Discharge capacity [A.h]"].entries[-1]
    return steps[-1].last_state, float(passed_ah - before_ah)


def pulse_rest_test(start: Any, current_a: float) -> list[Any]:
    """The steps of an OCV test at C/2: pulses of 5 % and rests of 2 h up to the cut-off.

    `current_a` is discharge-positive. The cell is then brought to its end point: full at constant
    voltage, or empty at C/20, and rests again.
    """
    charging = current_a < 0
    pulse = pybamm.step.current(
        current_a,
        duration=PULSE_S,
        termination=CHARGE_VOLTAGE if charging else DISCHARGE_VOLTAGE,
        period="1 s",
    )
    to_the_end = (
        pybamm.step.voltage(
            UPPER_CUTOFF_V, termination=f"{SLOW_RATE_A} A", duration=4 * 3600, period="10 s"
        )
        if charging
        else pybamm.step.current(
            SLOW_RATE_A, termination=DISCHARGE_VOLTAGE, duration=4 * 3600, period="10 s"
        )
    )
    steps = _run([pybamm.step.rest(60, period="1 s")], start)
    one_pulse = build_simulation([pulse, *LONG_REST])
    for _ in range(MOST_PULSES):
        latest = one_pulse.solve(starting_solution=steps[-1].last_state).cycles[-1].steps
        steps += latest
        if "event" in str(latest[0].termination):
            break
    return steps + _run([to_the_end, *LONG_REST], steps[-1].last_state)


def dynamic_test(start: Any, current_a: np.ndarray) -> list[Any]:
    """The one step of a profile given each second."""
    rows = as_breakpoints(current_a)
    profile = pybamm.step.current(rows, period="1 s", duration=rows[-1, 0])
    return _run([profile], start)[:1]


def exact_values(steps: Iterable[Any]) -> pl.DataFrame:
    """Time from 0, current and voltage without noise, discharge positive, of all the steps.

    Where two steps meet in one instant, the earlier one's sample stays.
    """
    names = {"time_s": "Time [s]", "current_a": "Current [A]", "voltage_v": "Voltage [V]"}
    frames = [
        pl.DataFrame({name: step[variable].entries for name, variable in names.items()})
        for step in steps
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
    return pl.DataFrame(
        {
            "Test Time / s": table["time_s"],
            "Current / A": np.round(-table["current_a"].to_numpy() + current_noise_a, DECIMALS),
            "Voltage / V": np.round(table["voltage_v"].to_numpy() + voltage_noise_v, DECIMALS),
        }
    )


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


def main() -> None:
    """Run the tests one after another from the same conditioned cell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the four files")
    folder: Path = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    pybamm.set_logging_level("ERROR")

    full, capacity_ah = condition()
    print(f"capacity at C/20: {capacity_ah:.4f} Ah", flush=True)
    empty = _run(DISCHARGE_FULLY, full)[-1].last_state
    tests = {
        "ocv_charge": lambda: exact_values(pulse_rest_test(empty, -HALF_RATE_A)),
        "ocv_discharge": lambda: exact_values(pulse_rest_test(full, HALF_RATE_A)),
        "identification": lambda: on_whole_seconds(
            exact_values(dynamic_test(full, identification_current(NOMINAL_CAPACITY_AH)))
        ),
        "validation": lambda: on_whole_seconds(
            exact_values(dynamic_test(full, validation_current(NOMINAL_CAPACITY_AH)))
        ),
    }
    for name, run_test in tests.items():
        record = measured(run_test(), NOISE_SEEDS[name])
        record.write_parquet(folder / f"{name}.parquet", compression="zstd")
        verdict = compared(record, pl.read_parquet(SHIPPED / f"{name}.parquet"))
        print(f"{name}: {record.height} samples; {verdict}", flush=True)


def _run(steps: list[Any], start: Any) -> list[Any]:
    return list(build_simulation(steps).solve(starting_solution=start).cycles[-1].steps)


if __name__ == "__main__":
    main()
