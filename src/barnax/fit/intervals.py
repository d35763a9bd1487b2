"""The interval of every node of fitted tables.

They differ from those of a constant circuit (`uncertainty.covariance`) because tables are smoothed:
a fit with the weights of the objective is smooth where the data determine little, so its standard
errors are too small. They are computed for a fit with a hundredth of the weights, as the sandwich
H^-1 J' G J H^-1 with G the covariance of the noise that `uncertainty.noise` fits to the residuals,
time constants included. The interval is centered on that fit; it is extended to the value where the
weights have moved it further, and to the curve that the table approximates by lines (`curves`),
less the effect of these lines on other values.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import block_diag

from ..cell.elements import alike, is_resistance, rungs_of
from ..cell.parameters import HALF_HYSTERESIS, OCV, OCV_CORRECTION
from ..cell.soc_axis import is_above
from ..execution import in_float64
from ..model.exponentials import span_through
from ..model.prepared import PreparedRecord
from ..model.reduced import Columns, Reduced, blocks
from ..model.reference import errors_along
from ..search.evaluate import nuisance_columns, one_clock
from ..uncertainty.identifiability import are_one
from ..uncertainty.noise import Noise, Slots, fit_gathered
from .node_interval import NodeInterval, mean_weights, parts_of, sum_name
from .objective import Solution, TableObjective
from .table_curves import TableCurve, curves_of

# Share of the smoothing weights in the fit from which standard errors are computed.
LIGHT = 0.01
# Slots of time for the correlation of residuals: no array is longer, however long the record.
MAX_SLOTS = 4096
# Half the step in a logarithm for difference quotients.
STEP = 1e-4
# Directions that move the errors by less than this share of the largest are unseen: below it least
# squares treat their curvature as rounding, and would give them no error at all.
UNSEEN = 1e-6
# A constant whose interval spans this many logarithms, nine decades, is not determined.
WIDEST = 9 * math.log(10)

# For some samples: columns, base error of every voltage, and which come after the first load.
Rows = tuple[Columns, Float[np.ndarray, "rows voltages"], Bool[np.ndarray, "rows"]]


@dataclass(frozen=True, eq=False)
class _Moves:
    """Contributions to the error of every value, those of tables first: of the noise, by column;
    one standard error each of nuisances with priors and of usual values; of the curves that
    straight lines miss; and of the best nuisances. `is_seen` is False for a value on which no
    sample and no free direction depends."""

    noise: Noise
    by_noise: Float[np.ndarray, "values columns"]
    beside: Float[np.ndarray, "values errors"]
    by_lines: Float[np.ndarray, "values"]
    by_best_nuisances: Float[np.ndarray, "values"]
    is_seen: Bool[np.ndarray, "values"]

    def reach(self, weights: Float[np.ndarray, "values"]) -> tuple[float, float, float] | None:
        """The standard error of a weighted sum of values, half its interval and its degrees of
        freedom; None if it is unseen."""
        if not np.any(weights[self.is_seen]):
            return None
        beside = float(np.sum((weights @ self.beside) ** 2))
        return self.noise.reach(weights @ self.by_noise, beside)


@in_float64
def intervals_of(objective: TableObjective, best: Solution) -> tuple[NodeInterval, ...]:
    """The intervals of visited nodes, table by table, of the time constants and gamma, and of the
    means of resistances and sums of them (`means`), which have no SOC."""
    lighter, light = lightly_smoothed(objective, best)
    curves = [*curves_of(objective, best)]
    moves = _moves_of(lighter, light, best, curves)
    count = len(best.unknowns)
    least, most = lighter.box
    is_bound = (light.active_set != 0) & (least < most)
    rows = [row for (name, _), row in objective.visited_rows.items() if is_resistance(name)]
    is_bound &= np.isin(np.arange(count), rows)
    # Beyond a bound of a resistance the data do not count; on its other side they do.
    freed = replace(light, active_set=np.where(is_bound, 0, light.active_set))
    away = _moves_of(lighter, freed, best, curves) if is_bound.any() else moves

    def interval(name: str, soc: float | None, weights, value: float, *unmoved: float):
        """The interval around the unmoved value at the best nuisances, extended to the fitted
        value."""
        bias = max((value - other for other in unmoved), key=abs)
        reach, freed = moves.reach(weights), away.reach(weights)
        bounds = light.active_set[is_bound & (weights[:count] != 0)]
        below, above = (freed if np.any(bounds == end) else reach for end in (1, -1))
        joint = float(weights @ moves.by_best_nuisances)
        low = None if below is None else min(value, min(unmoved) + joint - below[1])
        high = None if above is None else max(value, max(unmoved) + joint + above[1])
        if low is not None and name.startswith(("R", HALF_HYSTERESIS)):
            low = max(low, 0.0)
        return NodeInterval(name, soc, value, reach[0] if reach else 0.0, bias, low, high)

    held = _held_level(objective, best)
    both = np.column_stack([np.concatenate(values) for values in (best.values, light.values)])
    unit = np.eye(len(moves.is_seen))
    intervals = []
    sags = np.concatenate([curve.sags for curve in curves]).tolist()
    for ((name, soc), row), sag in zip(objective.visited_rows.items(), sags, strict=True):
        value, near = both[row].tolist()
        on_curve = near + sag - float(moves.by_lines[row])
        around = interval(name, soc, unit[row], value, near, on_curve)
        intervals.append(around.as_undetermined() if row in held else around)
    dependence, numbers = objective.prepared_records[0].dependence, objective.numbers
    usual = {} if dependence is None else dependence.usual
    of_numbers = {name: math.log(value) for name, value in numbers.items()}
    names = [axis.name for axis in objective.axes]
    logarithms = dict(zip(names, best.log_scales, strict=True)) | of_numbers
    for number, (name, scale) in enumerate(logarithms.items()):
        # In the logarithm, so that the interval is positive.
        around = interval(name, None, unit[count + number], scale, scale)
        value, ends = math.exp(scale), (around.low, around.high)
        if name in usual and around.low is not None and around.high is not None:
            # Whatever the data determine, the interval includes what cells usually have.
            middle, reach = usual[name].logarithm, 2 * usual[name].sd
            ends = (
                max(around.low, min(scale, middle - reach)),
                min(around.high, max(scale, middle + reach)),
            )
        # A constant that may be anything has an open interval, as if no sample moved it.
        is_closed = ends[0] is not None and ends[1] is not None and ends[1] - ends[0] < WIDEST
        low, high = (math.exp(end) if is_closed and end is not None else None for end in ends)
        error = value * around.standard_error if is_closed else 0.0
        intervals.append(NodeInterval(name, None, value, error, 0.0, low, high))

    def mean(name: str) -> NodeInterval:
        weights = np.pad(mean_weights(objective, name), (0, len(unit) - count))
        value, near = (weights[:count] @ both).tolist()
        tables = [objective.names.index(part) for part in parts_of(name)]
        sag = sum(curves[table].mean_above_lines for table in tables)
        return interval(name, None, weights, value, near, near + sag - weights @ moves.by_lines)

    means = {name: mean(name) for name in objective.names if name not in (OCV, OCV_CORRECTION)}
    sums = []
    for last, first in enumerate(range(alike(objective.elements) - 1), 1):
        two = [*means.values()][first + 1 : last + 2]
        total = mean(sum_name([one.name for one in two]))
        gap = best.log_scales[last] - best.log_scales[first]
        reach = moves.reach(unit[count + last] - unit[count + first])
        errors = (one.standard_error / one.value if one.value else 0.0 for one in (total, *two))
        if reach is not None and are_one(gap, reach[1], *errors):
            sums.append(total)
    return (*intervals, *means.values(), *sums)


def _moves_of(
    lighter: TableObjective, light: Solution, best: Solution, curves: Sequence[TableCurve]
) -> _Moves:
    """The contributions to the error of the lightly smoothed fit, in the directions that its bounds
    leave free.
    """
    is_open = [
        axis.low < scale < axis.high
        for axis, scale in zip(lighter.axes, best.log_scales, strict=True)
    ]
    dependence, numbers = lighter.prepared_records[0].dependence, lighter.numbers
    nuisances_v, nuisances_sd = nuisance_columns(lighter.prepared_records, lighter.tables_at(light))
    beside = np.eye(len(numbers) + len(nuisances_sd))
    others = np.asarray(block_diag(np.eye(len(is_open))[:, is_open], beside))
    # Beside the error, the difference between lines and curves.
    voltages = np.concatenate(light.values)[:, None] * [1.0, 0.0]
    rows = _with_curves(lighter, curves, nuisances_v, jacobian_blocks(lighter, light))
    fit = LinearizedFit.of(lighter, light, others, rows, voltages)
    directions, slopes, weight = fit.directions, fit.slopes, fit.prior_weight
    normal = with_penalty(lighter, fit.products, directions)
    usual = {} if dependence is None else dependence.usual
    given = np.arange(len(normal) - len(nuisances_sd), len(normal))
    normal[given, given] += weight
    indices = [len(normal) - len(given) - len(numbers) + [*numbers].index(name) for name in usual]
    pull = best.objective_v2 * np.array([number.pull for number in usual.values()])
    normal[indices, indices] += pull
    lengths = np.diag(fit.products)
    is_seen = lengths > UNSEEN**2 * np.max(lengths)
    # Columns of H^-1 J' / N by which the noise moves every value. By least squares, because a short
    # record leaves some of them undetermined.
    by_nuisances = directions @ np.linalg.lstsq(normal, np.eye(len(normal))[:, given])[0]
    # Usual values are themselves uncertain.
    back = directions @ np.linalg.lstsq(normal, np.eye(len(normal))[:, indices])[0]
    errors = pull * np.array([number.sd for number in usual.values()])
    return _Moves(
        noise=fit.noises[0],
        by_noise=directions @ np.linalg.lstsq(normal, fit.to_noise.T)[0],
        beside=np.hstack([weight * by_nuisances, back * errors]),
        by_lines=directions @ np.linalg.lstsq(normal, slopes[:, 1])[0],
        by_best_nuisances=-by_nuisances @ (slopes[given, 0] + weight * nuisances_sd),
        is_seen=np.any(directions[:, is_seen] != 0, axis=1),
    )


def _held_level(objective: TableObjective, best: Solution) -> range:
    """The rows of the lowest visited nodes, below 10 % SOC, separated only by the bound that an OCV
    rises: under load, an OCV that falls there and a resistance that rises look alike.
    """
    table = 1 + objective.pairs
    if not (objective.settings.rising_ocv and objective.reduced.layout.has_correction):
        return range(0)
    first, nodes = objective.block(table).start, objective.nodes_of[table]
    low = np.flatnonzero(objective.visited_of(table) & ~is_above(nodes)) + first
    free = np.flatnonzero(best.active_set[low[1:]] >= 0)
    held = int(free[0]) if len(free) else max(0, len(low) - 1)
    return range(int(low[0]), int(low[held]) + 1) if held else range(0)


def _with_curves(
    objective: TableObjective,
    curves: Sequence[TableCurve],
    nuisances_v: Float[np.ndarray, "samples nuisances"],
    rows: Iterable[Rows],
) -> Iterator[Rows]:
    """The rows with the given additional columns, and with one more voltage: the errors if the
    tables' curves were the truth."""
    soc = np.concatenate([prepared.soc[prepared.scored] for prepared in objective.prepared_records])
    first = 0
    for columns, base, is_informative in rows:
        here = soc[first : first + len(base)]
        nuisance_v = nuisances_v[first : first + len(base)]
        first += len(base)
        left = sum(
            columns[:, objective.block(table)].sum(axis=1) * curve.above_lines(here)
            for table, curve in enumerate(curves)
        )
        yield np.hstack([columns, nuisance_v]), np.column_stack([base, left]), is_informative


