"""Whether a voltage can be one cell's, in volts."""

from dataclasses import replace

import numpy as np

from ..records.checks import CELL_RANGE_V, MILLIVOLT_V, MODULE_V
from ..records.samples import Samples
from .finding import Finding, counted, found_at

# A cell's volts divided by a thousand once too often.
_KILOVOLT_V = 0.01
# What cells in series are counted by.
_NOMINAL_V = 3.6


def examine_voltage(samples: Samples) -> tuple[Samples, list[Finding]]:
    """The samples with a voltage that can be one cell's, and what was wrong with it."""
    name = samples.names["voltage"]
    middle_v = float(np.median(samples.voltage_v))
    findings = []
    if middle_v < 0:
        what = f"the voltage in '{name}' is negative, {middle_v:.6g} V in the middle"
        remedy = "turn its sign (the sense leads were swapped), or give the right column"
        findings.append(_of_column(samples, what, remedy))
        samples, middle_v = _scaled(samples, -1.0), -middle_v
    if middle_v > MILLIVOLT_V:
        what = f"the voltage in '{name}' is {middle_v:.6g} in the middle: millivolts, not volts"
        findings.append(_of_column(samples, what, "rename the column to 'Voltage / mV'"))
        samples = _scaled(samples, 1e-3)
    elif middle_v > MODULE_V:
        cells = max(2, round(middle_v / _NOMINAL_V))
        what = (
            f"the voltage in '{name}' is {middle_v:.6g} V in the middle, too much for one cell: "
            f"about {cells} in series"
        )
        findings.append(_of_column(samples, what, "give the voltage of one cell"))
        samples = _scaled(samples, 1 / cells)
    elif 0 < middle_v < _KILOVOLT_V:
        what = f"the voltage in '{name}' is {middle_v:.4g} V in the middle: kilovolts, not volts"
        remedy = "multiply it by 1000, or name the unit that its values have"
        findings.append(_of_column(samples, what, remedy))
        samples = _scaled(samples, 1e3)
    return _within_a_cell(samples, findings)


def _within_a_cell(samples: Samples, findings: list[Finding]) -> tuple[Samples, list[Finding]]:
    voltage, name = samples.voltage_v, samples.names["voltage"]
    low_v, high_v = CELL_RANGE_V
    outside = (voltage < low_v) | (voltage > high_v)
    if not outside.any():
        return samples, findings
    impossible = np.abs(voltage) > MILLIVOLT_V
    first = int(np.argmax(impossible if impossible.any() else outside))
    what = (
        f"{voltage[first]:.6g} V in '{name}' is no cell's voltage "
        f"({counted(int(outside.sum()), 'sample')} outside {low_v} to {high_v} V)"
    )
    severity = "error" if impossible.any() else "warning"
    remedy = "correct or delete these rows; --score-from and --score-to leave out an end"
    if outside.mean() > 0.5:
        remedy = "give the column of the cell's voltage, in volts"
    findings = [*findings, found_at(samples, first, severity, what, remedy)]
    # Where nearly all is outside, the rest shows nothing either.
    return (samples if outside.mean() > 0.5 else samples.keep(~outside)), findings


def _of_column(samples: Samples, what: str, remedy: str) -> Finding:
    return found_at(samples, 0, "error", what, remedy)


def _scaled(samples: Samples, factor: float) -> Samples:
    return replace(samples, voltage_v=samples.voltage_v * factor)
