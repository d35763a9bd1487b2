"""What packs and kept factors cost, and what they find: `python -m benchmarks.packs`, or with the
numbers of some sections."""

import multiprocessing
import os
import resource
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.helpers.packs import PackedCell, alike, drive_a, frame, ocv_table, simulated

import barnax
from barnax.cell.parameters import ANYWHERE
from barnax.fit.factor_file import factors_to_bytes
from barnax.fit.pack import CAPACITY, R0, SHIFT, TOTAL
from barnax.fit.record_factors import Grid, factors_of
from barnax.fleet.dataset import dataset_path, factors_path, keep_file, regrouped, write_rows
from barnax.fleet.engine import identify_fleet
from barnax.model.prepared import PreparedRecord, prepare_record
from barnax.pack import Pack, identify_pack
from benchmarks.pages import as_markdown, provenance, save_page

RESULTS = Path(__file__).parent / "results" / "packs.md"
SAMPLES, CELLS, TURNS = 4500, 96, 1
PACKS, OF_CELLS, TAU_SPREAD = 2, 24, 0.05
STORED, DISTINCT, IN_GROUP = 10_000, 20, 10
STORED_TABLES = 200
ALL_ROWS, PROCESSES = 131_000_000, 2


def identified(cells: list[PackedCell], seed: int, own: bool = False) -> Pack:
    """A pack without an OCV test, whose mean cell's start and capacity are known."""
    current_a = drive_a(SAMPLES, seed=seed)
    table = frame(simulated(cells, current_a, seed=seed), current_a)
    soc = float(np.mean([each.soc for each in cells]))
    capacity_ah = float(np.mean([each.capacity_ah for each in cells]))
    window = barnax.Window(initial_soc=soc)
    return identify_pack(table, capacity=capacity_ah, window=window, separate_time_constants=own)


def times() -> list[str]:
    """Of one cell and of many, as medians of a warm process."""
    rows = {}
    for own in (False, True):
        for count in (1, CELLS):
            # The mean of two equal columns is one cell.
            cells = alike(1) * 2 if count == 1 else alike(count)
            turns = []
            for _ in range(TURNS + 1):
                began = time.perf_counter(), time.process_time()
                identified(cells, 1, own)
                turns.append((time.perf_counter() - began[0], time.process_time() - began[1]))
            rows[own, count] = np.median(turns[1:], axis=0)
    found = []
    for own, aim in ((False, 5), (True, 20)):
        one, many = rows[own, 1], rows[own, CELLS]
        verdict = "met" if many[0] <= aim * one[0] else "missed"
        found.append(
            f"| {'each its own' if own else 'in common'} | {one[0]:.2f} s | {many[0]:.2f} s | "
            f"{many[0] / one[0]:.2f} | {many[1] / one[1]:.2f} | at most {aim} | {verdict} |"
        )
    return found


def truths(cells: list[PackedCell]) -> dict[str, np.ndarray]:
    """What is true of every cell."""
    mean_soc = np.mean([each.soc for each in cells])
    mean_ah = np.mean([each.capacity_ah for each in cells])
    return {
        R0: np.array([each.r0_ohm for each in cells]),
        TOTAL: np.array([each.total_ohm for each in cells]),
        SHIFT: np.array([each.soc - mean_soc for each in cells]),
        CAPACITY: np.array([each.capacity_ah / mean_ah for each in cells]),
    }


def accuracy() -> tuple[list[str], list[str]]:
    """Errors and coverage with time constants in common and each its own, where the cells' are
    alike and where they scatter; and how often a cell is odd where none is."""
    found, false = [], []
    for scatter in (0.0, TAU_SPREAD):
        packs = []
        for seed in range(PACKS):
            rng = np.random.default_rng([7, seed])
            cells = [
                replace(each, tau_s=tuple(t * (1 + scatter * rng.normal()) for t in each.tau_s))
                for each in alike(OF_CELLS, seed)
            ]
            packs.append((cells, seed + 10))
        for own in (False, True):
            results = [(cells, identified(cells, seed, own)) for cells, seed in packs]
            row = [f"{scatter:.0%}", "each its own" if own else "in common"]
            for name in (R0, TOTAL, SHIFT, CAPACITY):
                errors, holds = [], []
                for cells, pack in results:
                    for true, cell in zip(truths(cells)[name], pack.fit.cells, strict=True):
                        if name in cell.values:
                            value = cell.values[name]
                            unit = 1.0 if name in (SHIFT, CAPACITY) else true
                            errors.append((value.value - true) / unit)
                            holds.append(value.low <= true <= value.high)
                row.append(f"{100 * np.sqrt(np.mean(np.square(errors))):.2g} %")
                row.append(f"{np.mean(holds):.0%}")
            found.append(f"| {' | '.join(row)} |")
            odd = len({(p.name, n, e.cell) for n, (_, p) in enumerate(results) for e in p.odd})
            false.append(f"{odd} of {PACKS * OF_CELLS} ({row[1]}, {row[0]})")
    return found, false


