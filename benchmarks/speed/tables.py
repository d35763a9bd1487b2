"""How fast tables over SOC are: `python -m benchmarks.speed.tables`, about three minutes.

The search against NumPy and SciPy, the whole of `identify` with and without tables, a record at
10 Hz, and how memory grows with the record. Writes benchmarks/results/table_speed.md.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
from scipy.optimize import lsq_linear
from scipy.signal import lfilter

import barnax
from barnax.cell.tables import hats
from barnax.model.descent import LogScales
from barnax.model.prepared import PreparedRecord, Window, prepare_record
from barnax.over_soc.objective import TableObjective
from barnax.over_soc.problem import reduced_objective
from barnax.over_soc.search import find_best
from barnax.over_soc.settings import TableSettings
from benchmarks.pages import as_markdown, provenance, publish

from . import report
from .case import bundled_cell, bundled_record
from .row import Row
from .sizes import Sizes
from .turns import Run, take_turns

SETTINGS = TableSettings(folds=0, max_boxes=0)
TAU_RANGE_S = (2.0, 1000.0)
# Seconds between samples of the bundled record, and from its first to its last.
INTERVAL_S, DURATION_S = 1.0, 19_679.0
AIM = 10.0
# What tables may add to the constant circuit's time, and doing without an OCV test to theirs, of
# the bundled record and of one at 10 Hz.
MORE_S, LONG_S = (3.0, 1.0), (10.0, 6.0)
# Of the record at 10 Hz.
FINE_S, FINE_SAMPLES = 0.1, 141_000
NOISE_V, SEED, CAPACITY_AH = 1e-3, 15, 2.0
IDENTIFY_TURNS = 3
LENGTHS = (200_000, 2_000_000)
RESULTS = Path(__file__).parents[1] / "results" / "table_speed.md"


def time_tables(sizes: Sizes) -> list[Row]:
    """The whole search, reduction included, and the same number of SciPy's solutions."""
    prepared = prepare_record(bundled_record(), bundled_cell(), "so-rc", Window())
    counted = 0

    class Counting(TableObjective):
        def solve(self, *given, **more):
            nonlocal counted
            counted += 1
            return super().solve(*given, **more)

    objective = _objective(prepared, Counting)
    best = find_best(objective)
    evaluations = counted
    root_v = np.sqrt(2 * _solved(prepared, objective, best.log_scales).cost)
    if not abs(root_v / best.rms_v - 1) < 1e-7:
        raise SystemExit(f"SciPy's sqrt(J) is {root_v} V, not {best.rms_v} V")
    runs = {
        "ours": Run(lambda: find_best(_objective(prepared, TableObjective))),
        "scipy": Run(lambda: _solved(prepared, objective, best.log_scales)),
    }
    taken = take_turns(runs, sizes.turns)
    return [
        Row(
            "tables over SOC, the whole search, the reduction included",
            taken["ours"],
            f"lfilter + lsq_linear on all samples, {evaluations} times",
            evaluations * taken["scipy"],
            evaluations * taken.ratio("scipy", "ours"),
            "times faster",
            AIM,
            f"{evaluations} time constants are tried; SciPy's own time is of one of them",
        )
    ]


def _objective(prepared: PreparedRecord, kind: type[TableObjective]) -> TableObjective:
    ranges = dict.fromkeys(("tau1 [s]", "tau2 [s]"), TAU_RANGE_S)
    objective = reduced_objective([prepared], SETTINGS, ranges)
    return kind(**vars(objective))


def _solved(prepared: PreparedRecord, objective: TableObjective, log_scales: LogScales):
    """SciPy's tables for given time constants, from every sample's columns."""
    spread = hats(prepared.soc, SETTINGS.nodes)
    columns = [spread * prepared.current_a[:, None]]
    for tau_s in np.exp(log_scales):
        decay = np.exp(-INTERVAL_S / tau_s)
        held = spread * prepared.held_a[:, None]
        columns.append(lfilter([0.0, 1 - decay], [1.0, -decay], held, axis=0))
    matrix = np.concatenate([*columns, -spread], axis=1)[prepared.scored] @ objective.to_tables
    unit, penalty = np.sqrt(len(matrix)), objective.penalty
    target = (prepared.source_v - prepared.voltage_v)[prepared.scored]
    return lsq_linear(
        np.concatenate([matrix / unit, penalty]),
        np.append(target / unit, np.zeros(len(penalty))),
        objective.box,
        method="bvls",
        tol=1e-12,
    )


def finer(samples: int, interval_s: float) -> barnax.Record:
    """The bundled trips sampled at another rate, so that the SOC stays what it is, with noise."""
    record = bundled_record()
    time_s = record.time_s[0] + interval_s * np.arange(samples)
    at = np.searchsorted(record.time_s, time_s, side="right") - 1
    noise_v = np.random.default_rng(SEED).normal(0, NOISE_V, samples)
    return replace(
        record,
        name=f"{samples:,} samples",
        time_s=time_s,
        # A sample's current flows until the next one.
        current_a=record.current_a[at],
        voltage_v=np.interp(time_s, record.time_s, record.voltage_v) + noise_v,
        temperature_degc=None,
        step=None,
        row=np.arange(samples) + 2,
        sha256="",
    )


