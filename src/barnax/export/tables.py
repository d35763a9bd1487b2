"""What every tool asks of a result: constants, and curves over SOC as tables read linearly."""

import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from ..cell import CellModel, CircuitParameters, SocTables, get_circuit
from ..cell.circuits import Circuit
from ..cell.curves import KNOTS, SegmentedHysteresis
from ..errors import InputError
from ..results import Result

# A table read linearly follows its curve this closely.
TOLERANCE_V = 50e-6
MOST_HALVINGS = 20
DIGITS_SOC, DIGITS_V = 9, 7
# An independent hysteresis fit steps at its knots; the lower side stands this far before them.
STEP_SOC = 10.0**-DIGITS_SOC
# Between measured temperatures there is one at least so often, so that a table read linearly
# follows resistances that are exponential in 1/T within half a percent.
BETWEEN_DEGC = 5.0
EVERYWHERE = np.linspace(0.0, 1.0, 101)

Hysteresis = Literal["none", "instant", "dynamic"]
Values = Float[np.ndarray, "points"]


@dataclass(frozen=True, eq=False)
class Table:
    """A voltage in V over SOC, strictly increasing from 0 or below to 1, to be read linearly."""

    soc: Values
    voltage_v: Values

    def __call__(self, soc: Values) -> Values:
        return np.interp(soc, self.soc, self.voltage_v)


@dataclass(frozen=True, eq=False)
class TemperatureAxis:
    """Tables at rising temperatures: the measured ones, and what is interpolated between them.

    `capacities_ah` are those at the measured ones. `ocv_v` is the corrected OCV at every
    temperature and every `soc`, those of `Tables.ocv`.
    """

    degc: tuple[float, ...]
    measured_degc: tuple[float, ...]
    capacities_ah: tuple[float, ...]
    over_soc: tuple[SocTables, ...]
    soc: Values
    ocv_v: Float[np.ndarray, "temperatures points"]

    @property
    def resistances(self) -> dict[str, Float[np.ndarray, "temperatures nodes"]]:
        """R0, R1 and so on in ohm."""
        values = [np.array([each.r0_ohm, *each.r_ohm]) for each in self.over_soc]
        return {f"R{number}": each for number, each in enumerate(np.stack(values, axis=1))}


@dataclass(frozen=True, eq=False)
class Tables:
    """A result as other tools take it. Discharge current is positive.

    `hysteresis` is W(soc), charge minus discharge OCV in V, None where the circuit has none. The
    circuit adds half of it after charging and takes half of it away after discharging: at once
    (`kind` is "instant"), or with a state that follows the charge passed at the rate
    `parameters.gamma` per unit of SOC ("dynamic"); a current below `rest_current_a` turns neither.
    `initial_direction` is the direction the simulation starts with, +1 charging. Where the circuit
    is tabulated, `over_soc` has its resistances and time constants and `parameters` are those of
    the constant circuit beside it; the OCV has the correction in it, and the hysteresis is the
    tabulated one. Where it is tabulated over temperature too, these are of the one nearest to
    25 degC, and `over_temperature` has all.
    """

    model: str
    heading: str
    parameters: CircuitParameters
    capacity_ah: float
    initial_soc: float
    initial_direction: int
    rest_current_a: float
    kind: Hysteresis
    ocv: Table
    hysteresis: Table | None
    over_soc: SocTables | None = None
    over_temperature: TemperatureAxis | None = None

    @property
    def pairs(self) -> int:
        return (self.over_soc or self.parameters).pairs

    @property
    def tau_s(self) -> tuple[float, ...]:
        return (self.over_soc or self.parameters).tau_s

    @property
    def gamma(self) -> float | None:
        return (self.over_soc or self.parameters).gamma

    @property
    def resistances(self) -> dict[str, tuple[float, ...]]:
        """R0, R1 and so on in ohm: one value, or one for each node over SOC."""
        if self.over_soc is not None:
            values = (self.over_soc.r0_ohm, *self.over_soc.r_ohm)
        else:
            values = tuple((r,) for r in (self.parameters.r0, *self.parameters.r))
        return {f"R{number}": each for number, each in enumerate(values)}

    @property
    def largest_hysteresis_v(self) -> float:
        return 0.0 if self.hysteresis is None else float(np.abs(self.hysteresis.voltage_v).max())

    @property
    def initial_hysteresis_v(self) -> float:
        """What the hysteresis adds to the OCV at the start."""
        if self.hysteresis is None:
            return 0.0
        w_v = self.hysteresis(np.array([self.initial_soc]))[0]
        return float(self.initial_direction * w_v / 2)