def planted() -> str:
    """How many of some planted cells are found, each odd in what was planted."""
    right, wrong, count = 0, 0, 0
    for seed in range(PACKS):
        cells = alike(24, 100 + seed)
        cells[3] = replace(cells[3], r0_ohm=1.15 * cells[3].r0_ohm)
        cells[11] = replace(cells[11], capacity_ah=0.95 * cells[11].capacity_ah)
        cells[17] = replace(cells[17], soc=cells[17].soc - 0.03)
        wanted = {("V4", R0), ("V12", CAPACITY), ("V18", SHIFT)}
        odd = {(each.cell, each.quantity) for each in identified(cells, 30 + seed).odd}
        count += len(wanted)
        right += len(wanted & odd)
        wrong += len({cell for cell, _ in odd} - {cell for cell, _ in wanted})
    return f"{right} of {count} planted cells found, {wrong} others called odd"


def records(count: int, samples: int = SAMPLES) -> list[PreparedRecord]:
    """Logs of one cell, each over a part of the SOC."""
    with tempfile.TemporaryDirectory() as folder:
        ocv_table().write_csv(Path(folder) / "ocv.csv")
        table = barnax.read_ocv_table(Path(folder) / "ocv.csv")
    cell = barnax.characterize([table], capacity_ah=5.0)
    found = []
    for seed in range(count):
        current_a = drive_a(samples, mean_a=2.0, seed=seed)
        start = float(np.random.default_rng(seed).uniform(0.75, 0.97))
        one = replace(PackedCell(), soc=start)
        table = frame(simulated([one], current_a, seed=seed), current_a, name="Voltage [V]")
        record = barnax.record_from_frame(table, name=f"log {seed}")
        window = barnax.Window(initial_soc=start, capacity_ah=5.0)
        found.append(prepare_record(record, cell, "so-rc", window))
    return found