def time_identify() -> Iterator[str]:
    """A row for each record: wall and CPU seconds of a constant circuit, of tables, and of tables
    without an OCV test, with the aims."""
    tests = [barnax.bundled_file(f"ocv_{way}") for way in ("discharge", "charge")]
    known = {"ocv": tests, "over": "soc"}
    ways = {
        "constant": {"ocv": tests, "model": "iso-rc"},
        "tables": known,
        "no test": known | {"ocv": ()},
    }
    lengths = (bundled_record(), MORE_S), (finer(FINE_SAMPLES, FINE_S), LONG_S)
    for record, (tables_s, no_test_s) in lengths:
        spent: dict[str, list[tuple[float, float]]] = {name: [] for name in ways}
        gap = ""
        # The first turn compiles.
        for turn in range(IDENTIFY_TURNS + 1):
            for name, options in ways.items():
                wall_s, cpu_s = time.perf_counter(), time.process_time()
                found = barnax.identify(record, capacity=CAPACITY_AH, **options)
                if name == "tables":
                    gap = f"{100 * found.fit.proved_gap:.2g} %"
                taken = time.perf_counter() - wall_s, time.process_time() - cpu_s
                if turn:
                    spent[name].append(taken)
        medians = {name: np.median(taken, axis=0) for name, taken in spent.items()}
        more = [
            np.median(np.subtract(spent[own], spent[other]), axis=0)[0]
            for own, other in (("tables", "constant"), ("no test", "tables"))
        ]
        verdicts = [
            f"{taken_s:+.1f} s, at most {aim_s:g} s: "
            + ("met" if taken_s <= aim_s else f"missed by {taken_s - aim_s:.1f} s")
            for taken_s, aim_s in zip(more, (tables_s, no_test_s), strict=True)
        ]
        cells = [f"{wall_s:.1f} s ({cpu_s:.1f} s)" for wall_s, cpu_s in medians.values()]
        yield f"| {' | '.join([f'{record.samples:,}', *cells, gap, *verdicts])} |"


def measure_memory(samples: int) -> None:
    """Print what this process took before and at most during a fit, in MiB, and its CPU seconds.

    One of few samples comes first, so that what is loaded and compiled for any does not count. All
    lengths have the same box: a faster clock would open a wider one, which needs larger factors.
    """
    box = {f"tau{pair} [s]": TAU_RANGE_S for pair in (1, 2)}
    settings = replace(SETTINGS, folds=5, max_boxes=1000, bounds=box)
    lengths = [LENGTHS[0] // 10, samples]
    first, own = (
        prepare_record(finer(each, DURATION_S / each), bundled_cell(), "so-rc", Window())
        for each in lengths
    )
    barnax.fit_tables([first], settings)
    # The highest mark from here on.
    Path("/proc/self/clear_refs").write_text("5")
    before, begin_s = _mib("VmRSS"), time.process_time()
    barnax.fit_tables([own], settings)
    print(before, _mib("VmHWM"), time.process_time() - begin_s)


def _mib(name: str) -> float:
    """What this process holds, or held at most; `getrusage` tells that of its parent too."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition(f"{name}:")[2].split()[0]) / 1024


def memory_rows() -> Iterator[str]:
    """A row for each length, then what a sample adds."""
    added = []
    for samples in LENGTHS:
        command = [sys.executable, "-m", "benchmarks.speed.tables", str(samples)]
        ran = subprocess.run(command, capture_output=True, text=True, check=True)
        before, after, cpu_s = map(float, ran.stdout.split())
        added.append(after - before)
        yield f"| {samples:,} | {before:.0f} | {after:.0f} | {added[-1]:.0f} | {cpu_s:.1f} s |"
    a_sample = max(0.0, added[-1] - added[0]) * 2**20 / (LENGTHS[-1] - LENGTHS[0])
    yield ""
    yield f"A further sample adds {a_sample:.0f} bytes for a moment; its record keeps 8 a column."


def main(arguments: Sequence[str]) -> None:
    """Measure, print the page and write it; with a number of samples the memory of one fit."""
    if arguments:
        measure_memory(int(arguments[0]))
        return
    facts = provenance("python -m benchmarks.speed.tables", SEED)
    facts["load average at the start"] = ", ".join(f"{load:.1f}" for load in os.getloadavg())
    sizes = Sizes(turns=3)
    lines = ["# How fast are tables over SOC?", "", as_markdown(facts), ""]
    with jax.enable_x64(True):
        lines += report.work_table(time_tables(sizes))
    lines += [
        "",
        "`barnax.identify` in a warm process: the constant `iso-rc`, circuits with tables weighed "
        "beside it, and tables with an OCV of the record's own, everything included: search, "
        f"proof, intervals, held-out blocks. Medians of {IDENTIFY_TURNS} turns, in brackets CPU "
        "seconds of all cores together, which do not wait for others.",
        "",
        "| samples | constant | tables | tables without an OCV test | proved gap of tables "
        "| tables add | no OCV test adds |",
        "|---|---|---|---|---|---|---|",
        *time_identify(),
        "",
        "Memory of a fresh process in MiB, the record and all libraries included, before and at "
        "most during `fit_tables`: reduction, search, proof, intervals and held-out blocks.",
        "",
        "| samples | before | at most | added | CPU of the fit |",
        "|---|---|---|---|---|",
        *memory_rows(),
        "",
    ]
    publish(RESULTS, "\n".join(lines))


if __name__ == "__main__":
    main(sys.argv[1:])
