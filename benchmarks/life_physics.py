"""Cells that age by a physical model, for `benchmarks.life`: PyBaMM's SPMe with a growing SEI and
loss of active material. What ages them is made faster, so that years pass in some tens of cycles.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

VALUES, NOMINAL_AH, FULL_V, EMPTY_V = "OKane2022", 5.0, 4.2, 2.5
STEP_S, SAMPLES, NOISE_V = 5.0, 2000, 1e-3
# Steps of the current take so long.
EDGE_S = 0.02
BLOCKS, CYCLES = 5, 18
# By how much the solvent diffuses faster, and active material of both electrodes goes.
MODES = {
    "SEI": (2500.0, 1.0, 1.0),
    "SEI, negative electrode": (700.0, 200.0, 1.0),
    "SEI, positive electrode": (700.0, 1.0, 300.0),
    "SEI, both electrodes": (1500.0, 120.0, 150.0),
}
FASTER = {
    "SEI solvent diffusivity [m2.s-1]": 0,
    "Negative electrode LAM constant proportional term [s-1]": 1,
    "Positive electrode LAM constant proportional term [s-1]": 2,
}


@dataclass(frozen=True)
class Aged:
    """A cell at one age: its capacity at C/20, R0 at 50 % SOC, and a drive from full."""

    capacity_ah: float
    r0_ohm: float
    drive: dict[str, np.ndarray]


def drive_a(seed: int, charge_ah: float) -> np.ndarray:
    """Levels of 5 to 200 s, mostly discharging, that go so far down at the lowest."""
    draw = np.random.default_rng(seed)
    heights = np.minimum(draw.gamma(0.8, 1.0, SAMPLES), 1.0) * draw.choice(
        [1, 1, 1, -0.6, 0], SAMPLES
    )
    current_a = np.repeat(heights, draw.integers(1, 40, SAMPLES))[:SAMPLES]
    current_a[: SAMPLES // 6] = np.abs(current_a[: SAMPLES // 6])
    current_a[:12] = 0.0
    return current_a * charge_ah / (np.cumsum(current_a).max() * STEP_S / 3600)


class PhysicalCell:
    """A cell in PyBaMM that goes from step to step."""

    def __init__(self, faster: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> None:
        import pybamm

        pybamm.set_logging_level("ERROR")
        self.model = pybamm.lithium_ion.SPMe(
            {
                "SEI": "solvent-diffusion limited",
                "particle mechanics": "swelling only",
                "loss of active material": "stress-driven",
            }
        )
        self.values = pybamm.ParameterValues(VALUES)
        self.values.update({name: self.values[name] * faster[at] for name, at in FASTER.items()})
        self.last: Any = None
        self.run(*self.filling)

    @property
    def filling(self) -> tuple[str, ...]:
        return (
            f"Charge at C/3 until {FULL_V} V",
            f"Hold at {FULL_V} V until C/50",
            "Rest for 1 hour",
        )

    def run(self, *steps: Any, period: str = "60 seconds") -> list[Any]:
        """The solutions of some steps."""
        import pybamm

        experiment = pybamm.Experiment([tuple(steps)], period=period)
        made = pybamm.Simulation(self.model, parameter_values=self.values, experiment=experiment)
        self.last = made.solve(starting_solution=self.last and self.last.last_state)
        return self.last.cycles[-1].steps

    def driven(self, seed: int, charge_ah: float) -> dict[str, np.ndarray]:
        """A drive, each level of which holds until the next sample."""
        import pybamm

        current_a = drive_a(seed, charge_ah)
        time_s = STEP_S * np.arange(SAMPLES)
        edges_s = np.stack([time_s, time_s + STEP_S - EDGE_S], axis=1).ravel()
        profile = np.column_stack([edges_s, np.repeat(current_a, 2)])
        step = pybamm.step.current(profile, duration=time_s[-1] + 1.0, period=STEP_S)
        (found,) = self.run(step)
        shown_s = found["Time [s]"].entries - found["Time [s]"].entries[0]
        places = np.searchsorted(shown_s, time_s - 1e-3)
        assert np.allclose(shown_s[places], time_s, atol=1e-3)
        assert np.allclose(found["Current [A]"].entries[places], current_a, atol=1e-3)
        noise_v = NOISE_V * np.random.default_rng([seed, 1]).standard_normal(SAMPLES)
        return {
            "Time [s]": time_s,
            "Current [A]": -current_a,
            "Voltage [V]": found["Voltage [V]"].entries[places] + noise_v,
        }

    def checked(self, seed: int, depth: float | None = None) -> Aged:
        """What is true of it now, and a drive."""
        slow = self.run(f"Discharge at C/20 until {EMPTY_V} V", "Rest for 1 hour", *self.filling)[0]
        capacity_ah = float(np.ptp(slow["Discharge capacity [A.h]"].entries))
        half = f"Discharge at {NOMINAL_AH / 3} A for {0.5 * capacity_ah / (NOMINAL_AH / 3)} hours"
        *_, rest, pulse = self.run(
            half, "Rest for 2 hours", f"Discharge at {NOMINAL_AH} A for 10 seconds"
        )
        dropped_v = rest["Voltage [V]"].entries[-1] - pulse["Voltage [V]"].entries[0]
        self.run(*self.filling)
        share = depth or float(np.random.default_rng([seed, 2]).uniform(0.6, 0.75))
        drive = self.driven(seed, share * capacity_ah)
        self.run(*self.filling)
        return Aged(capacity_ah, float(dropped_v / NOMINAL_AH), drive)

    def cycled(self, cycles: int) -> None:
        """The same, so many full cycles later."""
        for _ in range(cycles):
            self.run(f"Discharge at 1C until {EMPTY_V} V", *self.filling)


def ageing(number: int) -> Iterator[Aged]:
    """A cell at every age. Those of one mode age at rates of their own."""
    faster = list(MODES.values())[number % len(MODES)]
    rate = 0.8 + 0.4 * (number // len(MODES))
    cell = PhysicalCell(tuple(rate * each if each > 1 else each for each in faster))
    for block in range(BLOCKS):
        if block:
            cell.cycled(CYCLES)
        yield cell.checked(100 * number + block)
