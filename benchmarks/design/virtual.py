"""Virtual cells with known truth: a designed test beside an HPPC of half a day."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

import barnax
from barnax.bundled import bundled_file
from barnax.cell import CellModel, CircuitParameters, characterize
from barnax.experiment import Design
from barnax.experiment.belief import believed_of_fit, counting
from barnax.experiment.protocol import hppc_steps, sampled
from barnax.model.prepared import PreparedRecord, Window, prepare_record
from barnax.model.reference import simulate_circuit
from barnax.over_soc.fit import TableFit, fit_tables, pooled_errors
from barnax.over_soc.fitted_ocv import prove_with_ocv
from barnax.over_soc.problem import find_best, reduced_objective
from barnax.over_soc.starts import UntestedRecords
from barnax.records import Decision, Record, read_record
from barnax.reporting.design import reached_half
from barnax.search.evaluate import evaluate
from benchmarks.coverage.simulated import Noise

SEED = 30
DISCHARGE_C, CHARGE_C = 2.0, 1.0
RATES = {"max_discharge": DISCHARGE_C, "max_charge": CHARGE_C}
SETTINGS = barnax.TableSettings(folds=0, max_boxes=0, resistances_follow="none")
WINDOW = Window(initial_soc=1.0, initial_direction=1)
GAMMA, SHARES, LONGEST_H = 30.0, (6, 10), 3.0
FINE, EMPTY_SOC = np.linspace(-0.05, 1.0, 211), 0.08
TABLES = ("R0", "R1", "R2")
Row = dict[str, float | str]


@dataclass(frozen=True)
class Truth:
    """A virtual cell: tables, and the noise of its records."""

    cell: CellModel
    tables: CircuitParameters
    noise: Noise
    rng: np.random.Generator

    def without_noise(self, name: str, current_a: np.ndarray) -> Record:
        """The true voltage that a current from a full cell makes."""
        blank = as_record(name, current_a, np.full(len(current_a), 3.0))
        prepared = prepare_record(blank, self.cell, "esc", WINDOW, is_measured=False)
        return replace(blank, voltage_v=simulate_circuit(prepared, self.tables))

    def tested(self, name: str, current_a: np.ndarray) -> Record:
        """The record of a current from a full cell."""
        noise_v = self.noise.draw(self.rng, 1, len(current_a))[0]
        true = self.without_noise(name, current_a)
        return replace(true, voltage_v=true.voltage_v + noise_v)


def as_record(name: str, current_a: np.ndarray, voltage_v: np.ndarray) -> Record:
    """A record of a sample a second, whose currents hold until the next."""
    hold = Decision("forward", "given", "made so")
    sign = replace(hold, value="discharge-positive")
    second = np.arange(len(current_a))
    return Record(
        name, second.astype(float), current_a, voltage_v, None, None, second + 2, sign, hold, ""
    )


def curve(rng: np.random.Generator) -> np.ndarray:
    """A few waves over SOC with random phases, about one in size."""
    waves = np.arange(1, 5)
    sizes, phases = rng.normal(size=4) / waves, rng.uniform(0, 2 * np.pi, 4)
    return sizes @ np.sin(np.pi * waves[:, None] * FINE + phases[:, None])


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


def drive_of(capacity_ah: float) -> np.ndarray:
    """A drive cycle that nothing is identified on, down to 8 % SOC."""
    current_a = read_record(bundled_file("validation")).current_a * capacity_ah / 2.0
    whole = np.tile(current_a, 2)
    return whole[: int(np.argmax(np.cumsum(whole) / 3600 > 0.92 * capacity_ah)) or len(whole)]


def prepared_for(record: Record, cell: CellModel, circuit: str = "esc") -> PreparedRecord:
    """A record that starts full."""
    return prepare_record(record, cell, circuit, WINDOW)


def with_ocv(cell: CellModel, *records: Record) -> TableFit:
    """Tables of records with the OCV test's cell."""
    return fit_tables([prepared_for(record, cell) for record in records], SETTINGS)


def without_ocv(record: Record, capacity_ah: float, drive: Record) -> float:
    """The RMSE in V on the drive of tables and OCV of a record alone."""
    alone = UntestedRecords.of([record], {record.name: WINDOW}, SETTINGS, capacity_ah)
    starts = alone.starts("so-rc")
    prepared = alone.prepared("so-rc", starts.windows)
    objective = reduced_objective(prepared, alone.settings_of("so-rc"))
    own = prove_with_ocv(alone, objective, find_best(objective), starts)
    return pooled_errors([prepared_for(drive, own.cell, "so-rc")], own.fit.tables).rmse_v


