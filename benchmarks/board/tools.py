"""The tools on the board: each makes a circuit of one record, and predicts another with it."""

import csv
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares, nnls
from scipy.signal import lfilter

import barnax
from barnax import CircuitParameters, InputError
from barnax.cell.parameters import OHMIC
from barnax.execution import in_float64
from barnax.fit.table_fit import TableFit
from barnax.model.prepared import PreparedRecord, prepare_record
from barnax.model.reference import errors_along

from .records import Split

# Errors in V of every simulated sample of a record.
Predict = Callable[[PreparedRecord], np.ndarray]
TAUS_S = np.geomspace(2, 1000, 16)
NODES = np.linspace(0, 1, 9)
# Weight of the tables' second differences, in mean squares of their columns.
SMOOTH = 0.01
STARTS = 10


@dataclass(frozen=True)
class Fitted:
    """What a tool made of a record: how it predicts, how long it took, the errors in V on the
    record left out, which of its samples are above 10 % SOC, and how many intervals of R0 hold
    that of the record left out, of how many."""

    seconds: float
    errors_v: np.ndarray
    is_high: np.ndarray
    intervals: tuple[int, int] = (0, 0)

    def rmse_mv(self, is_high: bool) -> float:
        """The RMSE above or below 10 % SOC."""
        errors_v = self.errors_v[self.is_high == is_high]
        return 1e3 * float(np.sqrt(np.mean(errors_v**2))) if len(errors_v) else math.nan


@dataclass(frozen=True)
class Grid:
    """A record on an even clock, for tools that have no other: of each time the sample before it,
    with the current `ohmic_a` of its voltage, and `held_a` until the next sample."""

    interval_s: float
    time_s: np.ndarray
    ohmic_a: np.ndarray
    held_a: np.ndarray
    over_v: np.ndarray
    soc: np.ndarray
    scored: np.ndarray

    @classmethod
    def of(cls, prepared: PreparedRecord, least_s: float = 0.0) -> "Grid":
        interval_s = max(float(np.median(np.diff(prepared.time_s))), least_s)
        time_s = np.arange(prepared.time_s[0], prepared.time_s[-1], interval_s)
        at = np.searchsorted(prepared.time_s, time_s, side="right") - 1
        over_v = prepared.voltage_v - prepared.source_v
        samples = prepared.current_a, prepared.held_a, over_v, prepared.soc, prepared.scored
        return cls(interval_s, time_s, *(one[at] for one in samples))  # pyrefly: ignore

    def response(self, tau_s: float, drive_a: np.ndarray) -> np.ndarray:
        """What an RC pair of 1 Ohm answers to currents that are held until the next time."""
        decay = math.exp(-self.interval_s / tau_s)
        return lfilter([0.0, 1 - decay], [1.0, -decay], drive_a, axis=0)


def scipy_constants(prepared: PreparedRecord) -> Predict:
    """Two RC pairs: the best of ten starts of SciPy's `least_squares` (trf), in logarithms."""
    grid, rng = Grid.of(prepared), np.random.default_rng(0)
    low, high = np.log([1e-4, 1e-4, 1e-4, 1, 30]), np.log([0.3, 0.3, 0.3, 60, 2000])

    def residuals_v(logs: np.ndarray) -> np.ndarray:
        r0, r1, r2, tau1_s, tau2_s = np.exp(logs)
        pairs = (r1, tau1_s), (r2, tau2_s)
        pairs_v = sum(r_ohm * grid.response(tau_s, grid.held_a) for r_ohm, tau_s in pairs)
        return (grid.over_v + r0 * grid.ohmic_a + pairs_v)[grid.scored]

    starts = rng.uniform(low, high, (STARTS, 5))
    answers = [least_squares(residuals_v, start, bounds=(low, high)) for start in starts]
    r0, r1, r2, *taus_s = np.exp(min(answers, key=lambda one: one.cost).x)
    return along(CircuitParameters.of_tau(r0, (r1, r2), taus_s))


