"""A thousand virtual cells, ten seeds each, against one cell a thousand times."""

import statistics
import time
from dataclasses import dataclass, replace
from functools import cache

import jax.random as jr
import numpy as np
from scipy.signal import lfilter

import barnax
from barnax.model.prepared import PreparedRecord
from barnax.search.seeds import search_many

from .case import bundled_cell, bundled_problem, bundled_record
from .growth import peak_mib
from .row import Row
from .searches import identify, optimizer_of
from .sizes import KEY, Sizes

NOISE_V = 1e-3
# As long as the bundled record or shorter; one box for all of them, so that they share a program.
LENGTHS = (6000, 8000, 10_000, 12_000, 14_000, 16_000, 18_000, 19_680)
BOUNDS = {f"tau{pair} [s]": (0.5, 5000.0) for pair in (1, 2)}
SINGLE_CELLS = 5
MAX_MIB = 4096


@dataclass(frozen=True)
class Cells:
    """What all cells took, preparing and reducing them apart from searching, and one alone."""

    count: int
    prepared_s: float
    searched_s: float
    one_s: float
    peak_mib: float

    @property
    def total_s(self) -> float:
        return self.prepared_s + self.searched_s


def virtual_record(number: int) -> barnax.Record:
    """The bundled cell's current through another circuit, with noise, of another length."""
    rng, prepared = np.random.default_rng([KEY, number]), _course()
    samples = LENGTHS[number % len(LENGTHS)]
    current_a = prepared.current_a[:samples]
    voltage_v = prepared.source_v[:samples] + NOISE_V * rng.standard_normal(samples)
    voltage_v -= rng.uniform(0.02, 0.1) * current_a
    for shortest_s, longest_s in ((3, 60), (100, 2000)):
        r, tau = rng.uniform(0.005, 0.05), np.exp(rng.uniform(*np.log([shortest_s, longest_s])))
        decay = np.exp(-1 / tau)
        voltage_v -= lfilter([0, r * (1 - decay)], [1, -decay], current_a)
    record, kept = bundled_record(), slice(prepared.first, prepared.first + samples)
    return replace(
        record,
        name=f"virtual cell {number}",
        time_s=record.time_s[kept],
        current_a=current_a,
        voltage_v=voltage_v,
        temperature_degc=None,
        step=None,
        row=record.row[kept],
    )


def identify_cells(records: list[barnax.Record], sizes: Sizes) -> tuple[float, float]:
    """Seconds to prepare and reduce, and to search, all of some cells."""
    begin = time.perf_counter()
    problems = [_problem(record) for record in records]
    prepared_s = time.perf_counter() - begin
    begin = time.perf_counter()
    search_many(problems, optimizer_of(sizes), key=jr.key(KEY), seeds=sizes.seeds_a_cell)
    return prepared_s, time.perf_counter() - begin


def time_cells(sizes: Sizes) -> Cells:
    """All cells at once, with single cells before and after."""
    records = [virtual_record(number) for number in range(sizes.cells)]
    # Every length once, so that nothing is compiled any more.
    identify_cells(records[: len(LENGTHS)], sizes)
    singles = [_one_cell_s(record, sizes) for record in records[:SINGLE_CELLS]]
    prepared_s, searched_s = identify_cells(records, sizes)
    peak = peak_mib()
    singles += [_one_cell_s(record, sizes) for record in records[SINGLE_CELLS : 2 * SINGLE_CELLS]]
    return Cells(sizes.cells, prepared_s, searched_s, statistics.median(singles), peak)


def row_of(cells: Cells, sizes: Sizes) -> Row:
    """The line of the table."""
    alone_s = cells.count * cells.one_s
    return Row(
        f"{cells.count:,} cells x {sizes.seeds_a_cell} seeds, compressed",
        cells.total_s,
        f"one cell x {sizes.seeds_a_cell} seeds, times {cells.count:,}",
        alone_s,
        cells.total_s / alone_s,
        "times as long",
        1.0,
        f"`make_problem` of all {cells.prepared_s:.3g} s, `identify_many` "
        f"{cells.searched_s:.3g} s; the most memory of the process {cells.peak_mib:,.0f} MiB "
        f"({'under' if cells.peak_mib < MAX_MIB else 'over'} {MAX_MIB:,})",
    )


def _one_cell_s(record: barnax.Record, sizes: Sizes) -> float:
    begin = time.perf_counter()
    identify(_problem(record), sizes, sizes.seeds_a_cell)
    return time.perf_counter() - begin


def _problem(record: barnax.Record) -> barnax.Problem:
    window = barnax.Window(initial_soc=_course().start.soc)
    return barnax.make_problem(
        record, bundled_cell(), window=window, bounds=BOUNDS, objective="compressed"
    )


@cache
def _course() -> PreparedRecord:
    return bundled_problem().prepared
