"""Is a designed test worth an HPPC? `python -m benchmarks.design [CELLS] [FOLDER]`.

Virtual cells with known truth, half of them of NMC, half of LFP with its moving hysteresis: random
tables that bend over SOC, an error correlated over seconds and minutes, and a capacity. Each is
tested by an HPPC of half a day and by a test designed from capacity and chemistry alone, in a sixth
of the hours. Then PyBaMM's SPMe and DFN as truths that are no circuits, where it is installed, and
measured records, of which the design picks a quarter without seeing the voltage, where their folder
is given. Writes benchmarks/results/design.md.
"""

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import barnax
from barnax.bundled import bundled_file
from barnax.cell import CellModel, CircuitParameters, characterize
from barnax.experiment import Design, Limits
from barnax.experiment.belief import believed_of_chemistry, believed_of_fit
from barnax.experiment.information import (
    Believed,
    Width,
    columns_along,
    information_of,
    widths_of,
)
from barnax.experiment.next_test import DRIVE, WANTED, wishes_of
from barnax.experiment.protocol import hppc_steps, sampled
from barnax.experiment.search import Choice, OnDrive, worst_first
from barnax.model.prepared import PreparedRecord, Window, prepare_record
from barnax.model.reference import simulate_circuit
from barnax.over_soc import TableFit, errors_on, fit_tables, fit_with_ocv
from barnax.records import Decision, Record, read_record
from barnax.reporting.design import pybamm_steps, reached_half
from benchmarks.coverage.simulated import Noise
from benchmarks.pages import as_markdown, provenance, publish
from benchmarks.real_cells.cases import data_folder
from benchmarks.table_coverage import EMPTY_SOC, FINE, curve

RESULTS = Path(__file__).parent / "results" / "design.md"
CELLS, SEED = 18, 30
DISCHARGE_C, CHARGE_C = 2.0, 1.0
SETTINGS = barnax.TableSettings(folds=0, max_boxes=0, resistances_follow="none")
GAMMA, SHARES, LONGEST_H = 30.0, (6, 10), 3.0
# Of HPPC's widths, what is wanted of the test, so that it is not reached by half of the cells.
WANTED_SHARE = 0.8
TABLES = ("R0", "R1", "R2")


@dataclass(frozen=True)
class Truth:
    """A virtual cell: tables, and the noise of its records."""

    cell: CellModel
    tables: CircuitParameters
    noise: Noise
    rng: np.random.Generator

    def tested(self, name: str, current_a: np.ndarray) -> Record:
        """The record of a current from a full cell, until it is empty."""
        given = Decision("forward", "given", "made so")
        sign = replace(given, value="discharge-positive")
        time_s = np.arange(len(current_a), dtype=float)
        row = np.arange(len(current_a)) + 2
        blank = Record(
            name, time_s, current_a, np.full(len(row), 3.0), None, None, row, sign, given, ""
        )
        prepared = prepare_record(blank, self.cell, "esc", WINDOW, is_measured=False)
        voltage_v = simulate_circuit(prepared, self.tables)
        noise_v = self.noise.draw(self.rng, 1, len(voltage_v))[0]
        return replace(blank, voltage_v=voltage_v + noise_v)


WINDOW = Window(initial_soc=1.0, initial_direction=1)