def projected_tables(prepared: PreparedRecord) -> Predict:
    """Resistances at nine nodes over SOC: non-negative least squares for every two of sixteen time
    constants, from one matrix of products."""
    grid = Grid.of(prepared)
    hats = np.stack([np.interp(grid.soc, NODES, row) for row in np.eye(len(NODES))], axis=1)
    held_a = hats * grid.held_a[:, None]
    blocks = [hats * grid.ohmic_a[:, None], *(grid.response(tau_s, held_a) for tau_s in TAUS_S)]
    columns = np.concatenate(blocks, axis=1)[grid.scored]
    products = columns.T @ columns
    bends = np.diff(np.eye(len(NODES)), n=2, axis=0)
    for at in range(0, len(products), len(NODES)):
        block = products[at : at + len(NODES), at : at + len(NODES)]
        block += SMOOTH * np.trace(block) / len(NODES) * bends.T @ bends
    products += 1e-9 * np.trace(products) * np.eye(len(products))
    target = -columns.T @ grid.over_v[grid.scored]
    best = None
    for pair in combinations(range(len(TAUS_S)), 2):
        used = np.concatenate([np.arange(9) + 9 * block for block in (0, *(k + 1 for k in pair))])
        factor = np.linalg.cholesky(products[np.ix_(used, used)])
        side = np.linalg.solve(factor, target[used])
        ohm, left = nnls(factor.T, side)
        # What is left of the voltage, but for a constant.
        value = left**2 - side @ side
        if best is None or value < best[0]:
            best = value, pair, np.maximum(ohm, 1e-9).reshape(3, 9)
    assert best is not None, "there are pairs of time constants"
    _, pair, (r0, *r) = best
    return along(CircuitParameters.over_soc(NODES, TAUS_S[[*pair]], r0, r))


def regression(prepared: PreparedRecord) -> Predict:
    """The structure of PyBatteryID (Sheikh et al.) without its sparsity and hysteresis: every
    second the overvoltage is regressed on its two samples before and on three currents, each by 1,
    SOC, 1 / SOC and log SOC; simulated freely."""
    grid = Grid.of(prepared, least_s=1.0)

    def rows(over_v: np.ndarray, one: Grid) -> np.ndarray:
        soc = np.clip(one.soc[2:], 0.01, 1.0)
        basis = np.stack([np.ones_like(soc), soc, 1 / soc, np.log(soc)], axis=1)
        current_a = one.ohmic_a
        signals = over_v[1:-1], over_v[:-2], current_a[2:], current_a[1:-1], current_a[:-2]
        return np.concatenate([basis * signal[:, None] for signal in signals], axis=1)

    scored = grid.scored[2:]
    columns = rows(grid.over_v, grid)[scored]
    coefficients, *_ = np.linalg.lstsq(columns, grid.over_v[2:][scored])

    def predict(other: PreparedRecord) -> np.ndarray:
        one = Grid.of(other, least_s=1.0)
        of_current = rows(np.zeros_like(one.over_v), one) @ coefficients
        bases = rows(np.ones_like(one.over_v), one)[:, :8]
        first, second = bases[:, :4] @ coefficients[:4], bases[:, 4:] @ coefficients[4:8]
        over_v = np.zeros_like(one.over_v)
        for k, terms in enumerate(zip(of_current, first, second, strict=True), start=2):
            over_v[k] = np.clip(
                terms[0] + terms[1] * over_v[k - 1] + terms[2] * over_v[k - 2], -9, 9
            )
        simulated_v = other.source_v + np.interp(other.time_s, one.time_s, over_v)
        return other.voltage_v - simulated_v

    return predict


def along(circuit: CircuitParameters) -> Predict:
    """The errors of a circuit, sample by sample on the record's own clock."""
    return in_float64(lambda prepared: errors_along(prepared, circuit))


PEERS: dict[str, Callable[[PreparedRecord], Predict]] = {
    "SciPy trf, ten starts, constants": scipy_constants,
    "NumPy and SciPy nnls, tables": projected_tables,
    "LPV regression, as in PyBatteryID": regression,
}


