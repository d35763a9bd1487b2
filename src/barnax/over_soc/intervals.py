"""The interval of every node of fitted tables.

They are not those of a constant circuit (`uncertainty.covariance`), for tables are smoothed: a fit
with the weights of the objective is smooth where the data say little, so its own standard errors
are too small. They are taken of a fit with a hundredth of the weights, as the sandwich
H^-1 J' G J H^-1 with G the covariance of the noise that `uncertainty.noise` fits to the residuals,
time constants included. That fit is where the interval lies; it reaches on to the value where the
weights have moved it further, and to the curve of which the table is lines (`curves`), less what
these lines have moved other values.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import block_diag
from scipy.special import stdtrit

from ..cell.elements import rungs_of
from ..cell.parameters import HALF_HYSTERESIS, CircuitParameters
from ..cell.soc_axis import is_above
from ..execution import in_float64
from ..model.exponentials import span_through
from ..model.prepared import PreparedRecord
from ..model.reduced import Columns, blocks
from ..model.reference import errors_along
from ..uncertainty.covariance import CONFIDENCE
from ..uncertainty.joined import one_clock, open_starts
from ..uncertainty.noise import Noise, Slots, fit_gathered
from .curves import TableCurve, curves_of
from .objective import Solution, TableObjective

# Of the smoothing weights, those of the fit that standard errors are of.
LIGHT = 0.01
# Slots of time in which residuals are correlated: no array is longer, however long the record.
MAX_SLOTS = 4096
# Half the step in a logarithm of which slopes are differences.
STEP = 1e-4
# Directions that move the errors by less than this share of what the largest do are unseen: below
# it least squares take their curvature for rounding, and would give them no error at all.
UNSEEN = 1e-6
# A constant that may lie anywhere over such a span of logarithms, nine decades, is not told.
WIDEST = 9 * math.log(10)

# Of some samples: columns, base error of every side, and which come after the first load.
Rows = tuple[Columns, Float[np.ndarray, "rows sides"], Bool[np.ndarray, "rows"]]
# The ends of what another record would show.
RECORD_ENDS = ("record_low", "record_high")


@dataclass(frozen=True)
class NodeInterval:
    """One node's value of one table with its confidence interval; `soc` is None of a constant.

    `standard_error` allows for the residuals' autocorrelation, `bias` is what smoothing and the
    straight lines between nodes may have moved; the interval holds both. `low` and `high` are None,
    and the error zero, where a bound decides the value or no sample depends on it. `record_low` and
    `record_high` are what another record of the cell would show, by the spread of those identified
    on; None of fewer than three.
    """

    name: str
    soc: float | None
    value: float
    standard_error: float
    bias: float
    low: float | None
    high: float | None
    record_low: float | None = None
    record_high: float | None = None

    @property
    def is_biased(self) -> bool:
        """True where the value may have been moved further than its standard error."""
        return abs(self.bias) > self.standard_error

    def opened(self) -> "NodeInterval":
        """The same, not determined."""
        ends = dict.fromkeys(("low", "high", "record_low", "record_high"))
        return replace(self, standard_error=0.0, **ends)

    def between(self, other: "NodeInterval", soc: float) -> "NodeInterval":
        """What lies on the line to another node: no wider, for what the two leave open is not all
        in common. Not determined where one of them is not."""
        first, last = self.soc or 0.0, other.soc or 0.0
        share = (soc - first) / (last - first)
        pairs = {
            name: (getattr(self, name), getattr(other, name))
            for name in ("value", "standard_error", "bias", "low", "high", *RECORD_ENDS)
        }
        lines = {
            name: None if None in pair else (1 - share) * pair[0] + share * pair[1]
            for name, pair in pairs.items()
        }
        line = replace(self, soc=soc, **lines)
        return line.opened() if line.low is None or line.high is None else line

    def moved(self, by: float) -> "NodeInterval":
        """The same with value and interval counted from elsewhere."""
        ends = {
            name: None if (end := getattr(self, name)) is None else end + by
            for name in ("low", "high", "record_low", "record_high")
        }
        return replace(self, value=self.value + by, **ends)

    def spanning(self, shifts: Sequence[float]) -> "NodeInterval":
        """The same with an interval that includes those of equally possible values so far off."""
        if self.low is None or self.high is None:
            return self
        low, high = max(self.low + min([0.0, *shifts]), 0.0), self.high + max([0.0, *shifts])
        if self.record_low is None or self.record_high is None:
            return replace(self, low=low, high=high)
        # Another record leaves it open too.
        ends = {"record_low": min(self.record_low, low), "record_high": max(self.record_high, high)}
        return replace(self, low=low, high=high, **ends)


@in_float64
def intervals_of(objective: TableObjective, best: Solution) -> tuple[NodeInterval, ...]:
    """The intervals of visited nodes, table after table, then of the time constants and gamma."""
    lighter, light = unsmoothed(objective, best)
    is_open = [
        axis.low < scale < axis.high
        for axis, scale in zip(objective.axes, best.log_scales, strict=True)
    ]
    of_tables = lighter.ways(light)
    dependence, numbers = objective.facts[0].dependence, objective.numbers
    of_constants = block_diag(np.eye(len(is_open))[:, is_open], np.eye(len(numbers)))
    starts_v, starts_sd = open_starts(objective.prepared_records)
    ways = np.asarray(block_diag(of_tables, of_constants, np.eye(len(starts_sd))))
    values, curves = np.concatenate(light.values)[:, None], [*curves_of(objective, best)]
    # Beside the error, the one that lines leave of the curves.
    sides = np.hstack([values, np.zeros_like(values)])
    rows = _with_curves(objective, curves, starts_v, linearized(lighter, light))
    (noise, *_), to_noise, products, slopes = noises_behind(lighter, sides, ways, rows)
    normal = with_penalty(lighter, products, of_tables)
    usual = {} if dependence is None else dependence.usual
    begun = np.arange(len(normal) - len(starts_sd), len(normal))
    weight = float(np.mean(np.diag(noise.spread_v2))) / objective.reduced.scored
    normal[begun, begun] += weight
    places = [len(normal) - len(begun) - len(numbers) + [*numbers].index(name) for name in usual]
    pull = best.objective_v2 * np.array([number.pull for number in usual.values()])
    normal[places, places] += pull
    is_seen = np.diag(products) > UNSEEN**2 * np.max(np.diag(products))
    # Columns of H^-1 J' / N by which the noise moves every value.
    # By least squares, for a short record leaves some of them undetermined.
    moved = ways @ np.linalg.lstsq(normal, to_noise.T)[0]
    variance = np.einsum("ij,jk,ik->i", moved, noise.spread_v2, moved)
    moved_by_lines = ways @ np.linalg.lstsq(normal, slopes[:, 1])[0]
    by_starts = ways @ np.linalg.lstsq(normal, np.eye(len(normal))[:, begun])[0]
    variance += np.sum((weight * by_starts) ** 2, axis=1)
    to_joint = -by_starts @ (slopes[begun, 0] + weight * starts_sd)
    if places:
        # What is usual is itself uncertain.
        back = ways @ np.linalg.lstsq(normal, np.eye(len(normal))[:, places])[0]
        variance += (back * pull) ** 2 @ np.array([number.sd for number in usual.values()]) ** 2
    errors = np.sqrt(np.maximum(variance, 0.0))
    freedom = [max(1.0, min(noise.degrees_of_freedom(row), 1e6)) for row in moved]
    factors = stdtrit(np.array(freedom), (1 + CONFIDENCE) / 2)
    is_known = np.any(ways[:, is_seen] != 0, axis=1)

    def interval(name: str, soc: float | None, number: int, value: float, *unmoved: float):
        """Around what would stand there had nothing moved it, with the starts that fit best, as
        far as the value."""
        bias = max((value - other for other in unmoved), key=abs)
        if not is_known[number]:
            return NodeInterval(name, soc, value, 0.0, bias, None, None)
        error = float(errors[number])
        reach = float(factors[number]) * error
        joint = float(to_joint[number])
        low = min(value, min(unmoved) + joint - reach)
        high = max(value, max(unmoved) + joint + reach)
        return NodeInterval(name, soc, value, error, bias, low, high)

    held = _held_level(objective, best)
    found, both = [], np.column_stack([np.concatenate(best.values), values]).tolist()
    sags = np.concatenate([curve.sags for curve in curves]).tolist()
    places = zip(objective.visited_rows.items(), sags, strict=True)
    for ((name, soc), row), sag in places:
        value, own = both[row]
        on_curve = own + sag - float(moved_by_lines[row])
        around = interval(name, soc, row, value, own, on_curve)
        if name.startswith(("R", HALF_HYSTERESIS)) and around.low is not None:
            around = replace(around, low=max(around.low, 0.0))
        found.append(around.opened() if row in held else around)
    of_numbers = {name: math.log(value) for name, value in numbers.items()}
    names = [axis.name for axis in objective.axes]
    logarithms = dict(zip(names, best.log_scales, strict=True)) | of_numbers
    for number, (name, scale) in enumerate(logarithms.items()):
        # Of the logarithm, so that the interval is positive.
        around = interval(name, None, len(best.unknowns) + number, scale, scale)
        value, ends = math.exp(scale), (around.low, around.high)
        if name in usual and around.low is not None and around.high is not None:
            # However little the data tell, that is what cells usually have.
            middle, reach = usual[name].logarithm, 2 * usual[name].sd
            ends = (
                max(around.low, min(scale, middle - reach)),
                min(around.high, max(scale, middle + reach)),
            )
        # What may be anything has no end, as where no sample moves it.
        is_told = ends[0] is not None and ends[1] is not None and ends[1] - ends[0] < WIDEST
        low, high = (math.exp(end) if is_told and end is not None else None for end in ends)
        error = value * around.standard_error if is_told else 0.0
        found.append(NodeInterval(name, None, value, error, 0.0, low, high))
    return tuple(found)


def _held_level(objective: TableObjective, best: Solution) -> range:
    """The rows of the lowest visited nodes, below 10 % SOC, between which only the bound that an
    OCV rises decides: under load, an OCV that falls there and a resistance that rises look alike.
    """
    place = 1 + objective.pairs
    if not (objective.settings.rising_ocv and objective.reduced.layout.has_correction):
        return range(0)
    first, nodes = objective.block(place).start, objective.nodes_of[place]
    low = np.flatnonzero(objective.visited_of(place) & ~is_above(nodes)) + first
    free = np.flatnonzero(best.sides[low[1:]] >= 0)
    held = int(free[0]) if len(free) else max(0, len(low) - 1)
    return range(int(low[0]), int(low[held]) + 1) if held else range(0)


def _with_curves(
    objective: TableObjective,
    curves: Sequence[TableCurve],
    starts_v: Float[np.ndarray, "samples starts"],
    rows: Iterable[Rows],
) -> Iterator[Rows]:
    """The rows with columns of the records' starts, and with one more side: the errors that would
    be, were the tables' curves the truth."""
    soc = np.concatenate([prepared.soc[prepared.scored] for prepared in objective.prepared_records])
    first = 0
    for columns, base, informed in rows:
        here = soc[first : first + len(base)]
        begun_v = starts_v[first : first + len(base)]
        first += len(base)
        left = sum(
            columns[:, objective.block(table)].sum(axis=1) * curve.above_lines(here)
            for table, curve in enumerate(curves)
        )
        yield np.hstack([columns, begun_v]), np.column_stack([base, left]), informed


