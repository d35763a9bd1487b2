"""Records, evaluations, searches and results made by hand, whose every number a test knows."""

from dataclasses import replace
from typing import Any, Literal

import numpy as np

from barnax import Evaluation, Record, Result, TableFit, TableSettings, Window
from barnax.cell import (
    CellModel,
    CircuitParameters,
    InterpolatedCurve,
    OcvPoint,
    SegmentedHysteresis,
    get_circuit,
)
from barnax.fit.cross_validation import SocErrors
from barnax.fit.node_interval import NodeInterval
from barnax.fit.temperature_fits import TableFits
from barnax.metrics import Metrics
from barnax.model.prepared import PreparedRecord
from barnax.model.start import Start
from barnax.result_parts import ConstantPart, InputPart, MetricsBlock
from barnax.uncertainty import Assessment, Band, Diagnostics, Identifiability, Uncertainty
from barnax.uncertainty.covariance import NoiseParts
from helpers.reference import make_record as record_of

CIRCUIT = CircuitParameters.constant(r0=0.05, r=(0.01, 0.02), c=(1000.0, 5000.0))
CAPACITY_AH = 2.0
PAIRS = ((0.0123, 812.5), (0.0211, 4321.0), (0.0075, 60000.0), (0.004, 1e6))
PAIRS_OF = {"so-rc": 2, "iso-rc": 2, "esc": 2, "1rc": 1, "3rc": 3, "4rc": 4, "takacs": 2}
# Those with a dynamic hysteresis.
WITH_GAMMA = ("esc",)
# Those that curves over SOC say whole.
CIRCUITS = tuple(name for name in PAIRS_OF if get_circuit(name).hysteresis.kind != "loops")
GAMMA = 87.25


def line(axes, label: str):
    """The one line of that label in a panel of a figure."""
    (actual,) = [each for each in axes.get_lines() if each.get_label() == label]
    return actual


def labels(axes) -> list[str]:
    """What a panel of a figure has in its legend."""
    return axes.get_legend_handles_labels()[1]


def make_record(samples: int, interval_s: float = 1.0, name: str = "cycle.csv") -> Record:
    """A repeated square wave of current, and a voltage that falls with ripple."""
    number = np.arange(samples)
    current_a = np.where(number % 20 < 10, 2.0, -1.0)
    voltage_v = 4.0 - 0.5 * number / samples - 0.05 * current_a
    return record_of(1000.0 + interval_s * number, current_a, voltage_v, name=name)


def make_evaluation(
    record: Record, scored: np.ndarray | None = None, error_v: np.ndarray | None = None
) -> Evaluation:
    """An evaluation of all samples of `record`, off by `error_v` (a slow wave by default)."""
    number = np.arange(record.samples)
    scored = np.ones(record.samples, bool) if scored is None else scored
    error_v = 5e-3 * np.sin(number / 50) if error_v is None else error_v
    prepared = PreparedRecord(
        record=record,
        cell=make_cell(),
        circuit="so-rc",
        window=Window(),
        start=Start(1.0, "given", -1, "given", row=2, voltage_v=float(record.voltage_v[0])),
        first=0,
        soc=1.0 - number / record.samples,
        direction=np.full(record.samples, -1.0),
        source_v=record.voltage_v,
        hysteresis_amplitude_v=None,
        scored=scored,
        rest_current_a=0.02,
        capacity_ah=CAPACITY_AH,
        warnings=(),
    )
    simulated_v = record.voltage_v - error_v
    return Evaluation(prepared, simulated_v)


def ocv_v(soc: np.ndarray) -> np.ndarray:
    """An average OCV with a knee at low SOC."""
    return 3.2 + 0.9 * soc - 0.4 * np.exp(-30 * soc)


def make_cell(hysteresis_fit: str = "continuous") -> CellModel:
    """A cell with a measured gap of 10 mV to 40 mV, more of it at low SOC."""
    soc = np.linspace(0.0, 1.0, 21)
    gap_v = 0.01 + 0.03 * (1 - soc) ** 2
    charge_v, discharge_v = ocv_v(soc) + gap_v / 2, ocv_v(soc) - gap_v / 2

    def points(voltage_v: np.ndarray) -> tuple[OcvPoint, ...]:
        return tuple(
            OcvPoint(soc=float(s), voltage_v=float(v), source="made so", row=2, rest_s=7200.0)
            for s, v in zip(soc, voltage_v, strict=True)
        )

    return CellModel(
        capacity_ah=CAPACITY_AH,
        capacity_origin="given",
        charge=InterpolatedCurve.fit(soc, charge_v),
        discharge=InterpolatedCurve.fit(soc, discharge_v),
        hysteresis=SegmentedHysteresis.fit(soc, gap_v, hysteresis_fit),
        charge_points=points(charge_v),
        discharge_points=points(discharge_v),
        errors={},
    )


def metrics_of(record: str, rmse_v: float) -> Metrics:
    """Errors of which the RMSE alone is asked for."""
    others = dict.fromkeys(("r2", "r2_paper", "mape_percent", "ce_v", "max_v"), 0.0)
    return Metrics(record=record, rmse_v=rmse_v, samples=0, **others)


