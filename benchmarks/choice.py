"""How far the chosen circuit is from the best of its family, on records that it was not fitted to.

Run with `python -m benchmarks.choice [FOLDER OF MEASURED CELLS] [--most N]`. Writes
benchmarks/results/choice.md. Of every cell and temperature, each set of one record (with `--most 2`
of two too, and so on) is identified as `barnax identify` does it, with the sampling of its current
and the starts of several records by each other. The regret is the error of the answer over the
least error of all circuits of the family (1, 5, 9 and 17 nodes, one to three RC pairs, without a
law), each with its own starts, on all other records. The error is the geometric mean of the RMSE
over whole records and that above 10 % SOC.
"""

import argparse
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import barnax
from barnax.blas import one_blas_thread
from barnax.bundled import BUNDLED
from barnax.execution import in_float64
from barnax.fit.table_fit import visited_soc
from barnax.identification.pipeline import with_ocv_test
from barnax.identification.setup import bounded_tables, fit_ocv
from barnax.inputs import read_inputs
from barnax.job import Job
from barnax.model.prepared import PreparedRecord, Window, prepare_record
from barnax.model.reference import errors_along
from barnax.records.hold import sampled_as
from barnax.select.choose import Bench, Fitted
from barnax.select.family import NODE_LADDER, Point, limits_of
from benchmarks.pages import as_markdown, given_folder, provenance, publish

RESULTS = Path(__file__).parent / "results" / "choice.md"
PROFILE = Window(start_after_step=3, initial_soc=1.0, score_steps=(7, 8), capacity_ah=2.0)
CIRCUITS = ("1rc", "so-rc", "3rc")
PERCENTILES = (50, 90, 95, 100)


@dataclass(frozen=True)
class Cell:
    """The records of one cell at one temperature, by name, each with its window."""

    name: str
    tests: Sequence[Path]
    records: Sequence[tuple[Path, Window]]


@dataclass(frozen=True)
class Row:
    """One training set: what was chosen, the best in hindsight, and their errors in V."""

    cell: str
    records: tuple[str, ...]
    chosen: str
    chosen_v: float
    best: str
    best_v: float

    @property
    def regret(self) -> float:
        """By how much the chosen circuit's error is above the best one's, as a share."""
        return self.chosen_v / self.best_v - 1


def cells(folder: Path) -> Iterator[Cell]:
    """The measured cells with several records at one temperature."""
    calce, lg = folder / "calce-inr18650-20r", folder / "lg-hg2-18650"
    test = [calce / "ocv-incremental_25degC_SP20-3.parquet"]
    for degc, charges in ((25, (80, 50)), (0, (80,)), (45, (80,))):
        names = [f"{cycle}_{degc}degC_{soc}soc" for soc in charges for cycle in ("dst", "us06")]
        records = [(calce / f"{name}_SP20-2.parquet", PROFILE) for name in names]
        yield Cell(f"CALCE INR18650-20R, {degc} degC", test, records)
    for where, cycles in (("25", "us06 mixed1 la92 hppc"), ("0", "us06 mixed1 la92 hppc"),
                          ("minus10", "us06 mixed1 hppc")):  # fmt: skip
        records = [(lg / f"{name}_{where}degC.parquet", Window()) for name in cycles.split()]
        degc = where.replace("minus", "-")
        yield Cell(f"LG HG2, {degc} degC", [lg / f"c20_{where}degC.parquet"], records)
    window = Window(capacity_ah=2.0)
    records = [(BUNDLED.record, window), (BUNDLED.validation, window)]
    yield Cell("bundled", BUNDLED.ocv, records)


def rows_of(cell: Cell, most: int) -> Iterator[Row]:
    """Every training set of a cell, of so many records at most, in order."""
    indices = range(len(cell.records))
    for count in range(1, min(most, len(indices) - 1) + 1):
        for used in itertools.combinations(indices, count):
            yield row_of(cell, used, [index for index in indices if index not in used])


