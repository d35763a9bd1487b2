"""Simulate the virtual cell and write its records as Parquet files.

    pip install barnax[data]
    python data/virtual_cell/generate.py --out FOLDER

Each new file is compared with the one that ships beside this script. Takes about ten minutes.
"""

import argparse
from collections.abc import Iterable, Mapping
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
    "hppc_10degC": 20240661,
    "hppc_25degC": 20240671,
    "hppc_40degC": 20240681,
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


def hppc_test(full: Any, ambient_degc: float) -> list[Any]:
    """The steps of an HPPC test from full, after 3 h in air of that temperature.

    At ten levels the pulses of `HPPC_PULSES`, cut short at a cut-off; then C/2 for 10 % of the
    capacity and a rest of 1 h; at last C/2 to 2.5 V and a rest of 1 h.
    """
    pulses = [step for pulse in HPPC_PULSES for step in _pulse(*pulse)]
    # The pulses take and give charge too: 10 % in all.
    pulses_ah = sum(duration_s * rate for duration_s, rate, _ in HPPC_PULSES) / 3600
    rest_of_level_s = round(3600 * (NOMINAL_CAPACITY_AH / HPPC_LEVELS / HALF_RATE_A - pulses_ah))
    hour = [pybamm.step.rest(60, period="1 s"), pybamm.step.rest(3540, period="30 s")]
    steps = _run([pybamm.step.rest(3 * 3600, period="60 s")], full, ambient_degc)
    one_level = build_simulation(
        [*pulses, _discharge(rest_of_level_s), *hour], ambient_degc=ambient_degc
    )
    for _ in range(HPPC_LEVELS):
        latest = one_level.solve(starting_solution=steps[-1].last_state).cycles[-1].steps
        steps += latest
        if "event" in str(latest[2 * len(HPPC_PULSES)].termination):
            return steps
    return steps + _run([_discharge(3600), *hour], steps[-1].last_state, ambient_degc)


def _pulse(duration_s: int, rate: float, rest_s: int) -> list[Any]:
    cutoff = DISCHARGE_VOLTAGE if rate > 0 else CHARGE_VOLTAGE
    current_a = rate * NOMINAL_CAPACITY_AH
    return [
        pybamm.step.current(current_a, termination=cutoff, duration=duration_s, period="0.1 s"),
        pybamm.step.rest(rest_s, period="1 s" if rest_s < 60 else "10 s"),
    ]


def _discharge(duration_s: int) -> Any:
    return pybamm.step.current(
        HALF_RATE_A, termination=DISCHARGE_VOLTAGE, duration=duration_s, period="10 s"
    )


def dynamic_test(start: Any, current_a: np.ndarray) -> list[Any]:
    """The one step of a profile given each second."""
    rows = as_breakpoints(current_a)
    profile = pybamm.step.current(rows, period="1 s", duration=rows[-1, 0])
    return _run([profile], start)[:1]


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


def main() -> None:
    """Run the tests one after another from the same conditioned cell."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the files")
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
    } | {
        f"hppc_{degc:.0f}degC": lambda degc=degc: exact_values(
            hppc_test(full, degc), VALUES | TEMPERATURE
        )
        for degc in HPPC_DEGC
    }
    for name, run_test in tests.items():
        record = measured(run_test(), NOISE_SEEDS[name])
        record.write_parquet(folder / f"{name}.parquet", compression="zstd")
        shipped = SHIPPED / f"{name}.parquet"
        verdict = compared(record, pl.read_parquet(shipped)) if shipped.is_file() else "new"
        print(f"{name}: {record.height} samples; {verdict}", flush=True)


def _run(steps: list[Any], start: Any, ambient_degc: float = 25.0) -> list[Any]:
    simulation = build_simulation(steps, ambient_degc)
    return list(simulation.solve(starting_solution=start).cycles[-1].steps)


if __name__ == "__main__":
    main()
