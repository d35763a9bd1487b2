"""The cells of a pack: one current and many voltages, so one reduction with as many right-hand
sides.

The SOC axis is the mean cell's, and every cell has its own OCV on it. At the pack's time constants
the columns of all cells are the same, and so is the projection of residual noise on them. What
remains for each cell is a least-squares problem in a box, and the fit of its own noise. Derivatives
by the time constants are the mean cell's for all; they give values, to first order, at each cell's
own time constants.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..cell import CircuitParameters
from ..cell.parameters import OHMIC
from ..execution import in_float64
from ..model.descent import polish
from ..model.prepared import PreparedRecord
from ..model.reduced import combine_factors
from .flat_ocv import with_fitted_ocv, with_flat_ocv
from .intervals import LIGHT, UNSEEN, LinearizedFit, jacobian_blocks, lightly_smoothed, with_penalty
from .objective import Solution, TableObjective
from .settings import TableSettings
from .table_problem import reduced_objective, search_ranges

# Range of SOC over which resistances are averaged: near the ends few samples determine them.
MIDDLE = (0.1, 0.9)
# Starts and capacities with a wider half interval than this, in SOC or as a share, are omitted.
WIDEST = 0.1
R0, TOTAL, SHIFT, CAPACITY, LOADED = (
    OHMIC, "total R [Ohm]", "SOC shift", "capacity ratio", "loaded voltage [V]",
)  # fmt: skip
QUANTITIES = (R0, TOTAL, SHIFT, CAPACITY, LOADED)


@dataclass(frozen=True)
class Value:
    """A value with its 95 % interval.

    Attributes:
        value: The value.
        low: Lower end of the interval.
        high: Upper end.
    """

    value: float
    low: float
    high: float

    def widened(self, reach: float) -> "Value":
        """The value with its interval widened by another independent half-width."""
        low = self.value - math.hypot(self.value - self.low, reach)
        return Value(self.value, low, self.value + math.hypot(self.high - self.value, reach))

    def spanning(self, shifts: Sequence[float]) -> "Value":
        """The value with an interval that includes equally possible values at these distances; what
        is positive stays so."""
        low = max(self.low + min([0.0, *shifts]), min(self.low, 0.0))
        return Value(self.value, low, self.high + max([0.0, *shifts]))


@dataclass(frozen=True, eq=False)
class PackCell:
    """One cell of a pack.

    Attributes:
        name: Its column.
        rmse_v: RMSE of its tables, from the reduction.
        tables: Its tables over the pack's SOC.
        ocv_v: Its OCV at `ocv_nodes`; nan without a sample nearby.
        values: By name: R0 and the sum of all resistances, averaged over the visited nodes from 10
            to 90 % SOC; its start SOC minus the mean cell's, and its capacity over the mean's, if
            its OCV determines them; and its voltage under 1C at the lowest visited SOC above 10 %.
            With shared time constants these are, to first order, at the cell's own, while `tables`
            are at the pack's.
    """

    name: str
    rmse_v: float
    tables: CircuitParameters
    ocv_v: tuple[float, ...]
    values: Mapping[str, Value]


@dataclass(frozen=True, eq=False)
class PackFit:
    """All cells of a pack on one SOC axis, that of the mean cell.

    Attributes:
        ocv_nodes: States of charge of the cells' OCVs.
        loaded_soc: SOC of their loaded voltages.
        cells: The cells.
    """

    ocv_nodes: tuple[float, ...]
    loaded_soc: float
    cells: tuple[PackCell, ...]


@in_float64
def fit_pack(
    prepared: PreparedRecord,
    tables: CircuitParameters,
    voltage_offsets_v: Float[np.ndarray, "simulated cells"],
    names: Sequence[str],
    settings: TableSettings,
    has_separate_taus: bool = False,
) -> PackFit:
    """The tables of every cell of a pack.

    Args:
        prepared: The mean cell's record.
        tables: Its tables, with the time constants of the pack.
        voltage_offsets_v: Each cell's voltage minus the mean.
        names: Names of the cells.
        settings: Settings of the fit.
        has_separate_taus: Give every cell its own time constants, by descents that start at the
            pack's.
    """
    # At the nodes of the mean cell's correction, the OCV of a shifted cell would be coarse.
    prepared = with_flat_ocv([prepared])[0].with_dependence(tables.dependence)
    settings = replace(with_fitted_ocv(settings), nodes=tables.nodes, folds=0)
    constants = tables.constants
    sides_v = np.column_stack([np.zeros(len(prepared.soc)), voltage_offsets_v])
    held = {
        name: (constants[name], constants[name]) for name in search_ranges([prepared], settings)
    }
    pack = reduced_objective([prepared], settings, held, voltage_offsets_v=[sides_v])
    count, log_scales = 1 + len(names), tuple(math.log(low) for low, _ in held.values())
    parts = [replace(pack, reduced=pack.reduced.of_voltage(number)) for number in range(count)]
    optima = [one.solve(log_scales, exact=True) for one in parts]
    light = [lightly_smoothed(one, start)[1] for one, start in zip(parts, optima, strict=True)]
    lighter = replace(parts[0], smoothing_scale=LIGHT)
    others = np.eye(len(lighter.axes) + len(lighter.numbers))
    values = np.column_stack([np.concatenate(solution.values) for solution in light])
    fit = LinearizedFit.of(
        lighter, light[0], others, jacobian_blocks(lighter, light[0], sides_v), values
    )
    by_noise = _moved(fit, lighter, fit.to_noise.T)
    # All tables are at their optimum; what is left is the slope by the scales, relative to the mean
    # cell's.
    by_scales = fit.slopes[:, :1] - fit.slopes
    by_scales[: -len(others)] = 0.0
    # To each voltage's own time constants, for tables smoothed as usual and lightly.
    steps = [_moved(fit, weighted, by_scales) for weighted in (parts[0], lighter)]

    def reach_of(number: int, direction: Float[np.ndarray, "values"]) -> float:
        """Half the 95 % interval of a combination of values."""
        return fit.noises[number].reach(direction @ by_noise)[1]

    variance = np.einsum("ij,jk,ik->i", by_noise, fit.noises[0].spread_v2, by_noise)
    loaded_soc, directions = _directions(pack, optima[0], prepared, variance)
    if has_separate_taus:
        wide = reduced_objective([prepared], settings, voltage_offsets_v=[sides_v])
        for number in range(count):
            alone = replace(wide, reduced=combine_factors([wide.reduced.of_voltage(number)]))
            start = alone.solve(optima[number].log_scales, optima[number].active_set)
            met = polish(alone, start)
            optima[number] = alone.solve(met.log_scales, met.active_set, exact=True)
            light[number] = lightly_smoothed(alone, optima[number])[1]
    mean_cell = np.concatenate(light[0].values)
    ocv = pack.block(1 + pack.pairs)
    ocv_nodes = np.array(pack.reduced.layout.ocv_nodes)
    seen = pack.visited_of(1 + pack.pairs)
    cell_v = prepared.cell.average_ocv_v(ocv_nodes)
    loaded_v = float(prepared.cell.average_ocv_v(np.array([loaded_soc]))[0])
    cells = []
    for number, name in enumerate(names, 1):
        best = optima[number]
        rows, lightly = (np.concatenate(solution.values) for solution in (best, light[number]))
        if not has_separate_taus:
            # Reported values are at the cell's own time constants, to first order.
            rows, lightly = rows + steps[0][:, number], lightly + steps[1][:, number]
        shown: dict[str, Value] = {}
        for what, direction in directions.items():
            # Relative quantities have the values of the lightly smoothed fit.
            is_other, level_v = what in (SHIFT, CAPACITY), loaded_v if what == LOADED else 0.0
            pair = (lightly - mean_cell,) * 2 if is_other else (rows, lightly)
            value, near = (float(direction @ tables) + level_v for tables in pair)
            # The circuit's own error is common to all cells; the mean cell gives its best estimate.
            common = 0.0 if is_other else reach_of(0, direction)
            reach = math.hypot(reach_of(number, direction), common)
            ends = min(value, near - reach), max(value, near + reach)
            if is_other and reach > WIDEST:
                continue
            if what == CAPACITY:
                value, *ends = (1 / (1 - end) for end in (value, *ends))
            shown[what] = Value(value, *ends)
        ocv_v = np.where(seen, cell_v + np.concatenate(best.values)[ocv], np.nan)
        rmse_v = math.sqrt(float(best.error @ best.error))
        cells.append(PackCell(name, rmse_v, pack.tables_at(best), tuple(ocv_v.tolist()), shown))
    return PackFit(tuple(ocv_nodes.tolist()), loaded_soc, tuple(cells))


def _moved(
    fit: LinearizedFit, weighted: TableObjective, pushes: Float[np.ndarray, "directions pushes"]
) -> Float[np.ndarray, "values pushes"]:
    """The changes of smoothed tables under pushes, with the penalty of an objective."""
    normal = with_penalty(weighted, fit.products, fit.directions)
    moved = fit.directions @ np.linalg.lstsq(normal, pushes, UNSEEN**2)[0]
    return moved[: len(weighted.to_tables)]


def _directions(
    pack: TableObjective,
    mean: Solution,
    prepared: PreparedRecord,
    variance: Float[np.ndarray, "values"],
) -> tuple[float, dict[str, Float[np.ndarray, "values"]]]:
    """The SOC at which every cell is loaded, and its quantities as combinations of its tables'
    values.

    A cell that starts fuller by a, with a capacity of 1 / (1 - c) of the mean's, is at the pack's
    SOC s on its own OCV at s + a + (s0 - s) c. So a and c are the least squares of its OCV minus
    the mean's by the slope of the latter, each node weighted by its inverse variance.
    """
    nodes, visited = pack.nodes_of[0], pack.visited
    is_middle = visited & (nodes >= MIDDLE[0]) & (nodes <= MIDDLE[1])
    chosen = is_middle if np.any(is_middle) else visited
    mean_of = chosen / chosen.sum()
    size = sum(len(nodes) for nodes in pack.nodes_of)
    sums = {name: np.zeros(size) for name in QUANTITIES}
    sums[R0][pack.block(0)] = mean_of
    table = 1 + pack.pairs
    block, ocv_nodes = pack.block(table), pack.nodes_of[table]
    low = float(nodes[chosen][0])
    for resistance in range(table):
        sums[TOTAL][pack.block(resistance)] = mean_of
        sums[LOADED][pack.block(resistance)] = -prepared.capacity_ah * (nodes == low)
    sums[LOADED][block] = np.array([np.interp(low, ocv_nodes, e) for e in np.eye(len(ocv_nodes))])

    seen = np.flatnonzero(pack.visited_of(table))
    ocv_v = prepared.cell.average_ocv_v(ocv_nodes) + mean.values[table]
    slope = np.gradient(ocv_v[seen], ocv_nodes[seen])
    start = float(prepared.soc[0])
    design = slope[:, None] * np.column_stack([np.ones(len(seen)), start - ocv_nodes[seen]])
    variance = variance[block][seen]
    weight = np.where(variance > 0, 1 / np.sqrt(np.where(variance > 0, variance, 1.0)), 0.0)
    estimator = np.linalg.pinv(design * weight[:, None]) * weight
    for name, row in zip((SHIFT, CAPACITY), estimator, strict=True):
        sums[name][block.start + seen] = row
    return low, sums