def truth_of(number: int) -> Truth:
    """The virtual cell of that number, NMC and LFP in turn."""
    rng = np.random.default_rng([SEED, number])
    prefix = "lfp_" if number % 2 else ""
    tests = [read_record(bundled_file(f"{prefix}ocv_{way}")) for way in ("charge", "discharge")]
    capacity_ah = float(np.exp(rng.uniform(np.log(1.0), np.log(60.0))))
    cell = replace(characterize(tests, ocv_fit="interpolated"), capacity_ah=capacity_ah)
    empty = np.exp(-np.maximum(FINE, 0.0) / EMPTY_SOC)
    rows = []
    for ohm, spread, rise in ((0.1, 0.1, 0.3), (0.03, 0.2, 1.0), (0.05, 0.2, 1.0)):
        level = ohm / capacity_ah * np.exp(rng.normal(0, 0.3))
        shape = np.exp(spread * curve(rng)) + rise * rng.uniform(0.5, 1.5) * empty
        rows.append(tuple((level * shape).tolist()))
    tau_s = float(np.exp(rng.normal(np.log(12), 0.4))), float(np.exp(rng.normal(np.log(120), 0.4)))
    tables = CircuitParameters.over_soc(
        tuple(FINE.tolist()), tau_s, rows[0], tuple(rows[1:]), gamma=GAMMA
    )
    size = float(np.exp(rng.normal(np.log(3e-3), 0.3)))
    parts = ((0, 0.3 * size), (10, 0.65 * size), (200, 0.7 * size))
    return Truth(cell, tables, Noise("", parts), rng)


def known_of(capacity_ah: float) -> np.ndarray:
    """A drive cycle that is known before the test."""
    current_a = read_record(bundled_file("identification")).current_a
    return current_a * capacity_ah / 2.0


def errors_of(fit: TableFit, name: str) -> np.ndarray:
    """1.96 standard errors of a resistance from 10 to 90 % SOC, relative."""
    return np.array(
        [
            1.96 * each.standard_error / each.value
            if each.low is not None and each.value
            else np.inf
            for each in fit.of_table(f"{name} [Ohm]")
            if each.soc is not None and 0.1 <= each.soc <= 0.9
        ]
    )


def halves_of(fit: TableFit, name: str) -> np.ndarray:
    """Half the intervals of a resistance from 10 to 90 % SOC, relative; infinite where open."""
    return np.array(
        [
            np.inf
            if each.low is None or each.high is None or not each.value
            else (each.high - each.low) / 2 / each.value
            for each in fit.of_table(f"{name} [Ohm]")
            if each.soc is not None and 0.1 <= each.soc <= 0.9
        ]
    )


def held(fit: TableFit, truth: CircuitParameters) -> float:
    """The share of the intervals from 10 to 90 % SOC that hold the truth."""
    return float(
        np.mean(
            [
                each.low <= float(truth.at(each.name, np.array([each.soc]))[0]) <= each.high
                for name in TABLES
                for each in fit.of_table(f"{name} [Ohm]")
                if each.soc is not None and 0.1 <= each.soc <= 0.9
                if each.low is not None and each.high is not None
            ]
        )
    )


def drive_of(capacity_ah: float) -> np.ndarray:
    """A drive cycle that nothing is identified on, down to 8 % SOC."""
    current_a = read_record(bundled_file("validation")).current_a * capacity_ah / 2.0
    whole = np.tile(current_a, 2)
    return whole[: int(np.argmax(np.cumsum(whole) / 3600 > 0.92 * capacity_ah)) or len(whole)]


def ratios(design: Design, fit: TableFit) -> dict[str, float]:
    """The median over nodes of reached over promised."""
    found = {}
    for name in TABLES:
        pairs = [(reached_half(fit, each), each.alone) for each in design.of_table(name)]
        found[name] = float(np.median([np.inf if r is None else r / p for r, p in pairs]))
    return found


def with_ocv(
    record: Record, truth_cell: CellModel, drive: Record, circuit: str = "esc"
) -> tuple[TableFit, float]:
    """Tables of a record with the OCV test's cell, and their RMSE on the drive in V."""
    fit = fit_tables([prepare_record(record, truth_cell, circuit, WINDOW)], SETTINGS)
    return fit, errors_on(prepare_record(drive, truth_cell, circuit, WINDOW), fit.tables).rmse_v


def without_ocv(record: Record, capacity_ah: float, drive: Record) -> tuple[TableFit, float]:
    """Tables and OCV of a record alone, and their RMSE on the drive in V."""
    own = fit_with_ocv([record], "so-rc", {record.name: WINDOW}, SETTINGS, capacity_ah)
    prepared = prepare_record(drive, own.cell, "so-rc", WINDOW)
    return own.fit, errors_on(prepared, own.fit.tables).rmse_v


