"""A result in the form that all tools need: constants, and curves over SOC as tables for linear
interpolation."""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from ..cell import CellModel, CircuitParameters, get_circuit
from ..cell.circuits import Circuit, Hysteresis
from ..cell.curves import KNOTS, SegmentedHysteresis
from ..cell.elements import get_element, names_of
from ..cell.parameters import HALF_HYSTERESIS, OCV, OCV_CORRECTION, OHMIC
from ..errors import InputError, escaped
from ..fit.settings import circuit_name
from ..results import Result
from .exporter import caveats_of

# Accuracy of a linearly interpolated table.
TOLERANCE_V = 50e-6
MAX_HALVINGS = 20
DIGITS_SOC, DIGITS_V = 9, 7
# An independent hysteresis fit steps at its knots; the lower side is this far before them.
STEP_SOC = 10.0**-DIGITS_SOC
# Tables between measured temperatures are at most this far apart, so that linear interpolation
# reproduces resistances that are exponential in 1/T within half a percent.
BETWEEN_DEGC = 5.0

Values = Float[np.ndarray, "points"]


@dataclass(frozen=True, eq=False)
class VoltageTable:
    """A voltage in V over SOC, strictly increasing from 0 or below to 1, for linear
    interpolation."""

    soc: Values
    voltage_v: Values

    def __call__(self, soc: Values) -> Values:
        return np.interp(soc, self.soc, self.voltage_v)

    @property
    def largest_v(self) -> float:
        return float(np.abs(self.voltage_v).max())


@dataclass(frozen=True, eq=False)
class Tables:
    """A result as other tools use it. Discharge current is positive.

    `resistances` are R0, R1 and so on in ohm: a single value each; if the circuit is tabulated, one
    for each of `nodes` over SOC; if it is also tabulated over temperature, a row of those for each
    of `degc`, the measured temperatures and some interpolated between them. `parameters` are those
    at the temperature nearest to 25 degC. `ocv` includes the correction of the tables, and is the
    one nearest to 25 degC; `ocv_v` is the same, with a row for each of `degc` if there are several.

    `hysteresis` is W(soc), charge minus discharge OCV in V, None if the circuit has none. The
    circuit adds half of it after charging and subtracts half of it after discharging: at once
    (`kind` is "instant"), or with a state that follows the charge passed at the rate `gamma` per
    unit of SOC ("dynamic"); a current below the rest current turns neither. `caveats` name nodes
    that are not determined on their own, and temperatures that were not measured.
    """

    result: Result
    caveats: tuple[str, ...]
    parameters: CircuitParameters
    tau_s: tuple[float, ...]
    gamma: float | None
    nodes: tuple[float, ...] | None
    degc: tuple[float, ...] | None
    resistances: dict[str, np.ndarray]
    capacity_ah: float
    kind: str
    ocv: VoltageTable
    ocv_v: np.ndarray
    hysteresis: VoltageTable | None

    @property
    def pairs(self) -> int:
        return len(self.tau_s)

    @property
    def initial_hysteresis_v(self) -> float:
        """The share of the hysteresis in the voltage at the start."""
        if self.hysteresis is None:
            return 0.0
        w_v = self.hysteresis(np.array([self.result.initial_soc]))[0]
        return float(self.result.start.direction * w_v / 2)

    @property
    def heading(self) -> str:
        """The circuit, its record and its error in a sentence."""
        result, errors = self.result, self.result.metrics.identification
        return (
            f"Written by barnax {escaped(result.versions.get('barnax', ''))}: circuit "
            f"{circuit_name(result.model, result.over)}, identified on {escaped(errors.record)} "
            f"with an RMSE of {1e3 * errors.rmse_v:.3f} mV. Discharge current is positive."
        )


