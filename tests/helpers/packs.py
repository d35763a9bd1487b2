"""Packs of known truth: cells in series under one drive, each with its own resistances, capacity
and start. Pairs are exact for a current that is constant between samples.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import polars as pl

from .reference import drop_v, filtered_response

TAU_S = (15.0, 150.0)


@dataclass(frozen=True)
class PackedCell:
    """What is true of one cell."""

    r0_ohm: float = 0.020
    r_ohm: tuple[float, ...] = (0.008, 0.012)
    capacity_ah: float = 5.0
    soc: float = 0.97
    tau_s: tuple[float, ...] = field(default=TAU_S)

    @property
    def circuit(self):
        return self.r0_ohm, self.r_ohm, self.tau_s

    @property
    def total_ohm(self) -> float:
        return self.r0_ohm + sum(self.r_ohm)


def ocv_v(soc):
    """An OCV like that of NMC."""
    return 3.35 + 0.75 * soc - 0.25 * np.exp(-soc / 0.06) + 0.06 * np.tanh((soc - 0.55) / 0.08)


def alike(count: int, seed: int = 0, spread: float = 0.01) -> list[PackedCell]:
    """Cells whose resistances and capacities scatter as those of a batch do."""
    rng = np.random.default_rng(seed)
    cell = PackedCell()
    return [
        replace(
            cell,
            r0_ohm=cell.r0_ohm * (1 + spread * rng.normal()),
            r_ohm=tuple(each * (1 + spread * rng.normal()) for each in cell.r_ohm),
            capacity_ah=cell.capacity_ah * (1 + spread / 3 * rng.normal()),
            soc=cell.soc + spread / 5 * rng.normal(),
        )
        for _ in range(count)
    ]


def drive_a(samples: int, mean_a: float = 3.0, seed: int = 1):
    """Levels of 5 to 40 s about a mean discharge, some of them charging, after a minute of rest."""
    rng = np.random.default_rng(seed)
    levels = np.repeat(rng.normal(mean_a, 5.0, samples), rng.integers(5, 40, samples))[:samples]
    levels[:60] = 0.0
    return levels


def simulated(cells, current_a, interval_s=1.0, noise_v=5e-4, seed=2):
    """The voltage of every cell, a column each; the current holds until the next sample."""
    rng = np.random.default_rng(seed)
    passed_ah = np.append(0.0, np.cumsum(current_a[:-1]) * interval_s / 3600)
    columns = []
    for cell in cells:
        drop = drop_v(filtered_response, interval_s, current_a, cell.circuit)
        voltage_v = ocv_v(cell.soc - passed_ah / cell.capacity_ah) - drop
        columns.append(voltage_v + noise_v * rng.normal(size=len(current_a)))
    return np.stack(columns, axis=1)


def frame(voltages_v, current_a, interval_s=1.0, name="V{}"):
    """A table as a pack's logger writes it: time, current with discharge negative, cells."""
    time_s = interval_s * np.arange(len(current_a))
    cells = {name.format(k): column for k, column in enumerate(voltages_v.T, 1)}
    return pl.DataFrame({"Time [s]": time_s, "Current [A]": -current_a, **cells})


def ocv_table():
    """The OCV over SOC, as a table."""
    soc = np.linspace(0.0, 1.0, 101)
    return pl.DataFrame({"SOC [-]": soc, "OCV [V]": ocv_v(soc)})