def factors(folder: Path) -> list[str]:
    """Reduction in rows a second, sizes, and grouping and fitting many stored ones."""
    logs, found = records(DISTINCT), []
    for kind, grid, stored in (
        ("constants", Grid(nodes=ANYWHERE), STORED), ("tables", Grid(), STORED_TABLES),
    ):  # fmt: skip
        factors_of(logs[0], grid)
        began = time.process_time(), time.perf_counter()
        factors = [factors_of(each, grid) for each in logs]
        cpu_s, wall_s = time.process_time() - began[0], time.perf_counter() - began[1]
        rows = sum(len(each.soc) for each in logs)
        out = folder / kind
        contents = [factors_to_bytes([each]) for each in factors]
        dataset = []
        for place in range(stored):
            keep_file(out, factors_path(out, str(place)), contents[place % DISTINCT])
            dataset.append({"id": str(place), "error": None, "group": place // IN_GROUP})
        write_rows(dataset_path(out), dataset)
        began, cpu_began_s = time.perf_counter(), _cpu_s()
        state = identify_fleet(regrouped(out, ["group"]), folder / f"{kind}-again", workers=2)
        again_s, again_cpu_s = time.perf_counter() - began, _cpu_s() - cpu_began_s
        if state.failed or state.finished != stored // IN_GROUP:
            raise RuntimeError(f"{state}")
        found.append(
            f"| {kind} | {rows / cpu_s:,.0f} | {rows / wall_s:,.0f} | "
            f"{np.median([len(each) for each in contents]) / 1000:,.1f} kB | {stored:,} | "
            f"{again_s:.0f} s | {again_cpu_s:.0f} s |"
        )
    return found


def reduced_rows(logs: list[PreparedRecord]) -> int:
    """One process's share of all rows, to factors as they are stored."""
    grid, rows = Grid(nodes=ANYWHERE), 0
    while rows < ALL_ROWS / PROCESSES:
        for log in logs:
            factors_to_bytes([factors_of(log, grid)])
            rows += len(log.soc)
    return rows


def all_rows_section() -> list[str]:
    """A fleet's rows to constants' factors, all of them."""
    logs = records(DISTINCT)
    with ProcessPoolExecutor(PROCESSES, multiprocessing.get_context("spawn")) as pool:
        began, cpu_began_s = time.perf_counter(), _cpu_s()
        rows = sum(pool.map(reduced_rows, [logs] * PROCESSES))
        wall_s = time.perf_counter() - began
    spent_s = _cpu_s() - cpu_began_s
    return [
        f"{rows:,} rows in logs of {SAMPLES:,} ({DISTINCT} different ones, again and again) to "
        f"constants' factors as they are stored, by {PROCESSES} processes, their start included: "
        f"{wall_s / 60:.1f} minutes, {spent_s:.0f} s of CPU, {rows / wall_s:,.0f} rows a second. "
        f"The aim is 10 minutes. Load when it ended: {os.getloadavg()[0]:.0f} on "
        f"{os.cpu_count()} cores.",
    ]


def _cpu_s() -> float:
    """CPU time of this process and of all workers that have ended."""
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in usages)


def time_section() -> list[str]:
    """How long one cell takes and how long many do."""
    return [
        f"`identify_pack` in a warm process, packs of {SAMPLES:,} samples; median of turns: "
        f"{TURNS}.",
        "",
        f"| time constants | one cell | {CELLS} cells | ratio | of CPU | aim | verdict |",
        "|---|---|---|---|---|---|---|",
        *times(),
    ]


def accuracy_section() -> list[str]:
    """What is told of simulated cells, and which are called odd."""
    errors, false = accuracy()
    return [
        f"RMS errors against the truth over {PACKS} packs of {OF_CELLS} cells of {SAMPLES:,} "
        "samples without an OCV test, of resistances relative, and how many 95 % intervals hold "
        "it. Resistances scatter by 1 %, capacities by 0.3 %, noise is 0.5 mV, and time constants "
        "scatter as said.",
        "",
        "| scatter | time constants | R0 | holds | total R | holds | SOC shift | holds | "
        "capacity | holds |",
        "|---|---|---|---|---|---|---|---|---|---|",
        *errors,
        "",
        f"Called odd where none is: {'; '.join(false)}.",
        "",
        f"Of 24 cells with +15 % R0, -5 % capacity and -3 % SOC, {PACKS} packs: {planted()}.",
    ]


def factor_section() -> list[str]:
    """What a reduction costs, and the fits of stored ones."""
    with tempfile.TemporaryDirectory() as folder:
        rows = factors(Path(folder))
    return [
        f"Reductions of {DISTINCT} logs of {SAMPLES:,} samples, half of the SOC each, on "
        f"time constants from 1 to 1000 s; stored ones are grouped by {IN_GROUP} and fitted by "
        "two processes, their start included.",
        "",
        "| factors | rows a CPU s | rows a s | size | stored | fitted in | CPU of that |",
        "|---|---|---|---|---|---|---|",
        *rows,
        "",
        "The aim is 10,000 in 60 s. Where other work shares the machine, the wall time is longer "
        "than a quiet one takes; CPU time says what the work costs.",
    ]


SECTIONS = {
    "Time": time_section,
    "Time constants in common, or each its own": accuracy_section,
    "Factors": factor_section,
    "All rows of a fleet": all_rows_section,
}


def main() -> None:
    """Measure the sections whose numbers are given, by default all, and put them on the page."""
    facts = provenance("python -m benchmarks.packs", 0)
    known = RESULTS.read_text().split("\n## ") if RESULTS.exists() else []
    halves = (each.partition("\n") for each in known[1:])
    parts = {title: text.strip("\n") for title, _, text in halves}
    for number, (title, measure) in enumerate(SECTIONS.items(), 1):
        if str(number) in sys.argv[1:] or not sys.argv[1:]:
            parts[title] = "\n".join([*measure(), "", f"Measured on {facts['date']}."])
    lines = ["# What packs and kept factors cost, and what they find", "", as_markdown(facts), ""]
    for title in SECTIONS:
        lines += [f"## {title}", "", parts.get(title, ""), ""]
    save_page(RESULTS, "\n".join(lines))


if __name__ == "__main__":
    main()