def tables_of(result: Result, may_remember: bool = False) -> Tables:
    """A result's constants and tables. Raises `InputError` if no curve over SOC can represent them.

    `may_remember` is True for a format that itself remembers where the current turned.
    """
    circuit, fits = get_circuit(result.model), result.fits
    if circuit.hysteresis.kind == "loops" and not may_remember:
        raise InputError(
            f"the hysteresis of {circuit.name} depends on where the current last changed "
            "direction, which no table over SOC holds; export `to` 'c-filter', or identify esc or "
            "iso-rc"
        )
    reference = fits.reference_degc
    cell, degc, index = result.cell_at(reference), None, 0
    cells, answers = [cell], [fits.reference.tables]
    if fits.tables:
        degc = _with_some_between(fits.tables.temperatures_degc)
        cells, index = [result.cell.at(each) for each in degc], degc.index(reference)
        answers = [fits.tables.at(each) for each in degc]
    answers = [tables.laddered() for tables in answers]
    over_soc = [_from_empty_to_full(tables) for tables in answers] if fits.over else []
    # R0, R1 and so on first, then the temperatures.
    resistances = np.stack([tables.ohm for tables in over_soc or answers], axis=1)
    resistances = resistances if degc else resistances[:, 0]
    soc, ocv_v = _ocv(circuit, cells, over_soc)
    hysteresis, parameters = circuit.hysteresis_on(cell), answers[index]
    return Tables(
        result=result,
        caveats=_caveats(result, circuit, cell, over_soc),
        parameters=parameters,
        tau_s=parameters.tau_s,
        gamma=parameters.gamma,
        nodes=over_soc[0].nodes if over_soc else None,
        degc=degc,
        resistances={f"R{number}": values for number, values in enumerate(resistances)},
        capacity_ah=cell.capacity_ah,
        kind=hysteresis.kind,
        ocv=VoltageTable(soc, ocv_v[index]),
        ocv_v=ocv_v if degc else ocv_v[index],
        hysteresis=_hysteresis(hysteresis, cell, over_soc[index] if over_soc else None),
    )


def _caveats(
    result: Result, circuit: Circuit, cell: CellModel, over_soc: Sequence[CircuitParameters]
) -> tuple[str, ...]:
    """Notes on what the export omits about the capacity, the OCV, elements and constants at a
    bound; on nodes that are extrapolated, and on temperatures that were not measured."""
    ladders, pairs = [], 0
    for element, names in zip(circuit.elements, names_of(circuit.elements), strict=True):
        count = len(get_element(element).shares)
        if count > 1:
            ladders.append((names, get_element(element).description, pairs + 1, pairs + count))
        pairs += count
    bounds = {bound.name for bound in result.at_bound}
    bounds |= result.fits.held
    facts = [fact for fact in result.fit.facts if fact.soc is None and not fact.is_mean]
    facts = [fact for fact in facts if fact.is_assessed and fact.name not in bounds]
    limits = [fact for fact in facts if fact.high is not None and not fact.low]
    undetermined = [fact.name for fact in facts if fact.low is None and fact.high is None]
    unseen_ocv = _ocv_without_samples(result)
    facts_of = result, cell, unseen_ocv, ladders, undetermined, limits
    caveats = caveats_of("beside_tables", *facts_of)
    if not over_soc:
        return caveats
    unseen = ~np.all([tables.visited for tables in over_soc], axis=0)
    return caveats + caveats_of(
        "of_tables",
        result,
        np.array(over_soc[0].nodes)[unseen].tolist(),
        *map(dict.items, _open_resistances(result)),
        circuit.hysteresis_on(cell).kind != "none",
    )


def _ocv_without_samples(result: Result) -> Iterator[tuple[float | None, str]]:
    """The ranges of nodes of a fitted OCV without samples nearby, at each temperature."""
    nodes = [node for node in result.fits.settings.ocv_nodes or () if 0 <= node <= 1]
    for degc, fit in result.fits.by_degc:
        seen = {node.soc for node in fit.of_table(OCV)}
        # Neighbors form one range.
        groups = itertools.groupby(nodes, key=lambda node: node in seen)
        runs = [list(run) for is_seen, run in groups if seen and not is_seen]
        if runs:
            yield degc, ", ".join(f"{run[0]:g} to {run[-1]:g}" for run in runs)


def _with_some_between(measured_degc: tuple[float, ...]) -> tuple[float, ...]:
    """The measured temperatures, and further ones at most `BETWEEN_DEGC` apart."""
    parts = [
        np.linspace(low, high, math.ceil((high - low) / BETWEEN_DEGC), endpoint=False)
        for low, high in itertools.pairwise(measured_degc)
    ]
    return (*np.concatenate(parts).tolist(), measured_degc[-1])


def _ocv(
    circuit: Circuit, cells: Sequence[CellModel], over_soc: Sequence[CircuitParameters]
) -> tuple[Values, Float[np.ndarray, "temperatures points"]]:
    """The OCV of every cell on one SOC grid, corrected by the tables. Every node is a grid point,
    so that the correction is exact."""
    means = [linear_table(partial(circuit.ocv_v, cell), _bends(cell)) for cell in cells]
    nodes = np.array(over_soc[0].nodes if over_soc else [])
    points = np.concatenate([nodes, *(mean.soc for mean in means)])
    soc = np.unique(np.round(points, DIGITS_SOC))
    ocv_v = np.array([mean(soc) for mean in means])
    for row_v, tables in zip(ocv_v, over_soc, strict=False):
        if OCV_CORRECTION in tables.tables:
            row_v += tables.at(OCV_CORRECTION, soc)
    return soc, np.round(ocv_v, DIGITS_V)