def medians_of(fit: TableFit, truth: CircuitParameters) -> dict[str, float]:
    """Of the nodes from 10 to 90 % SOC: half the intervals of each resistance, relative, infinite
    where open, as medians; the share that holds the truth; and how many times as wide they would
    have to be for an RMS of the errors that fits them."""
    found, errors = {}, []
    for name in TABLES:
        halves = []
        for node in fit.of_table(f"{name} [Ohm]"):
            if node.soc is None or not 0.1 <= node.soc <= 0.9:
                continue
            if node.low is None or node.high is None or not node.value:
                halves.append(np.inf)
                continue
            true = float(truth.at(node.name, np.array([node.soc]))[0])
            half, middle = (node.high - node.low) / 2, (node.high + node.low) / 2
            halves.append(half / node.value)
            errors.append((true - middle) / half)
        found[name] = float(np.median(halves))
    found["held"] = float(np.mean(np.abs(errors) <= 1))
    found["needed"] = 1.96 * float(np.sqrt(np.mean(np.square(errors))))
    return found


def promised(design: Design, fit: TableFit, is_alone: bool) -> dict[str, float]:
    """The medians over nodes of reached over promised."""
    found = {}
    for name in TABLES:
        ratios = [
            np.inf if reached is None else reached / (width.alone if is_alone else width.after)
            for width in design.of_table(name)
            for reached in [reached_half(fit, width)]
        ]
        found[name] = float(np.median(ratios))
    return found


def virtual_row(number: int) -> Row:
    """All that one virtual cell shows: `v` are errors on the drive in V, `true` those without the
    drive's own noise, of what was identified on: HPPC alone and with the known drive, each test
    with that, the longer one alone."""
    truth = truth_of(number)
    capacity_ah, chemistry = truth.cell.capacity_ah, "lfp" if number % 2 else "nmc"
    drive = truth.tested("drive", drive_of(capacity_ah))
    prepared_drive = prepared_for(drive, truth.cell)
    true_drive = prepared_for(truth.without_noise("true", drive.current_a), truth.cell)
    steps = hppc_steps(capacity_ah, DISCHARGE_C * capacity_ah, CHARGE_C * capacity_ah)
    hppc = truth.tested("hppc", sampled(steps))
    known = truth.tested("known", known_of(capacity_ah))
    hppc_h = len(hppc.time_s) / 3600
    row: Row = {"cell": f"{chemistry} {capacity_ah:.3g} Ah", "hppc_h": hppc_h}

    def identified(what: str, *records: Record) -> TableFit:
        fit = with_ocv(truth.cell, *records)
        row[f"v {what}"] = pooled_errors([prepared_drive], fit.tables).rmse_v
        row[f"true {what}"] = pooled_errors([true_drive], fit.tables).rmse_v
        row.update({f"{key} {what}": value for key, value in medians_of(fit, truth.tables).items()})
        return fit

    identified("hppc", hppc)
    identified("hppc known", hppc, known)
    fit = identified("known", known)
    seen = evaluate(prepared_for(known, truth.cell), fit.tables)
    rmse_v = fit.errors[0].rmse_v
    believed = counting(believed_of_fit(fit, SETTINGS, truth.cell, rmse_v), [seen])
    for share in SHARES:
        test = barnax.design(believed, max_hours=hppc_h / share, want="hppc", **RATES)
        current_a = sampled(test.steps)
        record = truth.tested("test", current_a)
        over_v = record.voltage_v[current_a < 0].max(initial=0) - test.limits.high_v
        row[f"beyond {share}"] = max(test.limits.low_v - record.voltage_v.min(), over_v, 0.0)
        fits = {"known": identified(f"{share} known", record, known)}
        if share == SHARES[0]:
            fits["alone"] = identified(f"{share} alone", record)
        for what, fit in fits.items():
            for name, ratio in promised(test, fit, what == "alone").items():
                row[f"ratio {name} {share} {what}"] = ratio
    first = barnax.design(capacity=capacity_ah, chemistry=chemistry, max_hours=LONGEST_H, **RATES)
    record = truth.tested("first", sampled(first.steps))
    row["v first"] = without_ocv(record, capacity_ah, drive)
    return row


