"""Single samples, or two or three, that leave their neighbors and come back."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from .case import Case
from .finding import Finding, counted

_WIDTHS = (1, 2, 3)
# A spike's height, in volts and in noise; how steady the three samples on either side must be, and
# how much of it the other channel may explain, as shares of the height.
_HEIGHT_V, _HEIGHT_NOISE, _BESIDE = 0.02, 12.0, 3
_STEADY, _EXPLAINED = 0.4, 0.3

Channel = Float[np.ndarray, "samples"]


def find_voltage_spikes(case: Case) -> Iterator[Finding]:
    """Voltages that leave the course of their neighbors, and no current says why."""
    spiked = voltage_spikes(case)
    if spiked.any():
        yield _finding(case, spiked, "voltage", case.record.voltage_v, "V")


def find_current_spikes(case: Case) -> Iterator[Finding]:
    """Currents that leave the course of their neighbors, and the voltage does not answer."""
    if not case.resistance_ohm:
        return
    ohmic_v = case.record.current_a * case.resistance_ohm
    spiked = _spikes(ohmic_v, _least_v(case), case.record.voltage_v)
    if spiked.any():
        yield _finding(case, spiked, "current", case.samples.current_a, "A")


def voltage_spikes(case: Case) -> Bool[np.ndarray, "samples"]:
    """Where the voltage spikes."""
    ohmic_v = case.record.current_a * case.resistance_ohm
    return _spikes(case.record.voltage_v + ohmic_v, _least_v(case), ohmic_v)


def _least_v(case: Case) -> float:
    return max(_HEIGHT_V, _HEIGHT_NOISE * case.noise_v)


def _finding(
    case: Case, spiked: Bool[np.ndarray, "samples"], channel: str, values: Channel, unit: str
) -> Finding:
    at = int(np.argmax(spiked))
    beside = values[at - 1]
    which = counted(int(spiked.sum()), "sample")
    other = "no current explains it" if channel == "voltage" else "the voltage does not answer"
    return case.at(
        at,
        "warning",
        f"the {channel} spikes to {values[at]:.5g} {unit} beside {beside:.5g} {unit}, and {other} "
        f"({which})",
        "delete these rows, or correct them",
    )


def _spikes(values: Channel, least: float, other: Channel) -> Bool[np.ndarray, "samples"]:
    """Where `values` leave steady neighbors by `least` and come back, while `other` stays."""
    spiked = np.zeros(len(values), bool)
    for width in _WIDTHS:
        size = 2 * _BESIDE + width
        if len(values) < size:
            break
        # Only a jump can begin one; the windows of all samples would be slow.
        starts = np.flatnonzero(np.abs(np.diff(values)) > least) + 1
        starts = starts[(starts >= _BESIDE) & (starts + size - _BESIDE <= len(values))]
        window = starts[:, None] - _BESIDE + np.arange(size)
        around = values[window]
        inside = around[:, _BESIDE : _BESIDE + width]
        beside = np.delete(around, np.s_[_BESIDE : _BESIDE + width], axis=1)
        above = inside.min(axis=1) - beside.max(axis=1)
        below = beside.min(axis=1) - inside.max(axis=1)
        height = np.maximum(above, below)
        meanwhile = other[window[:, _BESIDE - 1 : _BESIDE + width + 1]]
        found = (
            (height > least)
            & (np.ptp(beside, axis=1) < _STEADY * height)
            & (np.ptp(meanwhile, axis=1) < _EXPLAINED * height)
        )
        spiked[window[found, _BESIDE : _BESIDE + width]] = True
    return spiked