def lightly_smoothed(objective: TableObjective, best: Solution) -> tuple[TableObjective, Solution]:
    """The objective with hardly any smoothing, and its tables at the same time constants."""
    lighter = replace(objective, smoothing_scale=LIGHT * objective.smoothing_scale)
    return lighter, lighter.solve(best.log_scales, best.active_set, exact=True)


def with_penalty(
    objective: TableObjective,
    products: Float[np.ndarray, "directions directions"],
    directions: Float[np.ndarray, "values directions"],
) -> Float[np.ndarray, "directions directions"]:
    """J'J / N with the smoothing added; the first values are those of the tables."""
    bent = objective.table_penalty @ directions[: len(objective.to_tables)]
    return products + bent.T @ bent


@dataclass(frozen=True, eq=False)
class LinearizedFit:
    """The least squares of N samples, linearized at an optimum along the given directions of
    values.

    With J = Q T and H = J'J / N and the smoothing, a noise u moves the values by the directions
    times H^-1 T' Q' u / N: their covariance is the sandwich H^-1 J' G J H^-1 / N^2, with G that
    of the noise.

    Attributes:
        directions: The change of every value along each direction.
        noises: The noise of every voltage, in the coordinates Q.
        to_noise: T / N.
        products: J'J / N.
        slopes: J'e / N of every voltage.
        prior_weight: Weight of a prior with a standard deviation of one, relative to the voltages:
            the strength of the first noise over N.
    """

    directions: Float[np.ndarray, "values directions"]
    noises: list[Noise]
    to_noise: Float[np.ndarray, "seen directions"]
    products: Float[np.ndarray, "directions directions"]
    slopes: Float[np.ndarray, "directions voltages"]
    prior_weight: float

    @classmethod
    def of(
        cls,
        objective: TableObjective,
        optimum: Solution,
        others: Float[np.ndarray, "others other_directions"],
        rows: Iterable[Rows],
        values: Float[np.ndarray, "tables_values voltages"] | None = None,
    ) -> "LinearizedFit":
        """From the rows of `jacobian_blocks`, in the directions that the bounds leave free for the
        tables and in those of all `others`; every voltage has its own table `values`, or those of
        the optimum."""
        if values is None:
            values = np.concatenate(optimum.values)[:, None]
        directions = np.asarray(block_diag(objective.free_directions(optimum), others))
        time_s = one_clock(objective.prepared_records)
        longest_s = max(prepared.scored_duration_s for prepared in objective.prepared_records)
        slots = Slots.of(time_s, longest_s, MAX_SLOTS)
        width, voltages = directions.shape[1], values.shape[1]
        # For [J e 1]: the sums in every slot, and the scalar products.
        sums, products = (
            np.zeros((slots.count, width + voltages + 1)),
            np.zeros((width + voltages,) * 2),
        )
        first = 0
        for columns, base, is_informative in rows:
            here = time_s[first : first + len(base)][is_informative]
            first += len(base)
            errors_v = base + columns[:, : len(values)] @ values
            both = np.column_stack([columns @ directions, errors_v])[is_informative]
            sums += slots.gathered(here, np.column_stack([both, np.ones(len(both))]))
            products += both.T @ both
        columns, errors_v, counts = np.split(sums, [width, width + voltages], axis=1)
        squares_v2 = np.diag(products)[width:]
        products, slopes = products[:width, :width], products[:width, width:]
        scale = np.sqrt(np.diag(products))
        scale = np.where(scale > 0, scale, 1.0)
        lengths, vectors = np.linalg.eigh(products / np.outer(scale, scale))
        seen = lengths > UNSEEN * lengths[-1]
        # J = Q T with T the square root of J'J in the seen directions.
        root = np.sqrt(lengths[seen])
        to_noise = root[:, None] * vectors[:, seen].T * scale
        columns = (columns / scale) @ vectors[:, seen] / root
        noises = fit_gathered(
            slots,
            counts=counts[:, 0],
            errors_v=errors_v,
            columns=columns,
            squares_v2=squares_v2,
        )
        samples = len(time_s)
        parts = (part / samples for part in (to_noise, products, slopes))
        strength_v2 = float(np.mean(np.diag(noises[0].spread_v2)))
        return cls(directions, noises, *parts, prior_weight=strength_v2 / samples)