def make_result(
    model: str = "iso-rc",
    initial_soc: float = 0.9,
    record: str = "cycle.csv",
    hysteresis_fit: str = "continuous",
    initial_direction: Literal[-1, 1] = 1,
    rest_current_a: float | None = 0.035,
    capacity_ah: float | None = None,
) -> Result:
    """A result of this circuit, with what an export reads of it; `capacity_ah` is the record's."""
    parameters = {"R0 [Ohm]": 0.0511}
    for pair, (r, c) in enumerate(PAIRS[: PAIRS_OF[model]], start=1):
        parameters |= {f"R{pair} [Ohm]": r, f"C{pair} [F]": c}
    if model in WITH_GAMMA:
        parameters["gamma"] = GAMMA
    metrics = metrics_of(record=record, rmse_v=0.0232)
    bands = tuple(Band(low, low + 0.1, 9, 0.02, 0.0, 0.1) for low in (0.1, 0.4, 0.8))
    noise = NoiseParts((0.0, 25.0, 700.0), (0.002, 0.015, 0.018))
    assessment = Assessment(
        uncertainty=Uncertainty(0.95, 99, (), (), (), noise),
        identifiability=Identifiability(()),
        diagnostics=Diagnostics((), (), 100.0, 9.0, 99, bands, (), None),
    )
    given = Start(initial_soc, "given", initial_direction, "given", row=2, voltage_v=4.0)
    block = MetricsBlock.model_construct(identification=metrics, validation=())
    constant = ConstantPart.model_construct(
        at_bound=(),
        model=model,
        parameters=CircuitParameters.from_dict(parameters),
        metrics=block,
        assessment=assessment,
        bounds={},
        fixed={},
    )
    return Result.model_construct(
        model=model,
        metrics=block,
        warnings=(),
        constant=constant,
        cell=make_cell(hysteresis_fit),
        inputs=(
            InputPart(
                role="identification",
                name=record,
                sha256="",
                start=given,
                rest_current_a=rest_current_a,
                capacity_ah=capacity_ah,
            ),
        ),
        versions={"barnax": "0.1.0"},
    )


# Steep below 20 % SOC, as cells are; the last is a resistance that the fit has at its bound.
NODES = (-0.05, 0.0, 0.1, 0.2, 0.5, 0.8, 1.0)
TABLE_OHM = (
    (0.09, 0.08, 0.06, 0.052, 0.05, 0.051, 0.053),
    (0.02, 0.018, 0.012, 0.011, 0.01, 0.0, 0.009),
    (0.05, 0.045, 0.03, 0.02, 0.018, 0.02, 0.021),
)
CORRECTION_V = (0.004, 0.003, -0.002, 0.001, 0.0, -0.001, 0.002)
TABLE_TAU_S = (9.0, 110.0)


def make_fit(circuit: str = "so-rc") -> TableFit:
    """Tables with the first two nodes near no sample, and intervals of the others."""
    visited = (False, False, *(5 * [True]))
    tables = CircuitParameters.over_soc(
        nodes=NODES,
        tau_s=TABLE_TAU_S,
        r0_ohm=TABLE_OHM[0],
        r_ohm=TABLE_OHM[1:],
        ocv_correction_v=CORRECTION_V,
        gamma=GAMMA if circuit in WITH_GAMMA else None,
        visited=visited,
    )
    intervals = tuple(
        NodeInterval(name, soc, value, 1e-3, 1e-4, value - 2e-3, value + 2e-3)
        for name, values in tables.tables.items()
        for soc, value, is_visited in zip(NODES, values, visited, strict=True)
        if is_visited
    )
    # By trapezoids over the nodes that samples visit, which are all above 10 %.
    means = tuple(
        NodeInterval(name, None, ohm, 1e-3, 0.0, max(ohm - 2e-3, 0.0), ohm + 2e-3)
        for name in tables.resistances
        for row in [tables.tables[name]]
        for ohm in [float(np.trapezoid(row[2:], NODES[2:]) / (NODES[-1] - NODES[2]))]
    )
    return TableFit(
        tables=tables,
        objective_v=5e-3,
        errors=(SocErrors(4.9e-3, 3e-3),),
        tau_ranges_s=((2.0, 1000.0), (2.0, 1000.0)),
        lower_bound_v=4.96e-3,
        status="certified",
        boxes=12,
        at_bound=(),
        parameters=22,
        intervals=intervals,
        cross_validation=None,
        warnings=(),
        means=means,
    )


def make_table_result(circuit: str = "so-rc", kept: slice = slice(None), **given: Any) -> Result:
    """The same with tables over SOC beside the constant circuit, with those of `NODES` kept."""
    metrics = metrics_of(record="cycle.csv", rmse_v=0.0049)
    fit = make_fit(circuit)
    tables = replace(
        fit.tables,
        nodes=NODES[kept],
        tables={name: row[kept] for name, row in fit.tables.tables.items()},
        visited=fit.tables.visited[kept],
    )
    part = TableFits((replace(fit, tables=tables),), settings=TableSettings(nodes=NODES))
    block = MetricsBlock.model_construct(identification=metrics, validation=())
    result = make_result(circuit, **given)
    return result.model_copy(update={"tables": part, "metrics": block})


def with_fit(result: Result, **changes: Any) -> Result:
    """The result with something else in each of its fits of tables."""
    fits = tuple(replace(fit, **changes) for fit in result.fits)
    return result.model_copy(update={"tables": replace(result.fits, fits=fits)})


def with_constant(result: Result, **update: Any) -> Result:
    """The result with something else in its constant circuit; its errors are the answer's too."""
    own = {"constant": result.constant.model_copy(update=update)}
    own |= {name: update[name] for name in ("metrics", "model") if name in update}
    return result.model_copy(update=own)