def with_barnax(split: Split) -> Fitted:
    """`barnax.identify` as it comes; intervals of R0 against what the record left out gives."""
    begin = time.perf_counter()
    result = identified(split, split.fitted)
    seconds = time.perf_counter() - begin
    inside = list(holds_r0(result.fit, identified(split, split.left_out).fit))
    path, window = split.left_out
    evaluation = result.validate(path, counted_over(window, split.capacity_ah))
    prepared = evaluation.prepared
    errors_v, soc = evaluation.error_v[prepared.scored], prepared.soc[prepared.scored]
    return Fitted(seconds, errors_v, soc > 0.1, (sum(inside), len(inside)))


def holds_r0(fit: TableFit, other: TableFit) -> Iterator[bool]:
    """Whether the interval at every node that both visit holds the R0 of another record."""
    span = other.mean_soc or (0.0, 1.0)
    for node in fit.intervals:
        if node.name != OHMIC or node.low is None or node.high is None:
            continue
        soc = 0.5 if node.soc is None else node.soc
        if span[0] <= soc <= span[1]:
            yield node.low <= float(other.tables.at(OHMIC, np.array(soc))) <= node.high


def identified(split: Split, part: tuple[Path, barnax.Window]) -> barnax.Result:
    """A record by itself, with the OCV tests."""
    path, window = part
    return barnax.identify(path, ocv=split.ocv, window=window, capacity=split.capacity_ah)


def counted_over(window: barnax.Window, capacity_ah: float | None) -> barnax.Window:
    """The window with the capacity that is counted over."""
    return barnax.Window(**{**vars(window), "capacity_ah": capacity_ah})


@in_float64
def prepared_of(split: Split) -> tuple[PreparedRecord, PreparedRecord]:
    """The record to fit to and the one left out, with the OCV that every tool is given."""
    tests = [barnax.read_record(path) for path in split.ocv]
    cell = barnax.characterize(tests, capacity_ah=split.capacity_ah, ocv_fit="interpolated")
    parts = (split.fitted, split.left_out)
    first, second = (
        prepare_record(barnax.read_record(path), cell, "so-rc", window) for path, window in parts
    )
    return first, second


def with_peer(make: Callable[[PreparedRecord], Predict], split: Split) -> Fitted:
    """A tool that is given what barnax has: OCV, start, capacity, and the counted samples."""
    begin = time.perf_counter()
    fitted, left_out = prepared_of(split)
    predict = make(fitted)
    seconds = time.perf_counter() - begin
    errors_v = predict(left_out)[left_out.scored]
    return Fitted(seconds, errors_v, left_out.soc[left_out.scored] > 0.1)


def submitted(path: Path) -> CircuitParameters:
    """A circuit from a CSV: `SOC` and `R0 [Ohm]`, `R1 [Ohm]`, ... with `tau1 [s]`, ... of which the
    first row counts. Raises `InputError` for another one."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    try:
        pairs = range(1, sum(name.startswith("R") for name in rows[0]))
        taus_s = [float(rows[0][f"tau{pair} [s]"]) for pair in pairs]
        tables = [[float(row[f"R{k} [Ohm]"]) for row in rows] for k in (0, *pairs)]
        nodes = [float(row["SOC"]) for row in rows]
    except (KeyError, IndexError, TypeError, ValueError) as problem:
        raise InputError(
            f"{path}: no table of a circuit ({problem!r}); give the columns SOC, R0 [Ohm], "
            "R1 [Ohm], tau1 [s] and so on, with a number in every row"
        ) from problem
    if len(nodes) == 1:
        return CircuitParameters.of_tau(tables[0][0], [row[0] for row in tables[1:]], taus_s)
    return CircuitParameters.over_soc(nodes, taus_s, tables[0], tables[1:])


def median(values: Sequence[float]) -> float:
    """The median of those that are numbers."""
    return float(np.nanmedian(values)) if len(values) else math.nan
