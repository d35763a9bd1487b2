"""What tables of a drive are worth on a charge: `python -m benchmarks.both_directions FOLDER`.

An LFP cell (A123 26650, in the folder of measured cells): a drive and a C/3 charge, as they are
told and with the drive registered on the OCV test, and hysteresis and resistances that follow the
direction otherwise. Writes benchmarks/results/both_directions.md.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import barnax
from barnax.cell import CellModel, Dependence
from barnax.cell.circuits import CIRCUITS as KNOWN
from barnax.cell.circuits import Circuit, half_hysteresis
from barnax.model.prepared import PreparedRecord, Window, prepare_record
from barnax.over_soc import SocErrors, errors_on, fit_tables, register_alone
from benchmarks.pages import as_markdown, provenance, publish
from benchmarks.real_cells.cases import given_folder

RESULTS = Path(__file__).parent / "results" / "both_directions.md"
CIRCUITS = ("so-rc", "esc", "esc+diffusion")
CHARGE = Window(initial_soc=0.0, initial_direction=-1, score_steps=(11,), score_soc=(0.03, 0.95))
SETTINGS = barnax.TableSettings(max_boxes=0, resistances_follow="none")
# Beside `esc`: the mean of hystereses of two rates,
# of plays (in SOC), and resistances that are so many times as large while charging.
RATES, PLAYS, RATIOS = ((5, 100), (20, 200)), ((0.02,), (0.05,), (0.1,), (0.05, 0.2)), (0.8, 1.25)
FITTED = "fitted on the drive: drive | left out | charge | fitted on both: drive | charge |"


def at_rate(gamma: float, soc: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The state of a hysteresis that follows the charge passed at such a rate."""
    kept, state = np.exp(-gamma * np.abs(np.diff(soc))), [float(direction[0])]
    for share, toward in zip(kept.tolist(), np.sign(np.diff(soc)).tolist(), strict=True):
        state.append(share * state[-1] + (1 - share) * toward)
    return np.array(state)


def played(width: float, soc: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The state of a play operator that has crossed from branch to branch after twice the width."""
    middle, state = float(soc[0] - width * direction[0]), []
    for own in soc.tolist():
        middle = min(max(middle, own - width), own + width)
        state.append((own - middle) / width)
    return np.array(state)


def circuit_of(states: list[Callable], name: str) -> str:
    """A circuit whose hysteresis is the mean of some states, known by its name."""

    def source_v(cell: CellModel, soc: np.ndarray, direction: np.ndarray) -> np.ndarray:
        state = np.mean([own(soc, direction) for own in states], axis=0)
        return cell.average_ocv_v(soc) + state * half_hysteresis(cell, soc)

    KNOWN.add(Circuit(name, f"two RC pairs and {name}", source_v))
    return name


def split(prepared: PreparedRecord, ratio: float) -> PreparedRecord:
    """The record with other resistances while charging."""
    factor = np.where(prepared.current_a < 0, ratio, 1.0)
    return replace(prepared, dependence=Dependence(), resistance_factor=factor)


def main(arguments: list[str]) -> None:
    """Fit all rows, print the page and write it."""
    first, second = _tables(given_folder(arguments) / "plett-a123-26650")
    lines = [
        "# Tables of a drive on a charge",
        "",
        as_markdown(provenance("python -m benchmarks.both_directions FOLDER", 0)),
        "",
        "A123 26650 at 25 degC, RMSE in mV whole (above 10 % SOC), on the drive and on a C/3 "
        "charge from 3 to 95 % SOC; left out are blocks of the drive. Resistances follow SOC "
        "alone. Half of the measured gap is the amplitude of the hysteresis. As told, the drive "
        "starts full and has the charge of the OCV test; registered, it has the start and capacity "
        "at which its tables fit best. The charge is counted over the capacity of the OCV test, "
        "and over that of the registered drive, as `identify` counts records to validate on.",
        "",
        f"| circuit | drive | start [%] | capacity [Ah] | charge over [Ah] | {FITTED}",
        "|---" * 10 + "|",
        *first,
        "",
        "## Other hysteresis, and resistances of their own while charging",
        "",
        "The registered drive, and the charge over its capacity: `esc`, then in its place the mean "
        "of two hystereses whose rates are given, plays that have crossed between the branches "
        "after twice their width in SOC, and `esc` with all resistances at a ratio of those while "
        "discharging.",
        "",
        f"| hysteresis, resistances | {FITTED}",
        "|---" * 6 + "|",
        *second,
        "",
    ]
    publish(RESULTS, "\n".join(lines))


def _tables(place: Path) -> tuple[list[str], list[str]]:
    tests = [barnax.read_record(place / f"ocv-s{part}_25degC.parquet") for part in (1, 3)]
    cell = barnax.characterize(tests, ocv_fit="interpolated")
    drive, charge = (
        barnax.read_record(place / f"dyn-s{part}_25degC.parquet", current_sign="discharge-positive")
        for part in (1, 3)
    )
    full = Window(initial_soc=1.0)
    rows, registered = [], {}
    for circuit in CIRCUITS:
        told = prepare_record(drive, cell, circuit, full)
        own = registered[circuit] = register_alone(told, SETTINGS)
        for name, given, capacity_ah in (
            ("as told", told, None),
            ("registered", own, None),
            ("registered", own, own.capacity_ah),
        ):
            other = prepare_record(charge, cell, circuit, replace(CHARGE, capacity_ah=capacity_ah))
            capacities = f"{given.capacity_ah:.3f} | {other.capacity_ah:.3f}"
            start = f"{100 * given.start.soc:.2f} | {capacities}"
            rows.append(f"| {circuit} | {name} | {start} | {_fitted(given, other)} |")
    known = registered["esc"]
    counted = replace(CHARGE, capacity_ah=known.capacity_ah)

    def tried(
        name: str, circuit: str, seen: Callable[[PreparedRecord], PreparedRecord] = lambda own: own
    ) -> str:
        both = (
            seen(prepare_record(record, cell, circuit, window))
            for record, window in ((drive, known.window), (charge, counted))
        )
        return f"| {name} | {_fitted(*both)} |"

    other_rows = [tried("esc", "esc")]
    for kind, given in (("rates", RATES), ("play", PLAYS)):
        for numbers in given:
            state = at_rate if kind == "rates" else played
            name = f"{kind} {' and '.join(map(str, numbers))}"
            own = circuit_of([partial(state, number) for number in numbers], name)
            other_rows.append(tried(name, own))
    for ratio in RATIOS:
        seen = partial(split, ratio=ratio)
        other_rows.append(tried(f"esc, {ratio} times while charging", "esc", seen))
    return rows, other_rows


def _fitted(drive: PreparedRecord, charge: PreparedRecord) -> str:
    """The errors of tables of the drive, and of tables of both."""
    alone = fit_tables([drive], SETTINGS)
    both = fit_tables([drive, charge], SETTINGS).errors
    held = alone.cross_validation
    errors = [alone.errors[0], held and held.tables, errors_on(charge, alone.tables), *both]
    return " | ".join(map(_errors, errors))


def _errors(errors: SocErrors | None) -> str:
    if errors is None or errors.above_v is None:
        return "-"
    return f"{1e3 * errors.rmse_v:.2f} ({1e3 * errors.above_v:.2f})"


if __name__ == "__main__":
    main(sys.argv[1:])
