"""State of charge by filters on measured cells, and their times: `python -m benchmarks.filters`.

The argument is the folder of measured cells. Each cell is identified on some of its drives and
replayed on another, where it has one. Writes benchmarks/results/filters.md; with `--times`, only
the times in it.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import barnax
from barnax.execution import compile_for, in_float64
from barnax.filters import Drive, ErrorModel, make_model, run_filter
from barnax.filters.kalman import PARTS
from barnax.model.prepared import prepare_record
from barnax.replay import SocReplay
from barnax.result_filter import model_of
from barnax.scenarios import (
    BAND,
    HOLDS_S,
    SCENARIOS,
    Scenario,
    ScenarioPart,
    case_of,
    first_with_room,
)
from benchmarks.pages import provenance, publish, save_page

RESULTS = Path(__file__).parent / "results" / "filters.md"
SAMSUNG, A123, LG = "calce-inr18650-20r", "plett-a123-26650", "lg-hg2-18650"
WINDOW = barnax.Window(start_after_step=3, initial_soc=1.0, score_steps=(7, 8))
STARTS = [each for each in SCENARIOS if each.soc_error]
# What is often published: SOC and two pairs, white noise of 30 mV, and nothing else.
PLAIN_V = 0.03
# Kind, and whether with tables over SOC, beside the default.
OTHERS = (("ekf", True), ("ukf", True), ("sum", False))
COMPARED = ("0 degC, DST to US06", "25 degC, DST to US06", "45 degC, DST to US06", "A123")


@dataclass(frozen=True)
class Case:
    """A cell identified on some records and replayed on one."""

    name: str
    identified: tuple[Path, ...]
    ocv: tuple[Path, ...]
    replayed: Path
    window: barnax.Window | None = None
    changed: tuple[tuple[str, object], ...] = ()
    capacity_ah: float | None = None

    def own(self, result: barnax.Result) -> barnax.Window | None:
        """The window of the replay, with the capacity of the record identified on."""
        if not self.changed:
            return self.window
        window = result.inputs[0].window or barnax.Window()
        return replace(window, registration=None, **dict(self.changed))

    def result(self) -> barnax.Result:
        """The answer of `barnax identify`, whatever circuit that is."""
        window = {} if self.window is None else {"window": self.window}
        return barnax.identify(
            list(self.identified), ocv=list(self.ocv), capacity=self.capacity_ah, seeds=0, **window
        )


def cases(folder: Path) -> Iterator[Case]:
    """All that is replayed."""
    samsung, a123, lg = folder / SAMSUNG, folder / A123, folder / LG
    for degc in (0, 25, 45):
        for one, other in (("dst", "us06"), ("us06", "dst")):
            for soc in (80, 50) if degc == 25 else (80,):
                yield Case(
                    f"{degc} degC, {one.upper()} to {other.upper()}{' from 50 %' * (soc == 50)}",
                    (samsung / f"{one}_{degc}degC_80soc_SP20-2.parquet",),
                    (samsung / "ocv-incremental_25degC_SP20-3.parquet",),
                    samsung / f"{other}_{degc}degC_{soc}soc_SP20-2.parquet",
                    WINDOW,
                    capacity_ah=2.0,
                )
    ocv = tuple(a123 / f"ocv-s{part}_25degC.parquet" for part in (1, 3))
    drive = a123 / "dyn-s1_25degC.parquet"
    yield Case("A123", (drive,), ocv, drive)
    charged = (("initial_soc", 0.0), ("initial_direction", -1), ("score_to_s", 28_403.0))
    charge = a123 / "dyn-s3_25degC.parquet"
    yield Case("A123, drive to its C/3 charge", (drive,), ocv, charge, changed=charged)
    for degc in (25, 0):
        drives = tuple(lg / f"{each}_{degc}degC.parquet" for each in ("us06", "mixed1"))
        la92 = lg / f"la92_{degc}degC.parquet"
        yield Case(
            f"LG, {degc} degC, US06 and Mixed1 to LA92",
            drives,
            (lg / f"c20_{degc}degC.parquet",),
            la92,
        )


def cells(part: ScenarioPart) -> str:
    """The numbers of a row, those of the whole record first."""
    whole = (part.whole_rms, part.whole_max)
    if part.converged_s is None:
        reason = "diverged" if part.diverged_s is not None else "never"
        band = "" if part.band is None else f"{100 * part.band:.1f}"
        held = "" if part.in_band is None else f"{100 * part.in_band:.0f}"
        return f"{in_percent(whole)} | {reason} | – | – | {band} | {held} | – |"
    since = in_percent((part.rms, part.max))
    held = f"{100 * (part.band or 0):.1f} | {100 * (part.in_band or 0):.0f}"
    counted = f"{100 * (part.counter_rms or 0):.2f}"
    return f"{in_percent(whole)} | {part.converged_s:.0f} | {since} | {held} | {counted} |"


def in_percent(errors: Sequence[float | None]) -> str:
    """Errors in columns."""
    return " | ".join("–" if each is None else f"{100 * each:.2f}" for each in errors)


def estimate_rows(case: Case, replay: SocReplay) -> Iterator[tuple[str, bool]]:
    """What the filter tells of offset and capacity, and whether its interval holds the truth."""
    for part in replay.scenarios:
        scenario = next(each for each in SCENARIOS if each.name == part.name)
        truth = {"offset": part.offset_a, "capacity": 1 / scenario.capacity_factor}
        for name, (value, sd) in part.estimates.items():
            holds = abs(value - truth[name]) <= BAND * sd
            unit, by = ("mA", 1e3) if name == "offset" else ("", 1.0)
            told = (
                f"{by * value:.3g} +- {by * BAND * sd:.2g} {unit} | {by * truth[name]:.3g} {unit}"
            )
            yield (
                f"| {case.name} | {part.name} | {name} | {told} | {'yes' * holds or 'no'} |",
                holds,
            )


@in_float64
def plain_row(case: Case, result: barnax.Result, scenario: Scenario) -> str:
    """An extended filter of SOC and the pairs alone."""
    record = barnax.read_record(case.replayed)
    prepared = prepare_record(record, result.cell, result.model, case.own(result))
    model = make_model(
        result.cell_at(), result.model, result.circuit_parameters, ErrorModel(PLAIN_V),
        rest_current_a=result.start_rest_current_a,
    )  # fmt: skip
    first = first_with_room(prepared.soc, scenario.soc_error)
    assert first is not None, "every drive has room for its scenarios"
    given = case_of(model, prepared, scenario, first, 0.15).given
    found = jax.jit(lambda own, start, drive: run_filter(own, start, drive, "ekf"))(*given)
    truth = prepared.soc[first:]
    error = np.asarray(found.soc)[: len(truth)] - truth
    held = np.mean(np.abs(error) <= BAND * np.asarray(found.soc_sd)[: len(truth)])
    later = prepared.time_s[first:] - prepared.time_s[first] >= HOLDS_S
    rms = 100 * np.sqrt(np.mean(error[later] ** 2))
    return f"| {case.name} | {scenario.name} | {rms:.2f} | {100 * held:.0f} |"


TIMES = "## Times"
SAMPLES, REPEATS = 20_000, 25
TIMED = """\
#include <stdio.h>
#include <time.h>
#include "barnax_filter.h"
static double in[20000][4];
int main(void)
{
    int n = 0, k, turn;
    double best = 1e9;
    barnax_filter f;
    while (n < 20000 && fread(in[n], sizeof(double), 4, stdin) == 4)
        n++;
    for (turn = 0; turn < 20; turn++) {
        const clock_t begun = clock();
        double spent;
        barnax_filter_start(&f, (barnax_real)0.9, (barnax_real)0.1, 1);
        for (k = 0; k < n; k++)
            barnax_filter_step(&f, (barnax_real)in[k][0], (barnax_real)in[k][1],
                               (barnax_real)in[k][2], (barnax_real)in[k][3]);
        spent = (double)(clock() - begun) / CLOCKS_PER_SEC / n;
        best = spent < best ? spent : best;
    }
    printf("%.9f", 1e6 * best);
    return 0;
}
"""


@in_float64
def times(folder: Path, result: barnax.Result) -> Iterator[str]:
    """Warm times of a record, and of a sample in C."""
    record = barnax.read_record(folder / SAMSUNG / "us06_25degC_80soc_SP20-2.parquet")
    prepared = prepare_record(record, result.cell, result.model, WINDOW)
    repeated = jax.tree.map(lambda each: jnp.tile(each, 2)[:SAMPLES], Drive.of(prepared))
    model = model_of(result, ("offset", "capacity"))
    start = model.start(0.9, 0.1, 1.0, 0.0)
    for kind in ("sum", "ekf", "ukf"):
        single = compile_for(run_filter, model, start, repeated, kind)
        alone_s = best_s(single, model, start, repeated, kind)
        yield f"| {kind}, one cell, {SAMPLES:,} samples | {1e3 * alone_s:.1f} ms |"
    for count in (PARTS, 1):
        for precision in ("double", "float"):
            spent_us = c_time_us(result, repeated, precision, count)
            yield f"| C, filters: {count}, {precision}, a sample | {spent_us:.2f} us |"


def best_s(function, *arguments) -> float:
    """The least processor time of some warm runs, whatever else the machine does meanwhile."""
    jax.block_until_ready(function(*arguments))
    spent = []
    for _ in range(REPEATS):
        begun = time.process_time()
        jax.block_until_ready(function(*arguments))
        spent.append(time.process_time() - begun)
    return min(spent)


def c_time_us(result: barnax.Result, drive: Drive, precision: str, count: int) -> float:
    """What the exported filter takes for a sample."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        exporter = barnax.export.get_exporter("c-filter")
        (folder / "barnax_filter.h").write_bytes(exporter.write(result).content)
        (folder / "main.c").write_text(TIMED)
        given = (f"-DBARNAX_REAL={precision}", f"-DBARNAX_PARTS={count}")
        command = ["cc", "-std=c99", "-O2", *given]
        subprocess.run([*command, folder / "main.c", "-o", folder / "run", "-lm"], check=True)
        parts = (drive.interval_s, drive.held_a, drive.current_a, drive.voltage_v)
        rows = np.stack([np.asarray(each) for each in parts], axis=1)
        ran = subprocess.run(
            [folder / "run"], input=rows.tobytes(), capture_output=True, check=True
        )
        return float(ran.stdout)