def virtual_row(number: int) -> dict[str, float | str]:
    """All that one virtual cell shows."""
    truth = truth_of(number)
    capacity_ah, chemistry = truth.cell.capacity_ah, "lfp" if number % 2 else "nmc"
    limits = {"max_discharge": DISCHARGE_C, "max_charge": CHARGE_C, "chemistry": chemistry}
    drive = truth.tested("drive", drive_of(capacity_ah))
    steps = hppc_steps(capacity_ah, DISCHARGE_C * capacity_ah, CHARGE_C * capacity_ah)
    hppc = truth.tested("hppc", sampled(steps))
    hppc_h = len(hppc.time_s) / 3600
    hppc_fit, hppc_v = with_ocv(hppc, truth.cell, drive)
    row: dict[str, float | str] = {"cell": f"{chemistry} {capacity_ah:.3g} Ah", "hppc_v": hppc_v}
    # What a user has: a drive cycle, of which a test is designed that the rest is found by.
    known = truth.tested("known", known_of(capacity_ah))
    known_fit, row["known_v"] = with_ocv(known, truth.cell, drive)
    rmse_v = known_fit.errors[0].rmse_v
    believed = believed_of_fit(known_fit, SETTINGS, truth.cell, rmse_v)
    # The test is identified alone, as the HPPC is.
    believed = replace(believed, known={})
    rates = {"max_discharge": DISCHARGE_C, "max_charge": CHARGE_C}
    asked = barnax.design(believed, want="hppc", starts=1, **rates).wanted
    wanted = {name: WANTED_SHARE * half for name, half in asked.items()}
    for share in SHARES:
        began = time.perf_counter()
        test = barnax.design(believed, max_hours=hppc_h / share, want=wanted, **limits)
        row["seconds"] = time.perf_counter() - began
        record = truth.tested("test", sampled(test.steps))
        low_v, high_v = (
            record.voltage_v.min(),
            record.voltage_v[sampled(test.steps) < 0].max(initial=0),
        )
        row[f"beyond {share}"] = max(test.limits.low_v - low_v, high_v - test.limits.high_v, 0.0)
        fit, row[f"v {share}"] = with_ocv(record, truth.cell, drive)
        row[f"held {share}"] = held(fit, truth.tables)
        for name in TABLES:
            row[f"half {share} {name}"] = float(np.median(halves_of(fit, name)))
            row[f"error {share} {name}"] = float(np.median(errors_of(fit, name)))
        row |= {f"ratio {share} {name}": each for name, each in ratios(test, fit).items()}
    for name in TABLES:
        row[f"half hppc {name}"] = float(np.median(halves_of(hppc_fit, name)))
        row[f"error hppc {name}"] = float(np.median(errors_of(hppc_fit, name)))
    row["held hppc"] = held(hppc_fit, truth.tables)
    first = barnax.design(capacity=capacity_ah, max_hours=LONGEST_H, **limits)
    record = truth.tested("first", sampled(first.steps))
    _, row["v alone"] = without_ocv(record, capacity_ah, drive)
    return row


PHYSICS = (
    ("Prada2013", "SPMe", "lfp"),
    ("Chen2020", "SPMe", "nmc"),
    ("Chen2020", "DFN", "nmc"),
)


def physics_lines() -> list[str]:
    """The section of truths that are no circuits."""
    import pybamm

    pybamm.set_logging_level("ERROR")
    lines = [
        "## PyBaMM's models as the truth",
        "",
        "From capacity and chemistry alone: one test of at most "
        f"{LONGEST_H:g} h and no OCV test, against an OCV test at C/20 in both directions with an "
        "HPPC. RMSE on a drive cycle not used, in mV; 1 mV of white noise.",
        "",
        "| truth | hours | designed test alone | OCV test and HPPC | OCV test and designed test |",
        "|---|---|---|---|---|",
    ]
    return [*lines, *(_physics_line(*each) for each in PHYSICS), ""]


