"""What slow logs leave of a circuit: `python -m benchmarks.slow_logs [FIRST COUNT]`.

The cells of `benchmarks.operation` as loggers write them, without an OCV test: means over 10 s with
steps of 5 mV; instants 10 s apart; and a current with an offset of C/100, which two logs of one
tester share. Writes benchmarks/results/slow_logs.md; with FIRST and COUNT it prints what some cells
give.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import barnax
from benchmarks.operation import (
    CELLS,
    KINDS,
    LOGS,
    NOISE_V,
    NOMINAL_AH,
    SAMPLES,
    Cell,
    Outcome,
    by_kind,
    identified,
    record_of,
    share_held,
    table_of,
)
from benchmarks.pages import as_markdown, provenance, save_page

RESULTS = Path(__file__).parent / "results" / "slow_logs.md"
INTERVAL_S, STEP_V, OFFSET_A = 10, 5e-3, NOMINAL_AH / 100
# R0 and all resistances together are right within these.
R0_WITHIN, TOTAL_WITHIN = 0.02, 0.05


def logged(cell: Cell, rows: str) -> list[barnax.Record]:
    """The logs of a cell in rows of means or of instants, read as files are."""
    found = []
    for number, (soc, capacity_ah) in enumerate(zip(*cell.starts, strict=True)):
        draw = np.random.default_rng([cell.seed, number, LOGS])
        current_a, voltage_v = cell.drive(number, soc, capacity_ah)
        voltage_v += NOISE_V * draw.standard_normal(SAMPLES)
        blocks = (values.reshape(-1, INTERVAL_S) for values in (current_a, voltage_v))
        amps, volts = (
            block.mean(axis=1) if rows == "means" else block[:, 0].copy() for block in blocks
        )
        volts = STEP_V * np.round(volts / STEP_V)
        found.append(
            record_of(amps, volts, f"log{number + 1}", float(INTERVAL_S), current_hold="auto")
        )
    return found


def offset_found_a(cell: Cell, offset_a: float) -> tuple[float, float] | None:
    """The offset that two logs of one rate and of half of it are told to share, with how far it
    may be off; None without a word."""
    records = []
    for number, (rate, start_soc) in enumerate(((1.0, 0.997), (0.5, 0.999))):
        draw = np.random.default_rng([cell.seed, number, LOGS + 1])
        samples = int(SAMPLES / rate)
        current_a, voltage_v = cell.drive(number, start_soc, NOMINAL_AH, samples)
        voltage_v += NOISE_V * draw.standard_normal(samples)
        records.append(record_of(current_a + offset_a, voltage_v, f"log{number + 1}"))
    window = barnax.Window(initial_soc=1.0, capacity_ah=NOMINAL_AH)
    result = barnax.identify(
        records, window=window, seeds=0, trust="none", advise=False, max_boxes=0
    )
    for told in result.warnings:
        if told.code == "answer.current-offset":
            # As the files have it, which charge positive.
            return -float(told.values["offset_a"]), float(told.values["error_a"])
    return None


@dataclass(frozen=True)
class Degraded:
    """What the logs of one cell give: of means, what rows of both kinds are taken for, and the
    offsets found with and without one."""

    means: Outcome
    rows: dict[str, list[str]]
    with_offset: tuple[float, float] | None
    without_offset: tuple[float, float] | None


def degraded(cell: Cell) -> Degraded:
    """All of one cell."""
    logs = {rows: logged(cell, rows) for rows in ("means", "instants")}
    taken = {
        rows: [record.evidence.slow.kind for record in records] for rows, records in logs.items()
    }
    offsets = offset_found_a(cell, OFFSET_A), offset_found_a(cell, 0.0)
    return Degraded(identified(cell, logs["means"]), taken, *offsets)


def report(found: list[Degraded], command: str) -> str:
    """The page."""
    rows = []
    for kind, own in by_kind(each.means for each in found):
        off = np.abs([(each.r0_off, each.total_off) for each in own])
        within = np.mean(off <= (R0_WITHIN, TOTAL_WITHIN), axis=0)
        middle, high = np.median(off, axis=0), np.quantile(off, 0.95, axis=0)
        row = {"cell": kind}
        for place, name in enumerate(("R0", "total R")):
            limit = 100 * (R0_WITHIN, TOTAL_WITHIN)[place]
            row[f"{name} off, median (95 % of cells)"] = (
                f"{100 * middle[place]:.1f} % ({100 * high[place]:.1f} %)"
            )
            row[f"{name} within {limit:g} %"] = f"{100 * within[place]:.0f} %"
        row |= {name: share_held(own, name) for name in ("R0 [Ohm]", "OCV [V]")}
        rows.append(row)
    taken = {
        rows: [one for each in found for one in each.rows[rows]] for rows in ("instants", "means")
    }
    logs = len(taken["means"])
    sized = [each.with_offset for each in found if each.with_offset]
    right = sum(abs(value - OFFSET_A) <= error for value, error in sized)
    false = sum(each.without_offset is not None for each in found)
    return (
        "# What slow logs leave of a circuit\n\n"
        f"{len(found)} cells of `benchmarks.operation` without an OCV test. Three logs of means "
        f"over {INTERVAL_S} s with steps of {1e3 * STEP_V:g} mV: by how much R0 and all "
        "resistances together are off, each the median over SOC, and the shares of 95 % intervals "
        "that hold the truth.\n\n"
        f"{table_of(rows)}\n\n"
        f"Of {logs} logs of instants {INTERVAL_S} s apart, {taken['instants'].count('instants')} "
        f"are told, and {taken['instants'].count('means')} taken for means; of {logs} logs of "
        f"means {taken['means'].count('instants')} are taken for instants.\n\n"
        f"Two logs, the second of half the rate, with an offset of C/100 in both: it is told in "
        f"{len(sized)} of {len(found)}, and its size is within what is told in {right}. Without "
        f"an offset one is told in {false}.\n\n"
        f"{as_markdown(provenance(command, 0))}\n"
    )


def main(words: list[str]) -> None:
    """Run the cells and print the page; write it where all were run."""
    first, count = map(int, words) if words else (0, CELLS)
    found = []
    for seed in range(first, first + count):
        found.append(degraded(Cell(*KINDS[seed % len(KINDS)], seed)))
        print(found[-1] if words else f"{seed + 1} of {CELLS}", file=sys.stderr)
    page = report(found, " ".join(["python -m benchmarks.slow_logs", *words]))
    print(page)
    if not words:
        save_page(RESULTS, page)


if __name__ == "__main__":
    main(sys.argv[1:])
