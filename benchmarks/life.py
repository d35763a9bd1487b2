"""Whether ageing is found: `python -m benchmarks.life` writes results/life.md.

Cells of known truth age for three years, some with a planted fault. Every record is a short drive
from full, sampled every 5 s at some temperature, reduced and measured as `barnax fleet --ageing`
does, with an OCV that one fresh cell's drive showed: there is no OCV test. `--write FOLDER COUNT`
writes some of the cells as files with their manifest, for the commands themselves.
"""

import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

RESULTS = Path(__file__).parent / "results" / "life.md"
FRESH, CELLS, AGES, YEARS, SAMPLES, STEP_S = 3, 50, 10, 3.0, 1500, 5.0
NOMINAL_AH, NOISE_V, BETA = 2.0, 1e-3, 0.03
HEALTHY = 30
FAULTS = {
    "R0 rises faster": ("R0 [Ohm]", "12 % a year more"),
    "capacity falls faster": ("capacity [A.h]", "4 % a year more"),
    "knee of capacity": ("capacity [A.h]", "10 % a year more after 1.5 years"),
    "sensor offset": ("OCV shift [V]", "a step of 8 mV after 1.5 years"),
}
MIDDLE_S = 1.5
ALARM_FLEETS = 12
CAPACITY_OFF, R0_OFF = 0.01, 0.02


def ocv_v(soc):
    """That of all cells in V."""
    return 3.25 + 0.75 * soc + 0.18 * np.tanh((soc - 0.04) / 0.05) + 0.06 * soc**5