def _physics_line(name: str, kind: str, chemistry: str) -> str:
    """The errors of three ways to identify a PyBaMM model."""
    import pybamm

    rng = np.random.default_rng(SEED)
    values = pybamm.ParameterValues(name)
    low_v, high_v = (float(values[f"{way} voltage cut-off [V]"]) for way in ("Lower", "Upper"))

    def run(label: str, steps: Sequence, soc: float) -> Record:
        made = pybamm.Simulation(
            getattr(pybamm.lithium_ion, kind)(),
            parameter_values=values,
            experiment=pybamm.Experiment([tuple(steps)], period="1 second"),
        )
        found = made.solve(initial_soc=soc)
        time_s = found["Time [s]"].entries
        even_s = np.arange(0.0, np.floor(time_s[-1]))
        place = np.searchsorted(time_s, even_s + 1e-3, "right") - 1
        current_a, voltage_v = (found[key].entries[place] for key in ("Current [A]", "Voltage [V]"))
        noisy_v = voltage_v + 1e-3 * rng.normal(size=len(place))
        given = Decision("forward", "given", "made so")
        sign = replace(given, value="discharge-positive")
        row = np.arange(len(place)) + 2
        return Record(label, even_s, current_a, noisy_v, None, None, row, sign, given, "")

    slow = f"at {float(values['Nominal cell capacity [A.h]']) / 20:.4f} A"
    rest = "Rest for 2 hours"
    down = run("down", [rest, f"Discharge {slow} until {low_v} V", rest], 1.0)
    up = run("up", [rest, f"Charge {slow} until {high_v} V", rest], 0.0)
    capacity_ah = float(down.discharged_ah[-1])
    cell = replace(characterize([down, up], ocv_fit="interpolated"), capacity_ah=capacity_ah)
    current_a = drive_of(capacity_ah)
    current_a = current_a[: round(0.9 * len(current_a))]
    profile = np.column_stack([np.arange(len(current_a), dtype=float), current_a])
    drive = run("drive", [pybamm.step.current(profile, duration=len(current_a) - 1)], 1.0)
    design = barnax.design(
        capacity=capacity_ah, chemistry=chemistry, max_hours=LONGEST_H, low_voltage=low_v,
        high_voltage=high_v, max_discharge=DISCHARGE_C, max_charge=CHARGE_C,
    )  # fmt: skip
    test = run("test", pybamm_steps(design), 1.0)
    steps = hppc_steps(capacity_ah, DISCHARGE_C * capacity_ah, CHARGE_C * capacity_ah)
    hppc = run("hppc", pybamm_steps(design.model_copy(update={"steps": tuple(steps)})), 1.0)
    found = [
        without_ocv(test, capacity_ah, drive)[1],
        with_ocv(hppc, cell, drive)[1],
        with_ocv(test, cell, drive)[1],
    ]
    errors = " | ".join(f"{1e3 * error_v:.2f}" for error_v in found)
    print(name, kind, errors, file=sys.stderr, flush=True)
    return f"| {name}, {kind}, {capacity_ah:.2f} Ah | {design.hours:.2f} | {errors} |"


PIECE_S, QUARTER = 300, 4