def _hysteresis(
    hysteresis: Hysteresis, cell: CellModel, over_soc: CircuitParameters | None
) -> VoltageTable | None:
    """W(soc): from the tables, the cell's segments, or the gap that a circuit uses."""
    if over_soc is not None and HALF_HYSTERESIS in over_soc.tables:
        w_v = 2 * np.array(over_soc.tables[HALF_HYSTERESIS])
        return VoltageTable(np.round(over_soc.nodes, DIGITS_SOC), np.round(w_v, DIGITS_V))
    if hysteresis.kind == "none":
        return None
    if hysteresis.gap_v is CellModel.hysteresis_v:
        return segment_table(cell.hysteresis)
    return linear_table(partial(hysteresis.gap_v, cell), _bends(cell))


def _bends(cell: CellModel) -> Values:
    """States of charge at which the curves of a cell may bend."""
    return np.concatenate([cell.charge.soc, cell.discharge.soc])


def _from_empty_to_full(tables: CircuitParameters) -> CircuitParameters:
    """A copy with nodes from SOC 0 to 1: a tool may extrapolate beyond the ends, or refuse a table
    with a single node."""
    first, last = tables.nodes[0] > 0, tables.nodes[-1] < 1

    def held(table: tuple) -> tuple:
        return (*table[:first], *table, *table[len(table) - last :])

    return replace(
        tables,
        nodes=(*[0.0][:first], *tables.nodes, *[1.0][:last]),
        tables={name: held(row) for name, row in tables.tables.items()},
        visited=held(tables.visited),
    )


def _open_resistances(result: Result) -> tuple[dict[str, set[float]], dict[str, set[float]]]:
    """The SOC of the nodes, by name, at which samples do not determine a resistance or a fitted
    OCV, and of those at which the resistance of a pair may be zero."""
    undetermined: dict[str, set[float]] = {}
    may_be_zero: dict[str, set[float]] = {}
    for fact in (fact for fit in result.fits for fact in fit.facts if fact.is_assessed):
        name, _, unit = fact.name.partition(" ")
        if fact.soc is None or (unit != "[Ohm]" and fact.name != OCV):
            continue
        if fact.low is None and fact.high is None:
            undetermined.setdefault(name, set()).add(fact.soc)
        elif not fact.low and unit == "[Ohm]" and fact.name != OHMIC:
            may_be_zero.setdefault(name, set()).add(fact.soc)
    return undetermined, may_be_zero


def linear_table(
    curve: Callable[[Values], Values], breakpoints: Values, tolerance_v: float = TOLERANCE_V
) -> VoltageTable:
    """A curve from SOC 0 to 1 as a table whose linear interpolation is within a tolerance.

    Intervals between `breakpoints` (where the curve may bend) are halved until they are straight.

    >>> table = linear_table(lambda soc: 3 + soc**2, np.array([0.5]), tolerance_v=1e-3)
    >>> len(table.soc), float(abs(table(np.array([0.3])) - 3.09)[0]) < 1e-3
    (17, True)
    """
    soc = np.unique(np.round(np.clip([0.0, 1.0, *breakpoints], 0, 1), DIGITS_SOC))
    for _ in range(MAX_HALVINGS):
        width = np.diff(soc)
        is_bent = np.zeros(len(width), bool)
        # A cubic can cross its chord in the middle, not at all three quarters.
        for share in (0.25, 0.5, 0.75):
            chord_v = (1 - share) * curve(soc[:-1]) + share * curve(soc[1:])
            is_bent |= np.abs(curve(soc[:-1] + share * width) - chord_v) > tolerance_v
        if not is_bent.any():
            break
        middle = (soc[:-1] + width / 2)[is_bent]
        soc = np.unique(np.round(np.concatenate([soc, middle]), DIGITS_SOC))
    return VoltageTable(soc, np.round(curve(soc), DIGITS_V))


def segment_table(hysteresis: SegmentedHysteresis) -> VoltageTable:
    """W(soc) at the ends of its segments, with a step at a knot as two points close together."""
    soc, voltage_v = [], []
    for index, (left_v, right_v) in enumerate(hysteresis.ends_v):
        if not voltage_v or left_v != voltage_v[-1]:
            if voltage_v:
                soc[-1] -= STEP_SOC
            soc.append(float(KNOTS[index]))
            voltage_v.append(left_v)
        soc.append(float(KNOTS[index + 1]))
        voltage_v.append(right_v)
    return VoltageTable(np.round(soc, DIGITS_SOC), np.array(voltage_v))
