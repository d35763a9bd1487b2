"""A cell of which everything is known: its OCV, its circuit, and drives from any start."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from barnax.cell import CellModel, OcvPoint, OcvTable, characterize
from helpers.problems import drive_a
from helpers.reference import drop_v, filtered_response, make_record

R0_OHM, R_OHM, TAU_S = 0.05, (0.02, 0.03), (12.0, 150.0)
SAMPLES = 6000
# Enough for resistances that are the same at every SOC; of all nodes a fit takes twice as long.
FEW_NODES = (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
# Tables of two pairs as fast as they are fitted.
SMALL = {"model": "so-rc", "over": "soc", "seeds": 0, "trust": "none", "max_boxes": 0}


def ocv_v(soc):
    return 3.3 + 0.7 * soc + 0.15 * np.tanh((soc - 0.05) / 0.06) + 0.08 * soc**6


def cell_with_ocv(
    capacity_ah: float = 2.0,
    half_gap_v: float | None = None,
    curve: Callable[[np.ndarray], np.ndarray] = ocv_v,
    points: int = 101,
    swept_a: float = 0.0,
) -> CellModel:
    """The cell as an OCV test at so many points shows it: one curve, or branches so far from it in
    V that were swept by a current."""
    soc = np.linspace(0.0, 1.0, points)
    branches = {
        side: tuple(
            OcvPoint(*pair, "test", 1, 0.0, current_a=-side * swept_a)
            for pair in zip(soc, curve(soc) + side * (half_gap_v or 0.0), strict=True)
        )
        for side in ((0,) if half_gap_v is None else (-1, 1))
    }
    table = OcvTable("test", branches, "")
    return characterize([table], capacity_ah=capacity_ah, ocv_fit="interpolated")


def made(
    seed=0,
    start=1.0,
    hours=2.5,
    noise_v=2e-4,
    charge=False,
    capacity_ah=2.0,
    scale=1.0,
    driven=None,
):
    """A drive from `start` on a cell of 2 Ah that everything is known of, first charged to full
    by a held voltage where `charge`; its current is `scale` times the usual. Of times and currents
    `driven` gives the temperature, if it is measured, and the currents that flow through R0 and
    through the pairs."""
    interval_s = 3600 * hours / SAMPLES
    current_a = scale * 0.7 * drive_a(SAMPLES, seed=seed, interval=20)
    if charge:
        taper_a = -np.concatenate([np.full(400, 0.8), 0.8 * np.exp(-np.arange(600) / 180)])
        current_a = np.concatenate([taper_a, np.zeros(300), current_a])
    time_s = interval_s * np.arange(len(current_a))
    out_ah = np.append(0.0, np.cumsum(current_a[:-1] * interval_s)) / 3600
    at = 1300 if charge else 0
    soc = start - (out_ah - out_ah[at]) / capacity_ah

    degc, ohmic_a, through_a = None, current_a, current_a
    if driven is not None:
        degc, ohmic_a, through_a = driven(time_s, current_a)
    voltage_v = ocv_v(soc) - R0_OHM * ohmic_a
    voltage_v -= drop_v(filtered_response, interval_s, through_a, (0.0, R_OHM, TAU_S))
    if charge:
        held = np.arange(len(soc)) < 1000
        voltage_v = np.where(held, 4.25, voltage_v)
    voltage_v += noise_v * np.random.default_rng(seed).standard_normal(len(soc))
    record = make_record(time_s, current_a, voltage_v, name=f"made{seed}.csv")
    return replace(record, temperature_degc=degc), soc