def quarter_lines(folder: Path) -> list[str]:
    """The section of measured records of which a quarter is picked by its current alone."""
    place = folder / "lg-hg2-18650"
    cell = characterize([read_record(place / "c20_25degC.parquet")], ocv_fit="interpolated")
    names = ("us06", "mixed1", "la92")
    window = Window(initial_soc=1.0)
    records = {
        name: prepare_record(read_record(place / f"{name}_25degC.parquet"), cell, "so-rc", window)
        for name in names
    }
    lines = [
        "## A quarter of a measured record",
        "",
        f"LG 18650HG2 at 25 degC, its OCV test known. Of each record, the quarter of its pieces of "
        f"{PIECE_S} s that the predicted intervals speak for, by the current alone, with typical "
        "resistances and a typical error: 1.96 standard errors reached over promised, and the RMSE "
        "on the two other records, of that quarter, of every fourth piece and of the whole record.",
        "",
        "| record | R0 | R1 | R2 | picked [mV] | every fourth [mV] | whole [mV] |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, prepared in records.items():
        believed = replace(believed_of_chemistry("nmc", cell.capacity_ah), settings=SETTINGS)
        chosen_s, promised = _quarter(believed, prepared)
        piece = ((prepared.time_s - prepared.time_s[0]) // PIECE_S).astype(int)
        scored = {
            "picked": np.isin(piece, chosen_s),
            "every fourth": piece % QUARTER == QUARTER // 2,
            "whole": piece >= 0,
        }
        fits = {
            each: fit_tables([replace(prepared, scored=prepared.scored & part)], SETTINGS)
            for each, part in scored.items()
        }
        ratio = [
            np.median(
                [
                    reached / each.alone
                    for each in promised
                    if each.name == f"{table} [Ohm]" and each.soc is not None
                    and 0.1 <= each.soc <= 0.9
                    and (reached := reached_half(fits["picked"], each)) is not None
                ]
            )
            for table in TABLES
        ]  # fmt: skip
        others = [each for other, each in records.items() if other != name]
        errors = [
            np.sqrt(np.mean([errors_on(each, fit.tables).rmse_v ** 2 for each in others]))
            for fit in fits.values()
        ]
        cells = [f"{each:.2f}" for each in ratio] + [f"{1e3 * each:.2f}" for each in errors]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return [*lines, ""]


def _quarter(believed: Believed, prepared: PreparedRecord) -> tuple[list[int], tuple[Width, ...]]:
    """The pieces that are left where the least telling one is left out, again and again."""
    even_s = np.arange(0.0, prepared.time_s[-1] - prepared.time_s[0])
    place = np.searchsorted(prepared.time_s - prepared.time_s[0], even_s + 1e-3, "right") - 1
    columns, _ = columns_along(believed, prepared.current_a[place], prepared.start.soc)
    pieces = {
        number: information_of(believed, columns[first : first + PIECE_S])
        for number, first in enumerate(range(0, len(columns), PIECE_S))
    }
    wishes, _ = wishes_of(believed, None)
    whole_record = OnDrive(WANTED[DRIVE], columns.T @ columns / len(columns))
    limits = Limits(2.5, 4.2)
    choice = Choice(believed, limits, (), wishes, worst_first, 1.0, 0.05, whole_record)
    count = len(pieces) // QUARTER
    whole = sum(list(pieces.values())[1:], pieces[0])
    while len(pieces) > count:
        values = {number: choice.value(whole + each.scaled(-1)) for number, each in pieces.items()}
        least = min(values, key=values.__getitem__)
        whole = whole + pieces.pop(least).scaled(-1)
    return [*pieces], widths_of(believed, whole)


def main(arguments: Sequence[str]) -> None:
    """Measure, print the page and write it."""
    cells = int(arguments[0]) if arguments else CELLS
    rows = []
    for number in range(cells):
        rows.append(virtual_row(number))
        print(number, rows[-1], file=sys.stderr, flush=True)
    lines = [
        "# Is a designed test worth an HPPC?",
        "",
        as_markdown(provenance(f"python -m benchmarks.design {cells} [FOLDER]", SEED)),
        "",
        *virtual_lines(rows),
    ]
    folder = data_folder(arguments[1] if len(arguments) > 1 else None)
    lines += physics_lines() if find_spec("pybamm") else []
    lines += [] if folder is None else quarter_lines(folder)
    publish(RESULTS, "\n".join(lines) + "\n")


def virtual_lines(rows: Sequence[dict[str, float | str]]) -> list[str]:
    """The section of the virtual cells."""

    def share(holds: Callable[[dict], bool], of: Sequence[dict] = rows) -> str:
        return f"{100 * np.mean([holds(row) for row in of]):.0f} %"

    def median(key: str, of: Sequence[dict] = rows) -> float:
        return float(np.median([row[key] for row in of]))

    lines = [
        f"## {len(rows)} virtual cells",
        "",
        "A drive cycle and the OCV test are known; the test is designed from the tables of that "
        f"(wanted: {WANTED_SHARE:g} times HPPC's widths), and identified alone, as the HPPC is "
        "(12.7 h, an hour of rest each 10 %). Pulses and test go up to "
        f"{DISCHARGE_C:g}C and {CHARGE_C:g}C. Shares of cells, and medians.",
        "",
        "| | a sixth of the hours | a tenth |",
        "|---|---|---|",
    ]
    kinds = {"all": rows, "NMC": rows[::2], "LFP": rows[1::2]}
    for kind, own in kinds.items():
        if not own:
            continue
        for what, of in (
            ("95 % intervals of R0, R1 and R2 no wider than HPPC's", "half"),
            ("standard errors of R0, R1 and R2 no larger than HPPC's", "error"),
        ):
            cells = [
                share(
                    lambda row, s=s, of=of: all(
                        row[f"{of} {s} {n}"] <= row[f"{of} hppc {n}"] for n in TABLES
                    ),
                    own,
                )
                for s in SHARES
            ]
            lines.append(f"| {kind}: {what} | {' | '.join(cells)} |")
        for factor in (1.0, 1.1):
            cells = [
                share(lambda row, s=s, f=factor: row[f"v {s}"] <= f * row["hppc_v"], own)
                for s in SHARES
            ]
            lines.append(
                f"| {kind}: error on a drive not used up to {factor:g} times HPPC's | "
                f"{' | '.join(cells)} |"
            )
        cells = [
            f"{1e3 * median(f'v {s}', own):.2f} ({1e3 * median('hppc_v', own):.2f}) mV"
            for s in SHARES
        ]
        lines.append(f"| {kind}: that error (HPPC's) | {' | '.join(cells)} |")
    for name in TABLES:
        cells = [
            f"{100 * median(f'error {s} {name}'):.2g} ({100 * median(f'error hppc {name}'):.2g}) %"
            for s in SHARES
        ]
        lines.append(f"| 1.96 standard errors of {name} (HPPC's) | {' | '.join(cells)} |")
        cells = [
            share(lambda row, s=s, n=name: 0.8 <= row[f"ratio {s} {n}"] <= 1.25) for s in SHARES
        ]
        lines.append(f"| {name}: reached within 25 % of promised | {' | '.join(cells)} |")
        cells = [f"{median(f'ratio {s} {name}'):.2f}" for s in SHARES]
        lines.append(f"| {name}: reached over promised | {' | '.join(cells)} |")
    cells = [f"{100 * median(f'held {s}'):.0f} ({100 * median('held hppc'):.0f}) %" for s in SHARES]
    lines.append(f"| intervals that hold the truth (HPPC's) | {' | '.join(cells)} |")
    cells = [f"{1e3 * max(float(row[f'beyond {s}']) for row in rows):.1f} mV" for s in SHARES]
    lines.append(f"| furthest beyond a limit of voltage | {' | '.join(cells)} |")
    ratio = [float(row["v alone"]) / float(row["hppc_v"]) for row in rows]
    lines += [
        "",
        f"A design takes {median('seconds'):.0f} s. From capacity and chemistry alone, a test of "
        f"up to {LONGEST_H:g} h without an OCV test leaves {1e3 * median('v alone'):.2f} mV on the "
        f"drive, {np.median(ratio):.2f} times what OCV test and HPPC leave (up to 1.1 times in "
        f"{100 * np.mean(np.array(ratio) <= 1.1):.0f} % of the cells).",
        "",
    ]
    return lines


if __name__ == "__main__":
    main(sys.argv[1:])
