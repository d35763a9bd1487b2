"""Whether the current is in the unit that its name says."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..records.checks import milliampere_reasons, throughput_ratio
from ..records.columns import Column
from ..records.samples import Samples
from .bulk_time import bulk_time_s, span_ah
from .case import STEP_SHARE, step_resistance_ohm
from .finding import Finding, found_at

# Charge against the given capacity, in favor of a factor of a thousand either way.
_TOO_MUCH, _TOO_LITTLE = 20.0, 0.01
_TRAVEL_V = 0.3
# No cell has less than a tenth of a milliohm; those that come near carry hundreds of amperes.
_LEAST_OHM, _HEAVY_A = 1e-4, 50.0


def examine_current_unit(
    samples: Samples, columns: Mapping[str, Column], capacity_ah: float | None
) -> tuple[Samples, list[Finding]]:
    """The samples with current in A, and whether its column's name was wrong."""
    name = columns["current"].header
    peak_a = float(np.abs(samples.current_a).max())
    if peak_a == 0:
        what = f"every current in '{name}' is zero: nothing can be learned from the record"
        remedy = "give the column that holds the measured current"
        return samples, [found_at(samples, 0, "error", what, remedy)]
    at = int(np.argmax(np.abs(samples.current_a)))
    reasons = milliampere_reasons(samples)
    if capacity_ah is not None and span_ah(samples) > _TOO_MUCH * capacity_ah:
        reasons.append(
            f"the record moves {span_ah(samples):.4g} Ah of a cell of {capacity_ah:.4g} Ah"
        )
    resistance_ohm = _resistance_ohm(samples)
    if 0 < resistance_ohm < _LEAST_OHM and peak_a > _HEAVY_A:
        reasons.append(f"the cell's resistance would be {1e6 * resistance_ohm:.3g} microohm")
    if reasons:
        what = f"'{name}' looks like milliamperes, not amperes: {'; '.join(reasons)}"
        finding = found_at(samples, at, "error", what, "rename the column to 'Current / mA'")
        return replace(samples, current_a=samples.current_a * 1e-3), [finding]
    reason = _amperes_reason(samples, capacity_ah)
    if reason and columns["current"].unit.factor == 1e-3:
        what = f"'{name}' looks like amperes, not milliamperes: {reason}"
        finding = found_at(samples, at, "error", what, "rename the column to 'Current / A'")
        return replace(samples, current_a=samples.current_a * 1e3), [finding]
    return samples, []


def _amperes_reason(samples: Samples, capacity_ah: float | None) -> str:
    """Why the current is a thousand times too small, if it is."""
    ratio = throughput_ratio(samples)
    if ratio is not None:
        is_small = 1 / 5000 < ratio < 1 / 200
        return f"it integrates to 1/{1 / ratio:.4g} of the tester's Ah" if is_small else ""
    _, travel_v = bulk_time_s(samples)
    charge_ah = span_ah(samples)
    if capacity_ah is None or charge_ah > _TOO_LITTLE * capacity_ah or travel_v < _TRAVEL_V:
        return ""
    return (
        f"{charge_ah:.3g} of its {capacity_ah:.4g} Ah move the cell's voltage by {travel_v:.2g} V"
    )


def _resistance_ohm(samples: Samples) -> float:
    step_a, step_v = np.diff(samples.current_a), np.diff(samples.voltage_v)
    is_step = np.abs(step_a) > STEP_SHARE * np.abs(samples.current_a).max()
    return step_resistance_ohm(step_a[is_step], step_v[is_step])