@in_float64
def row_of(cell: Cell, used: Sequence[int], others: Sequence[int]) -> Row:
    """The regret of the answer on some of the records of a cell."""
    paths = [cell.records[index][0] for index in used]
    windows = {path.name: window for path, window in (cell.records[index] for index in used)}
    job = Job(records=paths, ocv=cell.tests, window=windows)
    inputs, windows, first = with_ocv_test(job, read_inputs(job, fit_ocv))
    tables, tested = bounded_tables(job), first.cell

    def prepare(circuit: str) -> list[PreparedRecord]:
        named = [(own.record, windows[own.record.name]) for own in first.prepared_records]
        return [prepare_record(record, tested, circuit, window) for record, window in named]

    unused = []
    for path, window in (cell.records[index] for index in others):
        record = sampled_as(barnax.read_record(path), inputs.records)
        unused.append(prepare_record(record, tested, CIRCUITS[1], window))
    bench = Bench(prepare, tables, limits_of(tested, tables))
    with one_blas_thread():
        answer = bench.chosen().chosen
        family = [
            bench.registered(bench.fit(Point(circuit, nodes)))
            for circuit, nodes in itertools.product(CIRCUITS, NODE_LADDER)
        ]
    best_v, best = min((error_v(fitted, unused), named(fitted)) for fitted in family)
    records = tuple(path.name for path in paths)
    return Row(cell.name, records, named(answer), error_v(answer, unused), best, best_v)


def named(fitted: Fitted) -> str:
    """A circuit of the family in words."""
    nodes = len(fitted.point.nodes)
    law = f", {' and '.join(fitted.point.law.numbers)}" if fitted.point.law else ""
    return f"{fitted.point.circuit}, {nodes} node{'s' * (nodes > 1)}{law}"


def error_v(fitted: Fitted, others: Sequence[PreparedRecord]) -> float:
    """The geometric mean of the RMSE over other records and that above 10 % SOC."""
    objective, whole, above = fitted.objective, [], []
    span = visited_soc(objective.prepared_records)
    tables = objective.tables_at(fitted.best).level_beyond(*span)
    for own in others:
        prepared = prepare_record(own.record, own.cell, fitted.point.circuit, own.window)
        errors_v = errors_along(replace(prepared, circuit=fitted.point.circuit), tables)
        errors_v, soc = errors_v[prepared.scored], prepared.soc[prepared.scored]
        whole.append(errors_v)
        above.append(errors_v[soc > 0.1])
    rms = [np.sqrt(np.mean(np.concatenate(group) ** 2)) for group in (whole, above)]
    return float(np.sqrt(rms[0] * rms[1]))


def main(arguments: Sequence[str] | None = None) -> None:
    """The page of all sets."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.choice", description=__doc__)
    parser.add_argument("folder", nargs="*", help="the folder of measured cells")
    parser.add_argument("--most", type=int, default=1, help="records in a set at most")
    options = parser.parse_args(arguments)
    rows = []
    for cell in cells(given_folder(options.folder)):
        for row in rows_of(cell, options.most):
            rows.append(row)
            print(f"{row.cell}, {' + '.join(row.records)}: {100 * row.regret:.1f} %", flush=True)
    lines = [
        "# The chosen circuit against the best of its family",
        "",
        *summary(rows),
        "",
    ]
    lines += ["| cell | fitted to | chosen | mV | best in hindsight | mV | regret |"]
    lines += ["|---|---|---|--:|---|--:|--:|"]
    lines += [
        f"| {row.cell} | {' + '.join(row.records)} | {row.chosen} | {1e3 * row.chosen_v:.2f} | "
        f"{row.best} | {1e3 * row.best_v:.2f} | {100 * row.regret:.1f} % |"
        for row in rows
    ]
    most = f" --most {options.most}" if options.most > 1 else ""
    facts = provenance(f"python -m benchmarks.choice{most}", 0)
    publish(RESULTS, "\n".join([*lines, "", as_markdown(facts), ""]))


def summary(rows: Sequence[Row]) -> list[str]:
    """The regret in the median, of nine in ten, of 95 in 100, and the worst."""
    lines = [
        "| records fitted to | sets | median | 90 % | 95 % | worst |",
        "|---|---|--:|--:|--:|--:|",
    ]
    counts = sorted({len(row.records) for row in rows})
    groups = {str(count): (count,) for count in counts}
    if len(counts) > 2:
        groups["2 or more"] = tuple(counts[1:])
    for name, group in groups.items():
        regrets = [100 * row.regret for row in rows if len(row.records) in group]
        shares = " | ".join(f"{np.percentile(regrets, share):.1f} %" for share in PERCENTILES)
        lines.append(f"| {name} | {len(regrets)} | {shares} |")
    return lines


if __name__ == "__main__":
    main()