def unsmoothed(objective: TableObjective, found: Solution) -> tuple[TableObjective, Solution]:
    """The objective with hardly any smoothing, and its tables at the same time constants."""
    lighter = replace(objective, smoothing_scale=LIGHT * objective.smoothing_scale)
    return lighter, lighter.solve(found.log_scales, found.sides, exact=True)


def with_penalty(
    objective: TableObjective,
    products: Float[np.ndarray, "ways ways"],
    of_tables: Float[np.ndarray, "values few"],
) -> Float[np.ndarray, "ways ways"]:
    """J'J / N with what the smoothing adds, the first ways being those of the tables."""
    normal, count = products.copy(), of_tables.shape[1]
    bent = objective.table_penalty @ of_tables
    normal[:count, :count] += bent.T @ bent
    return normal


def noises_behind(
    objective: TableObjective,
    values: Float[np.ndarray, "values sides"],
    ways: Float[np.ndarray, "all_values ways"],
    rows: Iterable[Rows],
) -> tuple[
    list[Noise],
    Float[np.ndarray, "seen ways"],
    Float[np.ndarray, "ways ways"],
    Float[np.ndarray, "ways sides"],
]:
    """The noise in coordinates Q, the T / N with J = Q T, J'J / N and J'e / N of some ways to move,
    from the rows of `linearized`: of every side, with its tables' values."""
    time_s = one_clock(objective.prepared_records)
    longest_s = max(prepared.scored_duration_s for prepared in objective.prepared_records)
    slots = Slots.of(time_s, longest_s, MAX_SLOTS)
    width, sides = ways.shape[1], values.shape[1]
    counts, errors = np.zeros(slots.count), np.zeros((slots.count, sides))
    sums = np.zeros((slots.count, width))
    products, slopes, first = np.zeros((width, width)), np.zeros((width, sides)), 0
    squares_v2 = np.zeros(sides)
    for columns, base, informed in rows:
        here = time_s[first : first + len(base)][informed]
        first += len(base)
        error = (base + columns[:, : len(values)] @ values)[informed]
        columns = columns[informed] @ ways
        counts += slots.gathered(here, np.ones(len(error)))
        errors += slots.gathered(here, error)
        sums += slots.gathered(here, columns)
        products += columns.T @ columns
        slopes += columns.T @ error
        squares_v2 += np.einsum("ij,ij->j", error, error)
    scale = np.sqrt(np.diag(products))
    scale = np.where(scale > 0, scale, 1.0)
    lengths, vectors = np.linalg.eigh(products / np.outer(scale, scale))
    seen = lengths > UNSEEN * lengths[-1]
    # J = Q T with T the square root of J'J in the seen directions.
    root = np.sqrt(lengths[seen])
    to_noise = root[:, None] * vectors[:, seen].T * scale
    columns = (sums / scale) @ vectors[:, seen] / root
    noises = fit_gathered(
        slots,
        counts=counts,
        errors_v=errors,
        columns=columns,
        products=np.eye(len(root)),
        squares_v2=squares_v2,
    )
    samples = len(time_s)
    return noises, to_noise / samples, products / samples, slopes / samples


