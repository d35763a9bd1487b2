"""Results made by hand, whose every number a test knows."""

import numpy as np

from barnax.cell import CellModel, InterpolatedCurve, OcvPoint, SegmentedHysteresis
from barnax.model.inputs import Window
from barnax.results import MetricsBlock, MetricsPart, Result

CAPACITY_AH = 2.0
PAIRS = ((0.0123, 812.5), (0.0211, 4321.0), (0.0075, 60000.0), (0.004, 1e6))
PAIRS_OF = {"so-rc": 2, "iso-rc": 2, "esc": 2, "1rc": 1, "3rc": 3, "4rc": 4}
CIRCUITS = tuple(PAIRS_OF)
GAMMA = 87.25


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


def make_result(
    model: str = "iso-rc",
    initial_soc: float = 0.9,
    record: str = "cycle.csv",
    hysteresis_fit: str = "continuous",
    initial_direction: int | None = 1,
    rest_current_a: float | None = 0.035,
) -> Result:
    """A result of this circuit, with what an export reads of it."""
    parameters = {"R0 [Ohm]": 0.0511}
    for pair, (r, c) in enumerate(PAIRS[: PAIRS_OF[model]], start=1):
        parameters |= {f"R{pair} [Ohm]": r, f"C{pair} [F]": c}
    if model == "esc":
        parameters["gamma"] = GAMMA
    metrics = MetricsPart.model_construct(record=record, rmse_v=0.0232)
    return Result.model_construct(
        model=model,
        parameters=parameters,
        cell=make_cell(hysteresis_fit).to_dict(),
        metrics=MetricsBlock.model_construct(identification=metrics, validation=()),
        window=Window(initial_direction=1),
        initial_soc=initial_soc,
        initial_direction=initial_direction,
        rest_current_a=rest_current_a,
        versions={"barnax": "0.1.0"},
    )
