"""Whether intervals from operation hold: `python -m benchmarks.operation [FIRST COUNT]`.

Cells of known truth, NMC and LFP-like, with and without a moving hysteresis, each with three logs
of different loads and no OCV test. Every log is said to start full on the nominal capacity, and
does not quite. The voltage is made with SciPy's `lfilter`. Writes benchmarks/results/operation.md;
with FIRST and COUNT it only prints what some cells give.
"""

import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

import barnax
from barnax.fit.node_interval import NodeInterval
from benchmarks.pages import as_markdown, provenance, save_page

RESULTS = Path(__file__).parent / "results" / "operation.md"
CELLS, LOGS, SAMPLES, NOMINAL_AH = 100, 3, 9000, 2.0
KINDS = [(name, moves) for name in ("NMC", "LFP") for moves in (False, True)]
START_SD, CAPACITY_SD, NOISE_V = 0.004, 0.002, 3e-4
# Nodes so far inside are judged, and R0 so far off is wrong.
INSIDE, WRONG = (0.1, 0.9), 0.1


@dataclass(frozen=True)
class Cell:
    """A cell, and how its logs begin."""

    kind: str
    moves: bool
    seed: int

    @property
    def drawn(self) -> np.random.Generator:
        return np.random.default_rng([self.seed, 28])

    def ocv_v(self, soc):
        """The mean of both branches in V."""
        if self.kind == "LFP":
            ends = 0.25 * np.tanh((soc - 0.01) / 0.04) + 0.08 * np.exp((soc - 1) / 0.015)
            return 3.02 + ends + 0.04 * np.tanh((soc - 0.68) / 0.05) + 0.03 * soc
        return 3.25 + 0.75 * soc + 0.18 * np.tanh((soc - 0.04) / 0.05) + 0.06 * soc**5

    @property
    def half_gap_v(self) -> float:
        return {"LFP": 0.012, "NMC": 0.006}[self.kind] * self.moves

    def r_ohm(self, soc):
        """R0, R1 and R2 over SOC."""
        low = np.exp(-np.maximum(soc, 0.0) / 0.12)
        r0, r1, r2 = self.drawn.uniform((0.02, 0.008, 0.01), (0.06, 0.02, 0.03))
        return r0 * (1 + 0.6 * low), r1 * (1 + 1.5 * low), r2 * (1 + 1.0 * low)

    @property
    def tau_s(self) -> tuple[float, float]:
        draw = self.drawn
        draw.uniform(size=3)
        return float(draw.uniform(8, 25)), float(draw.uniform(100, 250))

    @property
    def starts(self):
        """The SOC at the start of every log, and the capacity in Ah that its current counts."""
        draw = self.drawn
        draw.uniform(size=5)
        soc = np.minimum(1 - START_SD + START_SD * draw.standard_normal(LOGS), 1.0)
        return soc, NOMINAL_AH * (1 + CAPACITY_SD * draw.standard_normal(LOGS))

    def logs(self) -> Iterator[barnax.Record]:
        for number, (soc, capacity_ah) in enumerate(zip(*self.starts, strict=True)):
            draw = np.random.default_rng([self.seed, number, LOGS])
            current_a, voltage_v = self.drive(number, soc, capacity_ah)
            voltage_v += NOISE_V * draw.standard_normal(SAMPLES)
            yield record_of(current_a, voltage_v, f"log{number + 1}")

    def drive(
        self, number: int, start_soc: float, capacity_ah: float, samples: int = SAMPLES
    ) -> tuple[np.ndarray, np.ndarray]:
        """Current, discharge positive, and voltage at every second of one of the loads: steps of
        other lengths and heights in each, from full to nearly empty."""
        draw = np.random.default_rng([self.seed, number])
        lengths = draw.integers(2, (12, 40, 120)[number], samples)
        heights = draw.gamma(0.8, 1.0, samples) * draw.choice([1, 1, 1, -0.6, 0], samples)
        current_a = np.repeat(heights, lengths)[:samples]
        # Nothing charges a cell that is full.
        current_a[: samples // 5] = np.abs(current_a[: samples // 5])
        current_a *= 0.93 * 3600 * NOMINAL_AH / current_a.sum()
        current_a[:60] = 0.0
        soc = start_soc - np.append(0.0, np.cumsum(current_a[:-1])) / 3600 / capacity_ah
        r0, *r = self.r_ohm(soc)
        voltage_v = self.ocv_v(soc) - r0 * current_a
        for r_ohm, tau_s in zip(r, self.tau_s, strict=True):
            kept = np.exp(-1 / tau_s)
            voltage_v -= lfilter([0.0, 1 - kept], [1, -kept], r_ohm * current_a)
        state = 1.0
        if self.moves:
            states = np.empty(samples)
            for at, passed in enumerate(np.diff(soc, prepend=soc[0])):
                kept = np.exp(-30 * abs(passed))
                state = kept * state + (1 - kept) * np.sign(passed)
                states[at] = state
            voltage_v += self.half_gap_v * states
        return current_a, voltage_v


def record_of(
    current_a: np.ndarray, voltage_v: np.ndarray, name: str, interval_s: float = 1.0, **options
) -> barnax.Record:
    """The record of a log, whose file has charge positive."""
    table = {
        "Time [s]": interval_s * np.arange(len(current_a)),
        "Current [A]": -current_a,
        "Voltage [V]": voltage_v,
    }
    options = {"current_hold": "forward", **options}
    return barnax.record_from_frame(table, name=name, current_sign="charge-positive", **options)


@dataclass(frozen=True)
class Outcome:
    """Of one cell: how many intervals hold and how many there are, by name, and by which shares R0
    and all resistances together are off, medians over SOC, and the OCV."""

    cell: Cell
    held: dict[str, tuple[int, int]]
    r0_off: float
    total_off: float
    ocv_off_v: float
    seconds: float
    codes: frozenset[str]

    @property
    def is_wrong(self) -> bool:
        return abs(self.r0_off) > WRONG


def identified(cell: Cell, records: Iterable[barnax.Record]) -> Outcome:
    """One cell from its logs, and the truth on the axis that was found."""
    began = time.perf_counter()
    window = barnax.Window(initial_soc=1.0, capacity_ah=NOMINAL_AH)
    result = barnax.identify([*records], window=window, seeds=0, trust="none")
    seconds = time.perf_counter() - began
    soc, capacity_ah = cell.starts
    # SOC is scaled so that what was told is right on average.
    scale = capacity_ah.mean() / NOMINAL_AH
    held: dict[str, tuple[int, int]] = {}

    def count(name: str, low: float, high: float, truth: float) -> None:
        good, of = held.get(name, (0, 0))
        held[name] = good + (low <= truth <= high), of + 1

    windows = [part.window for part in result.of_role("identification")]
    for window, own_soc, own_ah in zip(windows, soc, capacity_ah, strict=True):
        known = window.registration
        count("start", known.soc_low, known.soc_high, own_soc - soc.mean() + 1)
        count("capacity", known.capacity_low_ah, known.capacity_high_ah, own_ah / scale)
    assert result.tables is not None, "an OCV of the records' own is a table"
    ocv_off_v, found_ohm = [], {}
    for node in result.fit.intervals:
        if node.soc is None or not INSIDE[0] <= node.soc <= INSIDE[1] or node.low is None:
            continue
        true_soc = float(soc.mean() - (1 - node.soc) / scale)
        if node.name.startswith("R"):
            found_ohm.setdefault(true_soc, []).append(node.value)
        truth = _truth(cell, node, true_soc)
        if truth is None:
            continue
        count(node.name, node.low, node.high, truth)
        if node.record_low is not None:
            count(f"{node.name}, another record", node.record_low, node.record_high, truth)
        if node.name.startswith("OCV"):
            ocv_off_v.append(abs(node.value - truth))
    off = [
        (own_ohm[0] / true_ohm[0] - 1, sum(own_ohm) / sum(true_ohm) - 1)
        for own_soc, own_ohm in found_ohm.items()
        for true_ohm in [cell.r_ohm(own_soc)]
    ]
    r0_off, total_off = np.median(off, axis=0).tolist()
    codes = frozenset(told.code for told in result.warnings)
    ocv_v = float(np.median(ocv_off_v or [0.0]))
    return Outcome(cell, held, r0_off, total_off, ocv_v, seconds, codes)


def _truth(cell: Cell, node: NodeInterval, soc: float) -> float | None:
    """The true value at a node; None of a pair, which another pair can stand for, and of an OCV
    that has two branches."""
    if node.name.startswith("R0"):
        return float(cell.r_ohm(soc)[0])
    if node.name.startswith("OCV") and not cell.moves:
        return float(cell.ocv_v(soc))
    return None


def by_kind(outcomes: Iterable[Outcome]) -> Iterator[tuple[str, list[Outcome]]]:
    """The outcomes of every kind of cell that there is, with its name."""
    found = list(outcomes)
    for kind, moves in KINDS:
        own = [each for each in found if (each.cell.kind, each.cell.moves) == (kind, moves)]
        if own:
            yield f"{kind}, {'moving hysteresis' if moves else 'no hysteresis'}", own


def share_held(outcomes: Iterable[Outcome], name: str) -> str:
    """The share of intervals of a name that hold."""
    good, of = np.sum([each.held.get(name, (0, 0)) for each in outcomes], axis=0)
    return f"{100 * good / of:.1f} % of {of}" if of else ""


def report(outcomes: list[Outcome], command: str) -> str:
    """The page."""
    rows = []
    for kind, own in by_kind(outcomes):
        row = {"cell": kind}
        for name in ("start", "capacity", "R0 [Ohm]", "R0 [Ohm], another record", "OCV [V]"):
            row[name] = share_held(own, name)
        off = np.quantile(np.abs([each.r0_off for each in own]), 0.95)
        row["R0 off in 95 % of cells"] = f"at most {100 * off:.1f} %"
        off_mv = 1e3 * np.median([each.ocv_off_v for each in own])
        row["median OCV off"] = f"{off_mv:.2f} mV" if off_mv else ""
        row["R0 wrong"] = str(sum(each.is_wrong for each in own))
        rows.append(row)
    seconds = np.median([each.seconds for each in outcomes])
    return (
        "# Intervals from operation, without an OCV test\n\n"
        f"{len(outcomes)} cells of known truth, three logs of 2.5 h each. Every log is said to "
        f"start full on {NOMINAL_AH:g} Ah; starts differ by {100 * START_SD:g} %, counters by "
        f"{100 * CAPACITY_SD:g} %. Shares of 95 % intervals that hold the truth, of nodes from 10 "
        "to 90 % SOC. R0 is wrong where its median over SOC is off by more than 10 %. The OCV of a "
        "cell with a moving hysteresis is one of two branches and not judged.\n\n"
        f"{table_of(rows)}\n\nMedian time a cell: {seconds:.1f} s.\n\n"
        f"{as_markdown(provenance(command, 0))}\n"
    )


def table_of(rows: list[dict[str, str]]) -> str:
    """Rows with the same keys, in Markdown."""
    lines = [[*rows[0]], ["---"] * len(rows[0]), *([*each.values()] for each in rows)]
    return "\n".join(f"| {' | '.join(each)} |" for each in lines)


def main(words: list[str]) -> None:
    """Run the cells and print the page; write it where all were run."""
    first, count = map(int, words) if words else (0, CELLS)
    outcomes = []
    for seed in range(first, first + count):
        cell = Cell(*KINDS[seed % len(KINDS)], seed)
        outcomes.append(identified(cell, cell.logs()))
        print(outcomes[-1] if words else f"{seed + 1} of {CELLS}", file=sys.stderr)
    page = report(outcomes, " ".join(["python -m benchmarks.operation", *words]))
    print(page)
    if not words:
        save_page(RESULTS, page)


if __name__ == "__main__":
    main(sys.argv[1:])