def time_table(folder: Path, result: barnax.Result) -> list[str]:
    """The times, as the page's last section."""
    command = provenance("python -m benchmarks.filters FOLDER --times", 0)
    return [
        TIMES,
        "",
        f"Processor time, the least of {REPEATS} warm runs, float64 ({command['date']}, load "
        f"{os.getloadavg()[0]:.0f} on {os.cpu_count()} cores), with tables over SOC.",
        "",
        "| what | processor time |",
        "|---|---|",
        *times(folder, result),
    ]


def main() -> None:
    """Measure, print the page and write it."""
    folder = Path(sys.argv[1])
    everything = list(cases(folder))
    if "--times" in sys.argv:
        before = RESULTS.read_text().partition(TIMES)[0]
        (case,) = [each for each in everything if each.name == COMPARED[1]]
        lines = time_table(folder, case.result())
        save_page(RESULTS, "\n".join([before + lines[0], *lines[1:], ""]))
        return
    rows, others, plain, told, results = [], [], [], [], {}
    for case in everything:
        key = case.identified
        result = results[key] = results.get(key) or case.result()
        replay = barnax.replay_soc(result, case.replayed, case.own(result))
        rows += [f"| {case.name} | {each.name} | {cells(each)}" for each in replay.scenarios]
        told += estimate_rows(case, replay)
        print("\n".join(rows[-len(replay.scenarios) :]), flush=True)
        if case.name not in COMPARED:
            continue
        plain += [plain_row(case, result, each) for each in STARTS]
        for kind, tables in OTHERS:
            settings = barnax.FilterSettings(kind, tables=tables)
            found = barnax.replay_soc(
                result, case.replayed, case.own(result), settings, scenarios=STARTS
            )
            name = f"{kind}{', constants' * (not tables)}"
            others += [
                f"| {case.name} | {name}, {each.name} | {cells(each)}" for each in found.scenarios
            ]
    origin = provenance("python -m benchmarks.filters FOLDER", 0)
    columns = "RMS | max | within 3 % [s] | then RMS | max | band | in band [%] | counting RMS |"
    ruler = "|---|---|---|---|---|---|---|---|---|---|"
    (samsung,) = [each for each in everything if each.name == COMPARED[1]]
    lines = [
        "# State of charge by filters",
        "",
        f"Printed by {origin['command']}, {origin['date']}, {origin['versions']}, "
        f"{origin['machine']}.",
        "",
        "Errors against the counter, in % of the capacity, over the whole record, then from where "
        "they stay within 3 % for ten minutes; the band is the mean half width of the filter's "
        "95 % band, and in it is the share of all samples. Every row is the default: a Gaussian "
        "sum with the answer of `barnax identify`. A start that is too high begins where the "
        "record leaves room for it.",
        "",
        "The Samsung INR18650-20R is identified on one drive and replayed on another from full to "
        "empty, at 0 and 45 degC with the OCV test of 25 degC. The LG 18650HG2 (10 Hz) is "
        "identified on two drives and replayed on a third. The A123 26650 (LFP) has one drive, so "
        "it is replayed on what it was identified on; its charge is not among that, and shows "
        "what the filter does not know: the resistances and the hysteresis while it charges.",
        "",
        f"| cell | scenario | {columns}",
        ruler,
        *rows,
        "",
        "## What is told of offset and capacity",
        "",
        "Only where three of the filter's standard deviations are half of the prior, or less; "
        f"{len(told)} of {2 * len(rows)} were told, and {sum(holds for _, holds in told)} of them "
        "hold.",
        "",
        "| cell | scenario | parameter | told | true | holds |",
        "|---|---|---|---|---|---|",
        *(row for row, _ in told),
        "",
        "## Other filters",
        "",
        "One extended or unscented filter with the same errors of the circuit, and the Gaussian "
        "sum with the best constant circuit of the same answer.",
        "",
        f"| cell | filter, start | {columns}",
        ruler,
        *others,
        "",
        "An extended filter of SOC and the pairs alone, with 30 mV of white noise and the same "
        "tables: what lasts is white noise to it, so it averages over the whole drive, and its "
        "band says nothing. RMS from ten minutes on.",
        "",
        "| cell | start | RMS | in band [%] |",
        "|---|---|---|---|",
        *plain,
        "",
        *time_table(folder, results[samsung.identified]),
    ]
    publish(RESULTS, "\n".join([*lines, ""]))


if __name__ == "__main__":
    main()