@dataclass(frozen=True)
class Cell:
    """A cell and how it ages; `fault` is one of `FAULTS` or nothing."""

    number: int

    @property
    def fault(self) -> str | None:
        place = self.number - HEALTHY
        return None if place < 0 else [*FAULTS][place % len(FAULTS)]

    @property
    def name(self) -> str:
        return f"C{self.number:03d}"

    @property
    def ages(self) -> np.ndarray:
        """In years."""
        drawn = np.random.default_rng([self.number, 1]).uniform(-0.4, 0.4, AGES)
        return np.maximum(np.linspace(0, YEARS, AGES) + drawn * YEARS / AGES, 0.0)

    def truth(self, age: np.ndarray) -> dict[str, np.ndarray]:
        """Capacity, R0 at 50 % SOC and 25 degC, all resistances there, and the OCV's shift."""
        draw = np.random.default_rng([self.number, 2])
        level, fade, r0, growth, rest = draw.normal(1, (0.008, 0.1, 0.04, 0.1, 0.04))
        later = np.maximum(age - MIDDLE_S, 0.0)
        share = 1 - 0.05 * fade * age**0.8
        share = share - 0.04 * age * (self.fault == "capacity falls faster")
        share = share - 0.10 * later * (self.fault == "knee of capacity")
        grown = 1 + 0.08 * growth * age + 0.12 * age * (self.fault == "R0 rises faster")
        own = 0.03 * r0 * grown * (1 + 0.6 * np.exp(-0.5 / 0.12))
        pairs = 0.012 * (1 + 1.5 * np.exp(-0.5 / 0.12)) + 0.02 * (1 + np.exp(-0.5 / 0.12))
        return {
            "capacity [A.h]": NOMINAL_AH * level * share,
            "R0 [Ohm]": own,
            "R [Ohm]": own + pairs * rest * (1 + 0.03 * age),
            "OCV shift [V]": 8e-3 * (age > MIDDLE_S) * (self.fault == "sensor offset"),
        }

    def temperature_degc(self, place: int) -> float:
        return float(np.random.default_rng([self.number, place, 3]).uniform(18, 32))

    def log(self, place: int, depth: float | None = None) -> dict[str, np.ndarray]:
        """A drive at one of its ages, from about full over some of the SOC."""
        draw = np.random.default_rng([self.number, place, 4])
        at = {name: float(each) for name, each in self.truth(self.ages[place]).items()}
        lengths = draw.integers(1, 40, SAMPLES)
        heights = draw.gamma(0.8, 1.0, SAMPLES) * draw.choice([1, 1, 1, -0.6, 0], SAMPLES)
        current_a = np.repeat(heights, lengths)[:SAMPLES]
        current_a[: SAMPLES // 6] = np.abs(current_a[: SAMPLES // 6])
        depth = depth or float(draw.uniform(0.6, 0.8))
        current_a[:12] = 0.0
        # So far down at the lowest.
        furthest_ah = np.cumsum(current_a).max() * STEP_S / 3600
        current_a *= depth * at["capacity [A.h]"] / furthest_ah
        passed_ah = np.append(0.0, np.cumsum(current_a[:-1])) * STEP_S / 3600
        soc = 1 + draw.normal(0, 0.003) - passed_ah / at["capacity [A.h]"]
        low = np.exp(-np.maximum(soc, 0.0) / 0.12)
        warm = np.exp(-BETA * (self.temperature_degc(place) - 25))
        r0 = at["R0 [Ohm]"] / (1 + 0.6 * np.exp(-0.5 / 0.12)) * (1 + 0.6 * low)
        middle = 0.012 * (1 + 1.5 * np.exp(-0.5 / 0.12)) + 0.02 * (1 + np.exp(-0.5 / 0.12))
        grown = (at["R [Ohm]"] - at["R0 [Ohm]"]) / middle
        voltage_v = ocv_v(soc) + at["OCV shift [V]"] - warm * r0 * current_a
        pairs = 0.012 * (1 + 1.5 * low), 0.02 * (1 + low)
        for each, tau_s in zip(pairs, (20.0, 160.0), strict=True):
            kept = np.exp(-STEP_S / tau_s)
            drive = np.append(0.0, (warm * grown * each * current_a)[:-1])
            voltage_v -= lfilter([1 - kept], [1, -kept], drive)
        voltage_v += NOISE_V * draw.standard_normal(SAMPLES)
        return {
            "Time [s]": STEP_S * np.arange(SAMPLES),
            "Current [A]": -current_a,
            "Voltage [V]": voltage_v,
        }


@dataclass(frozen=True)
class Fresh(Cell):
    """One whose drives are all of its first day, when its capacity was measured."""

    @property
    def ages(self) -> np.ndarray:
        return np.zeros(AGES)

    def truth(self, age: np.ndarray) -> dict[str, np.ndarray]:
        known = super().truth(age)
        return known | {"capacity [A.h]": np.full_like(age, NOMINAL_AH)}

    @property
    def fault(self) -> None:
        return None

    def temperature_degc(self, place: int) -> float:
        return 25.0


def write_fresh(folder: Path) -> list[Path]:
    """Drives of a fresh cell from full to nearly empty, which tell the OCV."""
    import polars as pl

    paths = [folder / f"fresh{number}.csv" for number in range(1, FRESH + 1)]
    for place, path in enumerate(paths):
        pl.DataFrame(Fresh(10_000).log(place, depth=0.97)).write_csv(path)
    return paths


def write_fleet(folder: Path, count: int, every: int = 1) -> None:
    """Some cells as CSV files, the fresh cell's drives, and their manifest."""
    import datetime

    import polars as pl

    folder.mkdir(parents=True)
    write_fresh(folder)
    rows = []
    for number in np.linspace(0, CELLS - 1, count).round().astype(int).tolist():
        cell = Cell(number)
        for place in range(0, AGES, every):
            name = f"{cell.name}-{place:02d}"
            pl.DataFrame(cell.log(place)).write_csv(folder / f"{name}.csv")
            day = datetime.date(2021, 1, 4) + datetime.timedelta(float(365.25 * cell.ages[place]))
            rows.append(
                {
                    "id": name, "records": f"{name}.csv", "cell": "fresh/result.json",
                    "specimen": cell.name, "date": day, "capacity": NOMINAL_AH, "initial_soc": 1.0,
                    "temperature": round(cell.temperature_degc(place), 1),
                }
            )  # fmt: skip
    pl.DataFrame(rows).write_csv(folder / "cells.csv")


@cache
def _known_cell(stored: str) -> Any:
    from barnax.results import Result

    return Result.from_json(stored).cell


def measure(task: tuple[int, int, str]) -> dict[str, Any]:
    """The row of one record, as far as ageing is concerned."""
    import barnax
    from barnax.life.rows import ageing_row
    from barnax.model.prepared import prepare_record

    number, place, stored = task
    cell = Cell(number)
    record = barnax.record_from_frame(
        cell.log(place),
        name=f"{cell.name}-{place:02d}",
        current_sign="charge-positive",
        current_hold="forward",
    )
    window = barnax.Window(
        initial_soc=1.0,
        capacity_ah=NOMINAL_AH,
        temperature_degc=cell.temperature_degc(place),
    )
    prepared = prepare_record(record, _known_cell(stored), "so-rc", window)
    return {
        "id": record.name, "error": None, "specimen": cell.name, "fingerprint": "",
        "age_years": float(cell.ages[place]), "capacity [A.h]": NOMINAL_AH,
        "temperature [degC]": prepared.temperature_degc, **ageing_row([prepared])[0],
    }  # fmt: skip


def main() -> None:
    """Measure everything, print the page and write it."""
    from benchmarks.pages import publish

    if sys.argv[1:2] == ["--write"]:
        write_fleet(Path(sys.argv[2]), int(sys.argv[3]), every=2)
        return
    with tempfile.TemporaryDirectory() as folder:
        text = page(Path(folder))
    publish(RESULTS, text)


def page(folder: Path) -> str:
    """All of it."""
    import barnax
    from barnax.fleet.dataset import dataset_path, read_rows, write_rows
    from barnax.fleet.engine import prepare_process

    prepare_process()
    fresh = barnax.identify(
        write_fresh(folder),
        current_hold="forward",
        seeds=0,
        trust="none",
        window=barnax.Window(initial_soc=1.0, capacity_ah=NOMINAL_AH),
    )
    stored = str(folder / "fresh.json")
    Path(stored).write_text(fresh.to_json())
    tasks = [(number, place, stored) for number in range(CELLS) for place in range(AGES)]
    began = time.perf_counter()
    with ProcessPoolExecutor(2, get_context("spawn"), initializer=prepare_process) as pool:
        rows = list(pool.map(measure, tasks, chunksize=8))
    taken_s = time.perf_counter() - began
    write_rows(dataset_path(folder), rows)
    return report(read_rows(folder), taken_s)


def report(rows: Any, taken_s: float) -> str:
    """The page of what was measured."""
    import polars as pl

    from barnax.life import QUANTITIES, life_of
    from benchmarks.pages import as_markdown, provenance

    names = set(rows["specimen"])
    cells = {each.name: each for each in map(Cell, range(CELLS)) if each.name in names}
    healthy = [each.name for each in cells.values() if each.fault is None]
    by_kind = {fault: [e.name for e in cells.values() if e.fault == fault] for fault in FAULTS}
    lives = []
    for place in range(max(map(len, by_kind.values()))):
        planted = [each[place] for each in by_kind.values() if place < len(each)]
        lives.append((planted, life_of(rows.filter(pl.col("specimen").is_in(healthy + planted)))))
    life, every = lives[0][1], life_of(rows)
    table = []
    for quantity in QUANTITIES:
        found = [
            _against_truth(one, each, cells[each.cell])
            for place, (planted, one) in enumerate(lives)
            for each in one.of(quantity)
            if each.cell in planted or not place
        ]
        off, held, told = (np.concatenate(each) for each in zip(*found, strict=True))
        own, smooth = off.T
        near = {"capacity [A.h]": CAPACITY_OFF, "R0 [Ohm]": R0_OFF}.get(quantity)
        scale, unit = (1e3, "mV") if quantity == "OCV shift [V]" else (100, "%")
        shares = [
            "" if near is None else f"{100 * np.mean(np.abs(each) <= near):.1f} %"
            for each in (own, smooth)
        ]
        wide = [scale * np.quantile(np.abs(each), 0.95) for each in (own, smooth)]
        good = [100 * np.mean(each) for each in held.T]
        table.append(
            f"| {quantity} | {100 * np.mean(told):.0f} % | {scale * np.median(own):+.2f} {unit} "
            f"| {wide[0]:.2f} {unit} | {shares[0]} | {good[0]:.1f} % "
            f"| {wide[1]:.2f} {unit} | {shares[1]} | {good[1]:.1f} % |"
        )

    def hits_in(one: Any, fault: str, whose: list[str]) -> list[Any]:
        return [
            each for each in one.faults
            if each.cell in {*whose} & {*by_kind[fault]} and each.quantity == FAULTS[fault][0]
        ]  # fmt: skip

    planted_rows = []
    for fault, (_, words) in FAULTS.items():
        hits = [each for planted, one in lives for each in hits_in(one, fault, planted)]
        at_once = len({each.cell for each in hits_in(every, fault, by_kind[fault])})
        kinds = ", ".join(sorted({each.kind for each in hits}))
        of = len(by_kind[fault])
        planted_rows.append(
            f"| {fault} ({words}) | {len(hits)} of {of} | {kinds} | {at_once} of {of} |"
        )
    wrong = [len({e.cell for e in one.faults} & set(healthy)) for _, one in lives]
    years = sum(float(np.ptp(cells[name].ages)) for name in healthy)
    alarms, alarm_years = false_alarms(life, cells)
    heads = [
        "quantity", "told", "estimates off, median", "in 95 %", "within 1 % or 2 %",
        "intervals hold", "trends off in 95 %", "within 1 % or 2 %", "intervals hold",
    ]  # fmt: skip
    return "\n".join(
        [
            "# Ageing from operation",
            "",
            as_markdown(provenance("python -m benchmarks.life", 0)),
            "",
            f"{len(cells)} cells of known truth at {AGES} ages over {YEARS:g} years: "
            f"{len(healthy)} healthy ones, and {len(cells) - len(healthy)} with a planted fault. "
            "Every record is a "
            f"drive of {SAMPLES * STEP_S / 3600:.1f} h, sampled every {STEP_S:g} s with "
            f"{1e3 * NOISE_V:g} mV of noise, from full within 0.3 % (one sigma) over 60 to "
            "80 % of the charge, at 18 to 32 degC. All records went through the measurement of "
            f"`barnax fleet --ageing`, with the OCV that {FRESH} drives of one fresh cell told: "
            f"no OCV test. A fleet is the healthy cells and one cell of every fault; there are "
            f"{len(lives)} of them. Measuring took {taken_s:.0f} s of both cores.",
            "",
            f"| {' | '.join(heads)} |",
            "|---" * len(heads) + "|",
            *table,
            "",
            "Resistances are at 50 % SOC and the fleet's median temperature, estimates by the "
            "fleet's own coefficient. R is the sum of all. Shares within are of 1 % for capacity, "
            "2 % for R0. Errors of the OCV of the new cell are in every row alike, and trends "
            "count them so. Estimates are those of a life, in which the records of all cells tell "
            f"how much OCVs change their shape: here not at all. {_alone(rows, cells)}",
            "",
            "## Planted faults",
            "",
            "Found where the cell is flagged in that quantity; in the last column with all faults "
            "in one fleet, where they hide each other.",
            "",
            "| fault | found | called | all at once |",
            "|---|---|---|---|",
            *planted_rows,
            "",
            "## False alarms",
            "",
            f"At the default of {100 * life.false_alarms:g} % a cell and year: "
            f"{', '.join(map(str, wrong))} of the healthy cells flagged in these fleets, the same "
            f"{years:.0f} cell years each time. Of {ALARM_FLEETS} fleets of healthy cells alone, "
            "whose estimates are drawn around the truth with the stated intervals and the scatter "
            f"found, {100 * alarms / alarm_years:.2f} % a cell and year ({alarms} in "
            f"{alarm_years:.0f}).",
            "",
        ]
    )


def _alone(rows: Any, cells: dict[str, Cell]) -> str:
    """How good capacities are by every record alone."""
    ends = "aged capacity [A.h]", "aged capacity [A.h] low", "aged capacity [A.h] high"
    known = rows.filter(rows[ends[0]].is_not_null())
    value, low, high = known.select(ends).to_numpy().T
    ages = zip(known["specimen"], known["age_years"], strict=True)
    truth = np.array([cells[name].truth(np.array(age))["capacity [A.h]"] for name, age in ages])
    near, held = np.abs(value / truth - 1) <= CAPACITY_OFF, (low <= truth) & (truth <= high)
    reach = 50 * np.median((high - low) / value)
    return (
        "By its record alone, as in the fleet's dataset, a capacity is within 1 % in "
        f"{100 * np.mean(near):.1f} %, and its interval, {reach:.1f} % to either side, holds in "
        f"{100 * np.mean(held):.1f} %."
    )


def _against_truth(life: Any, trend: Any, cell: Cell) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How far estimates and trends are off, whether their intervals hold, and what was told."""
    quantity = trend.quantity
    truth = cell.truth(trend.age)[quantity]
    is_shift = quantity == "OCV shift [V]"
    if quantity in ("R0 [Ohm]", "R [Ohm]"):
        truth = truth * np.exp(-BETA * ((life.reference_degc or 25.0) - 25))
    told = np.isfinite(trend.measured[:, 0])
    both = np.stack([trend.measured, trend.smooth], axis=1)[told]
    truth = truth[told, None]
    off = both[:, :, 0] - truth if is_shift else both[:, :, 0] / truth - 1
    return off, (both[:, :, 1] <= truth) & (truth <= both[:, :, 2]), told


def false_alarms(life: Any, cells: dict[str, Cell]) -> tuple[int, float]:
    """Cells flagged in fleets without faults, in how many years of cells."""
    from dataclasses import replace

    from barnax.life.trends import judge

    rng = np.random.default_rng(0)
    alarms, years = 0, 0.0
    for _ in range(ALARM_FLEETS):
        flagged: set[int] = set()
        for quantity, (names, judged) in life.judged.items():
            own = np.array([cells[name].fault is None for name in names])
            series = judged.fit.series.only(own)
            healthy = [cells[name] for name, is_own in zip(names, own, strict=True) if is_own]
            value = np.zeros_like(series.value)
            for place, cell in enumerate(healthy):
                age = life.first_age + life.span * series.age[place]
                truth = cell.truth(age)[quantity]
                value[place] = truth if quantity == "OCV shift [V]" else np.log(truth)
            sd = np.sqrt(series.variance + judged.fit.spread.scatter**2)
            value += sd * rng.standard_normal(value.shape)
            drawn = replace(series, value=value, covariate=np.zeros_like(value))
            spans = [float(np.ptp(cell.ages)) for cell in healthy]
            expected = life.false_alarms * sum(spans) / len(life.judged)
            flagged |= judge(drawn, expected, rng).faults.keys()
        alarms, years = alarms + len(flagged), years + sum(spans)
    return alarms, years


if __name__ == "__main__":
    main()