def virtual_lines(rows: Sequence[Row]) -> list[str]:
    """The section of the virtual cells."""

    def values(key: str, of: Sequence[Row]) -> np.ndarray:
        return np.array([row[key] for row in of], float)

    def share(holds: np.ndarray) -> str:
        return f"{100 * np.mean(holds):.0f} %"

    tests = [f"{SHARES[0]} known", f"{SHARES[1]} known", f"{SHARES[0]} alone"]
    errors = {"v": "", "true": " from the true voltage"}
    beside_hppc = {"hppc known": "HPPC's with the drive", "hppc": "HPPC's without the drive"}

    def compared(own: Sequence[Row], hppc: str) -> dict[str, list[str]]:
        """In which share of the cells each test is as good as the HPPC, by what."""
        beside = beside_hppc[hppc]
        narrow = [
            np.all([values(f"{n} {test}", own) <= values(f"{n} {hppc}", own) for n in TABLES], 0)
            for test in tests
        ]
        found = {f"95 % intervals of R0, R1 and R2 no wider than {beside}": narrow}
        for key, from_what in errors.items() if hppc == "hppc" else [*errors.items()][:1]:
            error = [values(f"{key} {t}", own) / values(f"{key} {hppc}", own) for t in tests]
            found |= {
                f"error{from_what} no larger than {beside}": [ratio <= 1 for ratio in error],
                f"both{from_what}, than {beside}": [
                    one & (ratio <= 1) for one, ratio in zip(narrow, error, strict=True)
                ],
                f"error{from_what} up to 1.1 times {beside}": [ratio <= 1.1 for ratio in error],
            }
        return {what: [share(holds) for holds in held] for what, held in found.items()}

    wide, larger, both, tenth = (held[0] for held in compared(rows, "hppc known").values())
    lines = [
        f"## {len(rows)} virtual cells",
        "",
        "Of every cell an OCV test and a drive cycle of 5.5 h are known, and the next test is "
        "designed from them, to tell what an HPPC would (12.7 h, an hour of rest each 10 %). Tests "
        f"and pulses go up to {DISCHARGE_C:g}C and {CHARGE_C:g}C. The test is identified with the "
        "drive cycle that is known, or alone; the HPPC alone, and with the drive cycle too. Shares "
        "of cells, and medians; errors are on another drive cycle, whose record has noise of "
        "its own, and those from the true voltage are without that noise.",
        "",
        "On equal terms, both with the drive cycle, the test of a sixth of the hours has intervals "
        f"no wider than HPPC's in {wide} of the cells, an error no larger in {larger}, both in "
        f"{both}, and an error up to 1.1 times as large in {tenth}.",
        "",
        "| | 1/6 of the hours, with the drive | 1/10, with the drive | 1/6, alone |",
        "|---|---|---|---|",
    ]
    kinds = {"all": rows, "NMC": rows[::2], "LFP": rows[1::2]}
    for kind, own in ((kind, own) for kind, own in kinds.items() if own):
        for hppc in beside_hppc:
            for what, held in compared(own, hppc).items():
                lines.append(f"| {kind}: {what} | {' | '.join(held)} |")
        for key, from_what in errors.items():
            medians_mv = [1e3 * np.median(values(f"{key} {test}", own)) for test in tests]
            cells = " | ".join(f"{median_mv:.2f} mV" for median_mv in medians_mv)
            lines.append(f"| {kind}: error{from_what} | {cells} |")
    for name in TABLES:
        cells = [f"{100 * np.median(values(f'{name} {test}', rows)):.2g} %" for test in tests]
        lines.append(f"| half the interval of {name} | {' | '.join(cells)} |")
    for name in TABLES:
        ratios = [values(f"ratio {name} {test}", rows) for test in tests]
        cells = [
            f"{np.median(ratio):.2f} ({share((ratio >= 0.8) & (ratio <= 1.25))})"
            for ratio in ratios
        ]
        lines.append(f"| {name}: reached over promised (within 25 %) | {' | '.join(cells)} |")
    cells = [f"{100 * np.median(values(f'held {test}', rows)):.0f} %" for test in tests]
    lines.append(f"| intervals that hold the truth | {' | '.join(cells)} |")
    cells = [f"{np.max(values(f'needed {test}', rows)):.2f}" for test in tests]
    lines.append(f"| widths needed over given, at most | {' | '.join(cells)} |")
    beyond = [1e3 * np.max(values(f"beyond {share_of}", rows)) for share_of in SHARES]
    lines.append(
        f"| beyond a limit of voltage, at most | {beyond[0]:.1f} mV | {beyond[1]:.1f} mV | |"
    )
    usual = [
        f"{what}: error {1e3 * np.median(values(f'v {key}', rows)):.2f} mV, half the intervals "
        + ", ".join(f"{100 * np.median(values(f'{n} {key}', rows)):.2g}" for n in TABLES)
        + " %"
        for key, what in (
            ("hppc", "HPPC"),
            ("hppc known", "with the drive"),
            ("known", "the drive"),
        )
    ]
    ratio = values("v first", rows) / values("v hppc", rows)
    return [
        *lines,
        "",
        "; ".join(usual) + ". From the true voltage, "
        f"HPPC: {1e3 * np.median(values('true hppc', rows)):.2f} mV, "
        f"the drive: {1e3 * np.median(values('true known', rows)):.2f} mV.",
        "",
        f"From capacity and chemistry alone, a test of {LONGEST_H:g} h without an OCV test leaves "
        f"{1e3 * np.median(values('v first', rows)):.2f} mV on the drive, {np.median(ratio):.2f} "
        f"times what OCV test and HPPC leave (up to 1.1 times in {share(ratio <= 1.1)} of the "
        "cells). These cells are circuits, and their errors are drawn without regard to the "
        "current: only time lessens what the slow ones do to the OCV.",
        "",
    ]