def tables_of(result: Result, may_remember: bool = False) -> Tables:
    """A result's constants and tables. Raises `InputError` where no curve over SOC says them.

    A format that itself remembers where the current turned says so by `may_remember`.
    """
    cell = result.cell_at(result.tables.found.reference_degc if result.tables else None)
    circuit = get_circuit(result.model)
    if circuit.turning is not None and not may_remember:
        raise InputError(
            f"the hysteresis of {circuit.name} depends on where the current last changed "
            "direction, which no table over SOC holds; export `to` 'c-filter', or identify esc or "
            "iso-rc"
        )
    kind = _kind_of(circuit, cell)
    over_soc = _from_empty_to_full(result.tables.fit.tables) if result.tables else None
    breakpoints = np.concatenate([cell.charge.soc, cell.discharge.soc])
    ocv, hysteresis = _average(circuit, cell), None
    if kind != "none":
        hysteresis = _hysteresis(circuit, cell, breakpoints)
    axis = _temperature_axis(result, circuit)
    if over_soc is not None:
        ocv = _corrected(ocv, over_soc, () if axis is None else axis.soc)
        if over_soc.half_hysteresis_v is not None:
            hysteresis = _on_nodes(over_soc, 2 * np.array(over_soc.half_hysteresis_v))
    return Tables(
        model=result.model,
        heading=_heading(result),
        parameters=result.circuit_parameters,
        capacity_ah=cell.capacity_ah,
        initial_soc=result.initial_soc,
        initial_direction=result.start_direction,
        rest_current_a=result.start_rest_current_a,
        kind=kind,
        ocv=ocv,
        hysteresis=hysteresis,
        over_soc=over_soc,
        over_temperature=axis,
    )


def _average(circuit: Circuit, cell: CellModel) -> Table:
    """The mean of the source after charging and after discharging."""
    breakpoints = np.concatenate([cell.charge.soc, cell.discharge.soc])
    return linear_table(lambda soc: np.mean(_sources_v(circuit, cell, soc), axis=0), breakpoints)


def _temperature_axis(result: Result, circuit: Circuit) -> TemperatureAxis | None:
    """All temperatures of a result, and further ones between them."""
    tables = result.tables and result.tables.found.tables
    if tables is None:
        return None
    measured = tables.temperatures_degc
    parts = [
        np.linspace(low, high, math.ceil((high - low) / BETWEEN_DEGC), endpoint=False)
        for low, high in itertools.pairwise(measured)
    ]
    degc = (*np.concatenate(parts).tolist(), measured[-1])
    over_soc = tuple(_from_empty_to_full(tables.at(each)) for each in degc)
    averages = [_average(circuit, result.cell.at(each)) for each in degc]
    soc = np.unique(np.concatenate([each.soc for each in averages]))
    corrected = [
        _corrected(average, each, soc) for average, each in zip(averages, over_soc, strict=True)
    ]
    ocv_v = np.array([each.voltage_v for each in corrected])
    capacities_ah = tuple(result.cell_at(each).capacity_ah for each in measured)
    return TemperatureAxis(degc, measured, capacities_ah, over_soc, corrected[0].soc, ocv_v)


def _from_empty_to_full(tables: SocTables) -> SocTables:
    """The same circuit with nodes that reach SOC 0 and 1: a tool may go on straight beyond the
    ends, or take no table of a single node."""
    first, last = tables.nodes[0] > 0, tables.nodes[-1] < 1

    def held(table: tuple) -> tuple:
        return (*table[:first], *table, *table[len(table) - last :])

    correction_v, half_v = tables.ocv_correction_v, tables.half_hysteresis_v
    return replace(
        tables,
        nodes=(*[0.0][:first], *tables.nodes, *[1.0][:last]),
        r0_ohm=held(tables.r0_ohm),
        r_ohm=tuple(held(each) for each in tables.r_ohm),
        ocv_correction_v=None if correction_v is None else held(correction_v),
        half_hysteresis_v=None if half_v is None else held(half_v),
        visited=held(tables.visited),
    )


def table_caveats(tables: Tables) -> tuple[str, ...]:
    """Which nodes mean nothing by themselves, and which temperatures were not measured; nothing
    where all were."""
    over_soc, axis = tables.over_soc, tables.over_temperature
    if over_soc is None:
        return ()
    visited = [over_soc.visited] if axis is None else [each.visited for each in axis.over_soc]
    unseen = zip(over_soc.nodes, np.all(visited, axis=0), strict=True)
    nodes = ", ".join(f"{node:g}" for node, is_visited in unseen if not is_visited)
    where = "" if axis is None else ", at one temperature or more"
    told = [
        f"No sample is near the nodes at SOC {nodes}{where}: their values follow from their "
        "neighbors'."
    ]
    if axis is None:
        return tuple(told) if nodes else ()
    measured = ", ".join(f"{each:.3g}" for each in axis.measured_degc)
    text = (
        f"Identified at {measured} degC. Between these, the logarithm of the resistances is "
        "interpolated over 1/T; beyond them, the tables of the nearest temperature apply."
    )
    if tables.kind != "none":
        text += " The hysteresis voltage is that of the temperature nearest to 25 degC."
    if len(set(axis.capacities_ah)) > 1:
        own_ah = ", ".join(f"{each:.4g}" for each in axis.capacities_ah)
        text += f" So is the capacity; at {measured} degC it was {own_ah} Ah."
    return (*(told if nodes else []), text)