def linearized(
    objective: TableObjective,
    found: Solution,
    beside_v: Float[np.ndarray, "simulated sides"] | None = None,
) -> Iterator[Rows]:
    """Columns of all unknowns, of all axes and of a dependence's numbers at the scored samples, the
    base error of every side, and which of them come after the first load. `beside_v` is as
    `reduce_records` has it."""
    pairs, layout = objective.pairs, objective.reduced.layout
    tau, rate = found.log_scales[:pairs], found.log_scales[pairs:]
    rungs = rungs_of(objective.elements)
    rung_scales = [tau[rung.element] + math.log(rung.ratio) for rung in rungs]
    in_tau = span_through(_around(rung_scales))
    in_rate = span_through([-scale for scale in _around(rate)]) if rate else None
    layout = replace(layout, in_tau=in_tau, in_rate=in_rate)
    part = replace(objective.reduced, layout=layout)
    for prepared in objective.prepared_records:
        beside = _dependence_slopes(prepared, objective.tables_at(found))
        for block in blocks(prepared, layout, beside_v):
            scored = prepared.scored[block.here]
            if not np.any(scored):
                continue
            rows = replace(part, scored=1, factor=block.rows(layout, scored))
            answers, responses, initial, current, correction, base = map(rows.part, layout.sizes)
            taus = np.zeros((3 * pairs, *answers.shape[1:]))
            for own, rung in zip(answers.reshape(-1, 3, *answers.shape[1:]), rungs, strict=True):
                taus[3 * rung.element : 3 * rung.element + 3] += rung.share * own
            amplitude, base = list(initial), base[:, :, 0].T
            if rate and layout.has_amplitude:
                amplitude = [initial[0] + responses[1]]
            elif rate:
                base = base + responses[1]
            tables = [*current, *taus[1::3], *correction, *amplitude]
            moved = [
                (taus[3 * pair + 2] - taus[3 * pair]) @ found.values[pair + 1] / (2 * STEP)
                for pair in range(pairs)
            ]
            if rate:
                counts = found.values[-1] if layout.has_amplitude else np.ones(1)
                moved.append((responses[2] - responses[0]) @ counts / (2 * STEP))
            moved += [slope[block.here][scored] for slope in beside]
            columns = np.concatenate([*tables, np.stack(moved, axis=1)], axis=1)
            yield columns, base, prepared.informed[block.here][scored]


def _dependence_slopes(
    prepared: PreparedRecord, tables: CircuitParameters
) -> list[Float[np.ndarray, "simulated"]]:
    """The derivatives of the error by the logarithm of every number that resistances follow."""
    if tables.dependence is None:
        return []
    found = []
    for name, value in tables.dependence.numbers.items():
        above, below = (
            errors_along(
                prepared,
                replace(
                    tables,
                    dependence=tables.dependence.with_numbers({name: value * math.exp(step)}),
                ),
            )
            for step in (STEP, -STEP)
        )
        found.append((above - below) / (2 * STEP))
    return found


def _around(scales: Sequence[float]) -> list[float]:
    """Every scale with what is one step beside it."""
    return [scale + step for scale in scales for step in (-STEP, 0.0, STEP)]
