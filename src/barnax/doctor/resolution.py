"""What the tester resolves, where that is coarse, and temperatures that nobody measured."""

from collections.abc import Iterator

import numpy as np

from .case import Case
from .finding import Finding

_COARSE_V, _COARSE_SHARE = 0.9e-3, 5e-3
_TEMPERATURE_DEGC = (-60.0, 120.0)


def find_resolution(case: Case) -> Iterator[Finding]:
    """Readings so coarse that they show in the results."""
    magnitude_a = np.abs(case.record.current_a)
    loaded_a = float(np.median(magnitude_a[magnitude_a > 0.05 * case.peak_a]))
    share = case.resolution_a / loaded_a
    if case.resolution_v < _COARSE_V and share < _COARSE_SHARE:
        return
    yield Finding(
        "note",
        f"coarse readings: voltage in steps of {1e3 * case.resolution_v:.2g} mV, current in steps "
        f"of {1e3 * case.resolution_a:.2g} mA ({100 * share:.2g} % of the usual load)",
        "no fit can be better than its readings",
    )


def find_temperature(case: Case) -> Iterator[Finding]:
    """Temperatures that no cell has."""
    temperature = case.record.temperature_degc
    if temperature is None:
        return
    low, high = _TEMPERATURE_DEGC
    outside = (temperature < low) | (temperature > high)
    if outside.any():
        first = int(np.argmax(outside))
        yield case.at(
            first,
            "warning",
            f"a temperature of {temperature[first]:.4g} degC ({int(outside.sum())} samples outside "
            f"{low:g} to {high:g} degC)",
            "check the sensor, or delete the column",
        )