def _heading(result: Result) -> str:
    over = " with tables over SOC" if result.tables else ""
    over += " and temperature" if result.tables and result.tables.over_temperature else ""
    errors = result.answer_metrics.identification
    return (
        f"Written by barnax {result.versions.get('barnax', '')}: circuit {result.model}{over}, "
        f"identified on {errors.record} with an RMSE of {1e3 * errors.rmse_v:.3f} mV. Discharge "
        "current is positive."
    )


def _corrected(ocv: Table, over_soc: SocTables, more: Iterable[float] = ()) -> Table:
    """The OCV with its correction: exact, as every node is a point of it; `more` are too."""
    nodes = np.array(over_soc.nodes)
    soc = np.unique(np.round(np.concatenate([ocv.soc, nodes, np.asarray(more)]), DIGITS_SOC))
    correction_v = over_soc.ocv_correction_v
    added_v = 0.0 if correction_v is None else np.interp(soc, nodes, correction_v)
    return Table(soc, np.round(ocv(soc) + added_v, DIGITS_V))


def _on_nodes(over_soc: SocTables, voltage_v: Values) -> Table:
    return Table(np.round(over_soc.nodes, DIGITS_SOC), np.round(voltage_v, DIGITS_V))


def linear_table(
    curve: Callable[[Values], Values], breakpoints: Values, tolerance_v: float = TOLERANCE_V
) -> Table:
    """A curve from SOC 0 to 1 as a table that linear interpolation follows within a tolerance.

    Intervals between `breakpoints` (where the curve may bend) are halved until they are straight.

    >>> table = linear_table(lambda soc: 3 + soc**2, np.array([0.5]), tolerance_v=1e-3)
    >>> len(table.soc), float(abs(table(np.array([0.3])) - 3.09)[0]) < 1e-3
    (17, True)
    """
    soc = np.unique(np.round(np.clip([0.0, 1.0, *breakpoints], 0, 1), DIGITS_SOC))
    for _ in range(MOST_HALVINGS):
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
    return Table(soc, np.round(curve(soc), DIGITS_V))


def segment_table(hysteresis: SegmentedHysteresis) -> Table:
    """W(soc) at the ends of its segments, a step at a knot as two points close together."""
    soc, voltage_v = [], []
    for index, (left_v, right_v) in enumerate(hysteresis.ends_v):
        if not voltage_v or left_v != voltage_v[-1]:
            if voltage_v:
                soc[-1] -= STEP_SOC
            soc.append(float(KNOTS[index]))
            voltage_v.append(left_v)
        soc.append(float(KNOTS[index + 1]))
        voltage_v.append(right_v)
    return Table(np.round(soc, DIGITS_SOC), np.array(voltage_v))


def _sources_v(circuit: Circuit, cell: CellModel, soc: Values) -> tuple[Values, Values]:
    """The source after charging and after discharging."""
    after_charge_v, after_discharge_v = (
        circuit.source_voltage(cell, soc, direction * np.ones_like(soc)) for direction in (1, -1)
    )
    return after_charge_v, after_discharge_v


def _kind_of(circuit: Circuit, cell: CellModel) -> Hysteresis:
    if circuit.has_rate:
        return "dynamic"
    after_charge_v, after_discharge_v = _sources_v(circuit, cell, EVERYWHERE)
    return "none" if np.array_equal(after_charge_v, after_discharge_v) else "instant"


def _hysteresis(circuit: Circuit, cell: CellModel, breakpoints: Values) -> Table:
    """W(soc): the cell's segments, or what a circuit makes of its own."""

    def between_v(soc: Values) -> Values:
        after_charge_v, after_discharge_v = _sources_v(circuit, cell, soc)
        return after_charge_v - after_discharge_v

    if circuit.has_rate or np.allclose(
        between_v(EVERYWHERE), cell.hysteresis_v(EVERYWHERE), rtol=0, atol=TOLERANCE_V
    ):
        return segment_table(cell.hysteresis)
    return linear_table(between_v, breakpoints)