def jacobian_blocks(
    objective: TableObjective,
    best: Solution,
    voltage_offsets_v: Float[np.ndarray, "simulated voltages"] | None = None,
    further: Callable[[int], Float[np.ndarray, "scored further"]] | None = None,
    every: int = 1,
) -> Iterator[Rows]:
    """Columns of all values, of all axes, of a dependence's numbers and of `further` unknowns at
    the scored samples, the base error of every voltage, and whether samples come after the first
    load.

    `voltage_offsets_v` is as in `reduce_records`; `further` gives the columns of a record by its
    index. Every `every`-th sample of a block counts.
    """
    tau, rate = best.log_scales[: objective.pairs], best.log_scales[objective.pairs :]
    rungs = rungs_of(objective.elements)
    log_taus = np.array([tau[rung.element] + math.log(rung.ratio) for rung in rungs])
    around = np.array([-STEP, 0.0, STEP])
    in_tau = span_through((log_taus[:, None] + around).ravel().tolist())
    in_rate = span_through((-rate[0] + around).tolist()) if rate else None
    layout = replace(objective.reduced.layout, in_tau=in_tau, in_rate=in_rate)
    # By the tables' values: with a rising OCV the unknowns are its steps.
    by_values = replace(objective, settings=replace(objective.settings, rising_ocv=False))
    for index, prepared in enumerate(objective.prepared_records):
        of_numbers = _dependence_slopes(prepared, objective, best)
        none = np.empty((np.count_nonzero(prepared.scored), 0))
        others, first = none if further is None else further(index), 0
        is_informative = prepared.is_informative
        for block in blocks(prepared, layout):
            scored = np.flatnonzero(prepared.scored[block.here])
            if not len(scored):
                continue
            counted = scored[::every]
            rows = block.rows(block.local_columns[counted], np.arange(layout.width))
            sampled = replace(by_values, reduced=Reduced(layout, 1, rows))
            columns, base = sampled.columns(best.log_scales)
            slopes = [
                (axis.columns_at(scale + STEP) - axis.columns_at(scale - STEP))
                @ (np.ones(1) if axis.table is None else best.values[axis.table])
                / (2 * STEP)
                for axis, scale in zip(sampled.axes, best.log_scales, strict=True)
            ]
            slopes += [slope[block.here][counted] for slope in of_numbers]
            here, first = slice(first, first + len(scored), every), first + len(scored)
            columns = np.column_stack([columns, *slopes, others[here]])
            voltages = (
                base[:, None]
                if voltage_offsets_v is None
                else base[:, None] + voltage_offsets_v[block.here][counted]
            )
            yield columns, voltages, is_informative[block.here][counted]


def _dependence_slopes(
    prepared: PreparedRecord, objective: TableObjective, best: Solution
) -> list[Float[np.ndarray, "simulated"]]:
    """The derivatives of the error by the logarithm of every number of the resistance law."""
    law, slopes = prepared.dependence, []
    if law is None:
        return slopes
    tables = objective.tables_at(best)
    for name, value in law.numbers.items():
        laws = [law.with_numbers({name: value * math.exp(step)}) for step in (STEP, -STEP)]
        above, below = (errors_along(prepared, replace(tables, dependence=one)) for one in laws)
        slopes.append((above - below) / (2 * STEP))
    return slopes
